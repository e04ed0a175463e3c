"""What a notebook shows: tables as HTML, and progress in a cell, or in a terminal."""

import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from importlib import import_module
from typing import Any

__all__ = ["ROWS_SHOWN", "html_view", "progress"]

#: Rows of a table.
ROWS_SHOWN = 10


def html_view(
    shown: object,
    head: Sequence[str],
    rows: Sequence[Sequence[object]],
    count: int | None = None,
) -> str:
    """Return the text of an object and a table, as an element of HTML.

    `rows` are the first of `count` rows; without a count the first `ROWS_SHOWN` of them are shown.

    >>> html_view(2, ["name"], [["a"]])
    '<div><p>2</p><table><thead><tr><th>name</th></tr></thead><tbody><tr><td>a</td></tr></tbody></table></div>'
    """
    escape = import_module("html").escape  # a run by the command line does not load it
    listed = rows[:ROWS_SHOWN] if count is None else rows
    cells = ("".join(f"<td>{escape(str(cell))}</td>" for cell in row) for row in listed)
    body = "".join(f"<tr>{row}</tr>" for row in cells)
    names = "".join(f"<th>{escape(name)}</th>" for name in head)
    table = f"<table><thead><tr>{names}</tr></thead><tbody>{body}</tbody></table>" if rows else ""
    more = (len(rows) if count is None else count) - len(listed)
    omitted = f"<p>and {more} more rows</p>" if more else ""
    return f"<div><p>{escape(repr(shown).strip('<>'))}</p>{table}{omitted}</div>"


@contextmanager
def progress(*, is_shown: bool) -> Iterator[Callable[[str, float, float], None]]:
    """Show progress bars, if `is_shown`: in a notebook's cell, else on standard error.

    Gives the function that sets a bar by name to what is completed of a total.
    """
    if not is_shown:
        yield lambda _name, _completed, _total: None
        return
    if _is_notebook():
        yield _CellBars().update
        return
    from rich import console, progress as bars

    tasks: dict[str, bars.TaskID] = {}
    with bars.Progress(console=console.Console(stderr=True), transient=True) as bar:

        def update(name: str, completed: float, total: float) -> None:
            if name not in tasks:
                tasks[name] = bar.add_task(name)
            bar.update(tasks[name], completed=completed, total=total)

        yield update


def _is_notebook() -> bool:
    """Return whether the code runs in a cell of a notebook: IPython with a kernel."""
    ipython = sys.modules.get("IPython")
    return ipython is not None and hasattr(ipython.get_ipython(), "kernel")


class _CellBars:
    """Progress bars as elements of HTML that a cell shows, one by name."""

    def __init__(self) -> None:
        self._cells: dict[str, Any] = {}

    def update(self, name: str, completed: float, total: float) -> None:
        cell = import_module("IPython.display")
        words = f"{name} {completed:g} of {total:g}"
        bar = cell.HTML(f'<progress value="{completed:g}" max="{total:g}"></progress> {words}')
        if name in self._cells:
            self._cells[name].update(bar)
        else:
            self._cells[name] = cell.display(bar, display_id=True)
