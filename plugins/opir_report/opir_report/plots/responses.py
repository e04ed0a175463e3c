"""Main effects, interactions and contours of a study of all combinations."""

from collections.abc import Iterator, Sequence
from itertools import combinations
from typing import Any

import numpy as np
from attrs import frozen
from matplotlib.axes import Axes
from matplotlib.contour import ContourSet
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from opir_core.arrays import FloatArray
from opir_report.canvas import legend_beside
from opir_report.factorial import FactorialRuns, ranked_settings
from opir_report.figure_data import FigureData
from opir_report.palette import GRID, INK, MUTED, SERIES, Hue
from opir_report.plots.effects import FigureScale, draw_panel, mark_values
from opir_report.plots.panels import WIDE_SETTING, EffectPanel, is_wide
from opir_report.saved_study import SavedStudy, level_text
from opir_report.words import axis_label, level_value, number_words, setting_words

#: The most panels beside each other, and lines of a contour.
_BESIDE = 3
_LINES = 6


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
    levels = runs.levels[runs.paths.index(study.split)]
    return [
        Part(level_value(study.split, level_text(level)), runs.at(study.split, level))
        for level in levels
    ]


def _settings(parts: Sequence[Part]) -> list[str]:
    """Return the settings that are drawn, by their effect in the first part."""
    return ranked_settings(parts[0].runs)[:_BESIDE]


def main_effect_rows(study: SavedStudy, figure: str) -> FigureData:
    """Return the means at each value of each setting over all others: path, value, part, mean,
    low_95, high_95.
    """
    found = list[tuple[Any, ...]]()
    for part in parts_of(study, figure):
        for path in part.runs.paths:
            rows = study.cut(figure, part.runs.rows([path]))
            values = (rows[name].tolist() for name in (path, "mean", "low_95", "high_95"))
            found += [
                (path, level_text(level), part.name, *ends)
                for level, *ends in zip(*values, strict=True)
            ]
    return FigureData.of_rows(("path", "value", "part", "mean", "low_95", "high_95"), found)


def main_effects_figure(drawn: Figure, study: SavedStudy, figure: str) -> None:
    """Draw the mean at each value of a setting over all others: a panel for each setting, a series
    for each part.
    """
    parts = parts_of(study, figure)
    scale = FigureScale.of(study, figure)
    settings = _settings(parts)
    grid = drawn.subplots(1, len(settings), sharey=True, squeeze=False)[0]
    hues: list[Hue] = []
    for axes, path in zip(grid, settings, strict=True):
        series = (study.split,) if study.split else ()
        rows = [
            _with_part(study, part, study.cut(figure, part.runs.rows([path]))) for part in parts
        ]
        panel = EffectPanel("", path, series, _joined(rows))
        hues = draw_panel(axes, study, panel, scale) or hues
        if axes is not grid[0]:
            axes.set_ylabel("")
    if hues:
        legend_beside(grid[0], hues, study.names([study.split]), whole=True)


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
        for axes, (along, series) in zip(row, pairs, strict=True):
            rows = study.cut(figure, part.runs.rows([along, series]))
            hues = draw_panel(axes, study, EffectPanel(part.name, along, (series,), rows), scale)
            if hues:
                legend_beside(axes, hues, study.names([series]))
            if axes is not row[0]:
                axes.set_ylabel("")


def contour_pair(study: SavedStudy, figure: str) -> tuple[str, str] | None:
    """Return the two numeric settings that move a figure the furthest, of which one has three
    values; or None.

    None, too, for a figure that some launches lack: no line would part what meets a requirement
    from what misses it.
    """
    parts = parts_of(study, figure) if study.is_whole(figure).all() else []
    ranked = ranked_settings(parts[0].runs) if parts else []
    rows = study.rows(figure)
    numeric = [path for path in ranked if rows[path].dtype.kind in "if"][:2]
    is_fit = len(numeric) == 2 and max(len(set(rows[path].tolist())) for path in numeric) > 2
    return _numbers_first(study, (numeric[0], numeric[1])) if is_fit else None


def contour_figure(drawn: Figure, study: SavedStudy, figure: str) -> None:
    """Draw lines of equal mean over two settings, with what misses the requirement shaded: a panel
    for each part.
    """
    parts = parts_of(study, figure)
    pair = contour_pair(study, figure)
    scale = FigureScale.of(study, figure)
    if pair is None:
        raise ValueError(f"{figure}: fewer than two numeric settings vary")
    limits = [each for each in study.requirements if each["figure"] == figure][:1]
    grid = drawn.subplots(1, len(parts), sharey=True, squeeze=False)[0]
    for axes, part in zip(grid, parts, strict=True):
        draw_contours(axes, part.runs, pair, scale, limits)
        axes.set_title(part.name)
        if axes is not grid[0]:
            axes.set_ylabel("")
    marks: list[Any] = [
        Line2D(
            [],
            [],
            color=MUTED,
            marker="o",
            markersize=4,
            linestyle="",
            label="settings that were run",
        ),
        Line2D([], [], color=SERIES[0], linewidth=1.0, label=f"mean {scale.label}"),
    ]
    for each in limits:
        sign = "≥" if each["is_least"] else "≤"
        value = number_words(each["limit"] / scale.shown.divisor)
        marks.append(Patch(facecolor=GRID, edgecolor=INK, label=f"misses {sign} {value}"))
    drawn.legend(handles=marks, loc="outside upper left", ncols=len(marks))


