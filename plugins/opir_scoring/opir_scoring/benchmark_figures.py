"""Figures of tracks on a benchmark set by case, and their table, as `opir score SET --tracks FILE`
prints it.
"""

import math
from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np

from opir_core.arrays import FloatArray
from opir_core.cli import table
from opir_scoring.benchmark_scores import SetScores, read_set, scene_scores
from opir_scoring.benchmark_tables import read_tracks
from opir_scoring.containments import share
from opir_scoring.figure_text import cells, figure_rows, number_text
from opir_scoring.quantiles import chi_square_quantiles

_CELLS = figure_rows(
    ("GOSPA, m", "gospa_m", 0),
    ("/c", "gospa_over_cutoff", 2),
    ("error, m", "position_median_m", 0),
    ("/bound", "error_over_bound", 2),
    ("/unknown", "error_over_unknown_thrust_bound", 2),
    ("energy, m", "position_energy_m", 0),
    ("/bound", "energy_over_bound", 2),
    ("log", "log_score_above_bound", 1),
    ("NEES/6", "nees_over_6_median", 2),
)
HEAD = (
    *("case", "covered, %", "false", "missed", "c, m"),
    *(row.label for row in _CELLS),
    "held, %",
)
LEGEND = """\
Covered: share of scored launches and ticks with a track; false: tracks of no launch, missed: launches without any.
GOSPA: per launch, of positions, p = 2, alpha = 2, c the cut-off of a scene, 10 x its median bound. Error: median of
position; /bound: RMS of error over the Cramér-Rao bound that knows the law of flights, 1 is efficient; /unknown: over
the bound with unknown thrust. Energy: mean energy score of position; /bound: mean over that of the bound. Log: mean
log score of the state, nats above that of the bound. NEES/6: median; 0.89 is consistent. Held: states in their 95 %
ellipsoids. All of these over covered ticks."""


def scored_set(
    folder: Path, tracks: Path, cases: Sequence[str] = ()
) -> tuple[Mapping[str, Any], list[tuple[str, SetScores]]]:
    """Return a description of a set and of a file of tracks on it, and the scores of each scene by
    name.

    Raises `SceneError` with the error in one of the files.
    """
    description, truths = read_set(folder, cases)
    names = [scene["scene"] for scene in description["scenes"]]
    read = read_tracks(tracks, description["tick_s"], names)
    about = {
        "set": description["set"],
        "version": description["version"],
        "tracks": read.name,
        "rows": len(read.time_s),
        "rows_left_out": read.left_out,
        "scenes": len(truths),
        "scenes_without_tracks": len({truth.name for truth in truths} - set(read.scene)),
    }
    return about, [(truth.name, scene_scores(truth, read)) for truth in truths]


def set_figures(scores: Sequence[SetScores]) -> dict[str, Any]:
    """Return the figures of scenes together."""

    def total(name: str) -> int:
        return sum(getattr(scene, name) for scene in scores)

    states = {
        name: np.concatenate([scene.states[name] for scene in scores]) for name in scores[0].states
    }
    covered = len(states["position_m"])
    nees = states["nees"][~np.isnan(states["nees"])]
    cutoffs_m = [scene.cutoff_m for scene in scores]
    gospa_over_cutoff = [scene.gospa_m / scene.cutoff_m for scene in scores]
    return {
        "launches": total("launches"),
        "covered": covered / total("scored") if total("scored") else np.nan,
        "false_tracks": total("false_tracks"),
        "missed_launches": total("missed_launches"),
        "cutoff_m": [min(cutoffs_m), max(cutoffs_m)],
        "gospa_m": _mean(np.concatenate([scene.gospa_m for scene in scores])),
        "gospa_over_cutoff": _mean(np.concatenate(gospa_over_cutoff)),
        "position_median_m": _median(states["position_m"]),
        "velocity_median_m_s": _median(states["velocity_m_s"]),
        "error_over_bound": _rms(states["position_m"] / states["bound_m"]),
        "error_over_unknown_thrust_bound": _rms(states["position_m"] / states["free_bound_m"]),
        "position_energy_m": _mean(states["energy_m"]),
        "energy_over_bound": _mean(states["energy_m"] / states["bound_energy_m"]),
        "log_score_above_bound": _mean(states["log_score"] - states["bound_log_score"]),
        "nees_over_6_median": _median(nees) / 6.0,
        "held_95": share(nees <= chi_square_quantiles(0.95, 6)),
    }


def figures_by_case(scores: Sequence[SetScores]) -> dict[str, dict[str, Any]]:
    """Return the figures of each case; `all` are of all scenes."""
    cases = dict.fromkeys(scene.case for scene in scores)
    figures = {
        name: set_figures([scene for scene in scores if scene.case == name]) for name in cases
    }
    return figures | ({"all": set_figures(scores)} if len(figures) > 1 else {})


def set_text(about: Mapping[str, Any], figures: Mapping[str, Mapping[str, Any]]) -> str:
    """Return the table of the figures of each case."""
    head = f"{about['set']} {about['version']}, {about['scenes']} scenes; tracks: {about['tracks']}"
    if about["scenes_without_tracks"]:
        head += f"; {about['scenes_without_tracks']} scenes without tracks"
    if about["rows_left_out"]:
        head += f"; {about['rows_left_out']} rows left out (at no tick, or P(launch) at most 0.5)"
    rows = [[name, *figure_cells(of_case)] for name, of_case in figures.items()]
    # Metres of cases with one sensor in high orbit and three in low orbit have no common mean.
    rows = [
        [
            cell if row[0] != "all" or not unit.endswith(", m") else ""
            for cell, unit in zip(row, HEAD, strict=True)
        ]
        for row in rows
    ]
    return "\n\n".join([head, table(HEAD, rows, numbers=range(1, len(HEAD))), LEGEND])


def figure_cells(figures: Mapping[str, Any]) -> list[str]:
    """Return the cells of a row of the table, after its name."""
    low, high = figures["cutoff_m"]
    return [
        number_text(100.0 * figures["covered"], 0),
        str(figures["false_tracks"]),
        str(figures["missed_launches"]),
        f"{low:.0f}" if low == high else f"{low:.0f}–{high:.0f}",
        *cells(figures, _CELLS),
        number_text(100.0 * figures["held_95"]["value"], 0),
    ]


def _mean(values: FloatArray) -> float:
    values = values[~np.isnan(values)]
    return float(values.mean()) if len(values) else math.nan


def _median(values: FloatArray) -> float:
    return float(np.median(values)) if len(values) else math.nan


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(_mean(np.square(values))))
