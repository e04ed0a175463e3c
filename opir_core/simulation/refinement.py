"""Refinement of the interpolation grid: pieces of pairs' looks are halved until P_d is within the
tolerance.
"""

from collections.abc import Sequence
from typing import Any, NamedTuple

import numpy as np
from attrs import evolve
from scipy.special import ndtri

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.interfaces.detection_models import DetectionProbability
from opir_core.interfaces.records import Exposures
from opir_core.planning.looks import LookGeometry, blocks, look_times_s
from opir_core.planning.sightlines import Blocked, Pairs

#: Unit of the places of knots, ns. Knots are not at looks: whatever the phases of scans, they stay.
UNIT_NS = 1000

#: Distance, in these units, of knots from breakpoints, whose times are those of models to some
#: light time · speed / c.
MARGIN = 50

#: First pieces of smooth intervals: longest duration, s, or in scan periods, and largest number.
FIRST_PIECE_S = 16.0
FIRST_PIECE_SCANS = 8
MOST_FIRST_PIECES = 64

#: Least distance of the knots of a curve, in scan periods: where that is too far, each look is
#: evaluated.
LEAST_SCANS = 2

#: Tolerance of signals and noise midway between neighbouring knots: relative, or in standard
#: deviations of noise.
SIGNAL_SHARE = 0.01
SIGNAL_SIGMA = 0.05

#: Largest relative change of signals on pieces with three knots.
STEADY_SHARE = 0.3

#: Slack of single evaluations, as a share of the tolerance.
_SLACK_SHARE = 1e-5

#: Largest terms of third and of fourth order of a curve, as shares of the tolerance; or of both
#: together, if the curve of the piece twice as long predicts the new knots to within the last
#: share. With a bend anywhere between its five knots the error of a curve is then below the
#: tolerance (docs/design/knots_judged.py).
THIRD_SHARE = 0.25
FOURTH_SHARE = 0.08
_PREDICTED_SHARE = 1.0
MISSED_SHARE = 0.03

#: Limit of quantiles: beyond 8.3 a probability is 1 to the last bit, below -38 it is no double.
FARTHEST = 40.0

#: Error of P_d of looks with P_d rounded to 0 or 1, as a share of the tolerance.
CERTAIN_SHARE = 1e-4

#: Knots of a piece, and those evaluated first.
KNOTS = 5
_SPARE = slice(0, 5, 2)


class Curves(NamedTuple):
    """Polynomials over scan numbers: `coefficients` (5, k), lowest power first, of (scan - middle)
    · per_scan.
    """

    middle: FloatArray
    per_scan: FloatArray
    coefficients: FloatArray

    @classmethod
    def through(cls, scan: IntArray, values: FloatArray) -> "Curves":
        """Return the polynomials through values (5, k) at increasing scans (5, k)."""
        middle, per_scan = _scaled(scan)
        at = (scan - middle) * per_scan
        # Newton's divided differences, and from them the powers.
        newton = values.copy()
        for order in range(1, len(at)):
            newton[order:] = (newton[order:] - newton[order - 1 : -1]) / (at[order:] - at[:-order])
        coefficients = np.zeros(values.shape)
        for order in range(len(at) - 1, -1, -1):
            coefficients[1:] = coefficients[:-1] - at[order] * coefficients[1:]
            coefficients[0] = newton[order] - at[order] * coefficients[0]
        return cls(middle, per_scan, coefficients)

    @classmethod
    def straight(cls, scan: IntArray, values: FloatArray, powers: int) -> "Curves":
        """Return straight lines through values (2, k) at scans (2, k), which may coincide."""
        coefficients = np.zeros((powers, values.shape[1]))
        coefficients[0] = 0.5 * (values[0] + values[1])
        coefficients[1] = 0.5 * (values[1] - values[0])
        return cls(*_scaled(scan), coefficients)

    def joined(self, curves: "Curves", order: IntArray) -> "Curves":
        """Return these curves and others, reordered."""
        return Curves(
            *(np.concatenate(pair, axis=-1)[..., order] for pair in zip(self, curves, strict=True))
        )

    def at(self, column: IntArray, times: IntArray, scan: IntArray) -> FloatArray:
        """Return the values (n,) at scans (n,): `times` (m,) of them for each of the curves
        `column` (m,).
        """
        place = np.subtract(scan, np.repeat(self.middle[column], times), dtype=np.float64)
        place *= np.repeat(self.per_scan[column], times)
        value = np.repeat(self.coefficients[-1, column], times)
        for coefficient in self.coefficients[-2::-1]:
            value *= place
            value += np.repeat(coefficient[column], times)
        return value


