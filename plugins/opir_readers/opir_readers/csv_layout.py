"""The layout of a table of text: what parts its columns, how it writes decimals, and the line of the
names.
"""

import csv
import io
import re
from collections.abc import Collection, Iterator, Sequence
from itertools import islice

from attrs import evolve, frozen

from opir_core.plugin import BadFileError
from opir_readers.columns import bare_name, quantity_of
from opir_readers.detections.times import looks_like_date
from opir_readers.json_text import table_of_json
from opir_readers.published import published

_COMMENTS = ("#", "%", "//")
_NUMBER = re.compile(r"\s*[+-]?(\d+([.,]\d*)?|[.,]\d+)([eEdD][+-]?\d+)?\s*")
_DECIMAL_COMMA = re.compile(r"\s*[+-]?\d*,\d+([eE][+-]?\d+)?\s*")
#: In columns that are parted by commas, three digits behind a comma may be thousands.
_QUOTED_DECIMAL_COMMA = re.compile(r"\s*[+-]?\d*,(\d{1,2}|\d{4,})([eE][+-]?\d+)?\s*")

#: Rows in which decimal commas are looked for, and lines in which the names are.
_SAMPLED_ROWS = 1000
_HEAD_LINES = 60

#: A column of a name like these may hold seconds, or dates.
_TIMES = ("t", "time")

#: A delimiter: two blanks or more, where cells have single ones in them.
_BLANKS = "  "

_EXCEL = re.compile(r"sep=(.)\s*", re.IGNORECASE)
_RULE = re.compile(r"\s*:?[-=]+:?\s*")

#: A line that is neither empty nor a comment, with its number; and the same as cells.
Line = tuple[int, str]
Cells = tuple[int, list[str]]


@frozen
class Layout:
    """The layout of a table: `delimiter` "" is any white space; `names` stand in line `line`,
    states below it.
    """

    delimiter: str
    has_decimal_comma: bool
    line: int
    names: tuple[str, ...]

    def rows(self, text: str) -> Iterator[Cells]:
        """Yield number and cells of each line of a state; raises `BadFileError` for what is not
        CSV.
        """
        return (row for row in _cells(text, self.delimiter) if row[0] > self.line)

    def plain_lines(self, text: str) -> Iterator[str]:
        """Yield the lines of states, decimals with points."""
        for number, line in _lines(text):
            if number > self.line:
                yield line.replace(",", ".") if self.has_decimal_comma else line

    def require_width(self, cells: Sequence[str], line: int) -> None:
        """Raise `BadFileError` for a line with fewer or more cells than there are names."""
        count = len(self.names)
        if len(cells) < count or any(cell.strip() for cell in cells[count:]):
            raise BadFileError(
                f"line {line}: has {len(cells)} values; line {self.line} names {count} columns"
            )

    def number(self, cell: str) -> float:
        """Return the number of a cell; raises `ValueError` for another text."""
        if "_" in cell:
            raise ValueError
        if "," in cell and "." in cell:
            raise ValueError(
                "has both a point and a comma; write numbers without separators of thousands"
            )
        plain = cell.replace(",", ".") if self.has_decimal_comma else cell
        # Fortran writes double precision as 1.5D+06.
        return float(re.sub(r"(?<=[\d.])[dD](?=[+-]?\d)", "e", plain))


def table_layout(text: str, mapped: Collection[str]) -> tuple[str, Layout]:
    """Return a text, of JSON the table of its records, and its layout.

    A column of times is called `timestamp` where it holds dates, unless it is `mapped`.
    """
    text = table_of_json(text) or text
    layout = layout_of(text, mapped)
    _, cells = next(layout.rows(text), (0, list[str]()))
    names = list(layout.names)
    for place, (name, cell) in enumerate(zip(layout.names, cells, strict=False)):
        if bare_name(name)[0] in _TIMES and name not in mapped and looks_like_date(cell):
            names[place] = "timestamp"
    return text, evolve(layout, names=tuple(names))


def layout_of(text: str, mapped: Collection[str] = ()) -> Layout:
    """Return the layout of a table; raises `BadFileError` for one without names, or without any
    line.

    Columns that are `mapped` by their number, `#1` for the first, are called so.
    """
    lines = list(islice(_lines(text), _HEAD_LINES))
    if not lines:
        raise BadFileError(
            "is empty; its first line names the columns: time_s, x_ecef_m, y_ecef_m, z_ecef_m"
        )
    declared = _EXCEL.fullmatch(lines[0][1])
    lines = lines[1:] if declared else lines
    lines = lines[_first_of_table([line for _, line in lines]) :]
    delimiter = declared[1] if declared else _delimiter([line for _, line in lines])
    delimiter = "" if delimiter == " " else delimiter
    start = lines[0][0] if lines else 1
    table = (row for row in _cells(text, delimiter) if row[0] >= start)
    rows = list(islice(table, _SAMPLED_ROWS))
    line, names = _named(text, rows, delimiter, mapped)
    comma = _QUOTED_DECIMAL_COMMA if delimiter == "," else _DECIMAL_COMMA
    has_comma = any(comma.fullmatch(cell) for _, row in rows for cell in row)
    return Layout(delimiter, has_comma, line, tuple(names))


