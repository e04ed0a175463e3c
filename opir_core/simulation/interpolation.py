"""P_d interpolated between looks: the detection model is evaluated at knots along each pair's looks
only.

Signals vary slowly along a track, except at breakpoints that models may know (`breakpoints_s`).
Between these, pieces have five knots (`opir_core.simulation.refinement`), or three if P_d is 0 or 1
throughout. The quantile of P_d is a polynomial through the knots; each band's signal and noise are
linear between knots. A piece is halved until the error of the curve is within the tolerance of P_d;
where knots come as near to each other as looks, each look is evaluated. Knots belong to pairs and
times: they depend neither on windows nor on the phases of scans, and replicates share them.
"""

from typing import NamedTuple

import numpy as np
from attrs import frozen
from scipy.special import ndtr

from opir_core.arrays import BoolArray, FloatArray, IndexArray, IntArray
from opir_core.interfaces.detection_models import (
    DetectionProbability,
    Measured,
    RandomDraws,
    Response,
)
from opir_core.planning.looks import LookGeometry, Looks, blocks
from opir_core.planning.sightlines import Pairs
from opir_core.simulation.refinement import (
    KNOTS,
    MARGIN,
    UNIT_NS,
    Curves,
    GridRefiner,
    Intervals,
    RefinedGrid,
    certain_beyond,
    error_terms,
    knot_places,
    values_of,
)

#: Rows whose curves are evaluated at once.
_ROWS = 8192


class _LookIntervals(NamedTuple):
    """Intervals of pairs' looks, sorted by pair and scan: pairs, first scans, and scans after the
    last ones.
    """

    pair: IntArray
    first: IntArray
    behind: IntArray

    @classmethod
    def of(cls, last_scan: IntArray, pair: IntArray, first_scan: IntArray) -> "_LookIntervals":
        """Return sorted intervals, each ending at the start of the pair's next one."""
        is_last = np.diff(pair, append=-1) != 0
        behind = np.where(is_last, last_scan[pair] + 1, np.append(first_scan[1:], 0))
        return cls(pair, first_scan, behind)

    def with_looks(
        self, last_scan: IntArray, pair: IntArray, scan: IntArray
    ) -> tuple["_LookIntervals", IntArray]:
        """Return the intervals with one for each look (n,), and the order that sorts them."""
        pairs = np.concatenate([self.pair, pair])
        scans = np.concatenate([self.first, scan])
        order = _in_order(pairs, scans)
        return _LookIntervals.of(last_scan, pairs[order], scans[order]), order

    def rows(self, looks: Looks) -> tuple[IntArray, IntArray]:
        """Return the row of each interval's first look in a window, and its number of looks
        there.
        """
        pair_count = max(int(self.pair.max(initial=0)), int(looks.active.max(initial=0))) + 1
        first_scan, scans, offset = (np.zeros(pair_count, dtype=np.int64) for _ in range(3))
        first_scan[looks.active] = looks.first_scan
        scans[looks.active] = looks.scans
        offset[looks.active] = np.cumsum(looks.scans) - looks.scans
        pair_first_scan = first_scan[self.pair]
        most_scans = scans[self.pair]
        start = np.clip(self.first - pair_first_scan, 0, most_scans)
        count: IntArray = np.clip(self.behind - pair_first_scan, 0, most_scans) - start
        return offset[self.pair] + start, count


