"""How a table of text is laid out: what parts its columns, how it writes decimals, where the names stand."""

import csv
import io
import re
from collections.abc import Collection, Iterator, Sequence
from itertools import islice

from attrs import evolve, frozen

from opir_core.plugin import BadFileError

_COMMENTS = ("#", "%", "//")
_NUMBER = re.compile(r"\s*[+-]?(\d+([.,]\d*)?|[.,]\d+)([eEdD][+-]?\d+)?\s*")
_DECIMAL_COMMA = re.compile(r"\s*[+-]?\d*,\d+([eE][+-]?\d+)?\s*")

#: Rows in which decimal commas are looked for.
_LOOKED_AT = 1000

#: A column of a name like these may hold seconds, or dates.
_TIMES = ("t", "time")
_DATE = re.compile(r"\s*(\d{4}-\d|\d{1,2} [A-Za-z]{3} \d{4}).*:\d\d.*")

_EXCEL = re.compile(r"sep=(.)\s*", re.IGNORECASE)


@frozen
class Layout:
    """The layout of a table: `delimiter` "" is any white space; `names` stand in line `line`, states below it."""

    delimiter: str
    has_decimal_comma: bool
    line: int
    names: tuple[str, ...]

    def rows(self, text: str) -> Iterator[tuple[int, list[str]]]:
        """Yield number and cells of each line of a state; raises `BadFileError` for what is not CSV."""
        for number, cells in _cells(text, self.delimiter):
            if number > self.line:
                yield number, cells

    def plain_lines(self, text: str) -> Iterator[str]:
        """Yield the lines of states, decimals with points."""
        for number, line in _lines(text):
            if number > self.line:
                yield line.replace(",", ".") if self.has_decimal_comma else line


def layout_of(text: str) -> Layout:
    """Return the layout of a table; raises `BadFileError` for one without names, or without any line."""
    first = next(_lines(text), None)
    if first is None:
        raise BadFileError("is empty; its first line names the columns: time_s, x_ecef_m, y_ecef_m, z_ecef_m")
    declared = _EXCEL.fullmatch(first[1])
    head = next((line for number, line in _lines(text) if not declared or number > first[0]), "")
    delimiter = declared[1] if declared else _delimiter(head)
    delimiter = "" if delimiter == " " else delimiter
    rows = (row for row in _cells(text, delimiter) if not declared or row[0] > first[0])
    names: Sequence[str]
    line, names = next(rows, (1, []))
    cells = [names]
    if all(_NUMBER.fullmatch(name) for name in names if name):
        line, names = _names_in_comment(text, line, len(names), delimiter)
    cells += [row for _, row in islice(rows, _LOOKED_AT)]
    has_comma = delimiter != "," and any(_DECIMAL_COMMA.fullmatch(cell) for row in cells for cell in row)
    return Layout(delimiter, has_comma, line, tuple(name.strip().strip('"') for name in names))


def with_dates_named(layout: Layout, text: str, mapped: Collection[str]) -> Layout:
    """Return a layout whose column of times is called `timestamp` where it holds dates, unless it is `mapped`."""
    _, cells = next(layout.rows(text), (0, []))
    names = [
        "timestamp" if name.lower() in _TIMES and name not in mapped and _DATE.fullmatch(cell) else name
        for name, cell in zip(layout.names, cells, strict=False)
    ]
    return evolve(layout, names=(*names, *layout.names[len(names) :]))


def decimal(cell: str, layout: Layout) -> float:
    """Return the number of a cell; raises `ValueError` where it is none."""
    if "_" in cell:
        raise ValueError
    if "," in cell and "." in cell:
        raise ValueError("has both a point and a comma; write numbers without separators of thousands")
    plain = cell.replace(",", ".") if layout.has_decimal_comma else cell
    # Fortran writes double precision as 1.5D+06.
    return float(re.sub(r"(?<=[\d.])[dD](?=[+-]?\d)", "e", plain))


def _delimiter(line: str) -> str:
    """Return what parts the columns of a line: tab, semicolon or comma, else white space."""
    return next((mark for mark in "\t;," if mark in line), "")


def _names_in_comment(text: str, line: int, count: int, delimiter: str) -> tuple[int, Sequence[str]]:
    """Return the names of as many columns in the last comment above a line of numbers, and where states begin."""
    for comment in reversed(text.split("\n")[: line - 1]):
        bare = comment.strip().lstrip("#%/").strip()
        # A sentence has as many words as any table has columns: names are parted by blanks only where numbers are.
        marks = dict.fromkeys(mark for mark in (delimiter, _delimiter(bare)) if mark or not delimiter)
        for mark in marks:
            names = [name.strip() for name in (bare.split(mark) if mark else bare.split())]
            if len(names) == count and comment.strip().startswith(_COMMENTS):
                return line - 1, names
    raise BadFileError(
        f"line {line}: has numbers and no line of names above it; the first line names the columns, like time_s,"
        " x_ecef_m, y_ecef_m, z_ecef_m"
    )


def _lines(text: str) -> Iterator[tuple[int, str]]:
    """Yield the lines that are neither empty nor comments, with their numbers."""
    for number, line in enumerate(io.StringIO(text), 1):
        if not line.isspace() and not line.lstrip().startswith(_COMMENTS):
            yield number, line.rstrip("\n")


def _cells(text: str, delimiter: str) -> Iterator[tuple[int, list[str]]]:
    """Yield the cells of each line that is neither empty nor a comment, with its number."""
    if not delimiter:
        yield from ((number, line.split()) for number, line in _lines(text))
        return
    reader = csv.reader(io.StringIO(text), delimiter=delimiter, strict=True)
    try:
        for cells in reader:
            if any(cell.strip() for cell in cells) and not cells[0].lstrip().startswith(_COMMENTS):
                yield reader.line_num, cells
    except csv.Error as error:
        raise BadFileError(f"line {reader.line_num}: not CSV: {error}") from error
