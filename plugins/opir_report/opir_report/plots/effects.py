"""Effect plots of a study: the mean of a figure with its interval, over one of the settings that
vary.
"""

from typing import Any, NamedTuple

import numpy as np
from attrs import frozen
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure, SubFigure
from matplotlib.ticker import NullLocator

from opir_core.arrays import FloatArray
from opir_report.canvas import legend_beside, number_ticks, panel_width_in, without_data
from opir_report.figure_data import FigureData
from opir_report.palette import INK, MUTED, SERIES, Hue, series_hue
from opir_report.plots.panels import (
    WIDE_FIGURE,
    WIDE_SETTING,
    EffectPanel,
    effect_panels,
    is_wide,
    panel_columns,
    rows_with_mean,
    usual_path,
)
from opir_report.saved_study import SavedStudy, level_text
from opir_report.words import (
    ShownUnit,
    axis_label,
    figure_words,
    number_words,
    setting_words,
    shown_unit,
)

#: Series with a line of their own; more are drawn as points of one colour.
_SERIES_SHOWN = 12


@frozen(eq=False)
class EffectAxis:
    """The axis of an effect plot: a path that varies, the places of its values, and their labels or
    None.
    """

    path: str
    place: FloatArray
    labels: list[str] | None = None
    is_log: bool = False

    @classmethod
    def of(cls, rows: FigureData, path: str | None) -> "EffectAxis":
        """Return the axis of a path, or of no path."""
        if path is None:
            return cls("", np.zeros(len(rows)), [""])
        values = rows[path]
        if values.dtype.kind in "if":
            numbers = values.astype(np.float64)
            return cls(path, numbers, is_log=is_wide(numbers, WIDE_SETTING))
        names = rows.levels(path)
        return cls(path, np.array([float(names.index(name)) for name in values.tolist()]), names)


class Interval(NamedTuple):
    """Means (n,) of a figure in its shown unit, and the ends (n,) of their intervals."""

    mean: FloatArray
    low: FloatArray
    high: FloatArray


@frozen
class FigureScale:
    """Scale of the values of a figure: words, unit, and whether the axis is logarithmic.

    `share` says of which share of launches, or runs, the means are, "" for all.
    """

    words: str
    shown: ShownUnit
    is_log: bool
    share: str = ""

    @classmethod
    def of(cls, study: SavedStudy, figure: str) -> "FigureScale":
        """Return the scale of a figure of a study, over all of its designs."""
        means = np.asarray(study.rows(figure)["mean"], dtype=np.float64)
        unit = study.units[figure]
        words = figure_words(figure, unit)
        shown = shown_unit(unit, means)
        return cls(words, shown, is_wide(means, WIDE_FIGURE), study.shares_text(figure))

    @property
    def label(self) -> str:
        """The label of an axis."""
        label = axis_label(self.words, self.shown.unit)
        return f"{label}\n({self.share})" if self.share else label

    def interval(self, rows: FigureData) -> Interval:
        """Return the means and intervals of rows; on a logarithmic axis they end above 0, and an
        unknown end is the mean.
        """
        mean, low, high = (
            rows[name] / self.shown.divisor for name in ("mean", "low_95", "high_95")
        )
        low = np.where(np.isfinite(low), low, mean)
        high = np.where(np.isfinite(high), high, mean)
        return Interval(mean, np.maximum(low, mean * 1e-6) if self.is_log else low, high)


def effect_plot(axes: Axes, study: SavedStudy, figure: str, path: str | None = None) -> Axes:
    """Draw the mean of a figure with its 95 % interval over a path, a series for each setting of
    the other paths.
    """
    rows = rows_with_mean(study, figure)
    if not len(rows):
        return without_data(axes, f"{figure}: no design has a value")
    axis_path = path if path is not None else usual_path(study.paths, rows)
    series = tuple(other for other in study.paths if other != axis_path)
    panel = EffectPanel("", axis_path, series, rows)
    hues = draw_panel(axes, study, panel, FigureScale.of(study, figure))
    if hues:
        legend_beside(axes, hues, study.names(panel.series))
    return axes


