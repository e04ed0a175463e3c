"""Estimates of the IMM filter in columns, and the positions and covariances that they predict about
a time.
"""

from typing import NamedTuple, TypeVar

import numpy as np
from attrs import Factory, evolve, field, frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.interfaces import Columns, names_of
from opir_estimation.filter.measurement_updates import Gaussian
from opir_estimation.motion import BOOST, COAST, taylor_positions, taylor_weights


class PredictedMeasurements(NamedTuple):
    """Track predictions about a time: position derivatives (n, 5, 3) and their covariance roots (n,
    12, 12).

    `bias_covariance` (n, sensors, 3, 3), m², is the position covariance due to the biases of the
    other sensors that see a track: a line of sight is compared with a position that these biases
    have shifted.
    """

    time_s: float
    derivative: FloatArray
    root: FloatArray
    bias_covariance: FloatArray | None = None

    def weights(self, time_s: FloatArray) -> FloatArray:
        """Return the Taylor weights (m, 5) at times (m,)."""
        return taylor_weights(time_s - self.time_s)

    def positions(self, track: IntArray, time_s: FloatArray) -> FloatArray:
        """Return positions (m, 3) of tracks (m,) at times (m,)."""
        return self.positions_with(track, self.weights(time_s))

    def positions_with(self, track: IntArray, weight: FloatArray) -> FloatArray:
        """Return positions (m, 3) of tracks (m,) with Taylor weights (m, 5)."""
        if len(self.derivative) == 1:
            positions: FloatArray = weight.dot(self.derivative[0])
            return positions
        return taylor_positions(self.derivative.take(track, axis=0), weight)

    def projected_covariances(
        self, track: IntArray, time_s: FloatArray, weight: FloatArray, rows: FloatArray
    ) -> FloatArray:
        """Return the covariances (m, 2, 2) of positions of tracks (m,) at times (m,), projected by
        rows (m, 2, 3).

        `weight` (m, 5) are the Taylor weights. With many looks per track the position covariance is
        cheaper than its root.
        """
        if len(self.root) == 1:
            side = weight[:, :4].dot(self.root.reshape(4, 3 * BOOST)).reshape(-1, 3, BOOST)
            projected = rows @ side
            spread: FloatArray = projected @ projected.mT
        else:
            spread = (rows @ self.position_covariances(track, time_s)) @ rows.mT
        spread[:, 1, 0] = spread[:, 0, 1]
        return spread

    def position_covariances(self, track: IntArray, time_s: FloatArray) -> FloatArray:
        """Return the position covariances (m, 3, 3) of tracks (m,) at times (m,), as polynomials of
        degree 6.

        The rounding error is of
        the size of the largest term.
        """
        since = (time_s - self.time_s)[:, None]
        terms = self._covariance_terms()
        total: FloatArray = terms[:, -1].take(track, axis=0)
        for power in range(terms.shape[1] - 2, -1, -1):
            total *= since
            total += terms[:, power].take(track, axis=0)
        return total.reshape(len(track), 3, 3)

    def _covariance_terms(self) -> FloatArray:
        """Return the coefficients (n, p, 9) of the powers of time in the position covariance,
        lowest first.
        """
        count = len(self.root)
        orders = 4 if np.count_nonzero(self.root[:, 6:]) else 2
        scaled = self.root[:, : 3 * orders] * _SHARES[: 3 * orders]
        products = (scaled @ scaled.mT).reshape(count, orders, 3, orders, 3)
        blocks = products.transpose(0, 1, 3, 2, 4).reshape(count, orders * orders, 9)
        return _SUMS[orders] @ blocks

    def position_bound_m(self, span_s: float) -> FloatArray:
        """Return bounds (n,) on the standard deviation of the position, all axes together, over a
        span.

        The span ends at the time of the prediction. Each derivative is bounded on its own.
        """
        spread = np.sqrt(np.sum(self.root.reshape(len(self.root), 4, -1) ** 2, axis=2))
        bound: FloatArray = np.sum(spread * taylor_weights(np.array([span_s]))[:, :4], axis=1)
        return (
            bound
            if self.bias_covariance is None
            else bound + np.sqrt(np.trace(self.bias_covariance, axis1=2, axis2=3).max(axis=1))
        )


#: Factor of each row of a root in the position, times a power of time.
_SHARES = np.repeat([1.0, 1.0, 0.5, 1.0 / 6.0], 3)[:, None]

#: Products of two derivatives that contribute to each power of time.
_SUMS = {
    orders: (
        np.add.outer(np.arange(orders), np.arange(orders)).ravel()
        == np.arange(2 * orders - 1)[:, None]
    )
    * 1.0
    for orders in (2, 4)
}


#: Probabilities of steady burn, staging and free where nothing is known of them: those that
#: transitions lead to.
BURN_SHARE = np.array([[1.0, 0.0, 0.0]])


class Burns(NamedTuple):
    """Burns (n,) of three parts: steady, staging and free (`burn_modes`).

    Means (n, 3, d), information roots (n, 3, d, d) and probabilities (n, 3).
    """

    mean: FloatArray
    root: FloatArray
    share: FloatArray

    @classmethod
    def of(cls, boost: Gaussian) -> "Burns":
        """Return burns all parts of which are the boost."""
        components = (in_parts(boost.mean), in_parts(boost.root))
        return cls(*components, BURN_SHARE.repeat(len(boost.mean), axis=0))

    @property
    def are_free(self) -> BoolArray:
        """Which burns (n,) have a free part that is computed."""
        return self.share[:, 2] > 0.0

    def part(self, number: int) -> Gaussian:
        """Return the estimates of one part."""
        return Gaussian(self.mean[:, number], self.root[:, number])

    def copied(self) -> "Burns":
        """Return a copy that may be written to."""
        return Burns(self.mean.copy(), self.root.copy(), self.share.copy())


