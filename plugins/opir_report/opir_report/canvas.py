"""Figures: their style, new axes, axes without data, and a figure as SVG text of the same bytes
each time.
"""

import re
from collections.abc import Callable, Sequence
from io import BytesIO, StringIO
from typing import Any

import matplotlib
import numpy as np
from matplotlib.axes import Axes
from matplotlib.axis import Axis
from matplotlib.backends.backend_svg import FigureCanvasSVG
from matplotlib.figure import Figure
from matplotlib.layout_engine import ConstrainedLayoutEngine
from matplotlib.lines import Line2D
from matplotlib.rcsetup import cycler
from matplotlib.ticker import FuncFormatter, LogFormatterSciNotation, LogLocator, NullFormatter

from opir_report.palette import GRID, INK, MUTED, PAPER, SERIES, Hue

#: Settings of matplotlib while a plot is drawn. Text stays text in SVG: it can be searched and
#: scaled.
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

#: Width of a figure over the text column of a page, inches, and of a file for a paper: two columns
#: of a journal.
WIDTH_IN = 8.6
PRINT_WIDTH_IN = 7.2

_PLACES = re.compile(r"(-?\d+\.\d{2})\d+")
_GEOMETRY = re.compile(r' (?:d|x|y|width|height)="[^"]*"')
_IDS = re.compile(
    r' id="(?:figure|axes|patch|line2d|text|xtick|ytick|matplotlib\.axis|legend|Path|Poly)[^"]*"'
)
#: A style for every element: inside a page it would apply to the page.
_GLOBAL_STYLE = re.compile(r"\s*<defs>\s*<style[^>]*>.*?</style>\s*</defs>", re.DOTALL)
_METADATA = re.compile(r"\s*<metadata>.*?</metadata>", re.DOTALL)


def new_layout() -> ConstrainedLayoutEngine:
    """Return the layout of figures."""
    return ConstrainedLayoutEngine(w_pad=0.06, h_pad=0.06)


def new_axes(height_in: float) -> Axes:
    """Return the axes of a new figure of pyplot, which notebooks show and scripts save."""
    from matplotlib import pyplot

    with matplotlib.rc_context(STYLE):
        _, axes = pyplot.subplots(figsize=(WIDTH_IN, height_in), layout=new_layout())
    return axes


def without_data(axes: Axes, words: str) -> Axes:
    """Write into empty axes why there is nothing to see."""
    axes.set_xticks([])
    axes.set_yticks([])
    axes.grid(False)
    for side in ("left", "bottom"):
        axes.spines[side].set_visible(False)
    axes.text(
        0.5, 0.5, words, transform=axes.transAxes, ha="center", va="center", color=MUTED, wrap=True
    )
    return axes


#: Widths of a letter and of the gaps of an entry in a legend, inches; height of a row, points.
_LETTER_IN = 0.062
_GAPS_IN = 0.24
_ROW_PT = 12.5
#: Lengths of a line with dashes and of a mark alone in a legend, in units of its font size, and of
#: that size in inches.
_LINE_LENGTH = 3.2
_MARK_LENGTH = 1.2
_FONT_IN = 8.0 / 72.0


def legend_of(axes: Axes, hues: Sequence[Hue], marks: Sequence[Line2D] = ()) -> None:
    """Draw a legend of the series' hues and of other marks above the axes."""
    lines = [
        Line2D([], [], color=hue.colour, linestyle=hue.dashes, label=hue.label) for hue in hues
    ]
    legend_above(axes, [*lines, *marks])


def legend_beside(
    axes: Axes, hues: Sequence[Hue], title: str = "", *, whole: bool = False, marker: str = "o"
) -> None:
    """Draw a legend of series with marks above the axes, or above their whole figure."""
    lines = [
        Line2D(
            [],
            [],
            color=hue.colour,
            linestyle=hue.dashes or "",
            marker=marker,
            markersize=4,
            label=hue.label,
        )
        for hue in hues
    ]
    legend_above(axes, lines, title, whole=whole)


def legend_above(
    axes: Axes, lines: Sequence[Line2D], title: str = "", *, whole: bool = False
) -> None:
    """Draw a legend of lines above the axes, off the data, or above the whole figure; a title of
    the axes moves up.
    """
    figure = axes.figure
    part = axes.get_subplotspec()
    panels = 1 if whole or part is None else part.get_geometry()[1]
    width_in = figure.bbox.width / figure.dpi / panels - 0.9
    has_lines = any(line.get_linestyle() != "None" for line in lines)
    handle = _LINE_LENGTH if has_lines else _MARK_LENGTH
    longest_in = (
        _GAPS_IN
        + _FONT_IN * handle
        + _LETTER_IN * max(len(str(line.get_label())) for line in lines)
    )
    columns = int(min(max(width_in // longest_in, 1), len(lines)))
    style: dict[str, Any] = {"handles": lines, "ncols": columns, "handlelength": handle}
    if title:
        style |= {"title": title, "title_fontsize": 8, "alignment": "left"}
    if whole:
        figure.legend(loc="outside upper left", **style)
        return
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.3, **style)
    if axes.get_title("left"):
        rows = -(-len(lines) // columns) + bool(title)
        axes.set_title(axes.get_title("left"), loc="left", pad=9.0 + _ROW_PT * rows)


def log_ticks(axis: Axis) -> None:
    """Write the ticks of a logarithmic axis as numbers, or as powers of ten where they span many
    decades.
    """
    low, high = sorted(axis.get_view_interval())
    decades = float(np.log10(high / low))
    digits = (1.0,) if decades > 2.5 else (1.0, 3.0) if decades > 1.2 else (1.0, 2.0, 5.0)
    axis.set_major_locator(LogLocator(subs=digits, numticks=12))
    axis.set_minor_locator(LogLocator(subs=tuple(np.arange(1.0, 10.0)), numticks=200))
    axis.set_minor_formatter(NullFormatter())
    if low >= 1e-3 and high <= 1e6:
        axis.set_major_formatter(
            FuncFormatter(
                lambda value, _place: f"{value:,.10g}".replace(",", "\N{NARROW NO-BREAK SPACE}")
            )
        )
    else:
        axis.set_major_formatter(LogFormatterSciNotation())


def svg_of(
    draw: Callable[[Figure], object], size_in: tuple[float, float], name: str, alt: str
) -> str:
    """Return a figure as an `svg` element for a page: the same bytes each time, with ids of its own
    by `name`.

    `draw` draws into the figure; `alt` describes it to readers who do not see it.
    """
    stream = StringIO()
    with matplotlib.rc_context({**STYLE, "svg.hashsalt": name}):
        figure = Figure(figsize=size_in, layout=new_layout())
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


def print_bytes(draw: Callable[[Figure], object], height_in: float, form: str) -> bytes:
    """Return a figure as a file for a paper, `png`, `svg` or `pdf`: fonts of 8 pt or more at the
    width of the page.
    """
    stream = BytesIO()
    with matplotlib.rc_context(
        {**STYLE, "svg.hashsalt": "opir", "svg.fonttype": "path", "pdf.fonttype": 42}
    ):
        figure = Figure(figsize=(PRINT_WIDTH_IN, height_in), layout=new_layout())
        draw(figure)
        undated = {"svg": {"Date": None}, "pdf": {"CreationDate": None}}.get(
            form, {"Software": None}
        )
        figure.savefig(stream, format=form, dpi=200, metadata=undated)
    return stream.getvalue()
