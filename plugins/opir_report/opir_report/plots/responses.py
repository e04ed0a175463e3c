"""Main effects, interactions and contours of a study of all combinations."""

from collections.abc import Sequence
from itertools import combinations
from typing import Any, NamedTuple

import numpy as np
from attrs import frozen
from matplotlib.axes import Axes
from matplotlib.contour import ContourSet
from matplotlib.figure import Figure
from matplotlib.patches import Patch

from opir_core.arrays import FloatArray
from opir_report.canvas import legend_beside, legend_entry
from opir_report.factorial import FactorialRuns, ranked_settings
from opir_report.figure_data import FigureData
from opir_report.palette import GRID, INK, MUTED, PAPER, SERIES, Hue
from opir_report.plots.effects import FigureScale, draw_panel, mark_values
from opir_report.plots.panels import WIDE_SETTING, EffectPanel, axis_rank, is_wide
from opir_report.saved_study import SavedStudy, level_text
from opir_report.words import axis_label, level_value, number_words, setting_words

#: Width and height of the number of a contour line, in those of its panel.
_LABEL_SIZE = (0.12, 0.09)


@frozen(eq=False)
class Part:
    """The runs at one value of the setting that is answered value by value, `name`, or all runs
    without one.
    """

    name: str
    runs: FactorialRuns


def parts_of(study: SavedStudy, figure: str) -> list[Part]:
    """Return the parts of a figure's runs, none for a study without all combinations of two
    settings.
    """
    runs = FactorialRuns.of(study, figure)
    if runs is None or len(ranked_settings(runs)) - bool(study.split) < 2:
        return []
    if not study.split:
        return [Part("", runs)]
    return [
        Part(level_value(study.split, level_text(level)), runs.at(study.split, level))
        for level in runs.levels_of(study.split)
    ]


def _settings(parts: Sequence[Part]) -> list[str]:
    """Return the three settings that are drawn, by their effect in the first part."""
    return ranked_settings(parts[0].runs)[:3]


def main_effect_rows(study: SavedStudy, figure: str) -> FigureData:
    """Return the means at each value of each setting over all others: path, value, part, mean,
    low_95, high_95.
    """
    effects = list[tuple[Any, ...]]()
    for part in parts_of(study, figure):
        for path in part.runs.paths:
            rows = study.cut(figure, part.runs.rows([path]))
            values = (rows[name].tolist() for name in (path, "mean", "low_95", "high_95"))
            effects += [
                (path, level_text(level), part.name, *interval)
                for level, *interval in zip(*values, strict=True)
            ]
    return FigureData.of_rows(("path", "value", "part", "mean", "low_95", "high_95"), effects)


def main_effects_figure(drawn: Figure, study: SavedStudy, figure: str) -> None:
    """Draw the mean at each value of a setting over all others: a panel for each setting, a series
    for each part.
    """
    parts = parts_of(study, figure)
    scale = FigureScale.of(study, figure)
    settings = _settings(parts)
    series = (study.split,) if study.split else ()
    grid = drawn.subplots(1, len(settings), sharey=True, squeeze=False)[0]
    hues: list[Hue] = []
    for axes, path in zip(grid, settings, strict=True):
        rows = FigureData.joined([_part_rows(study, part, figure, path) for part in parts])
        hues = draw_panel(axes, study, EffectPanel("", path, series, rows), scale) or hues
    _label_first(grid)
    if hues:
        legend_beside(grid[0], hues, study.names([study.split]), is_shared=True)


def _label_first(row: Sequence[Axes]) -> None:
    """Leave the label of the figure to the first panel of a row."""
    for axes in row[1:]:
        axes.set_ylabel("")


def _part_rows(study: SavedStudy, part: Part, figure: str, path: str) -> FigureData:
    """Return the means of a part over a setting, with the value of the part."""
    rows = study.cut(figure, part.runs.rows([path]))
    if not study.split:
        return rows
    return FigureData({**rows.columns, study.split: np.full(len(rows), part.name)})


def interaction_pairs(study: SavedStudy, figure: str) -> list[tuple[str, str]]:
    """Return the pairs of settings whose interactions are drawn: the first lies along the axis."""
    pairs = combinations(_settings(parts_of(study, figure)), 2)
    return [_numbers_first(study, pair) for pair in pairs]


