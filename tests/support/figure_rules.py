"""The rules of figures: what of a drawn figure of matplotlib breaks them, in words."""

from itertools import combinations

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.collections import LineCollection, PolyCollection
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.legend import Legend
from matplotlib.patches import StepPatch
from matplotlib.text import Text
from matplotlib.transforms import Bbox
from opir_report.canvas import PRINT_WIDTH_IN, STYLE, WIDTH_IN, new_layout

#: Pixels by which text may stick out or overlap, for what fonts measure larger than they draw.
_SLACK = 1.5
#: The smallest font, points.
_SMALLEST_PT = 7.9
#: The least share of an axis that its data use.
_LEAST_SHARE = 0.25


def drawn_complaints(picture):
    """Return what is wrong with a figure of a report, on the page and at the width of a paper."""
    result = []
    for width_in in (WIDTH_IN, PRINT_WIDTH_IN):
        with matplotlib.rc_context(STYLE):
            figure = Figure(figsize=(width_in, picture.height_in), layout=new_layout())
            FigureCanvasAgg(figure)
            picture.draw(figure)
            result += [f"{picture.name}, {width_in} in: {line}" for line in broken_rules(figure)]
    return result


def broken_rules(figure):
    """Return what is wrong with a figure, nothing for a good one; it is drawn first."""
    figure.canvas.draw()
    result = [*_text_rules(figure)]
    for axes in figure.findobj(Axes):
        if axes.get_visible() and axes.axison:
            result += [*_axis_rules(axes), *_interval_rules(axes)]
    result += [line for legend in figure.findobj(Legend) for line in _legend_rules(figure, legend)]
    return result


def _texts(figure):
    renderer = figure.canvas.get_renderer()
    hidden = {id(text) for axes in figure.findobj(Axes) for text in _hidden(axes)}
    shown = [
        text for text in figure.findobj(Text) if text.get_visible() and text.get_text().strip()
    ]
    return [(text, text.get_window_extent(renderer)) for text in shown if id(text) not in hidden]


def _hidden(axes):
    """Yield the labels of ticks that are not drawn: those outside the view, and all of axes that
    are off.
    """
    for axis in (axes.xaxis, axes.yaxis):
        is_off = not axes.get_visible() or not axes.axison
        drawn = set() if is_off else {id(tick) for tick in axis._update_ticks()}  # no public way
        for tick in (*axis.get_major_ticks(), *axis.get_minor_ticks()):
            if id(tick) not in drawn:
                yield from (tick.label1, tick.label2)
        if is_off:
            yield axis.label


def _text_rules(figure):
    width = figure.bbox.width
    height = figure.bbox.height
    texts = _texts(figure)
    for text, box in texts:
        if (
            box.x0 < -_SLACK
            or box.y0 < -_SLACK
            or box.x1 > width + _SLACK
            or box.y1 > height + _SLACK
        ):
            yield f"{text.get_text()!r} is cut by the edge"
        if text.get_fontsize() < _SMALLEST_PT:
            yield f"{text.get_text()!r} has {text.get_fontsize():g} pt"
    for (label, box), (second_label, second) in combinations(texts, 2):
        overlap = (
            min(box.x1, second.x1) - max(box.x0, second.x0),
            min(box.y1, second.y1) - max(box.y0, second.y0),
        )
        is_level = not label.get_rotation() % 90.0 and not second_label.get_rotation() % 90.0
        if is_level and label.get_text() != second_label.get_text() and min(overlap) > 2.0 * _SLACK:
            yield f"{label.get_text()!r} is printed over {second_label.get_text()!r}"


def _axis_rules(axes):
    for name, axis, values in (("x", axes.xaxis, 0), ("y", axes.yaxis, 1)):
        if axis.get_offset_text().get_text():
            yield f"the {name} axis has the offset {axis.get_offset_text().get_text()}"
        low, high = sorted(axis.get_view_interval())
        if axis.get_scale() == "log":
            places = zip(axis.get_majorticklocs(), axis.get_ticklabels(), strict=False)
            written = [
                text.get_text()
                for place, text in places
                if low <= place <= high and text.get_text()
            ]
            if len(written) < 2 and any(text.get_visible() for text in axis.get_ticklabels()):
                yield f"the logarithmic {name} axis has {len(written)} labels"
        shared = (
            axes.get_shared_x_axes() if values == 0 else axes.get_shared_y_axes()
        ).get_siblings(axes)
        data = np.concatenate([_data(panel, values) for panel in shared])
        if len(data) and axes.get_aspect() != 1.0:
            span = axis.get_transform().transform(np.array([data.min(), data.max(), low, high]))
            share = (min(span[1], span[3]) - max(span[0], span[2])) / (span[3] - span[2])
            if 0.0 < share < _LEAST_SHARE:
                yield f"the data use {share:.0%} of the {name} axis"


