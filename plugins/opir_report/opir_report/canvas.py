"""Figures: their style, new axes, axes without data, and a figure as SVG text of the same bytes each time."""

import re
from collections.abc import Callable, Sequence
from io import StringIO
from typing import Any

import matplotlib
from matplotlib.axes import Axes
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.rcsetup import cycler

from opir_report.palette import GRID, INK, MUTED, PAPER, SERIES, Hue

#: Settings of matplotlib while a plot is drawn. Text stays text in SVG: it can be searched and scaled.
STYLE: Any = {
    "axes.axisbelow": True,
    "axes.edgecolor": MUTED,
    "axes.facecolor": "none",
    "axes.grid": True,
    "axes.labelcolor": INK,
    "axes.prop_cycle": cycler(color=SERIES),
    "axes.spines.right": False,
    "axes.spines.top": False,
    "axes.titlecolor": INK,
    "axes.titlelocation": "left",
    "axes.titlesize": 10,
    "figure.facecolor": PAPER,
    "font.family": "sans-serif",
    "font.sans-serif": ["DejaVu Sans"],
    "font.size": 9,
    "grid.color": GRID,
    "grid.linewidth": 0.6,
    "legend.edgecolor": GRID,
    "legend.facecolor": PAPER,
    "legend.framealpha": 0.85,
    "legend.labelcolor": INK,
    "legend.fontsize": 8,
    "lines.linewidth": 1.4,
    "svg.fonttype": "none",
    "text.color": INK,
    "xtick.color": MUTED,
    "xtick.labelcolor": INK,
    "ytick.color": MUTED,
    "ytick.labelcolor": INK,
}

#: Width of a figure over the text column of a page, inches.
WIDTH_IN = 8.6

_PLACES = re.compile(r"(-?\d+\.\d{2})\d+")
_GEOMETRY = re.compile(r' (?:d|x|y|width|height)="[^"]*"')
_IDS = re.compile(r' id="(?:figure|axes|patch|line2d|text|xtick|ytick|matplotlib\.axis|legend|Path|Poly)[^"]*"')
#: A style for every element: inside a page it would apply to the page.
_GLOBAL_STYLE = re.compile(r"\s*<defs>\s*<style[^>]*>.*?</style>\s*</defs>", re.DOTALL)
_METADATA = re.compile(r"\s*<metadata>.*?</metadata>", re.DOTALL)


def _layout() -> ConstrainedLayoutEngine:
    return ConstrainedLayoutEngine(w_pad=0.06, h_pad=0.06)


def new_axes(height_in: float) -> Axes:
    """Return the axes of a new figure of pyplot, which notebooks show and scripts save."""
    from matplotlib import pyplot

    with matplotlib.rc_context(STYLE):
        _, axes = pyplot.subplots(figsize=(WIDTH_IN, height_in), layout=_layout())
    return axes


def without_data(axes: Axes, words: str) -> Axes:
    """Write into empty axes why there is nothing to see."""
    axes.set_xticks([])
    axes.set_yticks([])
    axes.grid(False)
    for side in ("left", "bottom"):
        axes.spines[side].set_visible(False)
    axes.text(0.5, 0.5, words, transform=axes.transAxes, ha="center", va="center", color=MUTED, wrap=True)
    return axes


def legend_of(axes: Axes, hues: Sequence[Hue], marks: Sequence[Line2D] = (), **where: Any) -> None:
    """Draw a legend of the series' hues and of other marks."""
    lines = [Line2D([], [], color=hue.colour, linestyle=hue.dashes, label=hue.label) for hue in hues]
    axes.legend(handles=[*lines, *marks], **{"loc": "best", **where})


def svg_of(draw: Callable[[Figure], object], size_in: tuple[float, float], name: str, alt: str) -> str:
    """Return a figure as an `svg` element for a page: the same bytes each time, with ids of its own by `name`.

    `draw` draws into the figure; `alt` describes it to readers who do not see it.
    """
    stream = StringIO()
    with matplotlib.rc_context({**STYLE, "svg.hashsalt": name}):
        figure = Figure(figsize=size_in, layout=_layout())
        FigureCanvasSVG(figure)
        draw(figure)
        figure.savefig(stream, format="svg", metadata={"Date": None})
    text = stream.getvalue()
    text = _GLOBAL_STYLE.sub("", text)
    text = _METADATA.sub("", text[text.index("<svg") :].rstrip())
    text = _IDS.sub("", text)
    text = _GEOMETRY.sub(lambda found: _PLACES.sub(r"\1", found[0]), text)
    label = alt.replace("&", "&amp;").replace('"', "&quot;").replace("<", "&lt;")
    return text.replace("<svg ", f'<svg role="img" aria-label="{label}" ', 1)
