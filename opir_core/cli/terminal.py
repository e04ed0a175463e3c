"""Text for terminals: tables and numbers. Tables are the same on a terminal and in a
file.
"""

import io
import os
import signal
import sys
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from threading import Event, Thread
from time import monotonic
from typing import Any


def ending_signals() -> list[signal.Signals]:
    """Return the signals that end a program in order: SIGTERM, and SIGHUP where it is not ignored,
    as under nohup.
    """
    hangup: signal.Signals | None = getattr(signal, "SIGHUP", None)  # Windows has none
    if hangup is None or signal.getsignal(hangup) == signal.SIG_IGN:
        return [signal.SIGTERM]
    return [signal.SIGTERM, hangup]


def table(
    head: Sequence[str], rows: Sequence[Sequence[object]], *, numbers: Sequence[int] = ()
) -> str:
    """Return aligned columns with a head; the columns in `numbers` are aligned right."""
    cells = [[str(cell) for cell in row] for row in (head, *rows)]
    widths = [max(len(row[column]) for row in cells) for column in range(len(head))]
    return "\n".join(_line(row, widths, numbers) for row in cells)


#: Rows of targets and tracks that are printed.
_LISTED = 12


def listed(head: Sequence[str], rows: Sequence[Sequence[object]], *, numbers: Sequence[int]) -> str:
    """Return a table of the first rows, with the number of those omitted; "" without rows."""
    omitted = f"\n... and {len(rows) - _LISTED} more" if len(rows) > _LISTED else ""
    return table(head, rows[:_LISTED], numbers=numbers) + omitted if rows else ""


def grouped(number: int | None) -> str:
    """Return a whole number with spaces between thousands, a dash for an unknown one."""
    return "–" if number is None else f"{number:,}".replace(",", " ")


#: Probabilities from which two decimals would be 1.00, and below which they would be 0.00.
_SURE = 0.995
_UNLIKELY = 0.005


def probability_text(chance: float) -> str:
    """Return a probability with two decimals, `> 0.99` and `< 0.01` in place of 1.00 and 0.00:
    nothing is certain.

    >>> from opir_core.cli import probability_text
    >>> [probability_text(chance) for chance in (0.97, 0.996, 0.00004)]
    ['0.97', '> 0.99', '< 0.01']
    """
    if chance >= _SURE:
        return "> 0.99"
    return "< 0.01" if chance < _UNLIKELY else f"{chance:.2f}"


#: When a step of a command is called slow, s; the later lines come after twice as long each.
_SLOW_S = 2.0


@contextmanager
def slow_notice(step: str, *, is_shown: bool) -> Iterator[None]:
    """Say on standard error what takes so long, if `is_shown`: after 2 s, 4 s, 8 s and so on."""
    if not is_shown:
        yield
        return
    is_done = Event()
    began_s = monotonic()

    def report() -> None:
        after_s = _SLOW_S
        while not is_done.wait(began_s + after_s - monotonic()):
            sys.stderr.write(f"opir: {step}, {after_s:g} s so far\n")
            after_s *= 2.0

    reporter = Thread(target=report, name="opir-slow", daemon=True)
    reporter.start()
    try:
        yield
    finally:
        is_done.set()
        reporter.join()


class _Diverted(io.TextIOBase):
    """Standard output during a run: text goes to standard error, `fileno` is that of the true
    standard output.
    """

    def __init__(self, descriptor: int | None) -> None:
        self._descriptor = descriptor

    @property
    def buffer(self) -> Any:
        return sys.stderr.buffer

    def write(self, text: str) -> int:
        return sys.stderr.write(text)

    def flush(self) -> None:
        sys.stderr.flush()

    def fileno(self) -> int:
        if self._descriptor is None:
            raise OSError("standard output has no file descriptor")
        return self._descriptor


@contextmanager
def prints_on_standard_error() -> Iterator[None]:
    """Send what is printed, also by libraries in C, to standard error; only the sinks write to
    standard output.
    """
    outer = sys.stdout
    try:
        outer.flush()
        descriptor = outer.fileno()
        copy: int | None = os.dup(descriptor)
        os.dup2(2, descriptor)
    except (OSError, ValueError, AttributeError):
        descriptor = -1
        copy = None
    try:
        sys.stdout = _Diverted(copy)
        yield
    finally:
        sys.stdout = outer
        if copy is not None:
            os.dup2(copy, descriptor)
            os.close(copy)


def _line(row: Sequence[str], widths: Sequence[int], numbers: Sequence[int]) -> str:
    aligned = (
        cell.rjust(width) if column in numbers else cell.ljust(width)
        for column, (cell, width) in enumerate(zip(row, widths, strict=True))
    )
    return "  ".join(aligned).rstrip()
