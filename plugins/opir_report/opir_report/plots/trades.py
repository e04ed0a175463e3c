"""Plots over the designs of a study: trade-off of two figures, tornado of the settings, convergence
over runs.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
from attrs import frozen
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.ticker import FuncFormatter, MaxNLocator
from scipy.special import stdtrit

from opir_core.arrays import BoolArray, FloatArray
from opir_report.canvas import legend_above, legend_beside, log_ticks, without_data
from opir_report.figure_data import FigureData
from opir_report.palette import INK, MUTED, SERIES, Hue, series_hue
from opir_report.plots.effects import FigureScale, draw_requirements
from opir_report.saved_study import SavedStudy, level_text
from opir_report.words import level_value, number_words, setting_words

#: Designs whose names are written beside their points, and whose convergence is drawn.
_NAMED = 12
_CONVERGING = 6
#: Beginnings of figures that are better if they are higher; of others with a unit, less is better.
_HIGHER = (
    *("warning_time", "warned", "detected", "tracked", "completeness"),
    *("impact_contained", "impact_predicted", "share_with"),
)


def is_higher_better(study: SavedStudy, figure: str) -> bool | None:
    """Return whether more of a figure is better: by its requirement or the standard metrics'
    meaning; None: unknown.
    """
    for each in study.requirements:
        if each["figure"] == figure:
            return bool(each["is_least"])
    if figure.startswith((*_HIGHER, "warning_contained")):
        return True
    return False if study.units[figure] else None


def front_of(first: FloatArray, second: FloatArray) -> BoolArray:
    """Return which points (n,) no other one beats in both figures, of which less is better; ties
    stay.
    """
    at_least = (first[None] <= first[:, None]) & (second[None] <= second[:, None])
    better = (first[None] < first[:, None]) | (second[None] < second[:, None])
    return np.asarray(~np.any(at_least & better, axis=1))


@frozen(eq=False)
class _Means:
    """The means of a figure in its shown unit, nan where unknown, with the ends of their intervals,
    by design.
    """

    mean: FloatArray
    low: FloatArray
    high: FloatArray
    scale: FigureScale

    @classmethod
    def of(cls, study: SavedStudy, figure: str) -> "_Means":
        rows = study.rows(figure)
        scale = FigureScale.of(study, figure)
        mean, low, high = (
            rows[name] / scale.shown.divisor for name in ("mean", "low_95", "high_95")
        )
        low = np.where(np.isfinite(low), low, mean)
        high = np.where(np.isfinite(high), high, mean)
        return cls(mean, np.maximum(low, mean * 1e-6) if scale.is_log else low, high, scale)

    @property
    def spread(self) -> FloatArray:
        """The lengths (2, n) of the intervals below and above the means."""
        return np.abs(np.stack([self.mean - self.low, self.high - self.mean]))


def trade_plot(axes: Axes, study: SavedStudy, over: str, figure: str) -> Axes:
    """Draw each design's mean of a figure against that of another; designs that no other beats in
    both are joined.
    """
    x = _Means.of(study, over)
    y = _Means.of(study, figure)
    known = np.flatnonzero(np.isfinite(x.mean) & np.isfinite(y.mean))
    if not len(known):
        return without_data(axes, f"no design has both {over} and {figure}")
    axes.errorbar(
        *(x.mean[known], y.mean[known], y.spread[:, known], x.spread[:, known]),
        fmt="o",
        markersize=4,
        color=MUTED,
        elinewidth=0.6,
    )
    for axis, each, name in ((axes.xaxis, x, over), (axes.yaxis, y, figure)):
        axis.set_label_text(each.scale.label)
        if each.scale.is_log:
            (axes.set_xscale if axis is axes.xaxis else axes.set_yscale)("log")
            ends = each.mean[known][each.mean[known] > 0.0]
            (axes.set_xlim if axis is axes.xaxis else axes.set_ylim)(
                0.5 * ends.min(), 2.0 * each.high[known].max()
            )
            log_ticks(axis)
        else:
            axis.set_major_formatter(FuncFormatter(lambda value, _place: number_words(value)))
        draw_requirements(axes, study, name, each.scale.shown.divisor, along_x=axis is axes.xaxis)
    signs = [is_higher_better(study, name) for name in (over, figure)]
    best = known[(study.is_whole(over) & study.is_whole(figure))[known]]
    if None not in signs:
        wanted = [
            -each.mean[best] if sign else each.mean[best]
            for each, sign in zip((x, y), signs, strict=True)
        ]
        best = best[front_of(*wanted)]
        best = best[np.argsort(x.mean[best], kind="stable")]
        axes.plot(
            x.mean[best], y.mean[best], color=SERIES[0], marker="o", markersize=6, linewidth=1.4
        )
        legend_beside(
            axes,
            [Hue(SERIES[0], "-", "designs that no other beats in both"), Hue(MUTED, "", "others")],
        )
    axes.margins(x=0.1, y=0.1)
    _name_points(axes, study, np.stack([x.mean, y.mean], axis=1), [*best.tolist(), *known.tolist()])
    return axes


def _name_points(axes: Axes, study: SavedStudy, points: FloatArray, order: Sequence[int]) -> None:
    """Write the values of what varies beside points (n, 2), the first of the order first, where
    there is space.
    """
    labels = study.short_labels(study.rows(next(iter(study.units))))
    places = axes.transAxes.inverted().transform(axes.transData.transform(points))
    taken = list[tuple[float, float, float]]()
    for row in dict.fromkeys(order):
        (x, y), width = places[row].tolist(), 0.0125 * len(labels[row])
        is_right = x + width < 1.0
        left = x if is_right else x - width
        if len(taken) < _NAMED and all(
            abs(y - other) > 0.06 or left > end or left + width < start
            for start, end, other in taken
        ):
            taken.append((left, left + width, y))
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
    known = np.isfinite(rows["mean"])
    found = list[tuple[str, float, float, str, str]]()
    for path in study.paths:
        use = known.copy()
        if study.definition["design"] == "one-at-a-time":
            for other in study.paths:
                use &= (rows[other] == rows[other][0]) if other != path else True
        levels = list(dict.fromkeys(rows[path][use].tolist()))
        means = [float(rows["mean"][use & (rows[path] == level)].mean()) for level in levels]
        if len(means) > 1:
            low = int(np.argmin(means))
            high = int(np.argmax(means))
            found.append(
                (path, means[low], means[high], level_text(levels[low]), level_text(levels[high]))
            )
    found.sort(key=lambda row: row[2] - row[1], reverse=True)
    return FigureData.of_rows(("path", "low", "high", "low_value", "high_value"), found)


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
    for row in range(len(rows)):
        for x, words, side in (
            (low[row], rows["low_value"][row], "right"),
            (high[row], rows["high_value"][row], "left"),
        ):
            shift = -4 if side == "right" else 4
            value = level_value(rows["path"][row], words)
            style: dict[str, Any] = {"textcoords": "offset points", "ha": side, "va": "center"}
            axes.annotate(value, (x, place[row]), xytext=(shift, 0), **style)
    reference = float(study.rows(figure)["mean"][0]) / scale.shown.divisor
    if np.isfinite(reference):
        axes.axvline(reference, color=INK, linewidth=1.0)
    axes.set_yticks(place, [setting_words(path)[0] for path in rows["path"].tolist()])
    axes.set_xlabel(f"{scale.label} (line: the first design)")
    if scale.is_log:
        axes.set_xscale("log")
        axes.set_xlim(0.4 * low.min(), 2.5 * high.max())
        log_ticks(axes.xaxis)
    else:
        margin = 0.18 * float(high.max() - low.min()) or 1.0
        axes.set_xlim(low.min() - margin, high.max() + margin)
        axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _place: number_words(value)))
    axes.grid(axis="y", visible=False)
    return axes


def path_plot(axes: Axes, study: SavedStudy) -> Axes:
    """Draw the objective of an optimisation, evaluation by evaluation, and the best so far that
    meets requirements.
    """
    objective = study.definition["objective"]
    values = _Means.of(study, objective["figure"])
    is_met = np.isfinite(values.mean) & study.is_whole(objective["figure"])
    for each in study.requirements:
        is_met &= study.is_met(each)
    place = np.arange(1, len(values.mean) + 1)
    axes.plot(
        place[is_met], values.mean[is_met], color=MUTED, marker="o", markersize=4, linestyle=""
    )
    axes.plot(
        place[~is_met], values.mean[~is_met], color=MUTED, marker="x", markersize=4, linestyle=""
    )
    marks = [Line2D([], [], color=MUTED, marker="o", markersize=4, linestyle="", label="a design")]
    if np.isfinite(values.mean[~is_met]).any():
        marks.append(
            Line2D(
                [],
                [],
                color=MUTED,
                marker="x",
                markersize=4,
                linestyle="",
                label="misses a requirement",
            )
        )
    if is_met.any():
        sign = -1.0 if objective["is_largest"] else 1.0
        best = sign * np.minimum.accumulate(np.where(is_met, sign * values.mean, np.inf))
        known = np.isfinite(best)
        axes.step(place[known], best[known], where="post", color=SERIES[0])
        marks.append(Line2D([], [], color=SERIES[0], label="best so far"))
    if values.scale.is_log:
        axes.set_yscale("log")
        log_ticks(axes.yaxis)
    else:
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _place: number_words(value)))
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set(xlabel="evaluation", ylabel=values.scale.label)
    legend_above(axes, marks)
    return axes


def convergence_rows(study: SavedStudy, figure: str) -> FigureData:
    """Return the mean of a figure over the first runs: design, runs, mean, low_95, high_95
    (Student's t).
    """
    found = list[tuple[int, int, float, float, float]]()
    if study.runs is None or figure not in study.runs.columns:
        return FigureData.of_rows(("design", "runs", "mean", "low_95", "high_95"), found)
    for design in dict.fromkeys(study.runs["design"].tolist()):
        values = study.runs[figure][study.runs["design"] == design].astype(np.float64)
        values = values[np.isfinite(values)]
        count = np.arange(1, len(values) + 1)
        mean = np.cumsum(values) / count
        squares = np.maximum(np.cumsum(np.square(values)) - count * mean**2, 0.0)
        half = stdtrit(np.maximum(count - 1, 1), 0.975) * np.sqrt(
            squares / np.maximum(count - 1, 1) / count
        )
        half[count < 2] = np.nan
        found += zip(
            [design] * len(values),
            count.tolist(),
            mean.tolist(),
            mean - half,
            mean + half,
            strict=True,
        )
    return FigureData.of_rows(("design", "runs", "mean", "low_95", "high_95"), found)


def convergence_plot(axes: Axes, study: SavedStudy, figure: str) -> Axes:
    """Draw the mean of a figure against the number of runs, with its 95 % interval, of the first
    designs.
    """
    rows = convergence_rows(study, figure)
    scale = FigureScale.of(study, figure)
    rows = study.cut(figure, rows.where(rows["runs"] >= 2))
    if not len(rows):
        return without_data(axes, f"{figure}: fewer than two runs have a value")
    labels = study.short_labels(study.rows(figure))
    hues = []
    for number, design in enumerate(list(dict.fromkeys(rows["design"].tolist()))[:_CONVERGING]):
        own = rows.where(rows["design"] == design)
        hue = series_hue(number, labels[design] or "the scene")
        mean, low, high = (
            own[name] / scale.shown.divisor for name in ("mean", "low_95", "high_95")
        )
        axes.fill_between(
            own["runs"],
            np.maximum(low, 1e-3 * mean) if scale.is_log else low,
            high,
            color=hue.colour,
            alpha=0.15,
            linewidth=0,
        )
        axes.plot(own["runs"], mean, color=hue.colour, linestyle=hue.dashes)
        hues.append(hue)
    settled = rows.where(rows["runs"] >= 0.7 * rows["runs"].max())
    if scale.is_log:
        axes.set_yscale("log")
        axes.set_ylim(
            0.3 * settled["mean"].min() / scale.shown.divisor,
            3.0 * settled["mean"].max() / scale.shown.divisor,
        )
        log_ticks(axes.yaxis)
    else:
        # The first intervals are so wide that they would hide the rest.
        bottom = float(np.nanmin(settled["low_95"]))
        top = float(np.nanmax(settled["high_95"]))
        margin = 0.25 * (top - bottom) or 1.0
        axes.set_ylim((bottom - margin) / scale.shown.divisor, (top + margin) / scale.shown.divisor)
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _place: number_words(value)))
    axes.xaxis.set_major_locator(MaxNLocator(integer=True))
    axes.set(xlabel="runs", ylabel=f"mean {scale.label}")
    if len(hues) > 1:
        legend_beside(axes, hues, study.names(), marker="")
    return axes
