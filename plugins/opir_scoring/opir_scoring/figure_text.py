"""The text of a figure, with its interval."""

import math
from collections.abc import Iterable, Mapping
from typing import Any

from attrs import frozen


@frozen
class FigureRow:
    """A row of a table of figures: its label, and the names, digits and factor of its figure."""

    label: str
    names: tuple[str, ...]
    digits: int
    scale: float = 1.0

    def text(self, figures: Mapping[str, Any]) -> str:
        """Return the text of the figure."""
        figure: Any = figures
        for name in self.names:
            figure = figure[name]
        if isinstance(figure, float):
            return number_text(figure, self.digits)
        return interval_text(figure, self.digits, self.scale)


def figure_rows(*rows: tuple[Any, ...]) -> tuple[FigureRow, ...]:
    """Return rows of (label, names with dots between, digits, factor)."""
    return tuple(FigureRow(label, tuple(names.split(".")), *form) for label, names, *form in rows)


def cells(figures: Mapping[str, Any], rows: Iterable[FigureRow]) -> tuple[str, ...]:
    """Return the texts of the figures of rows."""
    return tuple(row.text(figures) for row in rows)


def interval_text(figure: Mapping[str, Any], digits: int, scale: float = 1.0) -> str:
    """Return a figure with its interval, "-" where it is unknown.

    Its share follows where it has one that is not all: `0.28 [0.23, 0.34] (95 %)`.
    """
    if not math.isfinite(figure["value"]):
        return "-"
    of = f" ({percent_text(figure['share'])})" if figure.get("share", 1.0) != 1.0 else ""
    value = f"{scale * figure['value']:.{digits}f}"
    low, high = (scale * edge for edge in figure["interval_95"])
    # A single run, or track, has no interval. One whose ends differ by a factor of over a hundred,
    # as of two targets, means no more than "unknown".
    is_finite = math.isfinite(low) and not 0.0 < 100.0 * low < high
    return f"{value} [{low:.{digits}f}, {high:.{digits}f}]{of}" if is_finite else f"{value}{of}"


def number_text(value: float, digits: int) -> str:
    """Return a number, "-" where it is unknown or infinite."""
    return f"{value:.{digits}f}" if math.isfinite(value) else "-"


def percent_text(share: float) -> str:
    """Return a share in per cent, 0 or 100 only where it is exactly that; "-" where it is
    unknown.
    """
    if math.isnan(share):
        return "-"
    percent = 100.0 * share
    digits = 0
    while share not in (0.0, 1.0) and round(percent, digits) in (0.0, 100.0):
        digits += 1
    return f"{percent:.{digits}f} %"


def share_text(share: float, low: float, high: float) -> str:
    """Return a share with its interval, `12 % [5, 22]`; without one where it is nan."""
    ends = f" [{100.0 * low:.0f}, {100.0 * high:.0f}]" if math.isfinite(low) else ""
    return f"{percent_text(share)}{ends}"