def _named(
    text: str, rows: Sequence[Cells], delimiter: str, mapped: Collection[str]
) -> tuple[int, Sequence[str]]:
    """Return the line above the states, and the names of the columns."""
    line, names = rows[0] if rows else (1, list[str]())
    numbers = [f"#{place}" for place in range(1, len(names) + 1)]
    if all(map(_is_value, filter(None, names))):
        if not set(mapped).isdisjoint(numbers):
            return line - 1, numbers
        line, names = _names_in_comment(text, line, len(names), delimiter)
    elif len(rows) > 1 and _is_below_names(rows[1][1]):
        line, units = rows[1]
        names = _with_units(names, units)
    return line, [
        number if number in mapped else _bare(name)
        for number, name in zip(numbers, names, strict=True)
    ]


def is_table(text: str) -> bool:
    """Whether some line has two numbers or dates, or the first line names a known quantity."""
    lines = [line for _, line in islice(_lines(text), _SAMPLED_ROWS)]
    rows = [_split(line, _delimiter([line])) for line in lines]
    is_named = any(map(quantity_of, rows[0])) if rows else False
    return is_named or any(map(_has_values, rows))


def _delimiter(lines: Sequence[str]) -> str:
    """Return what parts the columns of a table by its names: a mark, else white space.

    Two blanks or more do where names and dates with single blanks agree in their number of columns
    only so.
    """
    head = lines[0] if lines else ""
    below = next((line for line in lines[1:] if not _is_rule(line)), "")
    mark = next((mark for mark in "\t;,|" if mark in head), "")
    if mark or not below or len(head.split()) == len(below.split()):
        return mark
    is_alike = len(_split(head, _BLANKS)) == len(_split(below, _BLANKS)) > 1
    return _BLANKS if is_alike else ""


def _split(line: str, delimiter: str) -> list[str]:
    if delimiter == _BLANKS:
        return re.split(r"\s{2,}", line.strip())
    return line.split(delimiter) if delimiter else line.split()


def _first_of_table(lines: Sequence[str]) -> int:
    """Return the row of the names: the first, or below lines about the table, whose columns are
    others.

    The names are above the first line of numbers, units or rules between them aside.
    """
    marks = [_delimiter([line]) for line in lines]
    rows = [_split(line, mark) for line, mark in zip(lines, marks, strict=True)]
    below = next((number for number, cells in enumerate(rows) if _has_values(cells)), 0)
    names = below - 1
    while names > 0 and _is_below_names(rows[names]):
        names -= 1
    if names <= 0 or len(rows[names]) < 2:
        return 0
    return names if (marks[0], len(rows[0])) != (marks[below], len(rows[below])) else 0


def _is_rule(line: str) -> bool:
    return all(_RULE.fullmatch(mark) for mark in re.split(r"[\s|,;]+", line.strip(" |")))


def _is_below_names(cells: Sequence[str]) -> bool:
    """Whether the cells of a line are rules or units, as they stand between names and numbers."""
    units = [_unit(cell) for cell in cells if cell.strip()]
    return bool(units) and all(
        unit == "-" or _RULE.fullmatch(unit) or _is_unit(unit) for unit in units
    )


def _unit(cell: str) -> str:
    return cell.strip().strip("()[]")


def _is_unit(text: str) -> bool:
    return text.lower() in published("units")["written"]


def _with_units(names: Sequence[str], below: Sequence[str]) -> list[str]:
    """Return names with the units that stand below them, `x_ecef (km)`."""
    units = [*map(_unit, below), *[""] * len(names)]
    return [
        f"{name} ({unit})" if _is_unit(unit) else name
        for name, unit in zip(names, units, strict=False)
    ]


def _bare(name: str) -> str:
    return name.strip().strip('"')


def _has_values(cells: Sequence[str]) -> bool:
    """Whether two of the first cells of a line are numbers or dates."""
    return sum(map(_is_value, cells[:_HEAD_LINES])) >= 2


def _is_value(cell: str) -> bool:
    return _NUMBER.fullmatch(_bare(cell)) is not None or looks_like_date(_bare(cell))


def _names_in_comment(text: str, line: int, count: int, delimiter: str) -> Cells:
    """Return the names of as many columns in the last comment above a line of numbers, and the line
    above the states.
    """
    for comment in reversed(text.split("\n")[: line - 1]):
        bare = comment.strip().lstrip("#%/").strip()
        # A sentence has as many words as any table has columns: names are parted by blanks only
        # where numbers are.
        for mark in (delimiter, _delimiter([bare])):
            names = [name.strip() for name in (bare.split(mark) if mark else bare.split())]
            is_named = len(names) == count and (mark or not delimiter)
            if is_named and comment.strip().startswith(_COMMENTS):
                return line - 1, names
    raise BadFileError(
        f"line {line}: has numbers and no line of names above it; name the columns in a first line,"
        " like time_s, x_ecef_m, y_ecef_m, z_ecef_m, or by their numbers with columns:"
        " {time_s: '#1', x_ecef_m: '#2', …}"
    )


def _lines(text: str) -> Iterator[Line]:
    """Yield the lines that are neither empty nor comments, with their numbers."""
    for number, line in enumerate(io.StringIO(text), 1):
        if not line.isspace() and not line.lstrip().startswith(_COMMENTS):
            yield number, line.rstrip("\n")


def _cells(text: str, delimiter: str) -> Iterator[Cells]:
    """Yield the cells of each line that is neither empty nor a comment, with its number."""
    if not delimiter.strip(" "):
        yield from ((number, _split(line, delimiter)) for number, line in _lines(text))
        return
    reader = csv.reader(io.StringIO(text), delimiter=delimiter, strict=True)
    try:
        for cells in reader:
            if any(cell.strip() for cell in cells) and not cells[0].lstrip().startswith(_COMMENTS):
                yield reader.line_num, cells
    except csv.Error as error:
        raise BadFileError(f"line {reader.line_num}: not CSV: {error}") from error