def interaction_figure(drawn: Figure, study: SavedStudy, figure: str) -> None:
    """Draw the effect of a setting at each value of another one: a row of panels for each part."""
    parts = parts_of(study, figure)
    scale = FigureScale.of(study, figure)
    pairs = interaction_pairs(study, figure)
    grid = drawn.subplots(len(parts), len(pairs), sharey=True, squeeze=False)
    for row, part in zip(grid, parts, strict=True):
        for axes, (path, series) in zip(row, pairs, strict=True):
            rows = study.cut(figure, part.runs.rows([path, series]))
            hues = draw_panel(axes, study, EffectPanel(part.name, path, (series,), rows), scale)
            if hues:
                legend_beside(axes, hues, study.names([series]))
        _label_first(row)


def contour_pair(study: SavedStudy, figure: str) -> tuple[str, str] | None:
    """Return the two numeric settings that move a figure the furthest, of which one has three
    values; or None.

    None, too, for a figure that some launches lack: no line would part the settings that meet a
    requirement from those that miss it.
    """
    parts = parts_of(study, figure) if study.is_whole(figure).all() else []
    if not parts:
        return None
    rows = study.rows(figure)
    ranks = {path: axis_rank(rows, path) for path in ranked_settings(parts[0].runs)}
    numeric = [path for path, (is_numeric, _) in ranks.items() if is_numeric][:2]
    if len(numeric) < 2 or max(ranks[path][1] for path in numeric) < 3:
        return None
    return _numbers_first(study, (numeric[0], numeric[1]))


def contour_figure(drawn: Figure, study: SavedStudy, figure: str) -> None:
    """Draw lines of equal mean over two settings, with the settings that miss the requirement
    shaded: a panel for each part.
    """
    parts = parts_of(study, figure)
    pair = contour_pair(study, figure)
    scale = FigureScale.of(study, figure)
    if pair is None:
        raise ValueError(f"{figure}: fewer than two numeric settings vary")
    requirements = study.requirements_on(figure)[:1]
    grid = drawn.subplots(1, len(parts), sharey=True, squeeze=False)[0]
    for axes, part in zip(grid, parts, strict=True):
        draw_contours(axes, part.runs, pair, scale, requirements)
        axes.set_title(part.name)
    _label_first(grid)
    marks = _contour_marks(scale, requirements)
    drawn.legend(handles=marks, loc="outside upper left", ncols=len(marks))


def _contour_marks(scale: FigureScale, requirements: Sequence[dict[str, Any]]) -> list[Any]:
    """Return the marks of a legend of contours."""
    marks: list[Any] = [
        legend_entry("settings that were run", MUTED, marker="o", markersize=4, linestyle=""),
        legend_entry(f"mean {scale.label}", SERIES[0], linewidth=1.0),
    ]
    for requirement in requirements:
        sign = "≥" if requirement["is_least"] else "≤"
        value = number_words(requirement["limit"] / scale.shown.divisor)
        marks.append(Patch(facecolor=GRID, edgecolor=INK, label=f"misses {sign} {value}"))
    return marks


class Surface(NamedTuple):
    """The mean (n, m) of a figure over the values (m,) and (n,) of two settings."""

    x: FloatArray
    y: FloatArray
    mean: FloatArray


def draw_contours(
    axes: Axes,
    runs: FactorialRuns,
    pair: tuple[str, str],
    scale: FigureScale,
    requirements: Sequence[dict[str, Any]] = (),
) -> list[ContourSet]:
    """Draw lines of equal mean of a figure over two numeric settings, linear between the values
    that were run.

    Returns the contours: that of the requirement, if there is one within the plot, then the lines
    with numbers.
    """
    surface = _surface(runs, pair, scale.shown.divisor)
    _mark_settings(axes, surface, pair)
    limits = [requirement["limit"] / scale.shown.divisor for requirement in requirements]
    contours: list[ContourSet] = [
        axes.contour(*surface, levels=[limit], colors=[INK], linewidths=1.6)
        for limit in limits
        if np.nanmin(surface.mean) < limit < np.nanmax(surface.mean)
    ]
    for requirement, limit in zip(requirements, limits, strict=True):
        _shade_misses(axes, surface, limit, is_least=requirement["is_least"])
    levels = np.setdiff1d(_line_levels(surface.mean, is_log=scale.is_log), limits)
    if len(levels):
        lines = axes.contour(*surface, levels=levels, colors=[SERIES[0]], linewidths=1.0)
        contours.append(lines)
    axes.use_sticky_edges = False
    axes.margins(0.06)
    if len(levels):
        _number_lines(axes, lines)
    return contours


