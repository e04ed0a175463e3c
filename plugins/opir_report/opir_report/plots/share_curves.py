"""Shares of launches over time: a step curve with its interval for each design, and the share that
never comes.
"""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from opir_scoring import percent_text, share_curve

from opir_core.arrays import FloatArray
from opir_report.canvas import legend_beside, without_data
from opir_report.figure_data import FigureData
from opir_report.palette import INK, Hue, series_hue
from opir_report.saved_study import SavedStudy

#: The most designs that have a curve each.
CURVES = 6
#: The style of lines of requirements.
REQUIRED: dict[str, Any] = {"color": INK, "linewidth": 1.0, "linestyle": (0, (2, 2))}
_COLUMNS = ("design", "condition", "time_s", "share", "low_95", "high_95", "launches", "runs")
#: The most curves that have bands.
_BANDS = 2
#: The most instants of a curve.
_INSTANTS = 200


def curve_rows(study: SavedStudy, column: str) -> FigureData:
    """Return the curves of a column of times of launches: design, condition, time_s, share, its
    95 % interval, launches and runs.

    The last instant of a curve is the latest time of any launch in the study, or of a requirement.
    """
    launches = study.launches
    if launches is None:
        return FigureData.of_rows(_COLUMNS, ())
    latest_s = np.max(launches[column][np.isfinite(launches[column])], initial=0.0)
    limits_s = [requirement["limit"] for requirement in share_requirements_on(study, column)]
    latest_s = max([float(latest_s), *(limit for limit in limits_s if np.isfinite(limit))])
    rows = [
        (name, condition, instant_s, share.share, low, high, share.launches, share.runs)
        for name, condition, launch_rows in _curves_of(study, launches)
        for instants_s in [_instants_s(launch_rows[column], latest_s)]
        for instant_s, (share, low, high) in zip(
            instants_s.tolist(),
            share_curve(launch_rows[column], launch_rows["replicate"], instants_s),
            strict=True,
        )
    ]
    return FigureData.of_rows(_COLUMNS, rows)


def _curves_of(study: SavedStudy, launches: FigureData) -> Iterator[tuple[str, str, FigureData]]:
    """Yield the launches of each design and condition, with the names of both."""
    names = np.array(study.short_labels(launches, study.choices) or [""] * len(launches))
    split = study.split
    labels = np.array(study.short_labels(launches, [split]) if split else [""] * len(launches))
    for condition in dict.fromkeys(labels.tolist()):
        for name in dict.fromkeys(names.tolist()):
            rows = (labels == condition) & (names == name)
            if rows.any():
                yield name, condition, launches.where(rows)


def _instants_s(time_s: FloatArray, latest_s: float) -> FloatArray:
    """Return the times at which a curve steps, thinned to a few, from 0 to the latest one."""
    steps = np.unique(time_s[np.isfinite(time_s)])
    if len(steps) > _INSTANTS:
        steps = steps[np.linspace(0, len(steps) - 1, _INSTANTS).astype(int)]
    return np.unique(np.concatenate([[0.0], steps, [latest_s]]))


def share_requirements_on(study: SavedStudy, column: str) -> list[Mapping[str, Any]]:
    """Return the requirements on shares of launches that are on a column."""
    requirements = study.definition.get("share_requirements", ())
    return [requirement for requirement in requirements if requirement["column"] == column]


def curves_figure(drawn: Figure, study: SavedStudy, column: str) -> None:
    """Draw the curves of a column, a panel for each condition; requirements are lines."""
    requirements = share_requirements_on(study, column)
    rows = curve_rows(study, column)
    if not len(rows):
        without_data(drawn.add_subplot(), f"{column}: the study has no launches")
        return
    conditions = rows.levels("condition")
    names = rows.levels("design")
    hues = [series_hue(number, name) for number, name in enumerate(names[:CURVES])]
    grid = drawn.subplots(1, len(conditions), sharey=True, squeeze=False)[0]
    for axes, condition in zip(grid, conditions, strict=True):
        _draw_panel(axes, rows.at("condition", condition), hues, requirements)
        axes.set_title(condition)
    grid[0].set_ylabel("share of launches, %")
    if len(names) > 1:
        more = f" (the first {CURVES} of {len(names)} designs)" if len(names) > CURVES else ""
        title = f"{study.names(study.choices)}{more}"
        legend_beside(grid[0], hues, title, is_shared=True, marker="")


def _draw_panel(
    axes: Axes, rows: FigureData, hues: Sequence[Hue], requirements: Sequence[Mapping[str, Any]]
) -> None:
    curves = [(hue, rows.at("design", hue.label)) for hue in hues]
    limits_s = [
        requirement["limit"] for requirement in requirements if np.isfinite(requirement["limit"])
    ]
    for number, (hue, curve) in enumerate(curves):
        if len(curve):
            axes.step(curve["time_s"], 100.0 * curve["share"], where="post", **hue.style)
            _draw_intervals(axes, curve, hue, number, len(hues), limits_s)
    for limit_s in limits_s:
        axes.axvline(limit_s, **REQUIRED)
    for requirement in requirements:
        axes.axhline(100.0 * requirement["share"], **REQUIRED)
    axes.set_ylim(-2.0, 102.0)
    axes.set_xlabel("time since ignition, s")


def _draw_intervals(
    axes: Axes, curve: FigureData, hue: Hue, number: int, count: int, limits_s: Sequence[float]
) -> None:
    """Draw the intervals of a curve: a band, or bars beside each other at the required times, or at
    the end, where more than two bands would hide each other.
    """
    time_s = curve["time_s"]
    share, low, high = (100.0 * curve[name] for name in ("share", "low_95", "high_95"))
    if count <= _BANDS:
        axes.fill_between(time_s, low, high, step="post", color=hue.colour, alpha=0.15, linewidth=0)
        return
    for instant_s in limits_s or [float(time_s[-1])]:
        row = int(np.searchsorted(time_s, instant_s, side="right")) - 1
        place_s = instant_s + 0.012 * float(time_s[-1]) * (number - 0.5 * (count - 1))
        spread = [[share[row] - low[row]], [high[row] - share[row]]]
        axes.errorbar([place_s], [share[row]], spread, fmt="o", color=hue.colour, markersize=3)


def never_texts(rows: FigureData) -> list[str]:
    """Return the share of launches of each drawn design and condition that never come, `three GEO,
    day: 12 %`.
    """
    texts = []
    for condition in rows.levels("condition"):
        curves = rows.at("condition", condition)
        for name in curves.levels("design")[:CURVES]:
            share = float(curves.at("design", name)["share"][-1])
            label = ", ".join(filter(None, (name, condition))) or "all"
            texts.append(f"{label}: {percent_text(1.0 - share)}")
    return texts
