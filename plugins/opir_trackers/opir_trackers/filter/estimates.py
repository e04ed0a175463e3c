"""The estimates of the stereo filter: of each track both modes and how probable they are, as columns.

Where tracks are about a time, and how surely: positions and covariances at the times of looks.
"""

from typing import NamedTuple

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray, IntArray
from opir_core.estimation.motion import BOOST, COAST, followed, weights_at
from opir_core.interfaces.columns import Columns, names_of


class PredictedMeasurements(NamedTuple):
    """Tracks about a time: derivatives (n, 5, 3) of the position and the spread S (n, 12, 12) of the state.

    `blur` (n, sensors, 3, 3), m², is what the biases of the sensors that see a track, but for each one's own, add to
    the covariance of its position: rays of a sensor are held against a place that the others' biases have moved.
    """

    time_s: float
    derivative: FloatArray
    side: FloatArray
    blur: FloatArray | None = None

    def weights(self, time_s: FloatArray) -> FloatArray:
        """Return the weights (m, 5) of the derivatives at times (m,)."""
        return weights_at(time_s - self.time_s)

    def positions(self, track: IntArray, time_s: FloatArray) -> FloatArray:
        """Return positions (m, 3) of tracks (m,) at times (m,)."""
        return self.followed(track, self.weights(time_s))

    def followed(self, track: IntArray, weight: FloatArray) -> FloatArray:
        """Return positions (m, 3) of tracks (m,) at times of weights (m, 5)."""
        if len(self.derivative) == 1:
            lone: FloatArray = weight.dot(self.derivative[0])
            return lone
        return followed(self.derivative.take(track, axis=0), weight)

    def position_sides(self, track: IntArray, time_s: FloatArray) -> FloatArray:
        """Return A (m, 3, 12) with A Aᵀ the covariance of the position of tracks (m,) at times (m,)."""
        weight = weights_at(time_s - self.time_s)[:, :, None, None]
        blocks = self.side.reshape(len(self.side), 4, 3, BOOST)
        total: FloatArray = blocks[track, 0]
        for order in range(1, 4):
            total += blocks[track, order] * weight[:, order]
        return total

    def seen_covariances(self, track: IntArray, time_s: FloatArray, weight: FloatArray, rows: FloatArray) -> FloatArray:
        """Return the covariances (m, 2, 2) of what rows (m, 2, 3) make of the positions of tracks (m,) at times (m,).

        `weight` (m, 5) are those of the times. Many looks a track are cheaper by way of the position's covariance than
        by its sides.
        """
        if len(self.side) == 1:
            side = weight[:, :4].dot(self.side.reshape(4, 3 * BOOST)).reshape(-1, 3, BOOST)
            seen = rows @ side
            spread: FloatArray = seen @ seen.transpose(0, 2, 1)
        else:
            spread = (rows @ self.position_covariances(track, time_s)) @ rows.transpose(0, 2, 1)
        spread[:, 1, 0] = spread[:, 0, 1]
        return spread

    def position_covariances(self, track: IntArray, time_s: FloatArray) -> FloatArray:
        """Return the covariances (m, 3, 3) of the positions of tracks (m,) at times (m,): polynomials of degree 6.

        Many looks a track are cheaper this way than by `position_sides`; rounding is of the largest term's size.
        """
        since = (time_s - self.time_s)[:, None]
        terms = self._covariance_terms()
        total: FloatArray = terms[:, -1].take(track, axis=0)
        for power in range(terms.shape[1] - 2, -1, -1):
            total *= since
            total += terms[:, power].take(track, axis=0)
        return total.reshape(len(track), 3, 3)

    def _covariance_terms(self) -> FloatArray:
        """Return the coefficients (n, p, 9) of the powers of time in the covariance of the position, lowest first."""
        count = len(self.side)
        orders = 4 if np.count_nonzero(self.side[:, 6:]) else 2
        sides = self.side[:, : 3 * orders] * _SHARES[: 3 * orders]
        products = (sides @ sides.transpose(0, 2, 1)).reshape(count, orders, 3, orders, 3)
        blocks = products.transpose(0, 1, 3, 2, 4).reshape(count, orders * orders, 9)
        terms: FloatArray = _SUMS[orders] @ blocks
        return terms

    def reach_m(self, span_s: float) -> FloatArray:
        """Return bounds (n,) on the standard deviation of each track's position, all axes together, over a span.

        The span ends at the outlook's time. The spread of each derivative is bounded on its own.
        """
        spread = np.sqrt(np.sum(self.side.reshape(len(self.side), 4, -1) ** 2, axis=2))
        bound: FloatArray = np.sum(spread * weights_at(np.array([span_s]))[:, :4], axis=1)
        return bound if self.blur is None else bound + np.sqrt(np.trace(self.blur, axis1=2, axis2=3).max(axis=1))


#: What each row of a spread counts for in the position, times a power of time.
_SHARES = np.repeat([1.0, 1.0, 0.5, 1.0 / 6.0], 3)[:, None]

#: Which products of two derivatives' spreads, in order of rows, go with each power of time.
_SUMS = {
    orders: (np.add.outer(np.arange(orders), np.arange(orders)).ravel() == np.arange(2 * orders - 1)[:, None]) * 1.0
    for orders in (2, 4)
}


@frozen(eq=False)
class ModeEstimates(Columns):
    """The estimates of tracks, one row each, all at one time: mean and root of information of each mode, and weights.

    `weight` (n, 2) are the probabilities of boost and coast; `pace` (n, 3) the looks that detected and the time, s,
    over which they are counted, both fading, and the time since the last of them, s.
    """

    weight: FloatArray
    boost_mean: FloatArray
    boost_root: FloatArray
    coast_mean: FloatArray
    coast_root: FloatArray
    pace: FloatArray

    @classmethod
    def empty(cls) -> "ModeEstimates":
        """Return the bank of no tracks."""
        boost, coast = np.empty((0, BOOST)), np.empty((0, COAST))
        roots = np.empty((0, BOOST, BOOST)), np.empty((0, COAST, COAST))
        return cls(np.empty((0, 2)), boost, roots[0], coast, roots[1], np.empty((0, 3)))

    @property
    def likelier_position_m(self) -> FloatArray:
        """Return the inertial positions (n, 3) of the likelier mode of each track."""
        return np.where(self.weight[:, 1:] > self.weight[:, :1], self.coast_mean[:, :3], self.boost_mean[:, :3])

    def put(self, rows: IntArray, part: "ModeEstimates") -> "ModeEstimates":
        """Return the bank with its rows (m,) replaced by those of another."""
        columns = []
        for name in names_of(ModeEstimates):
            column = getattr(self, name).copy()
            column[rows] = getattr(part, name)
            columns.append(column)
        return ModeEstimates(*columns)
