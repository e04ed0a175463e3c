"""The text of a figure, with its interval."""

import math
from collections.abc import Mapping
from typing import Any

#: The text has no interval whose ends differ by a larger factor: it says no more than "unknown".
_WIDEST = 100.0


def interval_text(figure: Mapping[str, Any], digits: int, scale: float = 1.0) -> str:
    """Return a figure with its interval, "-" where it is unknown.

    The share that it is of follows where it has one, and this is not all: `0.28 [0.23, 0.34] (95
    %)`.
    """
    if not math.isfinite(figure["value"]):
        return "-"
    of = f" ({percent_text(figure['share'])})" if figure.get("share", 1.0) != 1.0 else ""
    value = f"{scale * figure['value']:.{digits}f}"
    low, high = (scale * edge for edge in figure["interval_95"])
    # A single run, or track, has no interval; that of two targets may say nothing.
    is_finite = math.isfinite(low) and not 0.0 < _WIDEST * low < high
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
