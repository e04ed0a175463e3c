"""Figures as a paper prints them: a text and the values that it stands for."""

import math
from decimal import Decimal

from attrs import frozen

from opir_paper.simulated import Simulated


@frozen
class Printed:
    """A printed figure: its text, and the least and largest value that it may stand for."""

    text: str
    low: float
    high: float

    def covers(self, value: float) -> bool:
        """Whether the figure may stand for a value."""
        return self.low <= value <= self.high


def rounded(text: str) -> Printed:
    """Return a figure that stands for the values that round to it.

    >>> rounded("0.33").covers(1.0 / 3.0), rounded("0.30").covers(0.2)
    (True, False)
    """
    value = Decimal(text)
    exponent = Decimal(text).as_tuple().exponent
    half = Decimal(5).scaleb(int(exponent) - 1)
    return Printed(text, float(value - half), float(value + half))


def about(text: str, share: float) -> Printed:
    """Return a figure that is "on the order of" a value: within this share of it."""
    value = float(text)
    return Printed(f"~ {text}", value * (1.0 - share), value * (1.0 + share))


def above(limit: str, text: str = "") -> Printed:
    """Return a lower limit."""
    return Printed(text or f"> {limit}", float(limit), math.inf)


def between(text: str, low: float, high: float) -> Printed:
    """Return a range."""
    return Printed(text, low, high)


def figure_text(simulated: Simulated, digits: int) -> str:
    """Return a simulated figure with its interval; one that is counted has none."""
    if simulated.low == simulated.high:
        return f"{simulated.value:.{digits}g}"
    shown = min(digits, 4)
    return f"{simulated.value:.{shown}g} [{simulated.low:.{shown}g}, {simulated.high:.{shown}g}]"
