"""Figures: their style, new axes, axes without data, and a figure as SVG text of the same bytes
each time.
"""

import re
from collections.abc import Callable, Sequence
from inspect import isfunction
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
from matplotlib.path import Path
from matplotlib.rcsetup import cycler
from matplotlib.ticker import FuncFormatter, LogLocator, NullFormatter

from opir_core.notebook import html_view
from opir_report.palette import GRID, INK, MUTED, PAPER, SERIES, Hue
from opir_report.words import number_words

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

_RAISED = str.maketrans("-0123456789", "⁻⁰¹²³⁴⁵⁶⁷⁸⁹")
_PLACES = re.compile(r"(-?\d+\.\d{2})\d+")
#: Long outlines of coasts and regions: the letters and points of a path, and the codes of these.
_OUTLINE = re.compile(r' d="([MLz\s\d.-]{2000,})"')
_POINT = re.compile(r"([MLz])(?:\s+(-?[\d.]+) (-?[\d.]+))?")
_CODES = {"M": Path.MOVETO, "L": Path.LINETO, "z": Path.CLOSEPOLY}
#: How far a point of an outline may be moved, points of 1/72 inch.
_OUTLINE_TOLERANCE = 0.2
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


class Plots:
    """Plots as methods: the text of an object names them, a notebook shows what each draws."""

    def __repr__(self) -> str:
        """Return the names of the plots."""
        return f"<{type(self).__name__}: {', '.join(self._summaries())}>"

    def _repr_html_(self) -> str:
        """Return the plots with what they draw."""
        rows = list(self._summaries().items())
        return html_view(self, ("plot", "draws"), rows, len(rows))

    def _summaries(self) -> dict[str, str]:
        return {
            f"{name}()": " ".join(str(method.__doc__).partition("\n\n")[0].split())
            for name, method in vars(type(self)).items()
            if isfunction(method) and not name.startswith("_")
        }


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


def legend_entry(label: str, colour: str = INK, **style: Any) -> Line2D:
    """Return an entry of a legend."""
    return Line2D([], [], color=colour, label=label, **style)


def legend_of(axes: Axes, hues: Sequence[Hue], marks: Sequence[Line2D] = ()) -> None:
    """Draw a legend of the series' hues and of other marks above the axes."""
    lines = [legend_entry(hue.label, hue.colour, linestyle=hue.dashes) for hue in hues]
    legend_above(axes, [*lines, *marks])


def legend_beside(
    axes: Axes, hues: Sequence[Hue], title: str = "", *, is_shared: bool = False, marker: str = "o"
) -> None:
    """Draw a legend of series with marks above the axes, or above their figure."""
    lines = [
        legend_entry(hue.label, hue.colour, linestyle=hue.dashes or "", marker=marker, markersize=4)
        for hue in hues
    ]
    legend_above(axes, lines, title, is_shared=is_shared)


def legend_above(
    axes: Axes, lines: Sequence[Line2D], title: str = "", *, is_shared: bool = False
) -> None:
    """Draw a legend of lines above the axes, off the data, or above the figure if panels share it;
    a title of the axes moves up.
    """
    has_lines = any(line.get_linestyle() != "None" for line in lines)
    # Length of a line with dashes, or of a mark, in units of the font size, 8 pt.
    handle_length = 3.2 if has_lines else 1.2
    width_in = panel_width_in(axes, is_shared=is_shared) - 0.9
    columns = _legend_columns(lines, handle_length, width_in)
    style: dict[str, Any] = {"handles": lines, "ncols": columns, "handlelength": handle_length}
    if title:
        style |= {"title": title, "title_fontsize": 8, "alignment": "left"}
    if is_shared:
        axes.figure.legend(loc="outside upper left", **style)
        return
    axes.legend(loc="lower left", bbox_to_anchor=(0.0, 1.0), borderaxespad=0.3, **style)
    _lift_title(axes, rows=-(-len(lines) // columns) + bool(title))


def _lift_title(axes: Axes, rows: int) -> None:
    """Move the title of axes above the rows of a legend."""
    if axes.get_title("left"):
        axes.set_title(axes.get_title("left"), loc="left", pad=9.0 + 12.5 * rows)


def _legend_columns(lines: Sequence[Line2D], handle_length: float, width_in: float) -> int:
    """Return how many entries of a legend fit beside each other."""
    # An entry has gaps of 0.24 inches, a letter is 0.062 inches wide.
    letters = max(len(str(line.get_label())) for line in lines)
    entry_in = 0.24 + handle_length * 8.0 / 72.0 + 0.062 * letters
    return int(min(max(width_in // entry_in, 1), len(lines)))


def panel_width_in(axes: Axes, *, is_shared: bool = False) -> float:
    """Return the width of a figure, inches, divided by its columns of panels unless they share
    it.
    """
    figure = axes.figure
    panel = axes.get_subplotspec()
    columns = 1 if is_shared or panel is None else panel.get_geometry()[1]
    return float(figure.bbox.width / figure.dpi / columns)


def number_ticks(axis: Axis, *, is_log: bool) -> None:
    """Write the ticks of an axis as numbers to a few digits."""
    if is_log:
        log_ticks(axis)
    else:
        axis.set_major_formatter(FuncFormatter(lambda value, _place: number_words(value)))


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
        axis.set_major_formatter(FuncFormatter(_power_text))


def _power_text(value: float, _place: int | None) -> str:
    """Return `10⁻⁴` or `3×10⁻⁴`, as text: matplotlib would parse each as a formula."""
    exponent = int(np.floor(np.log10(value)))
    factor = f"{value / 10.0**exponent:.3g}"
    power = "10" + str(exponent).translate(_RAISED)
    return power if factor == "1" else f"{factor}×{power}"


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
        canvas: Any = FigureCanvasSVG(figure)
        draw(figure)
        # `savefig` would draw all once more before, for the layout.
        canvas.print_svg(stream, metadata={"Date": None})
    label = alt.replace("&", "&amp;").replace('"', "&quot;").replace("<", "&lt;")
    head = f'<svg role="img" aria-label="{label}" '
    return _shortened(stream.getvalue()).replace("<svg ", head, 1)


def _shortened(text: str) -> str:
    """Return the `svg` element of a file, without unused parts and with places to 2 decimals; long
    outlines have no more points than their shape needs.
    """
    text = _GLOBAL_STYLE.sub("", text)
    text = _METADATA.sub("", text[text.index("<svg") :].rstrip())
    text = _OUTLINE.sub(_simplified, _IDS.sub("", text))
    return _GEOMETRY.sub(lambda attribute: _PLACES.sub(r"\1", attribute[0]), text)


def _simplified(outline: re.Match[str]) -> str:
    """Return the attribute of an outline with fewer points, to 1 decimal."""
    points = _POINT.findall(outline[1])
    vertices = [(float(x or "0"), float(y or "0")) for _, x, y in points]
    path = Path(vertices, [_CODES[letter] for letter, _, _ in points])
    path.simplify_threshold = _OUTLINE_TOLERANCE
    segments = [
        f"{'M' if code == Path.MOVETO else 'L'}{vertex[0]:.1f} {vertex[1]:.1f}"
        for vertex, code in path.cleaned(simplify=True).iter_segments()
        if code != Path.STOP
    ]
    return f' d="{"".join(segments)}"'


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
