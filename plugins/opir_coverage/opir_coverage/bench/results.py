"""What the bench finds: a table, and a plot of it."""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray


@frozen(eq=False)
class BenchLine:
    """A line of a plot: its label, abscissae and ordinates (n,); of bars the starts and the
    lengths.
    """

    label: str
    x: FloatArray
    y: FloatArray


@frozen(eq=False, kw_only=True)
class BenchPlot:
    """A plot of lines, or of bars by name where `names` are given; `levels` are marked across it,
    with labels.
    """

    x_label: str
    y_label: str
    lines: Sequence[BenchLine]
    names: Sequence[str] = ()
    log_x: bool = False
    log_y: bool = False
    is_share: bool = False
    levels: Sequence[tuple[float, str]] = ()
    spans: Sequence[tuple[float, float, str]] = ()


@frozen(eq=False, kw_only=True)
class BenchResult:
    """A table with a title, numbers as they are, and a plot."""

    title: str
    head: Sequence[str]
    rows: Sequence[Sequence[Any]]
    plot: BenchPlot
    notes: Sequence[str] = ()

    def plain(self) -> dict[str, Any]:
        """Return the result as plain data; what is not finite is None."""
        rows = [dict(zip(self.head, map(_plain, row), strict=True)) for row in self.rows]
        return {"title": self.title, "rows": rows, "notes": list(self.notes)}

    def text(self) -> str:
        """Return the result as text."""
        from opir_core.cli import table

        cells = [
            [each if isinstance(each, str) else _number(each) for each in row] for row in self.rows
        ]
        numbers = [
            place
            for place in range(len(self.head))
            if self.rows and not isinstance(self.rows[0][place], str)
        ]
        return "\n".join([self.title, table(self.head, cells, numbers=numbers), *self.notes])


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
    from opir_report import DASHES, MUTED, SERIES

    if plot.names:
        _draw_bars(axes, plot)
    else:
        for number, line in enumerate(plot.lines):
            hue = SERIES[number % len(SERIES)]
            dashes = DASHES[number % len(DASHES)]
            axes.plot(line.x, line.y, color=hue, linestyle=dashes, label=line.label)
    for value, words in plot.levels:
        axes.axhline(value, color=MUTED, linewidth=1.0, linestyle=":", label=words)
    for number, (low, high, words) in enumerate(plot.spans):
        axes.axvspan(low, high, color=SERIES[number % len(SERIES)], alpha=0.18, label=words)
    if plot.names:
        axes.set(xlabel=plot.y_label, xscale="log" if plot.log_y else "linear")
    else:
        scales = {
            "xscale": "log" if plot.log_x else "linear",
            "yscale": "log" if plot.log_y else "linear",
        }
        axes.set(xlabel=plot.x_label, ylabel=plot.y_label, **scales)
        if plot.is_share:
            axes.set_ylim(-0.02, 1.02)
    if len(plot.lines) > 1 or plot.levels or plot.spans:
        axes.legend(loc="upper left", bbox_to_anchor=(1.01, 1.0), frameon=False)


def _draw_bars(axes: Any, plot: BenchPlot) -> None:
    """Draw bars beside one another, from the top down, named at the left."""
    from opir_report import MUTED, SERIES

    deep = 0.8 / len(plot.lines)
    place = np.arange(len(plot.names))
    hatches = ("", "//", "..", "xx", "\\\\", "++")
    for number, line in enumerate(plot.lines):
        at = place + (number - 0.5 * (len(plot.lines) - 1)) * deep
        style: dict[str, Any] = {
            "color": SERIES[number % len(SERIES)],
            "hatch": hatches[number % len(hatches)],
        }
        axes.barh(
            at, line.y, left=line.x, height=0.9 * deep, label=line.label, edgecolor="white", **style
        )
    axes.set_yticks(place, list(plot.names))
    if not plot.log_y:
        axes.axvline(0.0, color=MUTED, linewidth=1.0)
    axes.invert_yaxis()
    axes.grid(visible=False, axis="y")
