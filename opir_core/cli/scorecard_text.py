"""Scorecards as text, one column a tracker."""

import argparse
import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from opir_core.cli.summary_text import table
from opir_core.errors import Problem, SceneError
from opir_core.scene.scene import REPORTED_TYPES, TARGET_TYPES
from opir_core.scoring.scorecard import GEOMETRIES, Scorecard, ScoreSettings

Cards = Mapping[str, Scorecard]

#: Powers of ten that leave room for sums in a double.
_LARGEST_POWER = 280.0


def settings_of(arguments: argparse.Namespace) -> ScoreSettings:
    """Return the settings that the arguments give; `SceneError` names those out of range."""
    problems = [
        Problem(flag, message)
        for flag, is_wrong, message in (
            ("--bin-s", not 0.01 <= arguments.bin_s < math.inf, "must be at least 0.01 and finite"),
            ("--cutoff-m", not 0.0 < arguments.cutoff_m < math.inf, "must be positive and finite"),
            ("--order", not 1.0 <= arguments.order < math.inf, "must be at least 1 and finite"),
            ("--alpha", not 0.0 < arguments.alpha <= 2.0, "must be in (0, 2]"),
            (
                "--order",
                _is_beyond(arguments.cutoff_m, arguments.order),
                "too large: no number holds the cut-off to it",
            ),
        )
        if is_wrong
    ]
    if problems:
        raise SceneError(problems, source="command line")
    return ScoreSettings(
        bin_s=arguments.bin_s, cutoff_m=arguments.cutoff_m, order=arguments.order, alpha=arguments.alpha
    )


def _is_beyond(cutoff_m: float, order: float) -> bool:
    """Return whether p-th powers of distances up to the cut-off, and their sums, would overflow, or come to nothing."""
    return 0.0 < cutoff_m < math.inf and 1.0 <= order < math.inf and abs(order * math.log10(cutoff_m)) > _LARGEST_POWER


def as_text(cards: Cards) -> str:
    """Return tables of the cards: the whole, then mono and stereo by time since ignition."""
    parts = [_heading(next(iter(cards.values())).figures), _whole(cards), _confusions(cards)]
    for geometry in GEOMETRIES:
        parts += _geometry(cards, geometry)
    return "\n\n".join(part for part in [*parts, LEGEND] if part)


LEGEND = """\
/known, /unknown: error over the Cramér-Rao bound with the thrust known, and unknown, where directions tell the place to
100 km. NEES/6, NIS/2: 1 is honest, more is too sure; p: of a Kolmogorov-Smirnov test against chi-squared. Launch and
impact are what was told last of each target, the shares those of the truths in the ellipses."""


def _heading(figures: Mapping[str, Any]) -> str:
    runs, seeds, gospa = figures["runs"], figures["seeds"], figures["gospa"]
    seeded = f"seed {seeds[0]}" if len(seeds) == 1 else f"seeds {seeds[0]} to {seeds[-1]}"
    bias = "with a bias" if figures["sensors_biased"] else "without bias"
    return (
        f"{runs} run{'s' if runs != 1 else ''} of each tracker ({seeded}), sensors {bias}; [95 % intervals];"
        f" GOSPA: c = {gospa['cutoff_m']:g} m, p = {gospa['order']:g}, alpha = {gospa['alpha']:g}"
    )


def _whole(cards: Cards) -> str:
    rows: Sequence[tuple[str, Callable[[Mapping[str, Any]], str]]] = (
        ("launches tracked", lambda f: _interval(f["launches_tracked"], 3)),
        ("tracks a launch", lambda f: _interval(f["tracks_a_launch"], 2)),
        ("false tracks a run", lambda f: _interval(f["false_tracks_a_run"], 2)),
        ("purity", lambda f: _interval(f["purity"], 4)),
        ("completeness", lambda f: _interval(f["completeness"], 3)),
        ("first track after, s", lambda f: _interval(f["first_track_after_s"], 2)),
        ("GOSPA a target, m", lambda f: _interval(f["gospa"]["a_target_m"], 0)),
        ("  located, missed, false", lambda f: _shares(f["gospa"])),
        ("type told right", lambda f: _interval(f["type_right"], 3)),
        ("time a detection, us", lambda f: _interval(f["tracking_us_a_detection"], 1)),
        ("time a track update, us", lambda f: _interval(f["tracking_us_a_track_update"], 0)),
    )
    return table(("", *cards), [(label, *(told(card.figures) for card in cards.values())) for label, told in rows])