def draw_contours(
    axes: Axes,
    runs: FactorialRuns,
    pair: tuple[str, str],
    scale: FigureScale,
    limits: Sequence[dict[str, Any]] = (),
) -> list[ContourSet]:
    """Draw lines of equal mean of a figure over two numeric settings, linear between the values
    that were run.

    Returns the contours: that of the requirement, if there is one within the plot, then the lines
    with numbers.
    """
    x, y, mean = _surface(runs, pair, scale.shown.divisor)
    for axis, values, path in ((axes.xaxis, x, pair[0]), (axes.yaxis, y, pair[1])):
        if is_wide(values, WIDE_SETTING):
            (axes.set_xscale if axis is axes.xaxis else axes.set_yscale)("log")
        axis.set_label_text(axis_label(*setting_words(path)))
        mark_values(axis, values.tolist())
    axes.plot(
        *(each.ravel() for each in np.meshgrid(x, y)),
        color=MUTED,
        marker="o",
        markersize=4,
        linestyle="",
    )
    drawn = list(
        _requirement_contours(
            axes, (x, y, mean), [each["limit"] / scale.shown.divisor for each in limits]
        )
    )
    for each in limits:
        _shade_missed(
            axes, (x, y, mean), each["limit"] / scale.shown.divisor, is_least=each["is_least"]
        )
    levels = np.setdiff1d(
        _line_levels(mean, is_log=scale.is_log),
        [each["limit"] / scale.shown.divisor for each in limits],
    )
    if len(levels):
        lines = axes.contour(x, y, mean, levels=levels, colors=[SERIES[0]], linewidths=1.0)
        axes.clabel(
            lines, fmt=lambda value: number_words(value, 3), fontsize=8, manual=_middles(lines)
        )
        drawn.append(lines)
    axes.use_sticky_edges = False
    axes.margins(0.06)
    return drawn


def _middles(lines: ContourSet) -> list[tuple[float, float]]:
    """Return the middle of each line, where its number is written."""
    vertices = [each for path in lines.get_paths() if len(each := np.asarray(path.vertices)) > 1]
    pairs = [
        each[len(each) // 2 - 1 : len(each) // 2 + 1].mean(axis=0).tolist() for each in vertices
    ]
    return [(x, y) for x, y in pairs]


def _surface(
    runs: FactorialRuns, pair: tuple[str, str], divisor: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the sorted values (m,) and (n,) of two settings, and the mean (n, m) of the figure
    over the others.
    """
    rows = runs.rows(list(pair))
    x, first = np.unique(rows[pair[0]].astype(np.float64), return_inverse=True)
    y, second = np.unique(rows[pair[1]].astype(np.float64), return_inverse=True)
    mean = np.full((len(y), len(x)), np.nan)
    mean[second, first] = rows["mean"] / divisor
    return x, y, mean


def _requirement_contours(
    axes: Axes, surface: tuple[FloatArray, FloatArray, FloatArray], limits: Sequence[float]
) -> Iterator[ContourSet]:
    for limit in limits:
        if np.nanmin(surface[2]) < limit < np.nanmax(surface[2]):
            yield axes.contour(*surface, levels=[limit], colors=[INK], linewidths=1.6)


def _shade_missed(
    axes: Axes, surface: tuple[FloatArray, FloatArray, FloatArray], limit: float, *, is_least: bool
) -> None:
    far = 10.0 * max(float(np.nanmax(np.abs(surface[2]))), abs(limit), 1.0)
    axes.contourf(*surface, levels=[-far, limit] if is_least else [limit, far], colors=[GRID])


def _line_levels(mean: FloatArray, *, is_log: bool) -> FloatArray:
    """Return round values between the least and the largest mean."""
    low = float(np.nanmin(mean))
    high = float(np.nanmax(mean))
    if not high > low:
        return np.empty(0)
    if is_log and low > 0.0:
        decades = np.arange(np.floor(np.log10(low)), np.ceil(np.log10(high)) + 1.0)
        levels = np.unique(np.concatenate([10.0**decades, 3.0 * 10.0**decades]))
    else:
        step = _round_step((high - low) / _LINES)
        levels = step * np.arange(np.floor(low / step), np.ceil(high / step) + 1.0)
    return levels[(levels > low) & (levels < high)]


def _round_step(step: float) -> float:
    """Return the next 1, 2 or 5 times a power of ten."""
    power = 10.0 ** np.floor(np.log10(step))
    return float(
        next(each * power for each in (1.0, 2.0, 5.0, 10.0) if each * power >= step * (1.0 - 1e-9))
    )


def _numbers_first(study: SavedStudy, pair: tuple[str, str]) -> tuple[str, str]:
    """Return two settings, the one with more numbers first: it lies along the axis."""
    rows = study.rows(next(iter(study.units)))

    def rank(path: str) -> tuple[bool, int]:
        return rows[path].dtype.kind in "if", len(set(rows[path].tolist()))

    first, second = sorted(pair, key=rank, reverse=True)
    return first, second


def _with_part(study: SavedStudy, part: Part, rows: FigureData) -> FigureData:
    """Return rows with the part's value of the setting that is answered value by value."""
    return (
        FigureData({**rows.columns, study.split: np.full(len(rows), part.name)})
        if study.split
        else rows
    )


def _joined(parts: Sequence[FigureData]) -> FigureData:
    """Return the rows of several data of the same columns."""
    return FigureData(
        {name: np.concatenate([each[name] for each in parts]) for name in parts[0].columns}
    )
