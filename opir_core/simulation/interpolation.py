"""Looks that share their reckoning: detection models are asked at knots along each pair's looks, and not between them.

Signals vary slowly along a track, but for moments at which plumes or the air bend them, which models may know
(`opir_core.interfaces.optional.WithBreakpoints`). Pieces between these have five knots each
(`opir_core.simulation.refinement`), or three where all that they have is certain or hopeless: through
them goes the quantile of the probability of detection, a polynomial over the number of the scan; each band's signal and
noise are straight lines from knot to knot. A piece is halved until what the curve is judged to miss would cost the
tolerance at most wherever in the piece the density is highest; where quantiles jump, halving ends at neighbouring
scans, which are exact. Knots belong to pairs and scans, so no slicing of time moves them.
"""

from typing import NamedTuple

import numpy as np
from attrs import frozen
from scipy.special import ndtr

from opir_core.arrays import BoolArray, FloatArray, IndexArray, IntArray
from opir_core.interfaces.optional import Response, SignalModel
from opir_core.interfaces.protocols import Measured, RandomDraws
from opir_core.planning.looks import LookGeometry, Looks
from opir_core.simulation.refinement import (
    KNOTS,
    Curves,
    GridRefiner,
    Intervals,
    RefinedGrid,
    judged_terms,
    sure_beyond,
)

#: Rows whose curves are evaluated at once.
_ROWS = 8192


class _Stretches(NamedTuple):
    """Stretches of pairs' looks, sorted by pair and scan: pairs, first scans, and the scans behind the last ones."""

    pair: IntArray
    first: IntArray
    behind: IntArray

    @classmethod
    def of(cls, last_scan: IntArray, pair: IntArray, first: IntArray) -> "_Stretches":
        """Return stretches, sorted, each of which ends where the pair's next one begins."""
        is_last = np.diff(pair, append=-1) != 0
        behind = np.where(is_last, last_scan[pair] + 1, np.append(first[1:], 0))
        return cls(pair, first, behind)

    def rows(self, looks: Looks) -> tuple[IntArray, IntArray]:
        """Return the row of a window's looks at which each stretch starts, and how many looks it has there."""
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
    """Curves of quantiles, one a piece, and straight lines of signals, one a stretch from knot to knot.

    `model` is who was asked; `sure` (p,) is the probability of pieces whose looks are certain or hopeless, nan of
    others. `at` and `rise` (2 B, k) are signals and noise at a stretch's first scan, and by how much they rise a scan.
    """

    model: SignalModel
    pieces: _Stretches
    curves: Curves
    sure: FloatArray
    stretches: _Stretches
    at: FloatArray
    rise: FloatArray

    @classmethod
    def of(cls, geometry: LookGeometry, model: SignalModel, tolerance: float) -> "ProbabilityInterpolant":
        """Return the knots of all pairs that have looks."""
        grid = GridRefiner(geometry, model, tolerance).refined()
        last_scan = geometry.pairs.last_scan
        pieces, curves, sure = _curved(last_scan, grid, sure_beyond(tolerance))
        lines = Intervals.joined([_lines(grid.settled), _lines(grid.curved)])
        lines = lines.take(_in_order(lines.pair, lines.scan[0]))
        light = grid.values[1:]
        at = light.take(lines.row[0], axis=1)
        rise = (light.take(lines.row[1], axis=1) - at) / np.maximum(lines.scan[1] - lines.scan[0], 1)
        stretches = _Stretches.of(last_scan, lines.pair, lines.scan[0])
        return cls(model, pieces, curves, sure, stretches, at, rise)

    def over(self, looks: Looks) -> "WindowInterpolant":
        """Return which pieces and stretches a window's looks fall in."""
        return WindowInterpolant(self, looks)


