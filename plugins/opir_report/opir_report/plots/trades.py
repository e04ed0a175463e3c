"""Plots over the designs of a study: trade-off of two figures, tornado of the settings, convergence
over runs.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.lines import Line2D
from matplotlib.ticker import MaxNLocator
from scipy.special import stdtrit

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_report.canvas import (
    legend_above,
    legend_beside,
    legend_entry,
    number_ticks,
    without_data,
)
from opir_report.figure_data import FigureData
from opir_report.palette import INK, MUTED, SERIES, Hue, series_hue
from opir_report.plots.effects import FigureScale, draw_requirements
from opir_report.saved_study import SavedStudy, level_text
from opir_report.words import level_value, number_words, setting_words

#: Beginnings of figures that are better if they are higher; of others with a unit, less is better.
_HIGHER = (
    "warning_time",
    "warning_contained",
    "warned",
    "detected",
    "tracked",
    "completeness",
    "impact_contained",
    "impact_predicted",
    "share_with",
)
_CONVERGENCE_NAMES = ("design", "runs", "mean", "low_95", "high_95")


def is_higher_better(study: SavedStudy, figure: str) -> bool | None:
    """Whether more of a figure is better: by its requirement or the standard metrics' meaning;
    None: unknown.
    """
    for requirement in study.requirements_on(figure):
        return bool(requirement["is_least"])
    if figure.startswith(_HIGHER):
        return True
    return False if study.units[figure] else None


def front_of(first: FloatArray, second: FloatArray) -> BoolArray:
    """Whether each of the points (n,) is beaten by no other one in both figures, of which less is
    better; ties stay.
    """
    at_least = (first[None] <= first[:, None]) & (second[None] <= second[:, None])
    better = (first[None] < first[:, None]) | (second[None] < second[:, None])
    return np.asarray(~np.any(at_least & better, axis=1))


def trade_plot(axes: Axes, study: SavedStudy, over: str, figure: str) -> Axes:
    """Draw each design's mean of a figure against that of another; designs that no other beats in
    both are joined.
    """
    x, y = (_Figure(study, name) for name in (over, figure))
    rows = np.flatnonzero(np.isfinite(x.mean) & np.isfinite(y.mean))
    if not len(rows):
        return without_data(axes, f"no design has both {over} and {figure}")
    axes.errorbar(
        x.mean[rows],
        y.mean[rows],
        y.spread[:, rows],
        x.spread[:, rows],
        fmt="o",
        markersize=4,
        color=MUTED,
        elinewidth=0.6,
    )
    _fit_axis(axes.xaxis, x, rows)
    _fit_axis(axes.yaxis, y, rows)
    front = rows[(x.is_whole & y.is_whole)[rows]]
    if x.is_higher_better is not None and y.is_higher_better is not None:
        front = front[front_of(x.cost[front], y.cost[front])]
        front = front[np.argsort(x.mean[front], kind="stable")]
        _draw_front(axes, x.mean[front], y.mean[front])
    axes.margins(x=0.1, y=0.1)
    _name_points(axes, study, np.stack([x.mean, y.mean], axis=1), [*front.tolist(), *rows.tolist()])
    return axes


class _Figure:
    """A figure of a study: its scale, and means (n,) with intervals by design."""

    def __init__(self, study: SavedStudy, name: str) -> None:
        self.study = study
        self.name = name
        self.scale = FigureScale.of(study, name)
        self.mean, low, self.high = self.scale.interval(study.rows(name))
        #: The lengths (2, n) of the intervals below and above the means.
        self.spread = np.abs(np.stack([self.mean - low, self.high - self.mean]))
        self.is_whole = study.is_whole(name)
        self.is_higher_better = is_higher_better(study, name)

    @property
    def cost(self) -> FloatArray:
        """The means, or their negatives if higher is better."""
        return -self.mean if self.is_higher_better else self.mean


def _fit_axis(axis: Axis, figure: _Figure, rows: IntArray) -> None:
    """Label the axis of a figure; if it is logarithmic, fit it to designs by their rows (n,)."""
    axes = axis.axes
    is_x = axis is axes.xaxis
    scale = figure.scale
    axis.set_label_text(scale.label)
    if scale.is_log:
        (axes.set_xscale if is_x else axes.set_yscale)("log")
        mean = figure.mean[rows]
        limits = 0.5 * mean[mean > 0.0].min(), 2.0 * figure.high[rows].max()
        (axes.set_xlim if is_x else axes.set_ylim)(*limits)
    number_ticks(axis, is_log=scale.is_log)
    draw_requirements(axes, figure.study, figure.name, scale.shown.divisor, is_along_x=is_x)


def _draw_front(axes: Axes, x: FloatArray, y: FloatArray) -> None:
    axes.plot(x, y, color=SERIES[0], marker="o", markersize=6, linewidth=1.4)
    legend_beside(
        axes,
        [Hue(SERIES[0], "-", "designs that no other beats in both"), Hue(MUTED, "", "others")],
    )


def _name_points(axes: Axes, study: SavedStudy, points: FloatArray, order: Sequence[int]) -> None:
    """Write the values of the settings beside points (n, 2), the first of the order first, up to 12
    where there is space.
    """
    labels = study.short_labels(study.rows(next(iter(study.units))))
    places = axes.transAxes.inverted().transform(axes.transData.transform(points))
    boxes = list[tuple[float, float, float]]()
    for row in dict.fromkeys(order):
        (x, y), width = places[row].tolist(), 0.0125 * len(labels[row])
        is_right = x + width < 1.0
        left = x if is_right else x - width
        is_free = all(
            abs(y - height) > 0.06 or left > end or left + width < start
            for start, end, height in boxes
        )
        if is_free and len(boxes) < 12:
            boxes.append((left, left + width, y))
            axes.annotate(
                labels[row],
                points[row],
                xytext=(5 if is_right else -5, 5),
                textcoords="offset points",
                ha="left" if is_right else "right",
                fontsize=8,
                color=INK,
            )


def tornado_rows(study: SavedStudy, figure: str) -> FigureData:
    """Return the effect of each setting on a figure: path, low, high, low_value, high_value; the
    widest first.

    Of all combinations it is the range of the means over the other settings, of one at a time that
    of the designs which change the setting alone.
    """
    rows = study.rows(figure)
    effects = [effect for path in study.paths for effect in _tornado_effect(study, rows, path)]
    effects.sort(key=lambda effect: effect[2] - effect[1], reverse=True)
    return FigureData.of_rows(("path", "low", "high", "low_value", "high_value"), effects)


def _tornado_effect(
    study: SavedStudy, rows: FigureData, path: str
) -> Iterator[tuple[str, float, float, str, str]]:
    """Yield the effect of a setting, if designs with two of its values have a mean."""
    is_used = np.isfinite(rows["mean"])
    if study.definition["design"] == "one-at-a-time":
        for other in study.paths:
            if other != path:
                is_used &= rows[other] == rows[other][0]
    used = rows.where(is_used)
    levels = used.levels(path)
    means = [float(used.at(path, level)["mean"].mean()) for level in levels]
    if len(means) > 1:
        low = int(np.argmin(means))
        high = int(np.argmax(means))
        yield path, means[low], means[high], level_text(levels[low]), level_text(levels[high])


def tornado_plot(axes: Axes, study: SavedStudy, figure: str) -> Axes:
    """Draw how far each setting moves the mean of a figure, the widest range on top, with the
    values at its ends.
    """
    rows = tornado_rows(study, figure)
    scale = FigureScale.of(study, figure)
    if not len(rows):
        return without_data(axes, f"{figure}: no setting has two values")
    place = -np.arange(len(rows), dtype=np.float64)
    low = rows["low"] / scale.shown.divisor
    high = rows["high"] / scale.shown.divisor
    axes.barh(place, high - low, left=low, height=0.55, color=SERIES[0])
    for row, y in enumerate(place):
        _name_end(axes, rows, row, "low", (low[row], y))
        _name_end(axes, rows, row, "high", (high[row], y))
    reference = float(study.rows(figure)["mean"][0]) / scale.shown.divisor
    if np.isfinite(reference):
        axes.axvline(reference, color=INK, linewidth=1.0)
    axes.set_yticks(place, [setting_words(path)[0] for path in rows["path"].tolist()])
    axes.set_xlabel(_tornado_label(study, figure, scale))
    draw_requirements(axes, study, figure, scale.shown.divisor, is_along_x=True)
    if scale.is_log:
        axes.set_xscale("log")
        axes.set_xlim(0.4 * low.min(), 2.5 * high.max())
    else:
        margin = 0.18 * float(high.max() - low.min()) or 1.0
        axes.set_xlim(low.min() - margin, high.max() + margin)
    number_ticks(axes.xaxis, is_log=scale.is_log)
    axes.grid(axis="y", visible=False)
    return axes


def _tornado_label(study: SavedStudy, figure: str, scale: FigureScale) -> str:
    """Return the label of the axis, which says what the lines are."""
    required = "".join(
        f"; dotted: required {'≥' if each['is_least'] else '≤'}"
        f" {number_words(each['limit'] / scale.shown.divisor)}"
        for each in study.requirements_on(figure)
    )
    return f"{scale.label} (line: the first design{required})"


def _name_end(axes: Axes, rows: FigureData, row: int, end: str, point: tuple[float, float]) -> None:
    """Write the value of a setting at the `low` or the `high` end of its bar."""
    axes.annotate(
        level_value(rows["path"][row], rows[f"{end}_value"][row]),
        point,
        xytext=(-4 if end == "low" else 4, 0),
        textcoords="offset points",
        ha="right" if end == "low" else "left",
        va="center",
    )


def path_plot(axes: Axes, study: SavedStudy) -> Axes:
    """Draw the objective of an optimisation, evaluation by evaluation, and the best so far that
    meets requirements.
    """
    objective = study.definition["objective"]
    figure = _Figure(study, objective["figure"])
    is_met = np.isfinite(figure.mean) & figure.is_whole
    for requirement in study.requirements:
        is_met &= study.is_met(requirement)
    marks = _draw_evaluations(axes, figure.mean, is_met)
    if is_met.any():
        sign = -1.0 if objective["is_largest"] else 1.0
        best = sign * np.minimum.accumulate(np.where(is_met, sign * figure.mean, np.inf))
        rows = np.flatnonzero(np.isfinite(best))
        axes.step(rows + 1, best[rows], where="post", color=SERIES[0])
        marks.append(legend_entry("best so far", SERIES[0]))
    if figure.scale.is_log:
        axes.set_yscale("log")
    number_ticks(axes.yaxis, is_log=figure.scale.is_log)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set(xlabel="evaluation", ylabel=figure.scale.label)
    legend_above(axes, marks)
    return axes


def _draw_evaluations(axes: Axes, values: FloatArray, is_met: BoolArray) -> list[Line2D]:
    """Draw the designs by whether they meet all requirements; return the marks for a legend."""
    marks = []
    for is_drawn, marker, label in (
        (is_met, "o", "a design"),
        (~is_met, "x", "misses a requirement"),
    ):
        rows = np.flatnonzero(is_drawn)
        style: dict[str, Any] = {"marker": marker, "markersize": 4, "linestyle": ""}
        axes.plot(rows + 1, values[rows], color=MUTED, **style)
        if marker == "o" or np.isfinite(values[rows]).any():
            marks.append(legend_entry(label, MUTED, **style))
    return marks


def convergence_rows(study: SavedStudy, figure: str) -> FigureData:
    """Return the mean of a figure over the first runs: design, runs, mean, low_95, high_95
    (Student's t).
    """
    rows = list[tuple[int, int, float, float, float]]()
    if study.runs is None or figure not in study.runs.columns:
        return FigureData.of_rows(_CONVERGENCE_NAMES, rows)
    for design in study.runs.levels("design"):
        values = study.runs.at("design", design)[figure].astype(np.float64)
        mean, half = _running_means(values[np.isfinite(values)])
        count = range(1, len(mean) + 1)
        columns = ([design] * len(mean), count, mean.tolist(), mean - half, mean + half)
        rows += zip(*columns, strict=True)
    return FigureData.of_rows(_CONVERGENCE_NAMES, rows)


def _running_means(values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the means (n,) of the first values (n,), and half the widths (n,) of their 95 %
    intervals.
    """
    count = np.arange(1, len(values) + 1)
    mean = np.cumsum(values) / count
    squares = np.maximum(np.cumsum(np.square(values)) - count * mean**2, 0.0)
    freedom = np.maximum(count - 1, 1)
    half = stdtrit(freedom, 0.975) * np.sqrt(squares / freedom / count)
    half[count < 2] = np.nan
    return mean, half


def convergence_plot(axes: Axes, study: SavedStudy, figure: str) -> Axes:
    """Draw the mean of a figure against the number of runs, with its 95 % interval, of the first
    six designs.
    """
    rows = convergence_rows(study, figure)
    scale = FigureScale.of(study, figure)
    rows = study.cut(figure, rows.where(rows["runs"] >= 2))
    if not len(rows):
        return without_data(axes, f"{figure}: fewer than two runs have a value")
    labels = study.short_labels(study.rows(figure))
    hues = []
    for number, design in enumerate(rows.levels("design")[:6]):
        hue = series_hue(number, labels[design] or "the scene")
        _draw_convergence(axes, rows.at("design", design), scale, hue)
        hues.append(hue)
    _fit_convergence(axes, rows.where(rows["runs"] >= 0.7 * rows["runs"].max()), scale)
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set(xlabel="runs", ylabel=f"mean {scale.label}")
    if len(hues) > 1:
        legend_beside(axes, hues, study.names(), marker="")
    return axes


def _draw_convergence(axes: Axes, rows: FigureData, scale: FigureScale, hue: Hue) -> None:
    mean, low, high = (rows[name] / scale.shown.divisor for name in ("mean", "low_95", "high_95"))
    low = np.maximum(low, 1e-3 * mean) if scale.is_log else low
    axes.fill_between(rows["runs"], low, high, color=hue.colour, alpha=0.15, linewidth=0)
    axes.plot(rows["runs"], mean, **hue.style)


def _fit_convergence(axes: Axes, settled: FigureData, scale: FigureScale) -> None:
    """Let the axis span the intervals of many runs: the first ones are so wide that they would hide
    the others.
    """
    if scale.is_log:
        axes.set_yscale("log")
        ends = 0.3 * settled["mean"].min(), 3.0 * settled["mean"].max()
    else:
        bottom = float(np.nanmin(settled["low_95"]))
        top = float(np.nanmax(settled["high_95"]))
        margin = 0.25 * (top - bottom) or 1.0
        ends = bottom - margin, top + margin
    axes.set_ylim(*(end / scale.shown.divisor for end in ends))
    number_ticks(axes.yaxis, is_log=scale.is_log)
