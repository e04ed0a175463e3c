"""Integrals of densities that are given by their logarithms, over the panels of rules of ratio gates."""

from collections.abc import Iterator

import numpy as np

from opir_core.arrays import FloatArray, IntArray
from opir_core.detection.panels import Panels

#: Beyond so many standard deviations a normal tail is below the last bit of 1.
FAR = 9.0
#: Panels for gates no steeper than the noise, and how often they are doubled for steep ones.
_PANELS, _MOST_DOUBLINGS = 3, 5
MOST_PANELS = _PANELS << _MOST_DOUBLINGS
LOG_HALF = float(np.log(0.5))


def by_steepness(steepest: FloatArray) -> Iterator[tuple[IntArray, int]]:
    """Yield rows with the number of panels that follows their steepest gate."""
    doublings = np.clip(np.ceil(np.log2(steepest)), 0, _MOST_DOUBLINGS).astype(np.int64)
    for times in range(_MOST_DOUBLINGS + 1):
        rows = np.flatnonzero(doublings == times)
        if len(rows):
            yield rows, _PANELS << times


def log_integral(panels: Panels, log_values: FloatArray) -> FloatArray:
    """Return logarithms of the integrals of values given by theirs."""
    peak = log_values.max(axis=1)
    scale = np.where(np.isfinite(peak), peak, 0.0)
    with np.errstate(divide="ignore"):
        logarithm: FloatArray = scale + np.log(panels.integral(np.exp(log_values - scale[:, None])))
    return logarithm


def log_between(low: FloatArray, high: FloatArray) -> FloatArray:
    """Return ln(Q(low) - Q(high)), of normal tails; -inf where low >= high."""
    from scipy.special import log_ndtr

    result = np.where(low < high, 0.0, -np.inf)
    near_edge = np.nonzero((low < high) & ((low > -FAR) | (high < FAR)))
    low, high = low[near_edge], high[near_edge]
    is_left = low + high < 0.0
    near, far = np.where(is_left, high, -low), np.where(is_left, low, -high)
    log_near = log_ndtr(near)
    fall = np.full(len(near), -np.inf)
    close = np.flatnonzero(far > np.minimum(near, 0.0) - FAR)
    fall[close] = np.minimum(log_ndtr(far[close]) - log_near[close], 0.0)
    with np.errstate(divide="ignore"):
        result[near_edge] = log_near + np.where(fall < LOG_HALF, np.log1p(-np.exp(fall)), np.log(-np.expm1(fall)))
    return result
