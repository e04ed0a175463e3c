"""P_d interpolated between looks: the detection model is evaluated at knots along each pair's looks only.

Signals vary slowly along a track, except at breakpoints that models may know (`breakpoints_s`). Between these, pieces
have five knots (`opir_core.simulation.refinement`), or three if P_d is 0 or 1 throughout. The quantile of P_d is a
polynomial over the scan number through the knots; each band's signal and noise are linear between knots. A piece is
halved until the error of the curve is within the tolerance of P_d; at jumps of the quantile halving ends at adjacent
scans, which are exact. Knots belong to pairs and scans, so they do not depend on the windows.
"""

from typing import NamedTuple

import numpy as np
from attrs import frozen
from scipy.special import ndtr

from opir_core.arrays import BoolArray, FloatArray, IndexArray, IntArray
from opir_core.interfaces.protocols import DetectionProbability, Measured, RandomDraws, Response
from opir_core.planning.looks import LookGeometry, Looks
from opir_core.simulation.refinement import (
    KNOTS,
    Curves,
    GridRefiner,
    Intervals,
    RefinedGrid,
    certain_beyond,
    error_terms,
)

#: Rows whose curves are evaluated at once.
_ROWS = 8192


class _LookIntervals(NamedTuple):
    """Intervals of pairs' looks, sorted by pair and scan: pairs, first scans, and scans after the last ones."""

    pair: IntArray
    first: IntArray
    behind: IntArray

    @classmethod
    def of(cls, last_scan: IntArray, pair: IntArray, first: IntArray) -> "_LookIntervals":
        """Return sorted intervals, each ending at the start of the pair's next one."""
        is_last = np.diff(pair, append=-1) != 0
        behind = np.where(is_last, last_scan[pair] + 1, np.append(first[1:], 0))
        return cls(pair, first, behind)

    def rows(self, looks: Looks) -> tuple[IntArray, IntArray]:
        """Return the row of each interval's first look in a window, and its number of looks there."""
        most = max(int(self.pair.max(initial=0)), int(looks.active.max(initial=0))) + 1
        first_scan, scans, offset = (np.zeros(most, dtype=np.int64) for _ in range(3))
        first_scan[looks.active], scans[looks.active] = looks.first_scan, looks.scans
        offset[looks.active] = np.cumsum(looks.scans) - looks.scans
        known, most_scans = first_scan[self.pair], scans[self.pair]
        start = np.clip(self.first - known, 0, most_scans)
        count: IntArray = np.clip(self.behind - known, 0, most_scans) - start
        return offset[self.pair] + start, count


@frozen(eq=False)
class ProbabilityInterpolant:
    """Interpolated P_d quantiles, one curve per piece, and signals and noise, one line per interval between knots.

    `certain` (p,) is the P_d, 0 or 1, of pieces without a curve, nan for others. `at` and `rise` (2 B + 1, k) are
    signals, noise and the sine of the elevation at an interval's first scan, and their increase per scan.
    """

    model: DetectionProbability
    pieces: _LookIntervals
    curves: Curves
    certain: FloatArray
    intervals: _LookIntervals
    at: FloatArray
    rise: FloatArray

    @classmethod
    def of(cls, geometry: LookGeometry, model: DetectionProbability, tolerance: float) -> "ProbabilityInterpolant":
        """Return the interpolant of all pairs with looks."""
        grid = GridRefiner(geometry, model, tolerance).refined()
        last_scan = geometry.pairs.last_scan
        pieces, curves, certain = _curved(last_scan, grid, certain_beyond(tolerance))
        lines = Intervals.joined([_lines(grid.settled), _lines(grid.curved)])
        lines = lines.take(_in_order(lines.pair, lines.scan[0]))
        light = grid.values[1:]
        at = light.take(lines.row[0], axis=1)
        rise = (light.take(lines.row[1], axis=1) - at) / np.maximum(lines.scan[1] - lines.scan[0], 1)
        intervals = _LookIntervals.of(last_scan, lines.pair, lines.scan[0])
        return cls(model, pieces, curves, certain, intervals, at, rise)

    def over(self, looks: Looks) -> "WindowInterpolant":
        """Return the interpolant of a window's looks."""
        return WindowInterpolant(self, looks)