class WindowInterpolant:
    """The knots of a window's looks."""

    def __init__(self, knots: ProbabilityInterpolant, looks: Looks) -> None:
        self._knots, self._looks = knots, looks
        start, count = knots.stretches.rows(looks)
        self._used = np.flatnonzero(count)
        self._ends = (start + count)[self._used]
        start, count = knots.pieces.rows(looks)
        self._pieces = np.flatnonzero(count)
        self._starts, self._counts = start[self._pieces], count[self._pieces]

    def probability(self) -> FloatArray:
        """Return the probability of detection (n,) of each look."""
        sure = self._knots.sure[self._pieces]
        probability = np.repeat(sure, self._counts)
        open_ = np.flatnonzero(np.isnan(sure))
        passed = np.cumsum(self._counts[open_])
        edges = np.searchsorted(passed, np.arange(0, passed[-1] if len(passed) else 0, _ROWS), side="right")
        for part in np.split(open_, np.unique(edges[1:])):
            times = self._counts[part]
            row = np.arange(times.sum()) + np.repeat(self._starts[part] - (np.cumsum(times) - times), times)
            probability[row] = ndtr(self._knots.curves.at(self._pieces[part], times, self._looks.scan[row]))
        return probability

    def undecided(self) -> BoolArray:
        """Return of which active pairs a look of the window may go either way."""
        undecided = np.zeros(len(self._looks.active), dtype=np.bool_)
        open_ = self._pieces[np.isnan(self._knots.sure[self._pieces])]
        undecided[np.searchsorted(self._looks.active, self._knots.pieces.pair[open_])] = True
        return undecided

    def measured(self, row: IntArray, sensor: IndexArray, dice: RandomDraws, probability: FloatArray) -> Measured:
        """Return what is measured in looks (n,) that detected, given by their rows in the window, in order."""
        return self._knots.model.measure_response(self.response(row), sensor, dice, probability)

    def response(self, row: IntArray) -> Response:
        """Return the signals and noise of looks (n,), given by their rows in the window, in order."""
        knots = self._knots
        first, last = np.searchsorted(self._ends, row[[0, -1]], side="right")
        used = self._used[first : last + 1]
        times = np.diff(np.searchsorted(row, self._ends[first : last + 1]), prepend=0)
        used, times = used[times > 0], times[times > 0]
        since = (self._looks.scan[row] - np.repeat(knots.stretches.first[used], times)).astype(np.float64)
        at, rise = knots.at.take(used, axis=1), knots.rise.take(used, axis=1)
        width = len(at) // 2
        return Response(
            None, *(_drawn_out(at[half], rise[half], times, since).T for half in (slice(width), slice(width, None)))
        )


def _drawn_out(at: FloatArray, rise: FloatArray, times: IntArray, since: FloatArray) -> FloatArray:
    """Return lines (B, m), so many `times` (m,) each, at scans (n,) since their starts; what stands still is a view."""
    moving = np.flatnonzero(rise.any(axis=1) | (at != at[:, :1]).any(axis=1))
    if not len(moving):
        return np.broadcast_to(at[:, :1], (len(at), len(since)))
    columns = np.empty((len(at), len(since)))
    columns[moving[-1] + 1 :] = at[moving[-1] + 1 :, :1]
    for column, start, climb in zip(columns[: moving[-1] + 1], at, rise, strict=False):
        np.multiply(np.repeat(climb, times), since, out=column)
        column += np.repeat(start, times)
    return columns


def _curved(last_scan: IntArray, grid: RefinedGrid, beyond: float) -> tuple[_Stretches, Curves, FloatArray]:
    """Return pieces with their curves and what is sure of them; where all looks are knots, lines from look to look."""
    settled, quantile = grid.settled, grid.values[0]
    is_dense = np.all(np.diff(grid.curved.scan, axis=0) <= 1, axis=0)
    dense, smooth = _lines(grid.curved.take(is_dense)), grid.curved.take(~is_dense)
    # What is settled has no curve but its sureness: a line stands in for one.
    straight = Intervals.joined([dense, settled.knots(slice(0, 3, 2))])
    inner, ends = quantile[smooth.row], quantile[straight.row]
    pair = np.concatenate([smooth.pair, straight.pair])
    first = np.concatenate([smooth.scan[0], straight.scan[0]])
    order = _in_order(pair, first)
    through = Curves.through(smooth.scan, inner)
    curves = through.joined(Curves.straight(straight.scan, ends, KNOTS), order)
    judged = sum(judged_terms(smooth.scan.astype(np.float64), inner))
    least = np.concatenate([inner.min(axis=0) - judged, ends.min(axis=0)])[order]
    most = np.concatenate([inner.max(axis=0) + judged, ends.max(axis=0)])[order]
    sure = np.where(least > beyond, 1.0, np.where(most < -beyond, 0.0, np.nan))
    return _Stretches.of(last_scan, pair[order], first[order]), curves, sure


def _in_order(pair: IntArray, scan: IntArray) -> IntArray:
    """Return the order by pair, then scan: of one number, and stably, for what comes in long runs."""
    return np.argsort(pair * (int(scan.max(initial=0)) + 1) + scan, kind="stable")


def _lines(pieces: Intervals) -> Intervals:
    """Return the lines from knot to knot, as pieces of two knots; one of a lone look."""
    long = np.diff(pieces.scan, axis=0) > 0
    long[-1, ~long.any(axis=0)] = True
    piece, place = np.nonzero(long.T)
    scan, row = (np.stack([each[place, piece], each[place + 1, piece]]) for each in (pieces.scan, pieces.row))
    return Intervals(pieces.pair[piece], scan, row, pieces.predicted[:, piece])