@frozen(eq=False, repr=False)
class KnotCurves:
    """Curves of P_d quantiles, one per piece, and lines of signals, one per interval, by pairs and
    places of knots.

    They do not depend on the phases of scans. In `rough` (p,) pieces looks are evaluated; `rise` is
    per unit, the rest as in `ProbabilityInterpolant`.
    """

    model: DetectionProbability
    tolerance: float
    pieces: Intervals
    curves: Curves
    certain: FloatArray
    rough: BoolArray
    intervals: Intervals
    at: FloatArray
    rise: FloatArray

    @classmethod
    def of(
        cls, geometry: LookGeometry, model: DetectionProbability, tolerance: float
    ) -> "KnotCurves":
        """Return the curves of all pairs that may have looks."""
        grid = GridRefiner(geometry, model, tolerance).refined()
        pieces, curves, certain, rough = _curved(grid, certain_beyond(tolerance))
        lines = Intervals.joined([_lines(grid.settled), _lines(grid.curved)])
        lines = lines.take(_in_order(lines.pair, lines.scan[0]))
        light = grid.values[1:]
        at = light.take(lines.row[0], axis=1)
        rise = (light.take(lines.row[1], axis=1) - at) / np.maximum(
            lines.scan[1] - lines.scan[0], 1
        )
        return cls(model, tolerance, pieces, curves, certain, rough, lines, at, rise)

    def at_scans(self, geometry: LookGeometry) -> "ProbabilityInterpolant":
        """Return the interpolant over scan numbers, for the phases of a geometry's pairs."""
        pairs = geometry.pairs
        ahead_ns = knot_places(pairs).phase_ns - pairs.phase_ns
        period_ns = pairs.period_ns
        pair = self.pieces.pair
        of_line = self.intervals.pair
        pieces = _first_scans(self.pieces, pairs)
        lines = _first_scans(self.intervals, pairs)
        units = period_ns / UNIT_NS
        middle = (self.curves.middle * UNIT_NS + ahead_ns[pair]) / period_ns[pair]
        curves = Curves(middle, self.curves.per_scan * units[pair], self.curves.coefficients)
        since = (lines * period_ns[of_line] - ahead_ns[of_line]) / UNIT_NS - self.intervals.scan[0]
        interpolant = ProbabilityInterpolant(
            self.model,
            _LookIntervals.of(pairs.last_scan, pair, pieces),
            curves,
            self.certain,
            _LookIntervals.of(pairs.last_scan, of_line, lines),
            self.at + self.rise * since,
            self.rise * units[of_line],
        )
        return interpolant.with_looks(geometry, np.flatnonzero(self.rough), self.tolerance)


