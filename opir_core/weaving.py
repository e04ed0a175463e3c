"""Laying knots: all pairs together, where their looks bend, and one halving of all that need it at a time."""

from typing import Any, NamedTuple

import numpy as np

from opir_core.looks import blocks, exposures, look_times_s
from opir_core.plan import Plan
from opir_core.records import BoolArray, FloatArray, IntArray
from opir_core.responses import Kinked, Responsive
from opir_core.sites import Sites

#: Pieces that smooth stretches are cut into at first: no longer than this, s, but no more of them than that.
FIRST_PIECE_S, MOST_FIRST_PIECES = 16.0, 64

#: How far signals and noise may be off midway between neighbouring knots, as a share of them or in deviations of noise.
SIGNAL_SHARE, SIGNAL_SIGMA = 0.01, 0.05

#: Of the tolerance, what single evaluations may be off.
_SLACK_SHARE = 1e-5

#: Of the tolerance, what the judged error may be: through five knots about a bend between them, a curve is off by less
#: than 2.6 times what is judged (docs/design/knots_judged.py).
_JUDGED_SHARE = 0.2

#: Quantiles are held within it; beyond 8.3 a probability is 1 to the last bit, and below -38 no double.
FARTHEST = 40.0

#: Nothing is ever detected with a quantile below it: the chance is 1e-12 a look.
_NEVER = -7.0

#: Knots of a piece.
KNOTS = 5


class Pieces(NamedTuple):
    """Pieces of pairs' looks: pairs (k,), scans (5, k) of their knots, and the knots' rows (5, k) among all asked."""

    pair: IntArray
    scan: IntArray
    row: IntArray

    def take(self, rows: Any) -> "Pieces":
        """Return some of the pieces."""
        return Pieces(self.pair[rows], self.scan[:, rows], self.row[:, rows])

    def __add__(self, other: Any) -> "Pieces":
        columns = (np.concatenate(both, axis=-1) for both in zip(self, other, strict=True))
        return Pieces(*columns)


class Weaver:
    """Lays the knots of a plan."""

    def __init__(self, plan: Plan, sites: Sites, model: Responsive, tolerance: float) -> None:
        self._plan, self._sites, self._model, self._tolerance = plan, sites, model, tolerance
        self._asked: list[FloatArray] = []
        self._count = 0

    def pieces(self) -> tuple[Pieces, FloatArray]:
        """Return pieces sorted by pair and scan, and what was asked (1 + 2 B, knots): quantile, signals and noise."""
        pieces = self._first_pieces()
        done = pieces.take(slice(0, 0))
        while len(pieces.pair):
            # Between neighbouring scans there is nothing to be judged.
            fine = np.all(np.diff(pieces.scan, axis=0) <= 1, axis=0)
            open_ = np.flatnonzero(~fine)
            fine[open_] = self._is_fine(pieces.take(open_))
            done += pieces.take(fine)
            pieces = self._halved(pieces.take(~fine))
        return done.take(np.lexsort((done.scan[0], done.pair))), self._values()

    def _first_pieces(self) -> Pieces:
        pair, first, last = _smooth_stretches(self._plan, self._model)
        period_s = self._plan.pairs.period_ns[pair] * 1e-9
        wanted = np.ceil((last - first) * period_s / FIRST_PIECE_S)
        count = np.clip(wanted, 1, np.minimum(MOST_FIRST_PIECES, np.maximum(last - first, 1))).astype(np.int64)
        number = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
        pair, first, looks, count = (np.repeat(each, count) for each in (pair, first, last - first, count))
        start, stop = first + looks * number // count, first + looks * (number + 1) // count
        scan = start + (stop - start) * np.arange(KNOTS)[:, None] // (KNOTS - 1)
        return self._with_rows(Pieces(pair, scan, np.full(scan.shape, -1)))

    def _halved(self, pieces: Pieces) -> Pieces:
        """Return both halves of pieces: all first halves, then all second ones."""
        halves = []
        for first in (0, 2):
            scan, row = np.empty_like(pieces.scan), np.full(pieces.row.shape, -1)
            scan[::2], row[::2] = pieces.scan[first : first + 3], pieces.row[first : first + 3]
            scan[1::2] = (scan[0:3:2] + scan[2:5:2]) // 2
            halves.append(Pieces(pieces.pair, scan, row))
        return self._with_rows(halves[0] + halves[1])

    def _with_rows(self, pieces: Pieces) -> Pieces:
        """Ask for the knots that have no row, each once where knots of a piece fall together."""
        for place in range(1, KNOTS):
            same = pieces.scan[place] == pieces.scan[place - 1]
            pieces.row[place] = np.where(same & (pieces.row[place] < 0), -2, pieces.row[place])
        new = np.nonzero(pieces.row == -1)
        pieces.row[new] = self._ask(pieces.pair[new[1]], pieces.scan[new])
        for place in range(1, KNOTS):
            pieces.row[place] = np.where(pieces.row[place] == -2, pieces.row[place - 1], pieces.row[place])
        return pieces

    def _ask(self, pair: IntArray, scan: IntArray) -> IntArray:
        """Evaluate looks and return the rows they have among all evaluated."""
        slack = self._tolerance * _SLACK_SHARE
        order = np.argsort(pair, kind="stable")
        for rows in blocks(len(pair)):
            chosen = order[rows]
            exposed = exposures(self._plan, self._sites, pair[chosen], scan[chosen], geometry=True)
            response = self._model.response(exposed, slack=slack)
            quantile = np.clip(response.probit, -FARTHEST, FARTHEST)
            self._asked.append(np.concatenate([quantile[None], response.snr.T, response.noise_w_m2.T]))
        first, self._count = self._count, self._count + len(pair)
        row = np.empty(len(pair), dtype=np.int64)
        row[order] = first + np.arange(len(pair))
        return row

    def _values(self) -> FloatArray:
        self._asked = [np.concatenate(self._asked, axis=1)] if self._asked else [np.empty((1, 0))]
        return self._asked[0]

    def _is_fine(self, pieces: Pieces) -> BoolArray:
        """Return which pieces are said to within the tolerance by curves and lines through their knots."""
        values = self._values()
        width = (len(values) - 1) // 2
        at = (pieces.scan - pieces.scan[0]) / (pieces.scan[-1] - pieces.scan[0])
        quantile = values[0].take(pieces.row)
        judged = judged_error(at, quantile)
        # Probabilities differ by the quantiles' difference times a density, which is highest nearest to the quantile 0.
        nearest = np.maximum(
            np.where(quantile.min(axis=0) * quantile.max(axis=0) > 0.0, np.abs(quantile).min(axis=0), 0.0) - judged, 0.0
        )
        density = np.exp(-0.5 * nearest * nearest) / np.sqrt(2.0 * np.pi)
        fine: BoolArray = judged * density <= _JUDGED_SHARE * self._tolerance
        seen = np.flatnonzero(fine & (quantile.max(axis=0) > _NEVER))
        for band in range(width):
            for values_of, least in ((values[1 + band], SIGNAL_SIGMA), (values[1 + width + band], 0.0)):
                own = values_of.take(pieces.row[:, seen])
                allowed = np.maximum(SIGNAL_SHARE * np.abs(own[1:-1]), least)
                fine[seen] &= np.all(_off_neighbours(at[:, seen], own) <= 2.0 * allowed, axis=0)
        return fine


