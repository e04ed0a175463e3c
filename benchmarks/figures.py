"""Figures of a benchmark: read from the files that it writes, or kept one by one; and their ratios
to others.

A script without a CSV file calls `keep("columns", 240.0, "ns/look")` for what is worth comparing.
Without the suite, which names a file in `OPIR_BENCHMARK_FIGURES`, that does nothing.
"""

import csv
import json
import os
import re
from pathlib import Path

Figures = dict[str, float]

#: A number, with spaces between groups of three digits, followed by nothing or by a unit.
_NUMBER = re.compile(r"[-+−]?\d+(?: \d{3})*(?:\.\d+)?(?:[eE][-+]?\d+)?(?=$|[ %\[])")
_RULE = re.compile(r"^\|[-:| ]+\|$")


def keep(name, value, unit=""):
    """Keep a figure for the suite that runs this script, if one does."""
    path = os.environ.get("OPIR_BENCHMARK_FIGURES")
    if path:
        with Path(path).open("a", encoding="utf-8") as file:
            file.write(json.dumps([f"{name}, {unit}" if unit else name, float(value)]) + "\n")


def kept_figures(path):
    """Return the figures that a script kept."""
    lines = path.read_text("utf-8").splitlines() if path.exists() else []
    return dict(json.loads(line) for line in lines)


def figures_in(folder):
    """Return the figures of the CSV files in a folder, or else of the tables of its pages, by file,
    row and column.
    """
    figures = {}
    for path in sorted(folder.glob("*.csv")):
        lines = [line for line in path.read_text("utf-8").splitlines() if not line.startswith("#")]
        figures |= table_figures(path.stem, list(csv.reader(lines)))
    if not figures:
        for path in sorted(folder.glob("*.md")):
            for table in markdown_tables(path.read_text("utf-8")):
                figures |= table_figures(path.stem, table)
    return figures


def markdown_tables(text):
    """Yield the tables of a page, each its header and rows."""
    table = []
    for line in [*text.splitlines(), ""]:
        if not line.startswith("|"):
            if table:
                yield table
            table = []
        elif not _RULE.match(line):
            table.append([cell.strip(" *") for cell in line.strip("|").split("|")])


def table_figures(title, table):
    """Return the numbers of a table, named by the text of their row, the first number if need be,
    and the column.
    """
    head, *rows = table
    numbers = [
        {n: value for n, cell in enumerate(row) if (value := number_of(cell)) is not None}
        for row in rows
    ]
    labels = [
        " ".join(cell for n, cell in enumerate(row) if n not in cells)
        for row, cells in zip(rows, numbers, strict=True)
    ]
    if len({*labels}) < len(labels) or not all(labels):
        first = [row[min(cells, default=0)] for row, cells in zip(rows, numbers, strict=True)]
        labels = [f"{label} {cell}".strip() for label, cell in zip(labels, first, strict=True)]
    figures = {}
    for place, (label, cells) in enumerate(zip(labels, numbers, strict=True)):
        number = f" ({place})" if label in labels[:place] else ""
        figures |= {f"{title}: {label}{number}: {head[n]}": value for n, value in cells.items()}
    return figures


def number_of(cell):
    """Return the number that a cell begins with, None without one."""
    match = _NUMBER.match(cell.strip())
    return float(match[0].replace(" ", "").replace("−", "-")) if match else None


def ratios(figures, reference):
    """Return the ratios to all reference figures of the same name that are not zero."""
    return {name: value / reference[name] for name, value in figures.items() if reference.get(name)}