def _confusions(cards: Cards) -> str:
    rows = [
        (true, name, *(str(row[told]) for told in REPORTED_TYPES))
        for true in TARGET_TYPES
        for name, card in cards.items()
        if (row := card.figures["type_confusion"].get(true))
    ]
    return table(("type", "tracker", *(f"told {told}" for told in REPORTED_TYPES)), rows) if rows else ""


def _geometry(cards: Cards, geometry: str) -> list[str]:
    """Return the tables of one geometry: errors and consistency by time, then of launch and impact."""
    binned = [
        (part["since_ignition_s"], name, part)
        for name, card in cards.items()
        for part in card.figures[geometry]["by_time"]
    ]
    if not binned:
        return []
    binned.sort(key=lambda row: row[0][0])
    over = ("/known", "/unknown")
    place = ("since s", "tracker", "n", "position m", *over, "impact km")
    speed = ("since s", "tracker", "n", "velocity m/s", *over)
    honest = ("since s", "tracker", "n", "NEES/6", "99 % band", "p", "n", "NIS/2", "99 % band", "p")
    label = [(f"{since[0]:g}-{since[1]:g}", name, part) for since, name, part in binned]
    figures = [(name, card.figures[geometry]) for name, card in cards.items()]
    title = geometry.replace("_biased", " by sensors of which some have a bias")
    points = ("tracker", "targets", "launch told", "impact told", "launch m", "launch s", "impact km", "impact s")
    nominal = [f"{100.0 * part['nominal']:g} %" for part in figures[0][1]["launch_containment"]]
    return [
        f"{title}, by time since ignition",
        table(place, [(since, name, *_place_cells(part)) for since, name, part in label]),
        table(speed, [(since, name, *_speed_cells(part)) for since, name, part in label]),
        table(honest, [(since, name, *_honest_cells(part)) for since, name, part in label]),
        f"{title}, launch and impact",
        table(points, [(name, *_point_cells(part)) for name, part in figures]),
        table(("% in the ellipse of", "tracker", *nominal), _curves(figures)),
    ]


def _place_cells(part: Mapping[str, Any]) -> tuple[str, ...]:
    return (
        str(part["samples"]),
        _interval(part["position_m"], 0),
        _interval(part["position_over_bound"], 2),
        _interval(part["position_over_free_bound"], 2),
        _interval(part["impact_m"], 1, 1e-3),
    )


def _speed_cells(part: Mapping[str, Any]) -> tuple[str, ...]:
    return (
        str(part["samples"]),
        _interval(part["velocity_m_s"], 1),
        _interval(part["velocity_over_bound"], 2),
        _interval(part["velocity_over_free_bound"], 2),
    )


def _honest_cells(part: Mapping[str, Any]) -> tuple[str, ...]:
    return tuple(cell for name in ("nees", "nis") for cell in _consistent_cells(part[name]))


def _consistent_cells(figure: Mapping[str, Any]) -> tuple[str, ...]:
    low, high = figure["band_99"]
    band = f"{_number(low, 2)}-{_number(high, 2)}" if figure["samples"] else "-"
    return str(figure["samples"]), _number(figure["mean"], 2), band, _number(figure["distribution_p"], 3)


def _point_cells(figures: Mapping[str, Any]) -> tuple[str, ...]:
    return (
        *(str(figures[name]) for name in ("targets", "launches_told", "impacts_told")),
        _interval(figures["launch_m"], 0),
        _interval(figures["launch_time_s"], 2),
        _interval(figures["impact_m"], 1, 1e-3),
        _interval(figures["impact_time_s"], 2),
    )


def _curves(figures: Sequence[tuple[str, Mapping[str, Any]]]) -> list[tuple[str, ...]]:
    return [
        (point, name, *(_interval(part, 0, 100.0) for part in told[f"{point}_containment"]))
        for point in ("launch", "impact")
        for name, told in figures
    ]


def _shares(gospa: Mapping[str, Any]) -> str:
    """Return what share of GOSPA's p-th power each part is."""
    parts = [gospa[f"{name}_a_target"]["value"] for name in ("localisation", "missed", "false")]
    total = sum(parts)
    return ", ".join(f"{100.0 * part / total:.0f} %" for part in parts) if total > 0.0 else "-"


def _interval(figure: Mapping[str, Any], digits: int, scale: float = 1.0) -> str:
    if not math.isfinite(figure["value"]):
        return "-"
    value = f"{scale * figure['value']:.{digits}f}"
    low, high = (scale * edge for edge in figure["interval_95"])
    # A single run, or track, has no interval.
    return f"{value} [{low:.{digits}f}, {high:.{digits}f}]" if math.isfinite(low) else value


def _number(value: float, digits: int) -> str:
    return f"{value:.{digits}f}" if math.isfinite(value) else "-"