def judged_error(at: FloatArray, values: FloatArray) -> FloatArray:
    """Return by how much a curve through values (5, k) at places (5, k) is judged to miss what lies between: its bends.

    The parabola through the first, middle and last value misses the two others; half of what these misses differ by,
    and half of their sum.
    """
    start, middle, stop = values[0], values[2], values[4]
    early = (middle - start) / np.maximum(at[2] - at[0], 1e-300)
    late = (stop - middle) / np.maximum(at[4] - at[2], 1e-300)
    bend = (late - early) / np.maximum(at[4] - at[0], 1e-300)
    off = [values[place] - (start + (at[place] - at[0]) * (early + (at[place] - at[2]) * bend)) for place in (1, 3)]
    judged: FloatArray = 0.5 * (np.abs(off[0] - off[1]) + np.abs(off[0] + off[1]))
    return judged


def _off_neighbours(at: FloatArray, values: FloatArray) -> FloatArray:
    """Return how far inner values (5, k) are off the lines between their neighbours, (3, k)."""
    share = (at[1:-1] - at[:-2]) / np.maximum(at[2:] - at[:-2], 1e-300)
    off: FloatArray = np.abs(values[1:-1] - (values[:-2] + share * (values[2:] - values[:-2])))
    return off


def _smooth_stretches(plan: Plan, model: Responsive) -> tuple[IntArray, IntArray, IntArray]:
    """Return stretches of looks in which the model says that nothing jumps or bends: pairs, first and last scans."""
    pairs = plan.pairs
    looking = np.flatnonzero(pairs.looks > 0)
    first, last = pairs.first_scan[looking], pairs.last_scan[looking]
    starts = first[:, None]
    if isinstance(model, Kinked):
        cut = _scans_from(plan, looking, model.kinks_s()[pairs.target[looking]])
        cut = np.clip(cut, first[:, None], last[:, None] + 1)
        starts = np.sort(np.concatenate([starts, cut], axis=1), axis=1)
    stops = np.concatenate([starts[:, 1:], last[:, None] + 1], axis=1)
    row, place = np.nonzero(starts < stops)
    return looking[row], starts[row, place], stops[row, place] - 1


def _scans_from(plan: Plan, pair: IntArray, emission_s: FloatArray) -> IntArray:
    """Return the first scans (n, k) of pairs (n,) that see light of these moments (n, k), or later; 0 for nan."""
    pairs = plan.pairs
    pair = np.repeat(pair, emission_s.shape[1])
    left_s = np.nan_to_num(emission_s.ravel(), nan=-1e9)
    first_s = look_times_s(pairs, pair, pairs.first_scan[pair])
    # Light times change little in the time that light takes.
    near_s = np.clip(left_s, first_s, look_times_s(pairs, pair, pairs.last_scan[pair]))
    travel_s = plan.sightlines.place(pair, near_s).interpolated(plan.sightlines.travel_s)
    seen_ns = (left_s + travel_s) * 1e9 - pairs.phase_ns[pair]
    scans: IntArray = np.ceil(seen_ns / pairs.period_ns[pair]).astype(np.int64).reshape(emission_s.shape)
    return scans
