"""The short text of a comparison of trackers: a verdict, paired differences, coverage."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from opir_core.cli import table
from opir_scoring.figure_text import figure_rows, interval_text, number_text
from opir_scoring.paired import DECIDING
from opir_scoring.scorecard_tables import runs_text
from opir_scoring.scorecards import Scorecard

#: Phases of a flight at which energy scores of impacts are printed; the others are in the figures.
_PHASES = ("50 % of burn", "95 % of burn", "20 s after burnout")

LEGEND = """\
Common: at the ticks, launches and phases that all trackers estimate. E: energy score, less is better. In brackets:
paired difference to the best and its 95 % interval; *: it excludes 0. (%): share of launches that a figure is of, where
it is not of all; n: tracks. --details: all scores; --json: all figures."""


def comparison_text(paired: Mapping[str, Any], cards: Mapping[str, Scorecard]) -> str:
    """Return the verdict, then the figures of what all trackers estimate, by time too, then those
    of each by itself.
    """
    figures = {name: card.figures for name, card in cards.items()}
    texts = [runs_text(next(iter(figures.values()))), verdict(paired, figures)]
    if len(cards) > 1 and paired["common_ticks"]:
        texts += [_common(paired, list(cards)), _by_time(paired, list(cards))]
    return "\n\n".join([*texts, _by_itself(figures), LEGEND])


def verdict(paired: Mapping[str, Any], figures: Mapping[str, Mapping[str, Any]]) -> str:
    """Return in sentences which tracker is the best by the energy score of position, and how
    certain that is.
    """
    best = paired["best"]
    rivals = [name for name in paired["compared"] if name != best]
    lines = [
        f"{name} never estimates a state while the truth is known."
        for name in paired["without_estimates"]
    ]
    if best is None:
        return "\n".join(["No verdict: there is no tick that all trackers estimate.", *lines])
    if not rivals:
        return "\n".join([f"{best}: nothing to compare it with.", *lines])
    certain = paired["certain"]
    uncertain = [name for name in rivals if name not in certain]
    if certain and uncertain:
        lines.append(f"It is not certain to be better than {' or '.join(uncertain)}.")
    coverage = {name: figures[name]["completeness"]["value"] for name in paired["compared"]}
    lines += [*_exceptions(paired), *_coverage(best, coverage)]
    return "\n".join([_best(paired, [best, *rivals]), *lines])


def _best(paired: Mapping[str, Any], names: Sequence[str]) -> str:
    """Return a sentence on the best tracker, the first of the names, with the scores of all."""
    errors = paired["states"][DECIDING.name]["errors"]
    scores = ", ".join(f"{name} {_short(errors[name])} m" for name in names)
    head = "No tracker is certain to be the best"
    if paired["certain"]:
        head = f"Best on the {paired['common_ticks']} ticks that all have: {names[0]}"
    return f"{head} (energy score of position: {scores})."


def _exceptions(paired: Mapping[str, Any]) -> list[str]:
    """Return sentences on the times at which the best tracker is certain to be worse than
    another.
    """
    times: dict[str, list[str]] = {}
    for bin_ in paired["by_time"]:
        energies = bin_[DECIDING.name]
        winner = energies["best"]
        start_s, end_s = bin_["since_ignition_s"]
        if (
            winner != paired["best"]
            and energies["differences"][paired["best"]]["interval_95"][0] > 0.0
        ):
            times.setdefault(winner, []).append(f"{start_s:g}-{end_s:g} s")
    return [f"{name} is better at {', '.join(bins)}." for name, bins in times.items()]


def _coverage(best: str, coverage: Mapping[str, float]) -> list[str]:
    """Return a sentence on the coverage of the best tracker, if it is less than that of another."""
    widest = max(coverage, key=lambda name: coverage[name])
    if not all(np.isfinite(list(coverage.values()))) or coverage[best] >= coverage[widest] - 0.02:
        return []
    words = f"covers {coverage[best]:.0%} of the ticks, {widest} {coverage[widest]:.0%}"
    return [f"{best} {words}: the verdict is of the common ones alone."]


def _common(paired: Mapping[str, Any], names: Sequence[str]) -> str:
    cells = [
        (label, *(_cell(errors, name, scale) for name in names))
        for label, errors, scale in _common_rows(paired)
        if errors["count"]
    ]
    nees = (number_text(paired["nees"].get(name, {"value": np.nan})["value"], 2) for name in names)
    return table((f"common ({paired['common_ticks']} ticks)", *names), [*cells, ("NEES/6", *nees)])


def _common_rows(paired: Mapping[str, Any]) -> list[tuple[str, Mapping[str, Any], float]]:
    """Return labels, paired errors and factors to the unit of the label."""
    states = paired["states"]
    rows = [
        ("E position, m", states["position_energy_m"], 1.0),
        ("RMSE position, m", states["position_m"], 1.0),
        ("E velocity, m/s", states["velocity_energy_m_s"], 1.0),
        ("RMSE velocity, m/s", states["velocity_m_s"], 1.0),
        (f"E launch point, m (n {paired['launch']['count']})", paired["launch"], 1.0),
    ]
    rows += [
        (f"E impact, km, {phase['phase']} (n {phase['count']})", phase, 1e-3)
        for phase in paired["impact_by_phase"]
        if phase["phase"] in _PHASES and phase["count"]
    ]
    return rows


def _by_time(paired: Mapping[str, Any], names: Sequence[str]) -> str:
    head = ("E position, m, at s (n)", *names)
    rows = []
    for bin_ in paired["by_time"]:
        errors = bin_[DECIDING.name]
        start_s, end_s = bin_["since_ignition_s"]
        label = f"{start_s:g}-{end_s:g} ({errors['count']})"
        rows.append((label, *(_cell(errors, name, 1.0) for name in names)))
    return table(head, rows)


def _cell(errors: Mapping[str, Any], name: str, scale: float) -> str:
    """Return a tracker's error, with the interval of its difference to the best; "-" without
    one.
    """
    if name not in errors["errors"]:
        return "-"
    text = _short(scale * errors["errors"][name])
    if name == errors["best"]:
        return text
    difference = errors["differences"][name]
    low, high = difference["interval_95"]
    if not np.isfinite(low):
        return text
    half = _short(scale * 0.5 * (high - low))
    mark = " *" if low > 0.0 else ""
    return f"{text} (+{_short(scale * difference['value'])} ± {half}){mark}"


def _short(value: float) -> str:
    """Return a number with three significant digits, thousands in full."""
    return f"{value:.0f}" if abs(value) >= 100.0 else f"{value:.3g}"


_BY_ITSELF = figure_rows(
    ("coverage, %", "completeness", 1, 100.0),
    ("launches tracked, %", "launches_tracked", 0, 100.0),
    ("first track after, s", "first_track_after_s", 2),
    ("false tracks per run", "false_tracks_a_run", 2),
    ("launches recognised, %", "recognition.launches_recognised", 0, 100.0),
    ("false launches per hour", "recognition.false_launches_an_hour", 2),
    ("type correct, %", "type_right", 0, 100.0),
)
_PACE = figure_rows(("time per track update, us", "tracking_us_a_track_update", 0))


def _by_itself(figures: Mapping[str, Mapping[str, Any]]) -> str:
    rows, pace = (
        [(row.label, *map(row.text, figures.values())) for row in group]
        for group in (_BY_ITSELF, _PACE)
    )
    last_ages = [own["hypotheses"]["by_age"][-1] for own in figures.values()]
    hypotheses = [
        (f"hypotheses: {label}", *(_of_tracks(age, name) for age in last_ages))
        for label, name in (("log score", "log_score"), ("Brier score", "brier"))
    ]
    return table(("each by itself", *figures), [*rows, *hypotheses, *pace])


def _of_tracks(scores: Mapping[str, Any], name: str) -> str:
    """Return a score of hypotheses with its number of tracks."""
    text = interval_text(scores[name], 3)
    return text if text == "-" else f"{text} (n {scores['tracks']})"
