"""Tables of scorecards, as `opir score` and `opir compare` print them."""

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any

from opir_core.cli import table
from opir_core.plugin import REPORTED_TYPES
from opir_scoring.figure_text import interval_text, number_text
from opir_scoring.hypothesis_tables import hypothesis_tables
from opir_scoring.scorecards import GEOMETRIES, Scorecard, by_class

Cards = Mapping[str, Scorecard]


def scorecard_text(cards: Cards) -> str:
    """Return tables of scorecards: overall figures, then mono and stereo by time since ignition."""
    parts = [_heading(next(iter(cards.values())).figures), _overall(cards), _confusions(cards)]
    parts += hypothesis_tables({name: card.figures for name, card in cards.items()})
    for geometry in GEOMETRIES:
        parts += _geometry(cards, geometry)
    return "\n\n".join(part for part in [*parts, LEGEND] if part)


LEGEND = """\
/known, /unknown: error divided by the Cramér-Rao bound for known and for unknown thrust, where lines of sight
determine the position to 100 km.
(%): the share of launches, by time of ticks, that a figure is of, where it is not of all.
Energy: energy score of the stated position, velocity, launch point or impact, less is better; of a point, its error.
NEES/6, NIS/2: 1 is consistent, above 1 is overconfident; p: of a Kolmogorov-Smirnov test against chi-squared.
Launch and impact points: the last estimates of each target; containment: share of true points in the ellipses.
Impact regions: share of the n targets with a prediction, of true impacts in the regions of 50, 90 and 95 %, and their
median areas; without impact: predictions for targets in orbit. True condition: the regions for a burn that is over, or
goes on, as it was; Brier: of their probabilities; samples: median of the effective ones."""


def runs_text(figures: Mapping[str, Any]) -> str:
    """Return the number of runs, their seeds, and whether sensors have a pointing bias."""
    runs = figures["runs"]
    seeds = figures["seeds"]
    seeded = f"seed {seeds[0]}" if len(seeds) == 1 else f"seeds {seeds[0]} to {seeds[-1]}"
    bias = "with pointing bias" if figures["sensors_biased"] else "without pointing bias"
    return (
        f"{runs} run{'s' if runs != 1 else ''} of each tracker ({seeded}), sensors {bias}; [95 %"
        f" intervals]"
    )


def _heading(figures: Mapping[str, Any]) -> str:
    gospa = figures["gospa"]
    parameters = f"c = {gospa['cutoff_m']:g} m, p = {gospa['order']:g}, alpha = {gospa['alpha']:g}"
    return f"{runs_text(figures)}; GOSPA: {parameters}"


def _overall(cards: Cards) -> str:
    rows: Sequence[tuple[str, Callable[[Mapping[str, Any]], str]]] = (
        ("launches tracked", lambda f: interval_text(f["launches_tracked"], 3)),
        ("tracks per launch", lambda f: interval_text(f["tracks_a_launch"], 2)),
        ("false tracks per run", lambda f: interval_text(f["false_tracks_a_run"], 2)),
        ("purity", lambda f: interval_text(f["purity"], 4)),
        ("completeness", lambda f: interval_text(f["completeness"], 3)),
        ("first track after, s", lambda f: interval_text(f["first_track_after_s"], 2)),
        ("GOSPA per target, m", lambda f: interval_text(f["gospa"]["a_target_m"], 0)),
        ("  localisation, missed, false", lambda f: _shares(f["gospa"])),
        (
            "launches recognised",
            lambda f: interval_text(f["recognition"]["launches_recognised"], 3),
        ),
        (
            "P(launch) > 0.95 after, s",
            lambda f: number_text(f["recognition"]["median_sure_after_s"], 1),
        ),
        (
            "false launches per hour",
            lambda f: interval_text(f["recognition"]["false_launches_an_hour"], 2),
        ),
        ("type correct", lambda f: interval_text(f["type_right"], 3)),
        ("time per detection, us", lambda f: interval_text(f["tracking_us_a_detection"], 1)),
        ("time per track update, us", lambda f: interval_text(f["tracking_us_a_track_update"], 0)),
    )
    return table(
        ("", *cards),
        [(label, *(text(card.figures) for card in cards.values())) for label, text in rows],
    )


def _confusions(cards: Cards) -> str:
    rows = [
        (true, name, *(str(row[reported]) for reported in REPORTED_TYPES))
        for true in by_class(
            true for card in cards.values() for true in card.figures["type_confusion"]
        )
        for name, card in cards.items()
        if (row := card.figures["type_confusion"].get(true))
    ]
    return (
        table(("type", "tracker", *(f"reported {reported}" for reported in REPORTED_TYPES)), rows)
        if rows
        else ""
    )


def _geometry(cards: Cards, geometry: str) -> list[str]:
    """Return the tables of one geometry: errors and consistency by time, then of launch and
    impact.
    """
    binned = [
        (part["since_ignition_s"], name, part)
        for name, card in cards.items()
        for part in card.figures[geometry]["by_time"]
    ]
    figures = [(name, card.figures[geometry]) for name, card in cards.items()]
    title = geometry.replace("_biased", " with biased sensors")
    if not binned:
        return _phases(title, figures)
    binned.sort(key=lambda row: row[0][0])
    over = ("/known", "/unknown")
    place = ("time s", "tracker", "n", "position m", *over, "energy m", "impact km")
    speed = ("time s", "tracker", "n", "velocity m/s", *over, "energy m/s")
    consistency = (
        "time s",
        "tracker",
        "n",
        "NEES/6",
        "99 % band",
        "p",
        "n",
        "NIS/2",
        "99 % band",
        "p",
    )
    label = [(f"{since[0]:g}-{since[1]:g}", name, part) for since, name, part in binned]
    points: tuple[str, ...] = ("tracker", "targets", "launch points", "impact points")
    points += ("launch m", "energy m", "launch s", "impact km", "impact s")
    nominal = [f"{100.0 * part['nominal']:g} %" for part in figures[0][1]["launch_containment"]]
    return [
        f"{title}, by time since ignition",
        table(place, [(since, name, *_place_cells(part)) for since, name, part in label]),
        table(speed, [(since, name, *_speed_cells(part)) for since, name, part in label]),
        table(
            consistency, [(since, name, *_consistency_cells(part)) for since, name, part in label]
        ),
        f"{title}, launch and impact points",
        table(points, [(name, *_point_cells(part)) for name, part in figures]),
        table(("containment, %", "tracker", *nominal), _curves(figures)),
        *_phases(title, figures),
    ]


