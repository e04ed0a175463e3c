"""Looks that share their reckoning: detection models are asked at knots along each pair's looks, and not between them.

Signals vary slowly along a track. Between knots the quantile of the probability of detection, and each band's signal
and noise, are straight lines over the number of the scan. A stretch is halved until what the line misses the quantile
by at its middle, which becomes a knot too, would cost a quarter of the tolerance at most wherever in the stretch the
density is highest, and signals are missed by no more than `SIGNAL_SHARE` of themselves or `SIGNAL_SIGMA` of the noise;
where they jump, halving ends at neighbouring scans, which are exact. Knots belong to pairs and scans, so no slicing of
time moves them.
"""

from typing import Any, NamedTuple

import numpy as np
from attrs import frozen

from opir_core.looks import Looks, blocks, exposures
from opir_core.plan import Plan
from opir_core.protocols import Dice, Measured
from opir_core.records import BoolArray, FloatArray, IndexArray, IntArray
from opir_core.responses import Response, Responsive
from opir_core.sites import Sites

#: Stretches a pair's looks are cut into at first: as long as this, s, but no more of them than that.
FIRST_STRETCH_S, MOST_FIRST_STRETCHES = 8.0, 64

#: How far signals and noise may be off at the middle of a stretch, as a share of them or in deviations of the noise.
SIGNAL_SHARE, SIGNAL_SIGMA = 0.01, 0.05

#: Of the tolerance, what single evaluations may be off.
_SLACK_SHARE = 0.01

#: Of the tolerance, what a line may be off at the middle of its stretch: beside it, at a kink, it may be off by more.
_MIDDLE_SHARE = 0.25

#: Quantiles are held within it; beyond 8.3 a probability is 1 to the last bit, and below -38 no double.
_FARTHEST = 40.0
_CERTAIN = 8.3

_SCAN_BITS = 40


class _Stretches(NamedTuple):
    """Stretches of looks between two knots each: their pairs, first and last scans, and rows among the knots."""

    pair: IntArray
    first: IntArray
    last: IntArray
    first_row: IntArray
    last_row: IntArray

    def take(self, rows: Any) -> "_Stretches":
        return _Stretches(*(column[rows] for column in self))


@frozen(eq=False)
class Knots:
    """Straight lines over scans, one a stretch, sorted by pair and scan.

    `key` (k,) is the pair's number and the stretch's first scan in one; `at` and `rise` (1 + 2 B, k) the quantile,
    signals and noise at that scan and by how much they rise a scan.
    """

    key: IntArray
    first: IntArray
    at: FloatArray
    rise: FloatArray
    width: int
    is_doubtful: BoolArray

    @classmethod
    def of(cls, plan: Plan, sites: Sites, tolerance: float) -> "Knots":
        """Return the knots of all pairs that have looks."""
        model = plan.detection
        assert isinstance(model, Responsive)
        return _Weaver(plan, sites, model, tolerance).knots()

    def over(self, looks: Looks) -> "Spans":
        """Return which stretch each of a window's looks falls in."""
        keys = (looks.pair << _SCAN_BITS) | looks.scan
        starts = np.searchsorted(keys, self.key)
        counts = np.diff(starts, append=len(keys))
        used = np.flatnonzero(counts)
        return Spans(self, used, counts[used], starts[used] + counts[used], looks.scan)


@frozen(eq=False)
class Spans:
    """The stretches of a window's looks: `used` (m,) of the knots, how many looks each has, and the row behind them."""

    knots: Knots
    used: IntArray
    counts: IntArray
    ends: IntArray
    scan: IntArray

    def probability(self) -> FloatArray:
        """Return the probability of detection (n,) of each look."""
        from scipy.special import ndtr

        at, rise = self.knots.at[0, self.used], self.knots.rise[0, self.used]
        quantile = np.repeat(at - rise * self.knots.first[self.used], self.counts)
        quantile += np.repeat(rise, self.counts) * self.scan
        probability = np.ones(len(quantile))
        doubtful = np.flatnonzero(quantile < _CERTAIN)
        probability[doubtful] = ndtr(quantile[doubtful])
        return probability

    def undecided(self, looks: Looks) -> BoolArray:
        """Return of which active pairs a look of the window may go either way."""
        doubtful = np.zeros(len(looks.active), dtype=np.bool_)
        pair = self.knots.key[self.used] >> _SCAN_BITS
        doubtful[np.searchsorted(looks.active, pair[self.knots.is_doubtful[self.used]])] = True
        return doubtful

    def measured(self, model: object, row: IntArray, sensor: IndexArray, dice: Dice) -> Measured:
        """Return what is measured in looks (n,) that detected, given by their rows in the window, in order."""
        assert isinstance(model, Responsive)
        return model.measure_response(self.response(row), sensor, dice)

    def response(self, row: IntArray) -> Response:
        """Return what looks (n,), given by their rows in the window, in order, would measure."""
        knots = self.knots
        first, last = np.searchsorted(self.ends, row[[0, -1]], side="right")
        used = self.used[first : last + 1]
        times = np.diff(np.searchsorted(row, self.ends[first : last + 1]), prepend=0)
        since = (self.scan[row] - np.repeat(knots.first[used], times)).astype(np.float64)
        columns = np.repeat(knots.rise[:, used], times, axis=1)
        columns *= since
        columns += np.repeat(knots.at[:, used], times, axis=1)
        return Response(columns[0], columns[1 : 1 + knots.width].T, columns[1 + knots.width :].T)