def _scaled(scan: IntArray) -> tuple[FloatArray, FloatArray]:
    return 0.5 * (scan[0] + scan[-1]), 2.0 / np.maximum(scan[-1] - scan[0], 1)


class Intervals(NamedTuple):
    """Pieces of pairs' looks: pairs (k,), scans (m, k) of their knots, and the knots' rows (m, k)
    in the values.

    `predicted` (2, k) are the quantiles at the second and fourth knots by the curve before halving,
    or nan.
    """

    pair: IntArray
    scan: IntArray
    row: IntArray
    predicted: FloatArray

    def take(self, rows: Any) -> "Intervals":
        """Return some of the pieces, by a slice, a mask or numbers."""
        if isinstance(rows, slice):
            return Intervals(
                self.pair[rows], self.scan[:, rows], self.row[:, rows], self.predicted[:, rows]
            )
        numbers = np.flatnonzero(rows) if rows.dtype == np.bool_ else rows
        scan = self.scan.take(numbers, axis=1)
        row = self.row.take(numbers, axis=1)
        return Intervals(self.pair.take(numbers), scan, row, self.predicted.take(numbers, axis=1))

    def knots(self, places: Any) -> "Intervals":
        """Return the pieces with some of their knots only."""
        return Intervals(self.pair, self.scan[places], self.row[places], self.predicted)

    @classmethod
    def joined(cls, intervals: "Sequence[Intervals]") -> "Intervals":
        """Return the pieces of all parts, in order."""
        return cls(*(np.concatenate(columns, axis=-1) for columns in zip(*intervals, strict=True)))


class RefinedGrid(NamedTuple):
    """Settled pieces with three knots, pieces of five knots with curves and `rough` ones without,
    and the values at the knots.

    `values` (2 + 2 B, knots) are quantile, signals, noise and the sine of the elevation; places are
    those of `knot_places`.
    """

    settled: Intervals
    curved: Intervals
    rough: Intervals
    values: FloatArray