def _phases(title: str, figures: Sequence[tuple[str, Mapping[str, Any]]]) -> list[str]:
    """Return the table of impact regions by phase; nothing without targets that reach one."""
    phases = zip(*(row["impact_by_phase"] for _, row in figures), strict=True)
    named = [
        (name, part) for parts in phases for (name, _), part in zip(figures, parts, strict=True)
    ]
    cells = [
        (part["phase"], name, *_phase_cells(part)) for name, part in named if _is_reached(part)
    ]
    probabilities = [f"{100 * region['nominal']:g} %" for region in named[0][1]["regions"]]
    inside = (f"in {each}" for each in probabilities)
    areas = (f"{each} km2" for each in probabilities)
    head = (
        "phase",
        "tracker",
        "n",
        "predicted, %",
        "impact km",
        "energy km",
        *inside,
        *areas,
        "without impact",
    )
    if not cells:
        return []
    given = [
        (part["phase"], name, *_given_cells(part)) for name, part in named if _is_reached(part)
    ]
    given_head = ("true condition", "tracker", *(f"in {each}" for each in probabilities))
    given_head += (f"{probabilities[-1]} km2", "Brier", "samples", "thin")
    return [f"{title}, predicted impact regions", table(head, cells), table(given_head, given)]


def _is_reached(part: Mapping[str, Any]) -> bool:
    return bool(part["targets"] or part["targets_without_impact"])


def _phase_cells(part: Mapping[str, Any]) -> tuple[str, ...]:
    none = f"{part['predicted_without_impact']} of {part['targets_without_impact']}"
    return (
        str(part["targets"]),
        interval_text(part["predicted"], 0, 100.0),
        interval_text(part["impact_m"], 1, 1e-3),
        interval_text(part["energy_m"], 1, 1e-3),
        *(interval_text(region, 0, 100.0) for region in part["regions"]),
        *(_significant(region["median_area_km2"]) for region in part["regions"]),
        none if part["targets_without_impact"] else "-",
    )


def _given_cells(part: Mapping[str, Any]) -> tuple[str, ...]:
    regions = part["regions_given_condition"]
    return (
        *(interval_text(region, 0, 100.0) for region in regions),
        _significant(regions[-1]["median_area_km2"]),
        interval_text(part["condition_brier"], 3),
        number_text(part["effective_samples"], 0),
        interval_text(part["thin"], 2),
    )


def _significant(value: float) -> str:
    return f"{value:.3g}" if math.isfinite(value) else "-"


def _place_cells(part: Mapping[str, Any]) -> tuple[str, ...]:
    return (
        str(part["samples"]),
        interval_text(part["position_m"], 0),
        interval_text(part["position_over_bound"], 2),
        interval_text(part["position_over_free_bound"], 2),
        interval_text(part["position_energy_m"], 0),
        interval_text(part["impact_m"], 1, 1e-3),
    )


def _speed_cells(part: Mapping[str, Any]) -> tuple[str, ...]:
    return (
        str(part["samples"]),
        interval_text(part["velocity_m_s"], 1),
        interval_text(part["velocity_over_bound"], 2),
        interval_text(part["velocity_over_free_bound"], 2),
        interval_text(part["velocity_energy_m_s"], 1),
    )


def _consistency_cells(part: Mapping[str, Any]) -> tuple[str, ...]:
    return tuple(cell for name in ("nees", "nis") for cell in _consistent_cells(part[name]))


def _consistent_cells(figure: Mapping[str, Any]) -> tuple[str, ...]:
    low, high = figure["band_99"]
    band = f"{number_text(low, 2)}-{number_text(high, 2)}" if figure["samples"] else "-"
    return (
        str(figure["samples"]),
        number_text(figure["mean"], 2),
        band,
        number_text(figure["distribution_p"], 3),
    )


def _point_cells(figures: Mapping[str, Any]) -> tuple[str, ...]:
    return (
        *(str(figures[name]) for name in ("targets", "launches_reported", "impacts_reported")),
        interval_text(figures["launch_m"], 0),
        interval_text(figures["launch_energy_m"], 0),
        interval_text(figures["launch_time_s"], 2),
        interval_text(figures["impact_m"], 1, 1e-3),
        interval_text(figures["impact_time_s"], 2),
    )


def _curves(figures: Sequence[tuple[str, Mapping[str, Any]]]) -> list[tuple[str, ...]]:
    return [
        (point, name, *(interval_text(part, 0, 100.0) for part in row[f"{point}_containment"]))
        for point in ("launch", "impact")
        for name, row in figures
    ]


def _shares(gospa: Mapping[str, Any]) -> str:
    """Return the share of each part in GOSPA's p-th power."""
    parts = [gospa[f"{name}_a_target"]["value"] for name in ("localisation", "missed", "false")]
    total = sum(parts)
    return ", ".join(f"{100.0 * part / total:.0f} %" for part in parts) if total > 0.0 else "-"