def _data(axes, column):
    """Return the values along x or y of lines in data coordinates, without lines across the
    axes.
    """
    lines = [
        line
        for line in axes.lines
        if line.get_transform() == axes.transData and len(line.get_xdata()) > 0
    ]
    line_data = [np.asarray(line.get_xydata(), dtype=np.float64)[:, column] for line in lines]
    bars = [
        np.concatenate(collection.get_segments())[:, column]
        for collection in axes.collections
        if isinstance(collection, LineCollection) and collection.get_segments()
    ]
    # Bands of intervals are data too.
    line_data += [
        path.vertices[:, column]
        for collection in axes.collections
        if isinstance(collection, PolyCollection) and collection.get_transform() == axes.transData
        for path in collection.get_paths()
    ]
    patches = [
        box.get_points()[:, column]
        for box in (
            collection.get_extents().transformed(axes.transData.inverted())
            for collection in axes.patches
        )
    ]
    data = (
        np.concatenate([*line_data, *bars, *patches])
        if line_data or bars or patches
        else np.empty(0)
    )
    return data[
        np.isfinite(data)
        & (
            (data > 0.0)
            | (axes.get_xscale() != "log" if column == 0 else axes.get_yscale() != "log")
        )
    ]


def _interval_rules(axes):
    for name, scale, column in (("x", axes.get_xscale(), 0), ("y", axes.get_yscale(), 1)):
        for collection in axes.collections:
            if scale == "log" and isinstance(collection, LineCollection):
                ends = np.concatenate([*collection.get_segments(), np.ones((1, 2))])[:, column]
                if np.any(ends <= 0.0):
                    yield f"an interval reaches 0 on the logarithmic {name} axis"


def _legend_rules(figure, legend):
    axes = [legend.axes] if legend.axes is not None else figure.findobj(Axes)
    box = legend.get_window_extent()
    if (
        box.x1 > figure.bbox.width + _SLACK
        or box.x0 < -_SLACK
        or box.y1 > figure.bbox.height + _SLACK
    ):
        yield "the legend is cut by the edge"
    for patch in axes:
        for line in patch.lines:
            points = _drawn_points(line)
            covered = _covered(Bbox.intersection(box, patch.bbox), points)
            if len(points) and covered and line.get_transform() == patch.transData:
                yield f"the legend covers {covered} points of a line"
                break
    drawn = {(_colour(line), _dashes(line)) for patch in axes for line in patch.lines}
    drawn |= {
        (to_hex(patch.get_edgecolor()), None)
        for panel in axes
        for patch in panel.patches
        if isinstance(patch, StepPatch)
    }
    for handle in legend.legend_handles:
        if (
            hasattr(handle, "get_linestyle")
            and hasattr(handle, "get_xdata")
            and handle.get_linestyle() not in ("None", "", " ")
        ):
            styles = [dashes for colour, dashes in drawn if colour == _colour(handle)]
            if styles and _dashes(handle) not in styles:
                yield f"the legend's line {handle.get_label()!r} has other dashes than that of the plot"


def _drawn_points(line):
    """Return the places of a line, pixels, also between its points where they are joined."""
    points = line.get_transform().transform(np.asarray(line.get_xydata(), dtype=np.float64))
    if len(points) < 2 or line.get_linestyle() in ("None", "", " "):
        return points
    share = np.linspace(0.0, 1.0, 8)[None, :, None]
    return (points[:-1, None] * (1.0 - share) + points[1:, None] * share).reshape(-1, 2)


def _covered(box, points):
    if box is None:
        return 0
    inside = (
        (points[:, 0] > box.x0)
        & (points[:, 0] < box.x1)
        & (points[:, 1] > box.y0)
        & (points[:, 1] < box.y1)
    )
    return int(np.count_nonzero(inside))


def _colour(line):
    return to_hex(line.get_color())


def _dashes(line):
    pattern = line._unscaled_dash_pattern
    return None if pattern[1] is None else tuple(np.round(pattern[1], 3))
