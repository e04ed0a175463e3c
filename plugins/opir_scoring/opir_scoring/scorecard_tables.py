"""Tables of scorecards, as `opir score` and `opir compare` print them."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

from opir_core.cli import table
from opir_core.plugin import REPORTED_TYPES
from opir_scoring.figure_text import FigureRow, cells, figure_rows, interval_text, number_text
from opir_scoring.hypothesis_tables import hypothesis_tables
from opir_scoring.scorecards import GEOMETRIES, Scorecard, by_class

Cards = Mapping[str, Scorecard]


def scorecard_text(cards: Cards) -> str:
    """Return tables of scorecards: overall figures, then mono and stereo by time since ignition."""
    texts = [_heading(next(iter(cards.values())).figures), _overall(cards), _confusions(cards)]
    texts += hypothesis_tables({name: card.figures for name, card in cards.items()})
    for geometry in GEOMETRIES:
        texts += _geometry(cards, geometry)
    return "\n\n".join(filter(None, [*texts, LEGEND]))


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


_OVERALL = figure_rows(
    ("launches tracked", "launches_tracked", 3),
    ("tracks per launch", "tracks_a_launch", 2),
    ("false tracks per run", "false_tracks_a_run", 2),
    ("purity", "purity", 4),
    ("completeness", "completeness", 3),
    ("first track after, s", "first_track_after_s", 2),
    ("GOSPA per target, m", "gospa.a_target_m", 0),
)
_RECOGNISED = figure_rows(
    ("launches recognised", "recognition.launches_recognised", 3),
    ("P(launch) > 0.95 after, s", "recognition.median_sure_after_s", 1),
    ("false launches per hour", "recognition.false_launches_an_hour", 2),
    ("type correct", "type_right", 3),
    ("time per detection, us", "tracking_us_a_detection", 1),
    ("time per track update, us", "tracking_us_a_track_update", 0),
)


def _overall(cards: Cards) -> str:
    figures = [card.figures for card in cards.values()]
    rows, recognised = (
        [(row.label, *map(row.text, figures)) for row in group] for group in (_OVERALL, _RECOGNISED)
    )
    gospa = [_shares(own["gospa"]) for own in figures]
    return table(("", *cards), [*rows, ("  localisation, missed, false", *gospa), *recognised])


def _confusions(cards: Cards) -> str:
    confusions = {name: card.figures["type_confusion"] for name, card in cards.items()}
    types = by_class(true for confusion in confusions.values() for true in confusion)
    rows = [
        (true, name, *(str(confusion[true][reported]) for reported in REPORTED_TYPES))
        for true in types
        for name, confusion in confusions.items()
        if true in confusion
    ]
    head = ("type", "tracker", *(f"reported {reported}" for reported in REPORTED_TYPES))
    return table(head, rows) if rows else ""


_PLACE = figure_rows(
    ("position m", "position_m", 0),
    ("/known", "position_over_bound", 2),
    ("/unknown", "position_over_free_bound", 2),
    ("energy m", "position_energy_m", 0),
    ("impact km", "impact_m", 1, 1e-3),
)
_SPEED = figure_rows(
    ("velocity m/s", "velocity_m_s", 1),
    ("/known", "velocity_over_bound", 2),
    ("/unknown", "velocity_over_free_bound", 2),
    ("energy m/s", "velocity_energy_m_s", 1),
)
_POINTS = figure_rows(
    ("launch m", "launch_m", 0),
    ("energy m", "launch_energy_m", 0),
    ("launch s", "launch_time_s", 2),
    ("impact km", "impact_m", 1, 1e-3),
    ("impact s", "impact_time_s", 2),
)
_IMPACTS = figure_rows(
    ("predicted, %", "predicted", 0, 100.0),
    ("impact km", "impact_m", 1, 1e-3),
    ("energy km", "energy_m", 1, 1e-3),
)
_CONDITIONS = figure_rows(
    ("Brier", "condition_brier", 3),
    ("samples", "effective_samples", 0),
    ("thin", "thin", 2),
)

_CONSISTENCY = ("NEES/6", "99 % band", "p", "n", "NIS/2", "99 % band", "p")

#: A tracker's name and its figures.
_Named = tuple[str, Mapping[str, Any]]


def _labels(rows: Sequence[FigureRow]) -> list[str]:
    return [row.label for row in rows]


def _geometry(cards: Cards, geometry: str) -> list[str]:
    """Return the tables of one geometry: errors and consistency by time, then of launch and
    impact.
    """
    figures = [(name, card.figures[geometry]) for name, card in cards.items()]
    title = geometry.replace("_biased", " with biased sensors")
    by_time = _by_time(figures)
    if not by_time:
        return _phases(title, figures)
    nominal = [f"{100.0 * level['nominal']:g} %" for level in figures[0][1]["launch_containment"]]
    return [
        f"{title}, by time since ignition",
        *by_time,
        f"{title}, launch and impact points",
        _point_table(figures),
        table(("containment, %", "tracker", *nominal), _curves(figures)),
        *_phases(title, figures),
    ]


def _point_table(figures: Sequence[_Named]) -> str:
    counts = ("targets", "launches_reported", "impacts_reported")
    rows = [
        (name, *(str(own[count]) for count in counts), *cells(own, _POINTS))
        for name, own in figures
    ]
    return table(("tracker", "targets", "launch points", "impact points", *_labels(_POINTS)), rows)


def _by_time(figures: Sequence[_Named]) -> list[str]:
    """Return the tables of errors and consistency by time since ignition; nothing without ticks."""
    binned = [(bin_, name) for name, own in figures for bin_ in own["by_time"]]
    if not binned:
        return []
    binned.sort(key=lambda row: row[0]["since_ignition_s"][0])
    bins = [("{:g}-{:g}".format(*bin_["since_ignition_s"]), name, bin_) for bin_, name in binned]
    head = ("time s", "tracker", "n")
    tables = []
    for rows in (_PLACE, _SPEED):
        errors = [
            (since, name, str(bin_["samples"]), *cells(bin_, rows)) for since, name, bin_ in bins
        ]
        tables.append(table((*head, *_labels(rows)), errors))
    consistency = [
        (since, name, *_consistent_cells(bin_["nees"]), *_consistent_cells(bin_["nis"]))
        for since, name, bin_ in bins
    ]
    return [*tables, table((*head, *_CONSISTENCY), consistency)]


def _phases(title: str, figures: Sequence[_Named]) -> list[str]:
    """Return the tables of impact regions by phase; nothing without targets that reach one."""
    phases = zip(*(own["impact_by_phase"] for _, own in figures), strict=True)
    reached = [
        (name, phase)
        for of_trackers in phases
        for (name, _), phase in zip(figures, of_trackers, strict=True)
        if phase["targets"] or phase["targets_without_impact"]
    ]
    if not reached:
        return []
    probabilities = [f"{100 * region['nominal']:g} %" for region in reached[0][1]["regions"]]
    inside = [f"in {probability}" for probability in probabilities]
    areas = [f"{probability} km2" for probability in probabilities]
    head = ("phase", "tracker", "n", *_labels(_IMPACTS), *inside, *areas, "without impact")
    rows = [(phase["phase"], name, *_phase_cells(phase)) for name, phase in reached]
    true_head = ("true condition", "tracker", *inside, areas[-1], *_labels(_CONDITIONS))
    true_rows = [(phase["phase"], name, *_given_cells(phase)) for name, phase in reached]
    return [f"{title}, predicted impact regions", table(head, rows), table(true_head, true_rows)]


def _phase_cells(phase: Mapping[str, Any]) -> tuple[str, ...]:
    orbiting = phase["targets_without_impact"]
    regions = phase["regions"]
    return (
        str(phase["targets"]),
        *cells(phase, _IMPACTS),
        *(interval_text(region, 0, 100.0) for region in regions),
        *(_significant(region["median_area_km2"]) for region in regions),
        f"{phase['predicted_without_impact']} of {orbiting}" if orbiting else "-",
    )


def _given_cells(phase: Mapping[str, Any]) -> tuple[str, ...]:
    regions = phase["regions_given_condition"]
    return (
        *(interval_text(region, 0, 100.0) for region in regions),
        _significant(regions[-1]["median_area_km2"]),
        *cells(phase, _CONDITIONS),
    )


def _significant(value: float) -> str:
    return f"{value:.3g}" if math.isfinite(value) else "-"


def _consistent_cells(figure: Mapping[str, Any]) -> tuple[str, ...]:
    low, high = figure["band_99"]
    band = f"{number_text(low, 2)}-{number_text(high, 2)}" if figure["samples"] else "-"
    return (
        str(figure["samples"]),
        number_text(figure["mean"], 2),
        band,
        number_text(figure["distribution_p"], 3),
    )


def _curves(figures: Sequence[_Named]) -> list[tuple[str, ...]]:
    return [
        (point, name, *(interval_text(level, 0, 100.0) for level in own[f"{point}_containment"]))
        for point in ("launch", "impact")
        for name, own in figures
    ]


def _shares(gospa: Mapping[str, Any]) -> str:
    """Return the share of each part in GOSPA's p-th power."""
    names = ("localisation", "missed", "false")
    powers = [gospa[f"{name}_a_target"]["value"] for name in names]
    total = sum(powers)
    return ", ".join(f"{100.0 * power / total:.0f} %" for power in powers) if total > 0.0 else "-"
