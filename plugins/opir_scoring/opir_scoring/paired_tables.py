"""The short text of a comparison of trackers: a verdict, paired differences, coverage."""

from collections.abc import Callable, Mapping, Sequence
from typing import Any

import numpy as np

from opir_core.cli import table
from opir_scoring.figure_text import interval_text, number_text
from opir_scoring.paired import DECIDING
from opir_scoring.scorecard_tables import runs_text
from opir_scoring.scorecards import Scorecard

#: A coverage that is less by this is named in the verdict.
_LESS = 0.02

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
    parts = [runs_text(next(iter(figures.values()))), verdict(paired, figures)]
    if len(cards) > 1 and paired["common_ticks"]:
        parts += [_common(paired, list(cards)), _by_time(paired, list(cards))]
    return "\n\n".join([*parts, _each(figures), LEGEND])


def verdict(paired: Mapping[str, Any], figures: Mapping[str, Mapping[str, Any]]) -> str:
    """Return in sentences which tracker is the best by the energy score of position, and how
    certain that is.
    """
    best = paired["best"]
    others = [name for name in paired["compared"] if name != paired["best"]]
    lines = [
        f"{name} never estimates a state while the truth is known."
        for name in paired["without_estimates"]
    ]
    if best is None:
        return "\n".join(["No verdict: there is no tick that all trackers estimate.", *lines])
    if not others:
        return "\n".join([f"{best}: nothing to compare it with.", *lines])
    certain = paired["certain"]
    count = paired["common_ticks"]
    open_ = [name for name in others if name not in certain]
    errors = paired["states"][DECIDING.name]["errors"]
    scores = ", ".join(f"{name} {_short(errors[name])} m" for name in (best, *others))
    head = (
        f"Best on the {count} ticks that all have: {best}"
        if certain
        else "No tracker is certain to be the best"
    )
    lines.insert(0, f"{head} (energy score of position: {scores}).")
    if certain and open_:
        lines.append(f"It is not certain to be better than {' or '.join(open_)}.")
    lines += _elsewhere(paired)
    covered = {name: figures[name]["completeness"]["value"] for name in paired["compared"]}
    if all(np.isfinite(list(covered.values()))) and covered[best] < max(covered.values()) - _LESS:
        most = max(covered, key=lambda name: covered[name])
        words = f"covers {covered[best]:.0%} of the ticks, {most} {covered[most]:.0%}"
        lines.append(f"{best} {words}: the verdict is of the common ones alone.")
    return "\n".join(lines)


def _elsewhere(paired: Mapping[str, Any]) -> list[str]:
    """Return at which times the best tracker is certain to be worse than another."""
    found: dict[str, list[str]] = {}
    for part in paired["by_time"]:
        own = part[DECIDING.name]
        (start_s, end_s) = part["since_ignition_s"]
        if (
            own["best"] != paired["best"]
            and own["differences"][paired["best"]]["interval_95"][0] > 0.0
        ):
            found.setdefault(own["best"], []).append(f"{start_s:g}-{end_s:g} s")
    return [f"{name} is better at {', '.join(times)}." for name, times in found.items()]


def _common(paired: Mapping[str, Any], names: Sequence[str]) -> str:
    states = paired["states"]
    rows = [
        ("E position, m", states["position_energy_m"], 1.0),
        ("RMSE position, m", states["position_m"], 1.0),
        ("E velocity, m/s", states["velocity_energy_m_s"], 1.0),
        ("RMSE velocity, m/s", states["velocity_m_s"], 1.0),
        (f"E launch point, m (n {paired['launch']['count']})", paired["launch"], 1.0),
    ]
    rows += [
        (f"E impact, km, {part['phase']} (n {part['count']})", part, 1e-3)
        for part in paired["impact_by_phase"]
        if part["phase"] in _PHASES and part["count"]
    ]
    cells = [
        (label, *(_cell(own, name, scale) for name in names))
        for label, own, scale in rows
        if own["count"]
    ]
    nees = (number_text(paired["nees"].get(name, {"value": np.nan})["value"], 2) for name in names)
    return table((f"common ({paired['common_ticks']} ticks)", *names), [*cells, ("NEES/6", *nees)])


def _by_time(paired: Mapping[str, Any], names: Sequence[str]) -> str:
    head = ("E position, m, at s (n)", *names)
    rows = []
    for part in paired["by_time"]:
        own = part[DECIDING.name]
        (start_s, end_s) = part["since_ignition_s"]
        rows.append(
            (f"{start_s:g}-{end_s:g} ({own['count']})", *(_cell(own, name, 1.0) for name in names))
        )
    return table(head, rows)


def _cell(own: Mapping[str, Any], name: str, scale: float) -> str:
    """Return a tracker's error, with the interval of its difference to the best; "-" where it has
    none.
    """
    if name not in own["errors"]:
        return "-"
    text = _short(scale * own["errors"][name])
    if name == own["best"]:
        return text
    low, high = own["differences"][name]["interval_95"]
    if not np.isfinite(low):
        return text
    return (
        f"{text} (+{_short(scale * own['differences'][name]['value'])} ±"
        f" {_short(scale * 0.5 * (high - low))})" + (" *" if low > 0.0 else "")
    )


def _short(value: float) -> str:
    """Return a number with three significant digits, thousands in full."""
    return f"{value:.0f}" if abs(value) >= 100.0 else f"{value:.3g}"


def _of_tracks(part: Mapping[str, Any], name: str) -> str:
    """Return a score of hypotheses with the number of tracks that it is of."""
    text = interval_text(part[name], 3)
    return text if text == "-" else f"{text} (n {part['tracks']})"


def _each(figures: Mapping[str, Mapping[str, Any]]) -> str:
    rows: Sequence[tuple[str, Callable[[Mapping[str, Any]], str]]] = (
        ("coverage, %", lambda f: interval_text(f["completeness"], 1, 100.0)),
        ("launches tracked, %", lambda f: interval_text(f["launches_tracked"], 0, 100.0)),
        ("first track after, s", lambda f: interval_text(f["first_track_after_s"], 2)),
        ("false tracks per run", lambda f: interval_text(f["false_tracks_a_run"], 2)),
        (
            "launches recognised, %",
            lambda f: interval_text(f["recognition"]["launches_recognised"], 0, 100.0),
        ),
        (
            "false launches per hour",
            lambda f: interval_text(f["recognition"]["false_launches_an_hour"], 2),
        ),
        ("type correct, %", lambda f: interval_text(f["type_right"], 0, 100.0)),
        ("hypotheses: log score", lambda f: _of_tracks(f["hypotheses"]["by_age"][-1], "log_score")),
        ("hypotheses: Brier score", lambda f: _of_tracks(f["hypotheses"]["by_age"][-1], "brier")),
        ("time per track update, us", lambda f: interval_text(f["tracking_us_a_track_update"], 0)),
    )
    cells = [(label, *(text(own) for own in figures.values())) for label, text in rows]
    return table(("each by itself", *figures), cells)
