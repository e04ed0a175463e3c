"""Effect plots of a study: the mean of a figure with its interval, over one of the settings that vary."""

import numpy as np
from attrs import frozen
from matplotlib.axes import Axes

from opir_core.arrays import FloatArray
from opir_report.canvas import legend_of, without_data
from opir_report.figure_data import FigureData
from opir_report.palette import MUTED, SERIES, series_hue
from opir_report.saved_study import SavedStudy, level_text

#: Values over a wider range than this have a logarithmic axis.
_WIDE = 8.0
#: Series with a line of their own; more are drawn as points of one colour.
_SERIES_SHOWN = 12
#: How far apart series are, as a share of the axis.
_ASIDE = 0.01


@frozen(eq=False)
class EffectAxis:
    """What lies along an effect plot: a path that varies, the places of its values, and their labels or None."""

    path: str
    place: FloatArray
    labels: list[str] | None
    is_log: bool


def usual_path(study: SavedStudy, rows: FigureData) -> str | None:
    """Return the path along which a figure is drawn: that with the most values, numbers before names."""

    def rank(path: str) -> tuple[bool, int]:
        return rows[path].dtype.kind in "if", len(set(rows[path].tolist()))

    return max(study.paths, key=rank) if study.paths else None


def _axis(study: SavedStudy, rows: FigureData, path: str | None) -> EffectAxis:
    if path is None:
        return EffectAxis("", np.zeros(len(rows)), [""], False)
    values = rows[path]
    if values.dtype.kind in "if":
        numbers = values.astype(np.float64)
        is_log = bool(numbers.min() > 0.0 and numbers.max() / numbers.min() >= _WIDE)
        return EffectAxis(path, numbers, None, is_log)
    names = list(dict.fromkeys(values.tolist()))
    return EffectAxis(path, np.array([names.index(value) for value in values.tolist()], dtype=np.float64), names, False)


def effect_plot(axes: Axes, study: SavedStudy, figure: str, path: str | None = None) -> Axes:
    """Draw the mean of a figure with its 95 % interval over a path, a series for each setting of the other paths."""
    rows = study.rows(figure)
    rows = rows.where(np.isfinite(rows["mean"]))
    if not len(rows):
        return without_data(axes, f"{figure}: no design has a value")
    along = _axis(study, rows, path if path is not None else usual_path(study, rows))
    others = [each for each in study.paths if each != along.path]
    series = study.labels(rows, others)
    names = list(dict.fromkeys(series))
    if len(names) > _SERIES_SHOWN:
        _draw(axes, rows, along.place, SERIES[0], "")
        axes.set_title(f"{len(rows)} designs; other settings vary too")
    else:
        _draw_series(axes, rows, along, series, names)
    unit = study.units[figure]
    axes.set_ylabel(f"{figure.removesuffix(f'_{unit}')}, {unit}" if unit else figure)
    axes.set_xlabel(study.short(along.path))
    if along.is_log:
        axes.set_xscale("log")
        ticks = sorted(set(along.place.tolist()))
        if len(ticks) <= 8:
            axes.set_xticks(ticks, [level_text(each) for each in ticks])
            axes.minorticks_off()
    if along.labels is not None:
        axes.set_xticks(np.arange(len(along.labels)), [name[:24] for name in along.labels])
        axes.margins(x=0.15)
    return axes


def _draw_series(axes: Axes, rows: FigureData, along: EffectAxis, series: list[str], names: list[str]) -> None:
    """Draw each series with a line, a little apart from the others where values are names."""
    hues = [series_hue(number, name) for number, name in enumerate(names)]
    is_named = along.labels is not None
    # Equal means would hide each other; on a logarithmic axis they are moved by a share of their place.
    span = 8.0 if is_named else float(np.ptp(along.place)) or 1.0
    for number, (name, hue) in enumerate(zip(names, hues, strict=True)):
        own = np.array([each == name for each in series])
        aside = _ASIDE * (number - 0.5 * (len(names) - 1))
        place = along.place[own] * (1.0 + 2.0 * aside) if along.is_log else along.place[own] + span * aside
        _draw(axes, rows.where(own), place, hue.colour, "" if is_named else hue.dashes)
    if len(names) > 1:
        legend_of(axes, hues)


def _draw(axes: Axes, rows: FigureData, place: FloatArray, colour: str, dashes: object) -> None:
    order = np.argsort(place, kind="stable")
    mean = rows["mean"][order]
    low, high = (np.where(np.isfinite(rows[name][order]), rows[name][order], mean) for name in ("low_95", "high_95"))
    spread = np.abs(np.stack([mean - low, high - mean]))
    axes.errorbar(place[order], mean, spread, fmt="none", ecolor=colour, elinewidth=1.2, capsize=3)
    style = {"linestyle": dashes, "color": colour, "marker": "o", "markersize": 4}
    axes.plot(place[order], mean, **style)  # type: ignore[arg-type]


def difference_plot(axes: Axes, study: SavedStudy, figure: str) -> Axes:
    """Draw how much each design differs from the first one: paired over runs, with the 95 % interval."""
    rows = study.rows(figure)
    rows = rows.where((rows["design"] > 0) & np.isfinite(rows["difference"]))
    if not len(rows):
        return without_data(axes, f"{figure}: no design to compare with the first")
    place = -np.arange(len(rows), dtype=np.float64)
    middle = rows["difference"]
    spread = np.abs(np.stack([middle - rows["difference_low_95"], rows["difference_high_95"] - middle]))
    axes.axvline(0.0, color=MUTED, linewidth=1.0)
    axes.errorbar(middle, place, xerr=np.where(np.isfinite(spread), spread, 0.0), fmt="o", color=SERIES[0], capsize=3)
    axes.set_yticks(place, study.labels(rows))
    axes.set_ylim(place[-1] - 0.6, 0.6)
    unit = study.units[figure]
    name = figure.removesuffix(f"_{unit}") if unit else figure
    axes.set_xlabel(f"{name} minus that of {study.labels(study.rows(figure))[0]}{f', {unit}' if unit else ''}")
    axes.grid(axis="y", visible=False)
    return axes
