"""Effect plots of a study: the mean of a figure with its interval, over one of the settings that
vary.
"""

from typing import Any

import numpy as np
from attrs import frozen
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.figure import Figure, SubFigure
from matplotlib.ticker import FuncFormatter, NullLocator

from opir_core.arrays import FloatArray
from opir_report.canvas import legend_beside, log_ticks, without_data
from opir_report.figure_data import FigureData
from opir_report.palette import INK, MUTED, SERIES, Hue, series_hue
from opir_report.plots.panels import (
    WIDE_FIGURE,
    WIDE_SETTING,
    EffectPanel,
    effect_panels,
    is_wide,
    panel_columns,
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
#: How far apart series are, as a share of the axis.
_ASIDE = 0.01
#: Ticks of a setting that are written; and letters of a name.
_TICKS = 8
_LETTERS = 18


@frozen(eq=False)
class EffectAxis:
    """What lies along an effect plot: a path that varies, the places of its values, and their
    labels or None.
    """

    path: str
    place: FloatArray
    labels: list[str] | None
    is_log: bool


@frozen
class FigureScale:
    """How the values of a figure are shown: words, unit, and whether the axis is logarithmic.

    `part` says of which share of launches, or runs, the means are, "" for all.
    """

    words: str
    shown: ShownUnit
    is_log: bool
    part: str = ""

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
        return f"{label}\n({self.part})" if self.part else label


def _axis(rows: FigureData, path: str | None) -> EffectAxis:
    if path is None:
        return EffectAxis("", np.zeros(len(rows)), [""], False)
    values = rows[path]
    if values.dtype.kind in "if":
        numbers = values.astype(np.float64)
        return EffectAxis(path, numbers, None, is_wide(numbers, WIDE_SETTING))
    names = list(dict.fromkeys(values.tolist()))
    return EffectAxis(
        path,
        np.array([names.index(value) for value in values.tolist()], dtype=np.float64),
        names,
        False,
    )


def effect_plot(axes: Axes, study: SavedStudy, figure: str, path: str | None = None) -> Axes:
    """Draw the mean of a figure with its 95 % interval over a path, a series for each setting of
    the other paths.
    """
    rows = study.rows(figure)
    rows = rows.where(np.isfinite(rows["mean"]))
    if not len(rows):
        return without_data(axes, f"{figure}: no design has a value")
    along = path if path is not None else usual_path(study.paths, rows)
    panel = EffectPanel("", along, tuple(each for each in study.paths if each != along), rows)
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
        legend_beside(grid[0], hues, title, whole=True)
    elif split:
        drawn.suptitle(split, fontsize=9, x=0.01, ha="left")


def effect_height_in(study: SavedStudy, figure: str) -> float:
    """Return the height of a figure of effects, inches."""
    panels = effect_panels(study, figure)
    return 0.5 + 3.0 * (-(-len(panels) // panel_columns(panels)) if panels else 1)


def draw_panel(axes: Axes, study: SavedStudy, panel: EffectPanel, scale: FigureScale) -> list[Hue]:
    """Draw a panel; return the hues of its series, none for a single one."""
    along = _axis(panel.rows, panel.path)
    labels = study.short_labels(panel.rows, panel.series)
    names = list(dict.fromkeys(labels))
    hues: list[Hue] = []
    if along.is_log:
        axes.set_xscale("log")
    if scale.is_log:
        axes.set_yscale("log")
    if panel.is_sampled or len(names) > _SERIES_SHOWN:
        _draw(axes, panel.rows, along.place, scale, Hue(SERIES[0], "", ""))
    else:
        hues = [series_hue(number, name) for number, name in enumerate(names)]
        _draw_series(axes, panel.rows, along, labels, hues, scale)
    _finish(axes, study, panel.rows, along, scale)
    if panel.title:
        axes.set_title(panel.title)
    elif len(names) > _SERIES_SHOWN:
        axes.set_title(f"{len(panel.rows)} designs; other settings vary too")
    return hues if len(hues) > 1 else []


def _finish(
    axes: Axes, study: SavedStudy, rows: FigureData, along: EffectAxis, scale: FigureScale
) -> None:
    """Write what the axes are, ticks and the lines of requirements."""
    axes.set_ylabel(scale.label)
    axes.set_xlabel(axis_label(*setting_words(along.path)) if along.path else "")
    if along.labels is not None:
        axes.set_xticks(np.arange(len(along.labels)), [_cut(name) for name in along.labels])
        axes.set_xlim(-0.5, len(along.labels) - 0.5)
        if max(map(len, along.labels)) > 8 and len(along.labels) > 2:
            for text in axes.get_xticklabels():
                text.set(rotation=25.0, ha="right", rotation_mode="anchor")
    else:
        mark_values(axes.xaxis, sorted(set(along.place.tolist())))
    if scale.is_log:
        _fit_log(axes, rows, scale)
        log_ticks(axes.yaxis)
    else:
        axes.yaxis.set_major_formatter(FuncFormatter(lambda value, _place: number_words(value)))
    draw_requirements(axes, study, str(rows["figure"][0]), scale.shown.divisor)


def mark_values(axis: Axis, values: list[float]) -> None:
    """Write the values of a setting, sorted, as the ticks of an axis, where they are few or the
    axis is logarithmic.
    """
    is_log = axis.get_scale() == "log"
    ticks = _apart(axis.axes, values, is_log=is_log) if axis is axis.axes.xaxis else values
    if is_log or len(ticks) == len(values) <= _TICKS:
        axis.set_ticks(ticks, [level_text(each) for each in ticks])
        axis.set_minor_locator(NullLocator())


def _apart(axes: Axes, values: list[float], *, is_log: bool) -> list[float]:
    """Return those of the values whose labels do not touch along the axis, from the first on."""
    places = (np.log(values) if is_log else np.array(values)).tolist()
    part = axes.get_subplotspec()
    width_in = (
        0.8
        * axes.figure.bbox.width
        / axes.figure.dpi
        / (1 if part is None else part.get_geometry()[1])
    )
    label_in = 0.1 + 0.08 * max(len(level_text(each)) for each in values)
    gap = label_in / width_in * (places[-1] - places[0])
    kept = [0]
    for number, place in enumerate(places):
        if place - places[kept[-1]] >= gap:
            kept.append(number)
    return [values[number] for number in dict.fromkeys(kept)]


def _cut(name: str) -> str:
    return name if len(name) <= _LETTERS else f"{name[: _LETTERS - 1]}…"


def _fit_log(axes: Axes, rows: FigureData, scale: FigureScale) -> None:
    """Let the axis span the means and the ends of intervals that are positive, not those that reach
    0.
    """
    every = (
        np.concatenate([rows[name] for name in ("mean", "low_95", "high_95")]) / scale.shown.divisor
    )
    mean = rows["mean"] / scale.shown.divisor
    every = every[np.isfinite(every) & (every > 0.1 * mean.min())]
    low, high = axes.get_ylim() if axes.get_autoscaley_on() is False else (np.inf, 0.0)
    axes.set_ylim(min(low, float(every.min()) / 1.5), max(high, float(every.max()) * 1.5))


def _draw_series(
    axes: Axes,
    rows: FigureData,
    along: EffectAxis,
    labels: list[str],
    hues: list[Hue],
    scale: FigureScale,
) -> None:
    """Draw each series, a little apart from the others; values that are names have no lines between
    them.
    """
    is_named = along.labels is not None
    # Equal means would hide each other; on a logarithmic axis they are moved by a share of their
    # place.
    span = 8.0 if is_named else float(np.ptp(along.place)) or 1.0
    for number, hue in enumerate(hues):
        own = np.array([each == hue.label for each in labels])
        aside = _ASIDE * (number - 0.5 * (len(hues) - 1))
        place = (
            along.place[own] * (1.0 + 2.0 * aside)
            if along.is_log
            else along.place[own] + span * aside
        )
        _draw(axes, rows.where(own), place, scale, Hue(hue.colour, "", "") if is_named else hue)


def _draw(axes: Axes, rows: FigureData, place: FloatArray, scale: FigureScale, hue: Hue) -> None:
    order = np.argsort(place, kind="stable")
    mean, low, high = (
        rows[name][order] / scale.shown.divisor for name in ("mean", "low_95", "high_95")
    )
    spread = np.abs(
        np.stack(
            [
                mean - np.where(np.isfinite(low), low, mean),
                np.where(np.isfinite(high), high, mean) - mean,
            ]
        )
    )
    if scale.is_log:  # an interval that reaches 0 is cut below the axis
        spread[0] = np.minimum(spread[0], mean * (1.0 - 1e-6))
    axes.errorbar(
        place[order], mean, spread, fmt="none", ecolor=hue.colour, elinewidth=1.2, capsize=3
    )
    style: dict[str, Any] = {
        "linestyle": hue.dashes,
        "color": hue.colour,
        "marker": "o",
        "markersize": 4,
    }
    axes.plot(place[order], mean, **style)


def draw_requirements(
    axes: Axes, study: SavedStudy, figure: str, divisor: float, *, along_x: bool = False
) -> None:
    """Draw the lines of the study's requirements on a figure."""
    for each in study.requirements:
        if each["figure"] != figure:
            continue
        value = each["limit"] / divisor
        sign = "≥" if each["is_least"] else "≤"
        style: dict[str, Any] = {"color": INK, "linewidth": 1.0, "linestyle": (0, (2, 2))}
        if along_x:
            axes.axvline(value, **style)
            continue
        axes.axhline(value, **style)
        axes.annotate(
            f"required {sign} {number_words(value)}",
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
    first = study.short_labels(rows)[0] if len(rows) else ""
    rows = rows.where((rows["design"] > 0) & np.isfinite(rows["difference"]))
    if not len(rows):
        return without_data(axes, f"{figure}: no design to compare with the first")
    unit = study.units[figure]
    shown = shown_unit(unit, rows["difference"])
    place = -np.arange(len(rows), dtype=np.float64)
    middle, low, high = (
        rows[name] / shown.divisor
        for name in ("difference", "difference_low_95", "difference_high_95")
    )
    spread = np.abs(np.stack([middle - low, high - middle]))
    axes.axvline(0.0, color=MUTED, linewidth=1.0)
    axes.errorbar(
        middle,
        place,
        xerr=np.where(np.isfinite(spread), spread, 0.0),
        fmt="o",
        color=SERIES[0],
        capsize=3,
    )
    axes.set_yticks(place, study.short_labels(rows))
    axes.set_title(study.names())
    axes.set_ylim(place[-1] - 0.6, 0.6)
    axes.xaxis.set_major_formatter(FuncFormatter(lambda value, _place: number_words(value)))
    label = axis_label(
        f"{figure_words(figure, unit)}: difference from {first or 'the first design'}", shown.unit
    )
    part = study.shares_text(figure)
    axes.set_xlabel(f"{label}\n({part})" if part else label)
    axes.grid(axis="y", visible=False)
    return axes