class WindowInterpolant:
    """The interpolant of a window's looks."""

    def __init__(self, whole: ProbabilityInterpolant, looks: Looks) -> None:
        self._whole, self._looks = whole, looks
        start, count = whole.intervals.rows(looks)
        self._used = np.flatnonzero(count)
        self._ends = (start + count)[self._used]
        start, count = whole.pieces.rows(looks)
        self._pieces = np.flatnonzero(count)
        self._starts, self._counts = start[self._pieces], count[self._pieces]

    def probability(self) -> FloatArray:
        """Return the probability of detection (n,) of each look."""
        certain = self._whole.certain[self._pieces]
        probability = np.repeat(certain, self._counts)
        open_ = np.flatnonzero(np.isnan(certain))
        passed = np.cumsum(self._counts[open_])
        edges = np.searchsorted(passed, np.arange(0, passed[-1] if len(passed) else 0, _ROWS), side="right")
        for part in np.split(open_, np.unique(edges[1:])):
            times = self._counts[part]
            row = np.arange(times.sum()) + np.repeat(self._starts[part] - (np.cumsum(times) - times), times)
            probability[row] = ndtr(self._whole.curves.at(self._pieces[part], times, self._looks.scan[row]))
        return probability

    def undecided(self) -> BoolArray:
        """Return which active pairs have a look in the window with P_d between 0 and 1."""
        undecided = np.zeros(len(self._looks.active), dtype=np.bool_)
        open_ = self._pieces[np.isnan(self._whole.certain[self._pieces])]
        undecided[np.searchsorted(self._looks.active, self._whole.pieces.pair[open_])] = True
        return undecided

    def measured(self, row: IntArray, sensor: IndexArray, rng: RandomDraws, probability: FloatArray) -> Measured:
        """Return the measurements of looks (n,) that detected, given by their rows in the window, in order."""
        return self._whole.model.measure_response(self.response(row), sensor, rng, probability)

    def response(self, row: IntArray) -> Response:
        """Return the signals and noise of looks (n,), given by their rows in the window, in order."""
        whole = self._whole
        first, last = np.searchsorted(self._ends, row[[0, -1]], side="right")
        used = self._used[first : last + 1]
        times = np.diff(np.searchsorted(row, self._ends[first : last + 1]), prepend=0)
        used, times = used[times > 0], times[times > 0]
        since = (self._looks.scan[row] - np.repeat(whole.intervals.first[used], times)).astype(np.float64)
        at, rise = whole.at.take(used, axis=1), whole.rise.take(used, axis=1)
        width = len(at) // 2
        parts = (slice(width), slice(width, -1), slice(-1, None))
        snr, noise, sine = (_lines_at(at[part], rise[part], times, since) for part in parts)
        return Response(None, snr.T, noise.T, sine[0])


def _lines_at(at: FloatArray, rise: FloatArray, times: IntArray, since: FloatArray) -> FloatArray:
    """Return lines (B, m), `times` (m,) each, at scans (n,) since their starts; constant columns are views."""
    moving = np.flatnonzero(rise.any(axis=1) | (at != at[:, :1]).any(axis=1))
    if not len(moving):
        return np.broadcast_to(at[:, :1], (len(at), len(since)))
    columns = np.empty((len(at), len(since)))
    columns[moving[-1] + 1 :] = at[moving[-1] + 1 :, :1]
    for column, start, climb in zip(columns[: moving[-1] + 1], at, rise, strict=False):
        np.multiply(np.repeat(climb, times), since, out=column)
        column += np.repeat(start, times)
    return columns


def _curved(last_scan: IntArray, grid: RefinedGrid, beyond: float) -> tuple[_LookIntervals, Curves, FloatArray]:
    """Return pieces with curves and certain P_d; lines from look to look where all looks are knots."""
    settled, quantile = grid.settled, grid.values[0]
    is_dense = np.all(np.diff(grid.curved.scan, axis=0) <= 1, axis=0)
    dense, smooth = _lines(grid.curved.take(is_dense)), grid.curved.take(~is_dense)
    # Settled pieces need no curve: a line fills the row.
    straight = Intervals.joined([dense, settled.knots(slice(0, 3, 2))])
    inner, ends = quantile[smooth.row], quantile[straight.row]
    pair = np.concatenate([smooth.pair, straight.pair])
    first = np.concatenate([smooth.scan[0], straight.scan[0]])
    order = _in_order(pair, first)
    through = Curves.through(smooth.scan, inner)
    curves = through.joined(Curves.straight(straight.scan, ends, KNOTS), order)
    error = sum(error_terms(smooth.scan.astype(np.float64), inner))
    least = np.concatenate([inner.min(axis=0) - error, ends.min(axis=0)])[order]
    most = np.concatenate([inner.max(axis=0) + error, ends.max(axis=0)])[order]
    certain = np.where(least > beyond, 1.0, np.where(most < -beyond, 0.0, np.nan))
    return _LookIntervals.of(last_scan, pair[order], first[order]), curves, certain


def _in_order(pair: IntArray, scan: IntArray) -> IntArray:
    """Return the order by pair, then scan; stable sorting is fast for long runs."""
    return np.argsort(pair * (int(scan.max(initial=0)) + 1) + scan, kind="stable")


def _lines(pieces: Intervals) -> Intervals:
    """Return the lines from knot to knot, as pieces of two knots; one line for a single look."""
    long = np.diff(pieces.scan, axis=0) > 0
    long[-1, ~long.any(axis=0)] = True
    piece, place = np.nonzero(long.T)
    scan, row = (np.stack([each[place, piece], each[place + 1, piece]]) for each in (pieces.scan, pieces.row))
    return Intervals(pieces.pair[piece], scan, row, pieces.predicted[:, piece])