def in_parts(rows: FloatArray) -> FloatArray:
    """Return rows (n, ...) as the equal parts of a burn, (n, 3, ...)."""
    return rows[:, None].repeat(BURN_SHARE.shape[1], axis=1)


_Record = TypeVar("_Record", Gaussian, Burns)


def rows_of(record: _Record, rows: IntArray) -> _Record:
    """Return some rows, ascending and distinct: all rows are the record itself."""
    if rows.size == record.mean.shape[0]:
        return record
    return type(record)(*[column[rows] for column in record])


def with_rows(record: _Record, rows: IntArray, part: _Record) -> _Record:
    """Return the record with some rows, ascending and distinct, replaced."""
    if rows.size == record.mean.shape[0]:
        return part
    columns = [column.copy() for column in record]
    for column, values in zip(columns, part, strict=True):
        column[rows] = values
    return type(record)(*columns)


@frozen(eq=False, repr=False)
class ModeEstimates(Columns):
    """Estimates of tracks at one time, one row each: mean and information root of each mode, and
    mode probabilities.

    `weight` (n, 2) are the probabilities of boost and coast. `detection_rate` (n, 3) are the number
    of detections and the time, s, over which they are counted, both with exponential forgetting,
    and the time since the last detection, s.

    `burn_mean`, `burn_root` and `burn_share` are the burns (`burn_modes`); `boost_mean` and
    `boost_root` are their moments. Without them all parts are the boost. The share of the free part
    is the probability of thrust in another direction than along the velocity, given that the target
    burns; 0 where the part is not computed.
    """

    weight: FloatArray
    boost_mean: FloatArray
    boost_root: FloatArray
    coast_mean: FloatArray
    coast_root: FloatArray
    detection_rate: FloatArray
    burn_mean: FloatArray = field(
        default=Factory(lambda self: in_parts(self.boost_mean), takes_self=True)
    )
    burn_root: FloatArray = field(
        default=Factory(lambda self: in_parts(self.boost_root), takes_self=True)
    )
    burn_share: FloatArray = field(
        default=Factory(lambda self: BURN_SHARE.repeat(len(self.weight), axis=0), takes_self=True)
    )

    @classmethod
    def empty(cls) -> "ModeEstimates":
        """Return the estimates of no tracks."""
        boost = Gaussian(np.empty((0, BOOST)), np.empty((0, BOOST, BOOST)))
        coast = Gaussian(np.empty((0, COAST)), np.empty((0, COAST, COAST)))
        return cls(np.empty((0, 2)), *boost, *coast, np.empty((0, 3)))

    @property
    def boost(self) -> Gaussian:
        """The estimates of the boost mode."""
        return Gaussian(self.boost_mean, self.boost_root)

    @property
    def coast(self) -> Gaussian:
        """The estimates of the coast mode."""
        return Gaussian(self.coast_mean, self.coast_root)

    @property
    def burns(self) -> Burns:
        """The parts of the boost."""
        return Burns(self.burn_mean, self.burn_root, self.burn_share)

    @property
    def are_used(self) -> tuple[bool, bool]:
        """Whether any track may be in boost, and in coast."""
        weight = self.weight
        greatest = weight[0] if len(weight) == 1 else np.maximum.reduce(weight, axis=0)
        boost, coast = greatest.tolist()
        return boost > 0.0, coast > 0.0

    @property
    def likelier_position_m(self) -> FloatArray:
        """The inertial positions (n, 3) of the likelier mode of each track."""
        return self.likelier_state[:, :3]

    @property
    def likelier_state(self) -> FloatArray:
        """The inertial positions and velocities (n, 6) of the likelier mode of each track."""
        return np.where(
            self.weight[:, 1:] > self.weight[:, :1], self.coast_mean, self.boost_mean[:, :COAST]
        )

    def moved_by(self, shift: FloatArray) -> "ModeEstimates":
        """Return the estimates with positions and velocities shifted by (n, 6)."""
        boost = self.boost_mean.copy()
        burn = self.burn_mean.copy()
        boost[:, :COAST] += shift
        burn[:, :, :COAST] += shift[:, None]
        return evolve(self, boost_mean=boost, coast_mean=self.coast_mean + shift, burn_mean=burn)

    def widened(self, factor: FloatArray) -> "ModeEstimates":
        """Return the estimates with standard deviations of positions and velocities times factors
        (n,).
        """
        share = np.ones((len(factor), 1, self.boost_root.shape[2]))
        share[:, :, :COAST] = 1.0 / factor[:, None, None]
        return evolve(
            self,
            boost_root=self.boost_root * share,
            coast_root=self.coast_root * share[:, :, :COAST],
            burn_root=self.burn_root * share[:, None],
        )

    def put(self, rows: IntArray, values: "ModeEstimates") -> "ModeEstimates":
        """Return the estimates with rows (m,) replaced."""
        columns = []
        for name in names_of(ModeEstimates):
            column = getattr(self, name).copy()
            column[rows] = getattr(values, name)
            columns.append(column)
        return ModeEstimates(*columns)