def _mark_settings(axes: Axes, surface: Surface, pair: tuple[str, str]) -> None:
    """Label the axes of two settings, and mark the values that were run."""
    for axis, values, path in zip((axes.xaxis, axes.yaxis), surface[:2], pair, strict=True):
        if is_wide(values, WIDE_SETTING):
            (axes.set_xscale if axis is axes.xaxis else axes.set_yscale)("log")
        axis.set_label_text(axis_label(*setting_words(path)))
        mark_values(axis, values.tolist())
    places = (values.ravel() for values in np.meshgrid(surface.x, surface.y))
    axes.plot(*places, color=MUTED, marker="o", markersize=4, linestyle="")


def _longest_middle(pieces: Sequence[FloatArray]) -> FloatArray:
    """Return the middle (2,) of the longest stretch of the pieces (n, 2) of a line."""
    first = np.concatenate([piece[:-1] for piece in pieces])
    last = np.concatenate([piece[1:] for piece in pieces])
    longest = int(np.argmax(np.hypot(*(last - first).T)))
    return np.asarray(0.5 * (first[longest] + last[longest]))


def _number_lines(axes: Axes, lines: ContourSet) -> None:
    """Write the value of each line in the middle of its longest stretch, where there is space."""
    axes.autoscale_view()
    to_axes = axes.transData + axes.transAxes.inverted()
    taken = list[FloatArray]()
    for value, path in zip(lines.levels, lines.get_paths(), strict=True):
        pieces = [to_axes.transform(line) for line in path.to_polygons(closed_only=False)]
        if not pieces:
            continue
        middle = _longest_middle(pieces)
        if any(np.all(np.abs(middle - other) < _LABEL_SIZE) for other in taken):
            continue
        taken.append(middle)
        _write_number(axes, number_words(value, 3), to_axes.inverted().transform(middle))


def _write_number(axes: Axes, words: str, place: FloatArray) -> None:
    """Write the value of a line at a place (2,)."""
    axes.annotate(
        words,
        tuple(place.tolist()),
        ha="center",
        va="center",
        fontsize=8,
        color=SERIES[0],
        bbox={"facecolor": PAPER, "edgecolor": "none", "pad": 1.0, "alpha": 0.85},
    )


def _surface(runs: FactorialRuns, pair: tuple[str, str], divisor: float) -> Surface:
    """Return the means of a figure over two settings, with sorted values, averaged over the other
    settings.
    """
    rows = runs.rows(list(pair))
    x, column = np.unique(rows[pair[0]].astype(np.float64), return_inverse=True)
    y, row = np.unique(rows[pair[1]].astype(np.float64), return_inverse=True)
    mean = np.full((len(y), len(x)), np.nan)
    mean[row, column] = rows["mean"] / divisor
    return Surface(x, y, mean)


def _shade_misses(axes: Axes, surface: Surface, limit: float, *, is_least: bool) -> None:
    bound = 10.0 * max(float(np.nanmax(np.abs(surface.mean))), abs(limit), 1.0)
    axes.contourf(*surface, levels=[-bound, limit] if is_least else [limit, bound], colors=[GRID])


def _line_levels(mean: FloatArray, *, is_log: bool) -> FloatArray:
    """Return some six round values between the least and the largest mean."""
    low = float(np.nanmin(mean))
    high = float(np.nanmax(mean))
    if not high > low:
        return np.empty(0)
    if is_log and low > 0.0:
        decades = np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1.0)
        levels = np.unique(np.concatenate([10.0**decades, 3.0 * 10.0**decades]))
    else:
        step = _round_step((high - low) / 6)
        levels = step * np.arange(np.floor(low / step), np.ceil(high / step) + 1.0)
    return levels[(levels > low) & (levels < high)]


def _round_step(step: float) -> float:
    """Return the next 1, 2 or 5 times a power of ten."""
    steps = np.array([1.0, 2.0, 5.0, 10.0]) * 10.0 ** np.floor(np.log10(step))
    return float(steps[steps >= step * (1.0 - 1e-9)][0])


def _numbers_first(study: SavedStudy, pair: tuple[str, str]) -> tuple[str, str]:
    """Return two settings, the one with more numbers first: it lies along the axis."""
    rows = study.rows(next(iter(study.units)))
    first, second = sorted(pair, key=lambda path: axis_rank(rows, path), reverse=True)
    return first, second