class _Weaver:
    """Lays knots: all pairs together, one halving of all that need it at a time."""

    def __init__(self, plan: Plan, sites: Sites, model: Responsive, tolerance: float) -> None:
        self._plan, self._sites, self._model, self._tolerance = plan, sites, model, tolerance
        self._values: list[FloatArray] = []
        self._count = 0
        self._width = 0

    def knots(self) -> Knots:
        stretches = self._first_stretches()
        done = [stretches.take(slice(0, 0))]
        while len(stretches.pair):
            middle = (stretches.first + stretches.last) // 2
            is_short = middle == stretches.first  # Neighbouring scans, or one.
            done.append(stretches.take(is_short))
            stretches, middle = stretches.take(~is_short), middle[~is_short]
            row = self._asked(stretches.pair, middle)
            halves = _halved(stretches, middle, row)
            is_fine = np.tile(self._is_fine(stretches, middle, row), 2)
            done.append(halves.take(is_fine))
            stretches = halves.take(~is_fine)
        return self._lines(_Stretches(*(np.concatenate(columns) for columns in zip(*done, strict=True))))

    def _first_stretches(self) -> _Stretches:
        pairs = self._plan.pairs
        looking = np.flatnonzero(pairs.looks > 0)
        scans, period_s = pairs.looks[looking] - 1, pairs.period_ns[looking] * 1e-9
        wanted = np.clip(np.ceil(scans * period_s / FIRST_STRETCH_S), 1, MOST_FIRST_STRETCHES).astype(np.int64)
        count = np.minimum(wanted, np.maximum(scans, 1))
        pair = np.repeat(looking, count + 1)
        number = np.arange(len(pair)) - np.repeat(np.cumsum(count + 1) - (count + 1), count + 1)
        share = np.repeat(scans, count + 1) * number // np.repeat(count, count + 1)
        scan = pairs.first_scan[pair] + share
        row = self._asked(pair, scan)
        inner = np.flatnonzero(number[1:] > 0)
        return _Stretches(pair[inner], scan[inner], scan[inner + 1], row[inner], row[inner + 1])

    def _asked(self, pair: IntArray, scan: IntArray) -> IntArray:
        """Evaluate looks and return the rows they have among all evaluated."""
        slack = self._tolerance * _SLACK_SHARE
        for rows in blocks(len(pair)):
            exposed = exposures(self._plan, self._sites, pair[rows], scan[rows], geometry=True)
            response = self._model.response(exposed, slack=slack)
            quantile = np.clip(response.probit, -_FARTHEST, _FARTHEST)
            self._width = response.snr.shape[1]
            self._values.append(np.concatenate([quantile[:, None], response.snr, response.noise_w_m2], axis=1))
        first, self._count = self._count, self._count + len(pair)
        return first + np.arange(len(pair))

    def _all_values(self) -> FloatArray:
        self._values = [np.concatenate(self._values)] if self._values else [np.empty((0, 1))]
        return self._values[0]

    def _is_fine(self, stretches: _Stretches, middle: IntArray, row: IntArray) -> BoolArray:
        """Return where the line between the ends of stretches says what their middles are."""
        values, width = self._all_values(), self._width
        share = ((middle - stretches.first) / np.maximum(stretches.last - stretches.first, 1))[:, None]
        start, true = values[stretches.first_row], values[row]
        line = start + (values[stretches.last_row] - start) * share
        off, size = np.abs(line - true), np.abs(true)
        ends = start[:, 0], values[stretches.last_row, 0]
        # Probabilities differ by the quantiles' difference times a density, which is highest nearest to the quantile 0.
        least, most = np.minimum(*ends), np.maximum(*ends)
        nearest = np.clip(0.0, np.minimum(least, true[:, 0]), np.maximum(most, true[:, 0]))
        density = np.exp(-0.5 * nearest * nearest) / np.sqrt(2.0 * np.pi)
        fine: BoolArray = off[:, 0] * density <= _MIDDLE_SHARE * self._tolerance
        for band in range(width):
            fine &= off[:, 1 + band] <= np.maximum(SIGNAL_SHARE * size[:, 1 + band], SIGNAL_SIGMA)
            fine &= off[:, 1 + width + band] <= SIGNAL_SHARE * size[:, 1 + width + band]
        return fine

    def _lines(self, stretches: _Stretches) -> Knots:
        values = self._all_values()
        order = np.lexsort((stretches.first, stretches.pair))
        pair, first, last, first_row, last_row = stretches.take(order)
        at = values[first_row]
        rise = (values[last_row] - at) / np.maximum(last - first, 1)[:, None]
        # The last look of a pair belongs to the stretch that ends there; a pair's only look has one of no length.
        ends = np.stack([at[:, 0], values[last_row, 0]])
        is_doubtful = (ends.min(axis=0) < _CERTAIN) & (ends.max(axis=0) > -_FARTHEST)
        return Knots((pair << _SCAN_BITS) | first, first, at.T.copy(), rise.T.copy(), self._width, is_doubtful)


def _halved(stretches: _Stretches, middle: IntArray, row: IntArray) -> _Stretches:
    """Return all first halves, then all second ones."""
    early = stretches._replace(last=middle, last_row=row)
    late = stretches._replace(first=middle, first_row=row)
    return _Stretches(*(np.concatenate(both) for both in zip(early, late, strict=True)))
