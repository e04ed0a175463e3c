"""Text for terminals: tables, numbers and progress bars. Tables are the same on a terminal and in a file."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager


def table(head: Sequence[str], rows: Sequence[Sequence[object]], *, numbers: Sequence[int] = ()) -> str:
    """Return aligned columns with a head; the columns in `numbers` are aligned right."""
    cells = [[str(cell) for cell in row] for row in (head, *rows)]
    widths = [max(len(row[column]) for row in cells) for column in range(len(head))]
    return "\n".join(_line(row, widths, numbers) for row in cells)


def grouped(number: int) -> str:
    """Return a whole number with spaces between thousands."""
    return f"{number:,}".replace(",", " ")


@contextmanager
def progress(total: float, *, is_shown: bool) -> Iterator[Callable[[str, float], None]]:
    """Show progress bars on standard error, if `is_shown`; give the function that sets a bar by name."""
    if not is_shown:
        yield lambda _name, _completed: None
        return
    from rich.console import Console
    from rich.progress import Progress, TaskID

    tasks: dict[str, TaskID] = {}
    with Progress(console=Console(stderr=True), transient=True) as bar:

        def update(name: str, completed: float) -> None:
            if name not in tasks:
                tasks[name] = bar.add_task(name, total=total)
            bar.update(tasks[name], completed=completed)

        yield update


def _line(row: Sequence[str], widths: Sequence[int], numbers: Sequence[int]) -> str:
    aligned = (
        cell.rjust(width) if column in numbers else cell.ljust(width)
        for column, (cell, width) in enumerate(zip(row, widths, strict=True))
    )
    return "  ".join(aligned).rstrip()
