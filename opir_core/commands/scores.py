"""Scorecards as text, one column a tracker."""

import argparse
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from opir_core.commands.tables import table
from opir_core.errors import Problem, SceneError
from opir_core.scoring.scorecard import Scorecard, ScoreSettings

Cards = Mapping[str, Scorecard]


def settings_of(arguments: argparse.Namespace) -> ScoreSettings:
    """Return the settings that the arguments give; `SceneError` names those out of range."""
    problems = [
        Problem(flag, message)
        for flag, is_wrong, message in (
            ("--bin-s", not arguments.bin_s > 0.0, "must be positive"),
            ("--cutoff-m", not 0.0 < arguments.cutoff_m < math.inf, "must be positive and finite"),
            ("--order", not 1.0 <= arguments.order < math.inf, "must be at least 1 and finite"),
            ("--alpha", not 0.0 < arguments.alpha <= 2.0, "must be in (0, 2]"),
        )
        if is_wrong
    ]
    if problems:
        raise SceneError(problems, source="command line")
    return ScoreSettings(
        bin_s=arguments.bin_s, cutoff_m=arguments.cutoff_m, order=arguments.order, alpha=arguments.alpha
    )


def as_text(cards: Cards) -> str:
    """Return tables of the cards: the whole, then mono and stereo by time since ignition."""
    runs = next(iter(cards.values())).figures["runs"]
    bias = "biased" if next(iter(cards.values())).figures["sensors_biased"] else "unbiased"
    parts = [f"{runs} run{'s' if runs != 1 else ''} of each tracker, {bias} sensors; [95 % intervals]", _whole(cards)]
    parts += [part for geometry in ("mono", "stereo") if (part := _geometry(cards, geometry))]
    return "\n\n".join(parts)


def _whole(cards: Cards) -> str:
    rows: Sequence[tuple[str, Callable[[Mapping[str, Any]], str]]] = (
        ("launches tracked", lambda f: _interval(f["launches_tracked"], 3)),
        ("false tracks a run", lambda f: f"{f['false_tracks_a_run']:.3g}"),
        ("purity", lambda f: _interval(f["purity"], 4)),
        ("completeness", lambda f: _interval(f["completeness"], 3)),
        ("first track after, s", lambda f: _interval(f["first_track_after_s"], 2)),
        ("GOSPA a target, m", lambda f: _interval(f["gospa"]["a_target_m"], 0)),
        ("tracking, us a detection", lambda f: _number(f["tracking_us_a_detection"], 1)),
        ("type told right", lambda f: _right(f["type_confusion"])),
    )
    return table(("", *cards), [(label, *(told(card.figures) for card in cards.values())) for label, told in rows])


def _geometry(cards: Cards, geometry: str) -> str:
    rows = []
    for name, card in cards.items():
        figures = card.figures[geometry]
        rows += [(name, *_bin_cells(part)) for part in figures["by_time"]]
    if not rows:
        return ""
    head = ("tracker", "since s", "n", "position m", "/bound", "velocity m/s", "/bound", "NEES/6", "99 % band", "p")
    points = [(name, *_point_cells(card.figures[geometry])) for name, card in cards.items()]
    point_head = ("tracker", "launch m", "launch s", "impact m", "impact s", "in 50 %", "in 90 %", "in 95 %")
    return "\n\n".join([geometry, table(head, rows), table(point_head, points)])


def _bin_cells(part: Mapping[str, Any]) -> tuple[str, ...]:
    since, nees = part["since_ignition_s"], part["nees"]
    return (
        f"{since[0]:g}-{since[1]:g}",
        str(part["samples"]),
        _interval(part["position_m"], 0),
        _number(part["position_over_bound"], 2),
        _interval(part["velocity_m_s"], 1),
        _number(part["velocity_over_bound"], 2),
        _number(nees["mean"], 2),
        f"{_number(nees['band_99'][0], 2)}-{_number(nees['band_99'][1], 2)}",
        _number(nees["distribution_p"], 3),
    )


def _point_cells(figures: Mapping[str, Any]) -> tuple[str, ...]:
    contained = (_number(100.0 * part["value"], 1) + " %" for part in figures["impact_containment"])
    return (
        _interval(figures["launch_m"], 0),
        _interval(figures["launch_time_s"], 2),
        _interval(figures["impact_m"], 0),
        _interval(figures["impact_time_s"], 2),
        *contained,
    )


def _right(confusion: Mapping[str, Mapping[str, int]]) -> str:
    total = sum(sum(row.values()) for row in confusion.values())
    right = sum(row[true] for true, row in confusion.items())
    return f"{right} of {total}" if total else "-"


def _interval(figure: Mapping[str, Any], digits: int) -> str:
    low, high = figure["interval_95"]
    if not math.isfinite(figure["value"]):
        return "-"
    return f"{figure['value']:.{digits}f} [{_number(low, digits)}, {_number(high, digits)}]"


def _number(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if math.isfinite(value) else "-"
