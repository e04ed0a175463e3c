"""Figures of merit of coverage over time, with the names and definitions of STK.

All are of a point that is covered, or not, at each of T instants, the middles of equal steps that
make up the interval: accesses and gaps are runs of steps, so their ends are known to half a step.
Gaps at the ends of the interval count, as long as they are. Arrays are (T, n) for n points; times
are in s. A point that is never covered has one gap, the whole interval, and no response.
"""

import numpy as np
from attrs import frozen

from opir_core.arrays import BoolArray, ByteArray, FloatArray, IntArray


@frozen(eq=False)
class Runs:
    """Numbers (n,) of runs of steps, and their least, mean and largest duration, s, or nan.

    `square_s2` (n,) is the sum of their squares.
    """

    number: IntArray
    least_s: FloatArray
    mean_s: FloatArray
    most_s: FloatArray
    square_s2: FloatArray


def runs(is_in: BoolArray, step_s: float) -> Runs:
    """Return the runs of steps (T, n) in which a condition holds, in steps of `step_s`."""
    count = is_in.shape[1]
    duration = np.zeros(count)
    number = np.zeros(count, dtype=np.int64)
    least = np.full(count, np.inf)
    longest = np.zeros(count)
    square = np.zeros(count)
    for is_on in np.vstack([is_in, np.zeros((1, count), dtype=np.bool_)]):
        ended = ~is_on & (duration > 0.0)
        number += ended
        least = np.where(ended, np.minimum(least, duration), least)
        longest = np.where(ended, np.maximum(longest, duration), longest)
        square += np.where(ended, duration * duration, 0.0)
        duration = np.where(is_on, duration + step_s, 0.0)
    total = is_in.sum(axis=0) * step_s
    has_run = number > 0
    with np.errstate(invalid="ignore"):
        mean = total / number
    least, mean, longest = (np.where(has_run, row, np.nan) for row in (least, mean, longest))
    return Runs(number, least, mean, longest, square)


def coverage_time_s(covered: BoolArray, step_s: float) -> FloatArray:
    """Return Coverage Time (n,): the time during which a point is covered, s."""
    return covered.sum(axis=0) * step_s


def simple_coverage(covered: BoolArray) -> BoolArray:
    """Return Simple Coverage (n,): whether a point is covered at any time."""
    return np.asarray(covered.any(axis=0))


def time_average_gap_s(gaps: Runs, interval_s: float) -> FloatArray:
    """Return Time Average Gap (n,), s: the mean length of the gap at a random instant, or 0.

    The sum of the squares of all gaps over the interval.
    """
    return gaps.square_s2 / interval_s


def response_times_s(covered: BoolArray, step_s: float) -> FloatArray:
    """Return Response Times (T, n), s, from each instant to the next access; 0 while covered.

    After the last access it is the time to the end of the interval: a lower bound. nan for points
    never covered.
    """
    wait = np.empty(covered.shape)
    remaining_s = np.full(covered.shape[1], 0.5 * step_s)
    for step in range(len(covered) - 1, -1, -1):
        # An access begins half a step before its first instant.
        remaining_s = np.where(covered[step], -0.5 * step_s, remaining_s)
        wait[step] = np.maximum(remaining_s, 0.0)
        remaining_s = remaining_s + step_s
    wait[:, ~covered.any(axis=0)] = np.nan
    return wait


def ages_of_data_s(covered: BoolArray, step_s: float) -> FloatArray:
    """Return Ages of Data (T, n), s, since the end of the last access, or nan; 0 while covered."""
    age = np.empty(covered.shape)
    since = np.full(covered.shape[1], np.nan)
    for step in range(len(covered)):
        since = np.where(covered[step], -0.5 * step_s, since + step_s)
        age[step] = np.where(covered[step], 0.0, np.maximum(since, 0.0))
    return age


def is_covered(in_view: ByteArray, assets: int) -> BoolArray:
    """Return whether at least N sensors see a point: N Asset Coverage."""
    covered: BoolArray = np.asarray(in_view >= assets)
    return covered


def percent_below(values: FloatArray, limit: float, weights: FloatArray) -> float:
    """Return the percentage of the area, by weights (n,), with values (n,) below a limit."""
    return float(100.0 * weights[values < limit].sum() / weights.sum())