def knot_places(pairs: Pairs) -> Pairs:
    """Return pairs that look every `UNIT_NS` while looks are possible: the places of knots are the
    scans of these.
    """
    # After the light of an ignition: a breakpoint there cuts nothing off.
    start_ns = -(-(pairs.from_ns + 1) // UNIT_NS) * UNIT_NS
    can_look = (pairs.blocked == Blocked.NOT) | (pairs.blocked == Blocked.NO_LOOK)
    last_place = np.where(
        can_look & (pairs.to_ns > pairs.from_ns),
        np.maximum(pairs.to_ns - start_ns, 0) // UNIT_NS,
        -1,
    )
    unit_ns = np.full_like(pairs.period_ns, UNIT_NS)
    return evolve(
        pairs,
        period_ns=unit_ns,
        phase_ns=start_ns,
        first_scan=np.zeros_like(last_place),
        last_scan=last_place,
    )


class GridRefiner:
    """Refines the interpolation grid of all pairs: each round evaluates new knots of all open
    pieces at once.
    """

    def __init__(
        self, geometry: LookGeometry, model: DetectionProbability, tolerance: float
    ) -> None:
        self._geometry = geometry
        self._model = model
        self._tolerance = tolerance
        self._certain = certain_beyond(tolerance)
        self._known = np.empty((1, 0))
        self._count = 0

    def refined(self) -> RefinedGrid:
        """Return the refined grid, which does not depend on the phases of scans."""
        period_ns = self._geometry.pairs.period_ns
        self._geometry = evolve(self._geometry, pairs=knot_places(self._geometry.pairs))
        pieces, short = self._first_pieces(period_ns)
        settled = [pieces.take(slice(0, 0)).knots(_SPARE)]
        curved = [pieces.take(slice(0, 0))]
        rough = [short]
        while len(pieces.pair):
            is_settled = self._is_settled(pieces.knots(_SPARE))
            settled.append(pieces.take(is_settled).knots(_SPARE))
            pieces = self._filled(pieces.take(~is_settled))
            gaps = np.diff(pieces.scan, axis=0)
            fine = np.all(gaps > 0, axis=0)
            distinct = np.flatnonzero(fine)
            fine[distinct] = self._is_fine(pieces.take(distinct))
            curved.append(pieces.take(fine))
            is_rough = ~fine & (
                gaps.max(axis=0) * UNIT_NS
                <= np.maximum(LEAST_SCANS * period_ns[pieces.pair], UNIT_NS)
            )
            rough.append(pieces.take(is_rough))
            pieces = _halved(pieces.take(~fine & ~is_rough), self._values()[0])
        all_settled, all_curved, all_rough = (
            Intervals.joined(intervals) for intervals in (settled, curved, rough)
        )
        return RefinedGrid(all_settled, all_curved, all_rough, self._values())

    def _first_pieces(self, period_ns: IntArray) -> tuple[Intervals, Intervals]:
        """Return the first pieces, with first, middle and last knots evaluated, and those that have
        hardly a look.
        """
        pair, first_scan, last_scan = _smooth_intervals(self._geometry, self._model)
        longest_ns = np.maximum(FIRST_PIECE_S * 1e9, FIRST_PIECE_SCANS * period_ns[pair])
        piece_count = np.ceil((last_scan - first_scan) * UNIT_NS / longest_ns)
        count = np.clip(
            piece_count, 1, np.minimum(MOST_FIRST_PIECES, np.maximum(last_scan - first_scan, 1))
        ).astype(np.int64)
        number = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
        pair, first_scan, span, count = (
            np.repeat(column, count) for column in (pair, first_scan, last_scan - first_scan, count)
        )
        start = first_scan + span * number // count
        stop = first_scan + span * (number + 1) // count
        scan = start + (stop - start) * np.arange(KNOTS)[:, None] // (KNOTS - 1)
        is_short = (stop - start) * UNIT_NS <= LEAST_SCANS * period_ns[pair]
        if is_short.all():
            self._rows(pair[:1], scan[0, :1])  # any look: its values have the number of bands
        pieces = Intervals(pair, scan, np.zeros_like(scan), np.full((2, len(pair)), np.nan))
        long = pieces.take(~is_short)
        long.row[::2] = self._rows(np.broadcast_to(long.pair, (3, len(long.pair))), long.scan[::2])
        return long, pieces.take(is_short)

    def _filled(self, pieces: Intervals) -> Intervals:
        """Return pieces with second and fourth knots evaluated, where these are distinct scans."""
        lower = pieces.scan[0:3:2]
        inner_scan = pieces.scan[1::2]
        new = np.nonzero(inner_scan != lower)
        row = pieces.row[0:3:2].copy()
        row[new] = self._rows(pieces.pair[new[1]], inner_scan[new])
        pieces.row[1::2] = row
        return pieces

    def _rows(self, pair: IntArray, scan: IntArray) -> IntArray:
        """Return the rows of the values of looks (…); equal looks are evaluated once."""
        scan_count = int(scan.max(initial=0)) + 1
        looks, row = np.unique(pair * scan_count + scan, return_inverse=True)
        first_row = self._count
        self._evaluate(looks // scan_count, looks % scan_count)
        return first_row + row.reshape(scan.shape)

    def _evaluate(self, pair: IntArray, scan: IntArray) -> None:
        """Evaluate looks, sorted by pair, and append their values."""
        for rows in blocks(len(pair)):
            exposed = self._geometry.exposures(pair[rows], scan[rows])
            self._keep(values_of(self._model, exposed, self._tolerance))

    def _keep(self, values: FloatArray) -> None:
        """Append the values (2 + 2 B, n) of looks (n,)."""
        count = self._count + values.shape[1]
        if count > self._known.shape[1]:
            # Twice the room: values are seldom copied.
            wider = np.empty((len(values), 2 * count))
            wider[:, : self._count] = self._known[:, : self._count]
            self._known = wider
        self._known[:, self._count : count] = values
        self._count = count

    def _values(self) -> FloatArray:
        return self._known[:, : self._count]

    def _is_settled(self, pieces: Intervals) -> BoolArray:
        """Return which pieces of three knots have P_d 0 or 1 throughout, and lines within the
        tolerance.
        """
        values = self._values()
        quantile = values[0].take(pieces.row)
        bend = np.abs(quantile[1] - 0.5 * (quantile[0] + quantile[2]))
        settled: BoolArray = (quantile.max(axis=0) + bend < -self._certain) | (
            quantile.min(axis=0) - bend > self._certain
        )
        certain = np.flatnonzero(settled & (quantile[0] > 0.0))
        settled[certain] = self._is_steady(pieces.take(certain), values)
        return settled

    def _is_steady(self, pieces: Intervals, values: FloatArray) -> BoolArray:
        """Return which pieces have signals that are nearly linear and change little: three knots
        suffice.
        """
        signals = values[1 : len(values) // 2].take(pieces.row, axis=1)
        change = np.ptp(signals, axis=1) <= np.maximum(
            STEADY_SHARE * signals.max(axis=1), SIGNAL_SIGMA
        )
        return np.all(change, axis=0) & self._is_straight(pieces, values)

    def _is_fine(self, pieces: Intervals) -> BoolArray:
        """Return which pieces are interpolated to within the tolerance by curves and lines through
        their knots.
        """
        values = self._values()
        at = _positions(pieces)
        quantile = values[0].take(pieces.row)
        third, fourth = error_terms(at, quantile)
        error = third + fourth
        # The error of P_d is that of the quantile times the normal density, which is highest
        # nearest to quantile 0.
        nearest = np.maximum(
            np.where(
                quantile.min(axis=0) * quantile.max(axis=0) > 0.0, np.abs(quantile).min(axis=0), 0.0
            )
            - error,
            0.0,
        )
        density = np.exp(-0.5 * nearest * nearest) / np.sqrt(2.0 * np.pi)
        missed = np.abs(quantile[1::2] - pieces.predicted).max(axis=0)
        allowed = self._tolerance / np.maximum(density, 1e-300)
        is_smooth = (third <= THIRD_SHARE * allowed) & (fourth <= FOURTH_SHARE * allowed)
        fine: BoolArray = is_smooth | (
            (error <= _PREDICTED_SHARE * allowed) & (missed <= MISSED_SHARE * allowed)
        )
        detectable = np.flatnonzero(fine & (quantile.max(axis=0) + error >= -self._certain))
        fine[detectable] = self._is_straight(pieces.take(detectable), values)
        return fine

    def _is_straight(self, pieces: Intervals, values: FloatArray) -> BoolArray:
        """Return which pieces have signals and noise that are linear between knots, to within the
        tolerance.
        """
        width = len(values) // 2 - 1
        at = _positions(pieces)
        straight = np.ones(len(pieces.pair), dtype=np.bool_)
        for band in range(width):
            for of_look, least in (
                (values[1 + band], SIGNAL_SIGMA),
                (values[1 + width + band], 0.0),
            ):
                look_curves = of_look.take(pieces.row)
                allowed = np.maximum(SIGNAL_SHARE * np.abs(look_curves[1:-1]), least)
                # Deviations (3, k) of the inner values from the lines between their neighbours.
                share = (at[1:-1] - at[:-2]) / np.maximum(at[2:] - at[:-2], 1e-300)
                off = np.abs(
                    look_curves[1:-1]
                    - (look_curves[:-2] + share * (look_curves[2:] - look_curves[:-2]))
                )
                straight &= np.all(off <= 2.0 * allowed, axis=0)
        return straight


def values_of(model: DetectionProbability, exposed: Exposures, tolerance: float) -> FloatArray:
    """Return the interpolated values (2 + 2 B, n) of looks: quantile, signals, noise, sine of
    elevation.
    """
    response = model.response(exposed, slack=tolerance * _SLACK_SHARE)
    assert response is not None
    assert response.probit is not None
    quantile = np.clip(response.probit, -FARTHEST, FARTHEST)
    sine = np.zeros(len(quantile)) if response.elevation_sine is None else response.elevation_sine
    return np.concatenate([quantile[None], response.snr.T, response.noise_w_m2.T, sine[None]])


def certain_beyond(tolerance: float) -> float:
    """Return the quantile beyond which P_d is rounded to 1, and below minus which to 0."""
    return -float(ndtri(CERTAIN_SHARE * tolerance))


def _positions(pieces: Intervals) -> FloatArray:
    """Return the positions (m, k) of knots in [0, 1] between the first and the last of their
    piece.
    """
    return (pieces.scan - pieces.scan[0]) / np.maximum(pieces.scan[-1] - pieces.scan[0], 1)


def _halved(pieces: Intervals, quantile: FloatArray) -> Intervals:
    """Return the first halves of pieces, then the second halves, with second and fourth knots
    open.
    """
    halves = []
    distinct = np.all(np.diff(pieces.scan, axis=0) > 0, axis=0)
    curves = Curves.through(pieces.scan[:, distinct], quantile.take(pieces.row[:, distinct]))
    everyone = np.arange(len(curves.middle))
    for first_knot in (0, 2):
        scan = np.empty_like(pieces.scan)
        row = np.full(pieces.row.shape, -1)
        scan[::2] = pieces.scan[first_knot : first_knot + 3]
        row[::2] = pieces.row[first_knot : first_knot + 3]
        scan[1::2] = (scan[0:3:2] + scan[2:5:2]) // 2
        predicted = np.full((2, len(pieces.pair)), np.nan)
        predicted[:, distinct] = [
            curves.at(everyone, np.ones_like(everyone), inner_scan)
            for inner_scan in scan[1::2, distinct]
        ]
        halves.append(Intervals(pieces.pair, scan, row, predicted))
    return Intervals.joined(halves)


def error_terms(at: FloatArray, values: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the terms of third and of fourth order (k,) of curves through values (5, k) at
    positions (5, k).

    From the deviations of the second and fourth value from the parabola through the others: half of
    their difference, and half of their sum. Their sum bounds the error of a curve; for a smooth one
    it is many times the error.
    """
    start = values[0]
    middle = values[2]
    stop = values[4]
    start_slope = (middle - start) / np.maximum(at[2] - at[0], 1e-300)
    stop_slope = (stop - middle) / np.maximum(at[4] - at[2], 1e-300)
    bend = (stop_slope - start_slope) / np.maximum(at[4] - at[0], 1e-300)
    off = [
        values[place] - (start + (at[place] - at[0]) * (start_slope + (at[place] - at[2]) * bend))
        for place in (1, 3)
    ]
    return 0.5 * np.abs(off[0] - off[1]), 0.5 * np.abs(off[0] + off[1])


def _smooth_intervals(
    geometry: LookGeometry, model: DetectionProbability
) -> tuple[IntArray, IntArray, IntArray]:
    """Return intervals between breakpoints of the model, less the margin: pairs, first and last
    places of knots.
    """
    pairs = geometry.pairs
    looking = np.flatnonzero(pairs.looks > 0)
    first_scan = pairs.first_scan[looking]
    last_scan = pairs.last_scan[looking]
    starts = first_scan[:, None]
    breakpoints_s = model.breakpoints_s()
    if breakpoints_s is not None:
        cut = _scans_from(geometry, looking, breakpoints_s[pairs.target[looking]])
        cut = np.clip(cut, first_scan[:, None], last_scan[:, None] + 1)
        starts = np.sort(np.concatenate([starts, cut], axis=1), axis=1)
    stops = np.concatenate([starts[:, 1:], last_scan[:, None] + 1], axis=1)
    row, place = np.nonzero(starts < stops)
    start = starts[row, place]
    last_scan = stops[row, place] - 1
    return (
        looking[row],
        np.minimum(start + MARGIN, (start + last_scan) // 2),
        np.maximum(last_scan - MARGIN, (start + last_scan) // 2),
    )


def _scans_from(geometry: LookGeometry, pair: IntArray, emission_s: FloatArray) -> IntArray:
    """Return the first scans (n, k) of pairs (n,) that see light emitted at or after times (n, k);
    0 for nan.
    """
    pairs = geometry.pairs
    pair = np.repeat(pair, emission_s.shape[1])
    left_s = np.nan_to_num(emission_s.ravel(), nan=-1e9)
    first_s = look_times_s(pairs, pair, pairs.first_scan[pair])
    # The change of the light time within itself is negligible.
    near_s = np.clip(left_s, first_s, look_times_s(pairs, pair, pairs.last_scan[pair]))
    travel_s = geometry.sightlines.place(pair, near_s).interpolated(geometry.sightlines.travel_s)
    seen_ns = (left_s + travel_s) * 1e9 - pairs.phase_ns[pair]
    return np.ceil(seen_ns / pairs.period_ns[pair]).astype(np.int64).reshape(emission_s.shape)