def _first_scans(pieces: Intervals, pairs: Pairs) -> IntArray:
    """Return the first scans (k,) of pieces: at or after their starts, of the first ones the first
    of the pair.
    """
    # Looks within the margin before a piece's first knot are its own: a breakpoint may be there.
    pair = pieces.pair
    start = np.maximum(pieces.scan[0] - MARGIN, 0)
    since_ns = start * UNIT_NS + (knot_places(pairs).phase_ns - pairs.phase_ns)[pair]
    first_scan = np.maximum(-(-since_ns // pairs.period_ns[pair]), 0)
    return np.where(start == 0, np.minimum(first_scan, pairs.first_scan[pair]), first_scan)


@frozen(eq=False)
class ProbabilityInterpolant:
    """Interpolated P_d quantiles, one curve per piece, and signals and noise, one line per interval
    between knots.

    `certain` (p,) is the P_d, 0 or 1, of pieces without a curve, nan for others. `at` and `rise` (2
    B + 1, k) are signals, noise and the sine of the elevation at an interval's first scan, and
    their increase per scan.
    """

    model: DetectionProbability
    pieces: _LookIntervals
    curves: Curves
    certain: FloatArray
    intervals: _LookIntervals
    at: FloatArray
    rise: FloatArray

    @classmethod
    def of(
        cls, geometry: LookGeometry, model: DetectionProbability, tolerance: float
    ) -> "ProbabilityInterpolant":
        """Return the interpolant of all pairs with looks."""
        return KnotCurves.of(geometry, model, tolerance).at_scans(geometry)

    def with_looks(
        self, geometry: LookGeometry, rough: IntArray, tolerance: float
    ) -> "ProbabilityInterpolant":
        """Return the interpolant with each look of rough pieces, given by their rows, evaluated."""
        pairs = geometry.pairs
        pair = self.pieces.pair[rough]
        first_scan = np.maximum(self.pieces.first[rough], pairs.first_scan[pair])
        count = np.maximum(
            np.minimum(self.pieces.behind[rough], pairs.last_scan[pair] + 1) - first_scan, 0
        )
        pair = np.repeat(pair, count)
        if not len(pair):
            return self
        scan = np.arange(len(pair)) + np.repeat(first_scan - (np.cumsum(count) - count), count)
        exposures = [geometry.exposures(pair[rows], scan[rows]) for rows in blocks(len(pair))]
        values = np.concatenate(
            [values_of(self.model, exposed, tolerance) for exposed in exposures], axis=1
        )
        pieces, order = self.pieces.with_looks(pairs.last_scan, pair, scan)
        lines, line_order = self.intervals.with_looks(pairs.last_scan, pair, scan)
        straight = Curves.straight(np.stack([scan, scan]), values[[0, 0]], KNOTS)
        certain = _certain(values[0], values[0], certain_beyond(tolerance))
        return ProbabilityInterpolant(
            self.model,
            pieces,
            self.curves.joined(straight, order),
            np.concatenate([self.certain, certain])[order],
            lines,
            np.concatenate([self.at, values[1:]], axis=1)[:, line_order],
            np.concatenate([self.rise, np.zeros_like(values[1:])], axis=1)[:, line_order],
        )

    def over(self, looks: Looks) -> "WindowInterpolant":
        """Return the interpolant of a window's looks."""
        return WindowInterpolant(self, looks)


class WindowInterpolant:
    """The interpolant of a window's looks."""

    def __init__(self, interpolant: ProbabilityInterpolant, looks: Looks) -> None:
        self._whole = interpolant
        self._looks = looks
        start, count = interpolant.intervals.rows(looks)
        self._used = np.flatnonzero(count)
        self._ends = (start + count)[self._used]
        start, count = interpolant.pieces.rows(looks)
        self._pieces = np.flatnonzero(count)
        self._starts = start[self._pieces]
        self._counts = count[self._pieces]

    def probability(self) -> FloatArray:
        """Return the probability of detection (n,) of each look."""
        certain = self._whole.certain[self._pieces]
        probability = np.repeat(certain, self._counts)
        open_ = np.flatnonzero(np.isnan(certain))
        passed = np.cumsum(self._counts[open_])
        edges = np.searchsorted(
            passed, np.arange(0, passed[-1] if len(passed) else 0, _ROWS), side="right"
        )
        for open_rows in np.split(open_, np.unique(edges[1:])):
            times = self._counts[open_rows]
            row = np.arange(times.sum()) + np.repeat(
                self._starts[open_rows] - (np.cumsum(times) - times), times
            )
            probability[row] = ndtr(
                self._whole.curves.at(self._pieces[open_rows], times, self._looks.scan[row])
            )
        return probability

    def undecided(self) -> BoolArray:
        """Return which active pairs have a look in the window with P_d between 0 and 1."""
        undecided = np.zeros(len(self._looks.active), dtype=np.bool_)
        open_ = self._pieces[np.isnan(self._whole.certain[self._pieces])]
        undecided[np.searchsorted(self._looks.active, self._whole.pieces.pair[open_])] = True
        return undecided

    def measured(
        self, row: IntArray, sensor: IndexArray, rng: RandomDraws, probability: FloatArray
    ) -> Measured:
        """Return the measurements of looks (n,) that detected, given by their rows in the window,
        in order.
        """
        return self._whole.model.measure_response(self.response(row), sensor, rng, probability)

    def response(self, row: IntArray) -> Response:
        """Return the signals and noise of looks (n,), given by their rows in the window, in
        order.
        """
        interpolant = self._whole
        first_piece, last_piece = np.searchsorted(self._ends, row[[0, -1]], side="right")
        pieces_used = self._used[first_piece : last_piece + 1]
        times = np.diff(np.searchsorted(row, self._ends[first_piece : last_piece + 1]), prepend=0)
        pieces_used = pieces_used[times > 0]
        times = times[times > 0]
        since = (
            self._looks.scan[row] - np.repeat(interpolant.intervals.first[pieces_used], times)
        ).astype(np.float64)
        at = interpolant.at.take(pieces_used, axis=1)
        rise = interpolant.rise.take(pieces_used, axis=1)
        width = len(at) // 2
        quantities = (slice(width), slice(width, -1), slice(-1, None))
        snr, noise, sine = (
            _lines_at(at[quantity], rise[quantity], times, since) for quantity in quantities
        )
        return Response(None, snr.T, noise.T, sine[0])


def _lines_at(at: FloatArray, rise: FloatArray, times: IntArray, since: FloatArray) -> FloatArray:
    """Return lines (B, m), `times` (m,) each, at scans (n,) since their starts; constant columns
    are views.
    """
    moving = np.flatnonzero(rise.any(axis=1) | (at != at[:, :1]).any(axis=1))
    if not len(moving):
        return np.broadcast_to(at[:, :1], (len(at), len(since)))
    columns = np.empty((len(at), len(since)))
    columns[moving[-1] + 1 :] = at[moving[-1] + 1 :, :1]
    for column, start, climb in zip(columns[: moving[-1] + 1], at, rise, strict=False):
        np.multiply(np.repeat(climb, times), since, out=column)
        column += np.repeat(start, times)
    return columns


def _curved(grid: RefinedGrid, beyond: float) -> tuple[Intervals, Curves, FloatArray, BoolArray]:
    """Return all pieces in order, with their curves, certain P_d, and which are rough."""
    quantile = grid.values[0]
    smooth = grid.curved
    # Settled pieces need no curve: a line fills the row; rough ones get none.
    straight = Intervals.joined(
        [
            curves.knots(slice(0, None, len(curves.scan) - 1))
            for curves in (grid.settled, grid.rough)
        ]
    )
    inner = quantile[smooth.row]
    ends = quantile[straight.row]
    pieces = Intervals.joined([smooth.knots(slice(0, None, KNOTS - 1)), straight])
    order = _in_order(pieces.pair, pieces.scan[0])
    through = Curves.through(smooth.scan, inner)
    curves = through.joined(Curves.straight(straight.scan, ends, KNOTS), order)
    error = sum(error_terms(smooth.scan.astype(np.float64), inner))
    least = np.concatenate([inner.min(axis=0) - error, ends.min(axis=0)])
    maximum = np.concatenate([inner.max(axis=0) + error, ends.max(axis=0)])
    certain = _certain(least, maximum, beyond)
    is_rough = np.arange(len(order)) >= len(order) - len(grid.rough.pair)
    return pieces.take(order), curves, certain[order], is_rough[order]


def _certain(least: FloatArray, most: FloatArray, beyond: float) -> FloatArray:
    """Return P_d, 0 or 1, where quantiles from `least` to `most` decide it, else nan."""
    return np.where(least > beyond, 1.0, np.where(most < -beyond, 0.0, np.nan))


def _in_order(pair: IntArray, scan: IntArray) -> IntArray:
    """Return the order by pair, then scan; stable sorting is fast for long runs."""
    return np.argsort(pair * (int(scan.max(initial=0)) + 1) + scan, kind="stable")


def _lines(pieces: Intervals) -> Intervals:
    """Return the lines from knot to knot, as pieces of two knots; one line for a single look."""
    long = np.diff(pieces.scan, axis=0) > 0
    long[-1, ~long.any(axis=0)] = True
    piece, place = np.nonzero(long.T)
    scan, row = (
        np.stack([column[place, piece], column[place + 1, piece]])
        for column in (pieces.scan, pieces.row)
    )
    return Intervals(pieces.pair[piece], scan, row, pieces.predicted[:, piece])
