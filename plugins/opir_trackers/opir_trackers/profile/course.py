"""Unit courses of boosts and their partial derivatives, for many hypotheses at once: what a fit needs.

With burn time T, burnout speed v and a sphere of radius R, height is h = v T c(t/T) and the angle swept w(t/T); c
depends on speed shape, pitch exponent, turn and pitch start alone, w also on flatness v T / R. Both are tabulated in
x = u^(1/4), in which they are smooth (`opir_core.flight.boost`), with the variations that make partial derivatives
beside them, and read at any time as Chebyshev series. Beyond the burnout the speed goes on growing as it did and the
angle from the local vertical stays, so that a fit can find a longer burn.
"""

from functools import cache
from typing import NamedTuple

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray, IntArray
from opir_core.flight.boost import speed_ratio, vertical_climb_s

#: Degree of the series in x.
_DEGREE = 18

#: Steps of the differences: logarithms of speed shape, pitch exponent, pitch start and flatness, and the turn, rad.
_STEP = 1e-5

#: The burn time of a unit course.
_ONE = np.ones(1)

#: The columns of partial derivatives.
SPEED, BURN, SHAPE, PITCH, TURN, LIFT = range(6)

#: The variations that are tabulated, by row: none, shape, pitch, turn, lift, flatness.
_BASE, _SHAPE, _PITCH, _TURN, _LIFT, _FLAT = range(6)


class Read(NamedTuple):
    """Courses at times: height (m,), m, angle swept (m,), rad, speed (m,), angle from the local vertical (m,).

    `height_slope` and `swept_slope` (m, 6) are their partial derivatives by the logarithms of speed, burn time, speed
    shape and pitch exponent, by the turn, rad, and by the logarithm of the pitch start's share of the burn.
    """

    height_m: FloatArray
    swept_rad: FloatArray
    speed_m_s: FloatArray
    lean_rad: FloatArray
    height_slope: FloatArray
    swept_slope: FloatArray


@frozen(eq=False)
class Courses:
    """Courses of n hypotheses: parameters (n,) and series (degree + 2, 6, n) of climb and sweep, by variation."""

    speed_m_s: FloatArray
    burn_s: FloatArray
    speed_shape: FloatArray
    pitch_exponent: FloatArray
    turn_rad: FloatArray
    lift: FloatArray
    flatness: FloatArray
    climb: FloatArray
    sweep: FloatArray

    @classmethod
    def of(
        cls, speed: FloatArray, burn: FloatArray, k: FloatArray, n: FloatArray, turn: FloatArray, lift: FloatArray,
        radius_m: FloatArray,
    ) -> "Courses":  # fmt: skip
        """Return the courses of parameters (n,) over spheres of those radii (n,)."""
        flatness = speed * burn / radius_m
        grown = np.exp(_STEP)
        k_, n_, lift_, flat_ = (np.repeat(value[None], 6, axis=0) for value in (k, n, lift, flatness))
        turn_ = np.repeat(turn[None], 6, axis=0)
        k_[_SHAPE] *= grown
        n_[_PITCH] *= grown
        turn_[_TURN] += _STEP
        lift_[_LIFT] *= grown
        flat_[_FLAT] *= grown
        climb, sweep = _tabulated(k_, n_, turn_, lift_, flat_)
        return cls(speed, burn, k, n, turn, lift, flatness, climb, sweep)

    def read(self, row: IntArray, elapsed_s: FloatArray) -> Read:
        """Return the courses of rows (m,) at times (m,) since their starts; before it they rest."""
        burn, shape, lift = self.burn_s[row], self.speed_shape[row], self.lift[row]
        share = np.maximum(elapsed_s / burn, 0.0)
        reach = burn * self.speed_m_s[row]
        x, x_lifted = _abscissa(share, lift), _abscissa(share, lift * np.exp(_STEP))
        c = _series(self.climb[:, :_FLAT], row, x, x_lifted)
        w = _series(self.sweep, row, x, x_lifted)
        early, early_shape = (vertical_climb_s(share, _ONE, shape * scale) for scale in (1.0, np.exp(_STEP)))
        before, after = share < lift, np.flatnonzero(share > 1.0)
        if len(after):
            self._go_on(c, w, row, share, after)
        c = np.where(before, early, c)
        c[_SHAPE] = np.where(before, early_shape, c[_SHAPE])
        pace = speed_ratio(share, _ONE, shape)
        lean = self.turn_rad[row] * np.sin(0.5 * np.pi * (x**4) ** self.pitch_exponent[row])
        lean = np.where(before, 0.0, lean)
        w[:, before] = 0.0
        speed = pace * self.speed_m_s[row]
        height, swept = reach * c[_BASE], w[_BASE]
        height_slope, swept_slope = np.empty((len(row), 6)), np.empty((len(row), 6))
        for column, variation in ((SHAPE, _SHAPE), (PITCH, _PITCH), (TURN, _TURN), (LIFT, _LIFT)):
            height_slope[:, column] = (c[variation] - c[_BASE]) * (reach / _STEP)
            swept_slope[:, column] = (w[variation] - swept) / _STEP
        by_flatness = (w[_FLAT] - swept) / _STEP
        moving = np.maximum(elapsed_s, 0.0) * speed
        radius = reach / self.flatness[row]
        height_slope[:, SPEED], swept_slope[:, SPEED] = height, by_flatness
        height_slope[:, BURN] = height - moving * np.cos(lean)
        swept_slope[:, BURN] = by_flatness - moving * np.sin(lean) / (radius + height)
        return Read(height, swept, speed, lean, height_slope, swept_slope)

    def _go_on(self, c: FloatArray, w: FloatArray, row: IntArray, share: FloatArray, after: IntArray) -> None:
        """Add to climbs and sweeps (variations, m) what comes beyond the burnout, at the places `after`."""
        row, share, ended = row[after], share[after], c[:, after]
        for number in range(6):
            grown = np.exp(_STEP)
            shape = self.speed_shape[row] * (grown if number == _SHAPE else 1.0)
            turn = self.turn_rad[row] + (_STEP if number == _TURN else 0.0)
            flatness = self.flatness[row] * (grown if number == _FLAT else 1.0)
            way = vertical_climb_s(share, _ONE, shape) - vertical_climb_s(np.ones_like(share), _ONE, shape)
            rise, level = way * np.cos(turn), ended[number % _FLAT]
            w[number, after] += way * np.sin(turn) / (1.0 / flatness + level + 0.5 * rise)
            if number < _FLAT:
                c[number, after] = level + rise