def effect_figure(drawn: Figure | SubFigure, study: SavedStudy, figure: str) -> None:
    """Draw a figure's effects into a whole figure: small multiples where several settings vary,
    with one scale.
    """
    panels = effect_panels(study, figure)
    if not panels:
        without_data(drawn.add_subplot(), f"{figure}: no design has a value")
        return
    columns = panel_columns(panels)
    grid = drawn.subplots(-(-len(panels) // columns), columns, sharey=True, squeeze=False).ravel()
    scale = FigureScale.of(study, figure)
    hues: list[Hue] = []
    for axes, panel in zip(grid, panels, strict=False):
        hues = draw_panel(axes, study, panel, scale) or hues
        if axes is not grid[0] and axes.get_subplotspec().colspan.start:
            axes.set_ylabel("")
    for axes in grid[len(panels) :]:
        axes.remove()
    split = f"panels: {study.names(panels[0].splits)}" if panels[0].splits else ""
    if hues:
        title = "; ".join(filter(None, [study.names(panels[0].series), split]))
        legend_beside(grid[0], hues, title, is_shared=True)
    elif split:
        drawn.suptitle(split, fontsize=9, x=0.01, ha="left")


def effect_height_in(study: SavedStudy, figure: str) -> float:
    """Return the height of a figure of effects, inches."""
    panels = effect_panels(study, figure)
    return 0.5 + 3.0 * (-(-len(panels) // panel_columns(panels)) if panels else 1)


def draw_panel(axes: Axes, study: SavedStudy, panel: EffectPanel, scale: FigureScale) -> list[Hue]:
    """Draw a panel; return the hues of its series, none for a single one."""
    axis = EffectAxis.of(panel.rows, panel.path)
    labels = study.short_labels(panel.rows, panel.series)
    names = list(dict.fromkeys(labels))
    hues: list[Hue] = []
    if axis.is_log:
        axes.set_xscale("log")
    if scale.is_log:
        axes.set_yscale("log")
    if panel.is_sampled or len(names) > _SERIES_SHOWN:
        _draw(axes, panel.rows, axis.place, scale, Hue(SERIES[0], "", ""))
    else:
        hues = [series_hue(number, name) for number, name in enumerate(names)]
        _draw_series(axes, panel.rows, axis, labels, hues, scale)
    _finish(axes, study, panel, axis, scale)
    if panel.title:
        axes.set_title(panel.title)
    elif len(names) > _SERIES_SHOWN:
        axes.set_title(f"{len(panel.rows)} designs; other settings vary too")
    return hues if len(hues) > 1 else []


def _finish(
    axes: Axes, study: SavedStudy, panel: EffectPanel, axis: EffectAxis, scale: FigureScale
) -> None:
    """Write the labels of the axes, ticks and the lines of requirements."""
    rows = panel.rows
    axes.set_ylabel(scale.label)
    axes.set_xlabel(axis_label(*setting_words(axis.path)) if axis.path else "")
    if axis.labels is not None:
        _mark_names(axes, axis.labels)
    elif panel.is_sampled:  # values that were drawn are no round numbers
        number_ticks(axes.xaxis, is_log=axis.is_log)
    else:
        mark_values(axes.xaxis, sorted(set(axis.place.tolist())))
    if scale.is_log:
        _fit_log(axes, rows, scale)
    number_ticks(axes.yaxis, is_log=scale.is_log)
    draw_requirements(axes, study, str(rows["figure"][0]), scale.shown.divisor)


def _mark_names(axes: Axes, names: list[str]) -> None:
    """Write names, of up to 18 letters, as the ticks of the axis."""
    labels = [name if len(name) <= 18 else f"{name[:17]}…" for name in names]
    axes.set_xticks(np.arange(len(names)), labels)
    axes.set_xlim(-0.5, len(names) - 0.5)
    if max(map(len, names)) > 8 and len(names) > 2:
        for text in axes.get_xticklabels():
            text.set(rotation=25.0, ha="right", rotation_mode="anchor")


def mark_values(axis: Axis, values: list[float]) -> None:
    """Write the values of a setting, sorted, as the ticks of an axis, where they are few or the
    axis is logarithmic.
    """
    is_log = axis.get_scale() == "log"
    ticks = _separate(axis.axes, values, is_log=is_log) if axis is axis.axes.xaxis else values
    if is_log or len(ticks) == len(values) <= 8:
        axis.set_ticks(ticks, [level_text(value) for value in ticks])
        axis.set_minor_locator(NullLocator())


def _separate(axes: Axes, values: list[float], *, is_log: bool) -> list[float]:
    """Return those of the values whose labels do not touch along the axis, from the first on."""
    places = (np.log(values) if is_log else np.array(values)).tolist()
    label_in = 0.1 + 0.08 * max(len(level_text(value)) for value in values)
    gap = label_in / (0.8 * panel_width_in(axes)) * (places[-1] - places[0])
    rows = [0]
    for row, place in enumerate(places):
        if place - places[rows[-1]] >= gap:
            rows.append(row)
    return [values[row] for row in dict.fromkeys(rows)]


def _fit_log(axes: Axes, rows: FigureData, scale: FigureScale) -> None:
    """Let the axis span the means and the ends of intervals that are positive, not those that reach
    0.
    """
    values = (
        np.concatenate([rows[name] for name in ("mean", "low_95", "high_95")]) / scale.shown.divisor
    )
    mean = rows["mean"] / scale.shown.divisor
    values = values[np.isfinite(values) & (values > 0.1 * mean.min())]
    low, high = axes.get_ylim() if axes.get_autoscaley_on() is False else (np.inf, 0.0)
    axes.set_ylim(min(low, float(values.min()) / 1.5), max(high, float(values.max()) * 1.5))


def _draw_series(
    axes: Axes,
    rows: FigureData,
    axis: EffectAxis,
    labels: list[str],
    hues: list[Hue],
    scale: FigureScale,
) -> None:
    """Draw each series, by 1 % of the axis apart from the others; values that are names have no
    lines between them.
    """
    is_named = axis.labels is not None
    # Equal means would hide each other; on a logarithmic axis they are moved by a share of their
    # place.
    span = 8.0 if is_named else float(np.ptp(axis.place)) or 1.0
    for number, hue in enumerate(hues):
        is_series = np.array([label == hue.label for label in labels])
        offset = 0.01 * (number - 0.5 * (len(hues) - 1))
        place = axis.place[is_series]
        place = place * (1.0 + 2.0 * offset) if axis.is_log else place + span * offset
        line = Hue(hue.colour, "", "") if is_named else hue
        _draw(axes, rows.where(is_series), place, scale, line)


def _draw(axes: Axes, rows: FigureData, place: FloatArray, scale: FigureScale, hue: Hue) -> None:
    order = np.argsort(place, kind="stable")
    interval = scale.interval(rows.where(order))
    mean = interval.mean
    spread = np.abs(np.stack([mean - interval.low, interval.high - mean]))
    axes.errorbar(
        place[order], mean, spread, fmt="none", ecolor=hue.colour, elinewidth=1.2, capsize=3
    )
    style: dict[str, Any] = {"color": hue.colour, "marker": "o", "markersize": 4}
    axes.plot(place[order], mean, linestyle=hue.dashes, **style)


def draw_requirements(
    axes: Axes, study: SavedStudy, figure: str, divisor: float, *, is_along_x: bool = False
) -> None:
    """Draw the lines of the study's requirements on a figure."""
    for requirement in study.requirements_on(figure):
        value = requirement["limit"] / divisor
        style: dict[str, Any] = {"color": INK, "linewidth": 1.0, "linestyle": (0, (2, 2))}
        if is_along_x:
            axes.axvline(value, **style)
            continue
        axes.axhline(value, **style)
        axes.annotate(
            f"required {'≥' if requirement['is_least'] else '≤'} {number_words(value)}",
            (0.99, value),
            xycoords=("axes fraction", "data"),
            xytext=(0, 2),
            textcoords="offset points",
            ha="right",
            va="bottom",
            fontsize=8,
            color=INK,
        )


def difference_plot(axes: Axes, study: SavedStudy, figure: str) -> Axes:
    """Draw how much each design differs from the first one: paired over runs, with the 95 %
    interval.
    """
    rows = study.rows(figure)
    rows = rows.where((rows["design"] > 0) & np.isfinite(rows["difference"]))
    if not len(rows):
        return without_data(axes, f"{figure}: no design to compare with the first")
    shown = shown_unit(study.units[figure], rows["difference"])
    place = -np.arange(len(rows), dtype=np.float64)
    difference, low, high = (
        rows[name] / shown.divisor
        for name in ("difference", "difference_low_95", "difference_high_95")
    )
    spread = np.abs(np.stack([difference - low, high - difference]))
    spread = np.where(np.isfinite(spread), spread, 0.0)
    axes.axvline(0.0, color=MUTED, linewidth=1.0)
    axes.errorbar(difference, place, xerr=spread, fmt="o", color=SERIES[0], capsize=3)
    axes.set_yticks(place, study.short_labels(rows))
    axes.set_title(study.names())
    axes.set_ylim(place[-1] - 0.6, 0.6)
    number_ticks(axes.xaxis, is_log=False)
    axes.set_xlabel(_difference_label(study, figure, shown.unit))
    axes.grid(axis="y", visible=False)
    return axes


def _difference_label(study: SavedStudy, figure: str, unit: str) -> str:
    reference = study.short_labels(study.rows(figure))[0] or "the first design"
    words = f"{figure_words(figure, study.units[figure])}: difference from {reference}"
    share = study.shares_text(figure)
    return axis_label(words, unit) + (f"\n({share})" if share else "")
