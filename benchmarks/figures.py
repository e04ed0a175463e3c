"""Figures of a benchmark: read from the files that it writes, or kept one by one; and their ratios
to others.

A script without a CSV file calls `keep("columns", 240.0, "ns/look")` for what is worth comparing.
Without the suite, which names a file in `OPIR_BENCHMARK_FIGURES`, that does nothing.
"""

import csv
import json
import os
import re
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

Figures = dict[str, float]

#: A number, with spaces between groups of three digits, followed by nothing or by a unit.
_NUMBER = re.compile(r"[-+−]?\d+(?: \d{3})*(?:\.\d+)?(?:[eE][-+]?\d+)?(?=$|[ %\[])")
_RULE = re.compile(r"^\|[-:| ]+\|$")


def keep(name: str, value: float, unit: str = "") -> None:
    """Keep a figure for the suite that runs this script, if one does."""
    place = os.environ.get("OPIR_BENCHMARK_FIGURES")
    if place:
        with Path(place).open("a", encoding="utf-8") as file:
            file.write(json.dumps([f"{name}, {unit}" if unit else name, float(value)]) + "\n")


def kept_figures(path: Path) -> Figures:
    """Return the figures that a script kept."""
    lines = path.read_text("utf-8").splitlines() if path.exists() else []
    return dict(json.loads(line) for line in lines)


def figures_in(folder: Path) -> Figures:
    """Return the figures of the CSV files in a folder, or else of the tables of its pages, by file,
    row and column.
    """
    found: Figures = {}
    for path in sorted(folder.glob("*.csv")):
        lines = [line for line in path.read_text("utf-8").splitlines() if not line.startswith("#")]
        found |= table_figures(path.stem, list(csv.reader(lines)))
    if not found:
        for path in sorted(folder.glob("*.md")):
            for table in markdown_tables(path.read_text("utf-8")):
                found |= table_figures(path.stem, table)
    return found


def markdown_tables(text: str) -> Iterator[list[list[str]]]:
    """Yield the tables of a page, each its header and rows."""
    table: list[list[str]] = []
    for line in [*text.splitlines(), ""]:
        if not line.startswith("|"):
            if table:
                yield table
            table = []
        elif not _RULE.match(line):
            table.append([cell.strip(" *") for cell in line.strip("|").split("|")])


def table_figures(title: str, table: Sequence[Sequence[str]]) -> Figures:
    """Return the numbers of a table, named by the text of their row, the first number if need be,
    and the column.
    """
    head, *rows = table
    numbers = [
        {n: number for n, cell in enumerate(row) if (number := number_of(cell)) is not None}
        for row in rows
    ]
    both = list(zip(rows, numbers, strict=True))
    text = [" ".join(cell for n, cell in enumerate(row) if n not in found) for row, found in both]
    first = [
        f"{name} {row[min(found, default=0)]}".strip()
        for name, (row, found) in zip(text, both, strict=True)
    ]
    labels = text if len({*text}) == len(text) and all(text) else first
    found: Figures = {}
    for place, (label, row) in enumerate(zip(labels, numbers, strict=True)):
        again = f" ({place})" if label in labels[:place] else ""
        found |= {f"{title}: {label}{again}: {head[n]}": number for n, number in row.items()}
    return found


def number_of(cell: str) -> float | None:
    """Return the number that a cell begins with, none if there is none."""
    found = _NUMBER.match(cell.strip())
    return float(found[0].replace(" ", "").replace("−", "-")) if found else None


def ratios(now: Mapping[str, float], then: Mapping[str, float]) -> dict[str, float]:
    """Return new over old of all figures that both have and that are not zero."""
    return {name: now[name] / then[name] for name in now if then.get(name)}