def _abscissa(share: FloatArray, lift: FloatArray) -> FloatArray:
    u = np.maximum((share - lift) / (1.0 - lift), 0.0)
    x: FloatArray = np.minimum(np.sqrt(np.sqrt(u)), 1.0)
    return x


def _series(series: FloatArray, row: IntArray, x: FloatArray, x_lifted: FloatArray) -> FloatArray:
    """Return the values (variations, m) of series (K, variations, n), by Clenshaw's recurrence."""
    every = np.repeat((4.0 * x - 2.0)[None], series.shape[1], axis=0)
    every[_LIFT] = 4.0 * x_lifted - 2.0
    chosen = series[:, :, row]
    later, latest = np.zeros_like(every), np.zeros_like(every)
    for coefficient in chosen[:0:-1]:
        later, latest = latest, every * latest - later + coefficient
    value: FloatArray = 0.5 * every * latest - later + chosen[0]
    return value


def _tabulated(
    k: FloatArray, n: FloatArray, turn: FloatArray, lift: FloatArray, flat: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the series (K, ...) of climb and sweep of parameters (...)."""
    x = _nodes().reshape(-1, *(1 for _ in k.shape))
    u, pace = x**4, 4.0 * x**3
    rate = speed_ratio(lift + (1.0 - lift) * u, _ONE, k) * pace * (1.0 - lift)
    lean = turn * np.sin(0.5 * np.pi * u**n)
    begun = vertical_climb_s(lift, _ONE, k)
    rise = rate * np.cos(lean)
    climb = begun + _summed(_at_nodes(), rise)
    series = _summed(_integral(), rise)
    series[0] += begun
    return series, _summed(_integral(), rate * np.sin(lean) / (1.0 / flat + climb))


def _summed(matrix: FloatArray, values: FloatArray) -> FloatArray:
    """Return matrix · values, summed in one order whatever the number of hypotheses (BLAS does not promise that)."""
    total = np.zeros((len(matrix), *values.shape[1:]))
    for weights, value in zip(matrix.T, values, strict=True):
        total += weights.reshape(-1, *(1 for _ in value.shape)) * value
    return total


@cache
def _nodes() -> FloatArray:
    """Return the Chebyshev-Lobatto points of [0, 1], ascending."""
    nodes: FloatArray = 0.5 - 0.5 * np.cos(np.pi * np.arange(_DEGREE + 1) / _DEGREE)
    return nodes


@cache
def _integral() -> FloatArray:
    """Return the matrix from values at the nodes to the Chebyshev coefficients of the integral from 0.

    Trefethen, Approximation Theory and Approximation Practice, 2013, ch. 19.
    """
    from numpy.polynomial import chebyshev

    inverse = np.linalg.inv(chebyshev.chebvander(2.0 * _nodes() - 1.0, _DEGREE))
    integrals = np.stack([chebyshev.chebint(row, lbnd=-1.0) for row in np.eye(_DEGREE + 1)], axis=1)
    return np.asarray(0.5 * (integrals @ inverse))


@cache
def _at_nodes() -> FloatArray:
    """Return the matrix from values at the nodes to integrals from 0 to the nodes."""
    from numpy.polynomial import chebyshev

    return np.asarray(chebyshev.chebvander(2.0 * _nodes() - 1.0, _DEGREE + 1) @ _integral())
