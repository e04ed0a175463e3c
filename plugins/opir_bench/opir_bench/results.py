"""Results of the bench: a table, and a plot of it."""

from collections.abc import Mapping, Sequence
from itertools import cycle
from pathlib import Path
from typing import Any

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray


@frozen(eq=False)
class BenchLine:
    """A line of a plot: label, abscissae and ordinates (n,); of bars starts and lengths."""

    label: str
    x: FloatArray
    y: FloatArray


@frozen(eq=False)
class BenchPlot:
    """A plot of lines, or of bars if it has `names`."""

    x_label: str
    y_label: str
    lines: Sequence[BenchLine]
    names: Sequence[str] = ()
    log_x: bool = False
    log_y: bool = False
    is_share: bool = False


@frozen(eq=False)
class BenchResult:
    """A table with a title, numbers as they are, and a plot."""

    title: str
    head: Sequence[str]
    rows: Sequence[Sequence[Any]]
    plot: BenchPlot
    notes: Sequence[str] = ()

    def plain(self) -> dict[str, Any]:
        """Return the result as plain data; numbers that are not finite are None."""
        rows = [dict(zip(self.head, map(_plain, row), strict=True)) for row in self.rows]
        return {"title": self.title, "rows": rows, "notes": list(self.notes)}

    def text(self) -> str:
        """Return the result as text."""
        from opir_core.cli import table

        cells = [
            [value if isinstance(value, str) else _number(value) for value in row]
            for row in self.rows
        ]
        numbers = [
            place
            for place in range(len(self.head))
            if self.rows and not isinstance(self.rows[0][place], str)
        ]
        return "\n".join([self.title, table(self.head, cells, numbers=numbers), *self.notes])


def bars(names: Sequence[str], label: str, lengths: Mapping[str, FloatArray]) -> BenchPlot:
    """Return the plot of bars from 0: the `lengths` (n,) of each series by name of the bar."""
    starts = np.zeros(len(names))
    lines = [BenchLine(series, starts, length) for series, length in lengths.items()]
    return BenchPlot("", label, lines, names)


def _plain(value: Any) -> Any:
    if isinstance(value, str):
        return value
    number = float(value)
    return number if np.isfinite(number) else None


def _number(value: Any) -> str:
    return f"{float(value):.4g}" if np.isfinite(value) else "-"


def write_plot(result: BenchResult, path: Path, kind: str) -> None:
    """Draw the plot of a result into a file: a `png`, `svg` or `pdf`."""
    import matplotlib
    from matplotlib.backends.backend_agg import FigureCanvasAgg
    from matplotlib.figure import Figure
    from opir_report import STYLE

    with matplotlib.rc_context(STYLE):
        figure = Figure(figsize=(6.6, 4.2), layout="constrained", dpi=150)
        FigureCanvasAgg(figure)
        axes = figure.add_subplot()
        _draw(axes, result.plot)
        axes.set_title(result.title, wrap=True)
        figure.savefig(path, format=kind)


def _draw(axes: Any, plot: BenchPlot) -> None:
    if plot.names:
        _draw_bars(axes, plot)
    else:
        _draw_lines(axes, plot)
    if len(plot.lines) > 1:
        axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False)


def _draw_lines(axes: Any, plot: BenchPlot) -> None:
    from opir_report import DASHES, SERIES

    for line, hue, dashes in zip(plot.lines, cycle(SERIES), cycle(DASHES), strict=False):
        axes.plot(line.x, line.y, color=hue, linestyle=dashes, label=line.label)
    axes.set(
        xlabel=plot.x_label,
        ylabel=plot.y_label,
        xscale="log" if plot.log_x else "linear",
        yscale="log" if plot.log_y else "linear",
    )
    if plot.is_share:
        axes.set_ylim(-0.02, 1.02)


def _draw_bars(axes: Any, plot: BenchPlot) -> None:
    """Draw bars beside one another, from the top down, named at the left."""
    from opir_report import MUTED, SERIES

    height = 0.8 / len(plot.lines)
    place = np.arange(len(plot.names))
    styles = zip(cycle(SERIES), cycle(("", "//", "..", "xx", "\\\\", "++")), strict=False)
    for number, (line, (hue, hatch)) in enumerate(zip(plot.lines, styles, strict=False)):
        axes.barh(
            place + (number - 0.5 * (len(plot.lines) - 1)) * height,
            line.y,
            left=line.x,
            height=0.9 * height,
            label=line.label,
            edgecolor="white",
            color=hue,
            hatch=hatch,
        )
    axes.set(xlabel=plot.y_label, xscale="log" if plot.log_y else "linear")
    axes.set_yticks(place, list(plot.names))
    if not plot.log_y:
        axes.axvline(0.0, color=MUTED, linewidth=1.0)
    axes.invert_yaxis()
    axes.grid(visible=False, axis="y")
