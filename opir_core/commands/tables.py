"""Plain text tables, the same on a terminal and in a file."""

from collections.abc import Sequence


def table(head: Sequence[str], rows: Sequence[Sequence[object]], *, numbers: Sequence[int] = ()) -> str:
    """Return aligned columns with a head; the columns in `numbers` are set flush right."""
    cells = [[str(cell) for cell in row] for row in (head, *rows)]
    widths = [max(len(row[column]) for row in cells) for column in range(len(head))]
    return "\n".join(_line(row, widths, numbers) for row in cells)


def counted(number: int) -> str:
    """Return a whole number with its thousands set apart."""
    return f"{number:,}".replace(",", " ")


def _line(row: Sequence[str], widths: Sequence[int], numbers: Sequence[int]) -> str:
    aligned = (
        cell.rjust(width) if column in numbers else cell.ljust(width)
        for column, (cell, width) in enumerate(zip(row, widths, strict=True))
    )
    return "  ".join(aligned).rstrip()
