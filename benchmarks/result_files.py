"""Results of a benchmark as files: a tidy CSV table, an SVG plot and a Markdown table."""

import csv
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from pathlib import Path
from typing import Any

#: Colours that colour-blind readers can tell apart (Okabe and Ito, 2008).
BLUE, ORANGE, GREEN, RED, PURPLE, SKY, GREY = (
    "#0072B2",
    "#E69F00",
    "#009E73",
    "#D55E00",
    "#CC79A7",
    "#56B4E9",
    "#666666",
)
CLASS_COLOURS = {"SRBM": BLUE, "IRBM": ORANGE, "ICBM": GREEN}
CLASS_MARKERS = {"SRBM": "o", "IRBM": "s", "ICBM": "^"}

Row = Mapping[str, str]


def write_csv(path: Path, rows: Sequence[Row]) -> None:
    """Write rows, all with the same columns, as UTF-8 with one header line."""
    with path.open("w", encoding="utf-8", newline="") as file:
        writer = csv.DictWriter(file, list(rows[0]), lineterminator="\n")
        writer.writeheader()
        writer.writerows(rows)


def read_csv(path: Path) -> list[dict[str, str]]:
    """Return the rows of a CSV file."""
    with path.open(encoding="utf-8", newline="") as file:
        return list(csv.DictReader(file))


def number(cell: str) -> float:
    """Return the value of a cell, nan of an empty one."""
    return float(cell) if cell else float("nan")


def column(rows: Iterable[Row], name: str) -> list[float]:
    """Return the values of a column."""
    return [number(row[name]) for row in rows]


def estimate(row: Row, name: str, unit: str = "") -> str:
    """Return a figure with its 95 % interval (columns `<name>_low95`, `<name>_high95`), a dash
    where it is empty.
    """
    if not row[name]:
        return "–"
    low = row[f"{name}_low95"]
    high = row[f"{name}_high95"]
    return f"{row[name]}{unit} [{low}, {high}]" if low else f"{row[name]}{unit}"


def markdown_table(head: Sequence[str], rows: Iterable[Sequence[str]]) -> str:
    """Return a Markdown table."""
    lines = (f"| {' | '.join(cells)} |" for cells in (head, *rows))
    return "\n".join([next(lines), "|" + "---|" * len(head), *lines])


@contextmanager
def svg_plot(path: Path, *shape: int, **settings: Any) -> Iterator[tuple[Any, Any]]:
    """Give a figure and its axes, as `matplotlib.pyplot.subplots` does, and save it as a
    reproducible SVG file.
    """
    import matplotlib

    matplotlib.use("svg")
    matplotlib.rcParams.update({"svg.hashsalt": "opir", "svg.fonttype": "none"})
    from matplotlib import pyplot

    figure, axes = pyplot.subplots(*shape, layout="constrained", **settings)
    yield figure, axes
    figure.savefig(path, metadata={"Date": None})
    pyplot.close(figure)
