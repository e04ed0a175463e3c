"""The course of a boosted ascent for unit burnout speed: integrals of a profile's speed and flight path angle.

With height h above a sphere of radius R and swept angle phi, h' = v sin(gamma) and phi' = v cos(gamma) / (R + h).

After pitch-over the flight path angle goes like u^n, u = (t - tv)/(T - tv), with a fractional n. In x = u^(1/4) height
and swept angle are so smooth that one Chebyshev series over the whole turn is exact to rounding: degree 32 leaves less
than 1e-9 m for every profile. Series are integrated exactly (Trefethen, Approximation Theory and Approximation
Practice, 2013, ch. 19).
"""

from collections.abc import Sequence
from functools import cache
from math import factorial

import numpy as np
from attrs import fields, frozen
from numpy.typing import ArrayLike

from opir_core.arrays import FloatArray, RowArray
from opir_core.flight.profiles import BoostProfile

#: Of the series in x; `docs/design/turn_series.py` shows what other degrees, and other powers of u, leave.
_DEGREE = 32


@frozen(eq=False)
class Ascent:
    """The course of n targets for unit burnout speed; it follows from profile and burnout flight path angle alone.

    Columns (n,): `burn_time_s`, `pitch_start_s`, `speed_shape`, `pitch_exponent` as in the profile; `turn_rad` is the
    burnout flight path angle from the vertical. At the 33 nodes of the turn (33, n): `climb_rate_s` and `sweep_rate_s`
    are dh/dx and (R + h) dphi/dx over burnout speed, `climb_s` is height over burnout speed.
    """

    burn_time_s: FloatArray
    pitch_start_s: FloatArray
    speed_shape: FloatArray
    pitch_exponent: FloatArray
    turn_rad: FloatArray
    climb_rate_s: FloatArray
    sweep_rate_s: FloatArray
    climb_s: FloatArray

    def take(self, rows: RowArray) -> "Ascent":
        """Return some of the ascents."""
        return Ascent(*(getattr(self, column.name)[..., rows] for column in fields(Ascent)))

    def burnout_height_m(self, burnout_speed_m_s: FloatArray) -> FloatArray:
        """Return the height at burnout, (n,)."""
        height_m: FloatArray = burnout_speed_m_s * self.climb_s[-1]
        return height_m

    def burnout_swept_rad(self, burnout_speed_m_s: FloatArray, radius_m: FloatArray) -> FloatArray:
        """Return the angle swept at burnout over spheres of that radius, (n,)."""
        flatness_s = radius_m / burnout_speed_m_s
        swept: FloatArray = np.zeros(np.shape(flatness_s))
        for weight, rate_s, climb_s in zip(_integral_at_nodes()[-1], self.sweep_rate_s, self.climb_s, strict=True):
            swept += weight * (rate_s / (flatness_s + climb_s))
        return swept

    def climb_series_s(self) -> FloatArray:
        """Return Chebyshev coefficients (34, n) of height over burnout speed during the turn."""
        series: FloatArray = _applied(_integral_series(), self.climb_rate_s)
        series[0] += self.climb_s[0]
        return series

    def swept_series_rad(self, burnout_speed_m_s: FloatArray, radius_m: FloatArray) -> FloatArray:
        """Return Chebyshev coefficients (34, n) of the angle swept during the turn over spheres of that radius."""
        rate = self.sweep_rate_s / (radius_m / burnout_speed_m_s + self.climb_s)
        return _applied(_integral_series(), rate)


def ascent(profiles: Sequence[BoostProfile], burnout_flight_path_angle_rad: ArrayLike) -> Ascent:
    """Return the ascents of targets with these profiles, one a target, and burnout flight path angles (n,)."""
    burn, start, k, n = (
        np.array([getattr(profile, name) for profile in profiles], dtype=np.float64)
        for name in ("burn_time_s", "pitch_start_s", "speed_shape", "pitch_exponent")
    )
    turn = 0.5 * np.pi - np.broadcast_to(np.asarray(burnout_flight_path_angle_rad, dtype=np.float64), burn.shape)
    return ascent_of_shape(burn, start, k, n, turn)


def ascent_of_shape(burn: FloatArray, start: FloatArray, k: FloatArray, n: FloatArray, turn: FloatArray) -> Ascent:
    """Return the ascents (n,) of these burn times, pitch starts, speed shapes, pitch exponents and turns."""
    x = _nodes()[:, None]
    u = (x * x) * (x * x)
    pace_s = speed_ratio(start + (burn - start) * u, burn, k) * (4.0 * x * x * x) * (burn - start)
    lean = lean_rad(u, n, turn)
    climb_rate_s, sweep_rate_s = pace_s * np.cos(lean), pace_s * np.sin(lean)
    climb_s = vertical_climb_s(start, burn, k) + _applied(_integral_at_nodes(), climb_rate_s)
    return Ascent(burn, start, k, n, turn, climb_rate_s, sweep_rate_s, climb_s)


def speed_ratio(elapsed_s: FloatArray, burn_time_s: FloatArray, speed_shape: FloatArray) -> FloatArray:
    """Return speed over burnout speed, 0 at ignition to 1 at burnout."""
    return np.expm1(speed_shape * elapsed_s / burn_time_s) / np.expm1(speed_shape)


def lean_rad(u: FloatArray, pitch_exponent: FloatArray, turn_rad: FloatArray) -> FloatArray:
    """Return the angle of the velocity from the local vertical at fraction u of the turn, in [0, 1]."""
    return turn_rad * np.sin(0.5 * np.pi * u**pitch_exponent)


def vertical_climb_s(elapsed_s: FloatArray, burn_time_s: FloatArray, speed_shape: FloatArray) -> FloatArray:
    """Return height over burnout speed while the flight is vertical: T (e^y - 1 - y) / (k (e^k - 1)), y = k t/T.

    Written so that nothing cancels for small k, where it is t²/(2T).
    """
    share = elapsed_s / burn_time_s
    return elapsed_s * share * _second_exponential(speed_shape * share) * (speed_shape / np.expm1(speed_shape))


def series_value(series: FloatArray, target: RowArray, x: FloatArray) -> FloatArray:
    """Return Chebyshev series (K, n) of targets (m,) at x in [0, 1] (m,), by Clenshaw's recurrence."""
    double_y = 4.0 * x - 2.0
    later, latest = np.zeros_like(double_y), np.zeros_like(double_y)
    for coefficient in series[:0:-1]:
        later, latest = latest, double_y * latest - later + coefficient[target]
    value: FloatArray = 0.5 * double_y * latest - later + series[0][target]
    return value


def _second_exponential(y: FloatArray) -> FloatArray:
    """Return (e^y - 1 - y) / y² for y >= 0: below 1 by Taylor's series, whose first term left out is 1e-17 of it."""
    small, large = np.minimum(y, 1.0), np.maximum(y, 1.0)
    series = np.zeros_like(y)
    for power in range(18, 1, -1):
        series = series * small + 1.0 / factorial(power)
    return np.where(y < 1.0, series, (np.expm1(large) - large) / (large * large))


@cache
def _nodes() -> FloatArray:
    """Return the Chebyshev-Lobatto points of [0, 1], ascending."""
    return 0.5 - 0.5 * np.cos(np.pi * np.arange(_DEGREE + 1) / _DEGREE)


@cache
def _integral_series() -> FloatArray:
    """Return the matrix (34, 33) from values at the nodes to Chebyshev coefficients of the integral from x = 0."""
    node, order = np.arange(_DEGREE + 1), np.arange(_DEGREE + 1)[:, None]
    ends = np.where((node == 0) | (node == _DEGREE), 0.5, 1.0)
    series = np.zeros((_DEGREE + 3, _DEGREE + 1))
    series[:-2] = (2.0 / _DEGREE) * ends * np.cos(np.pi * order * (_DEGREE - node) / _DEGREE)
    series[_DEGREE] *= 0.5
    integral = np.zeros((_DEGREE + 2, _DEGREE + 1))
    integral[1:] = 0.25 * (series[:-2] - series[2:]) / np.arange(1, _DEGREE + 2)[:, None]
    signs = (-1.0) ** np.arange(1, _DEGREE + 2)[:, None]
    integral[0] = -(signs * integral[1:]).sum(axis=0)
    return integral


@cache
def _integral_at_nodes() -> FloatArray:
    """Return the matrix (33, 33) from values at the nodes to integrals from x = 0 to the nodes."""
    order = np.arange(_DEGREE + 2)
    polynomials = np.cos(np.pi * order * (_DEGREE - np.arange(_DEGREE + 1)[:, None]) / _DEGREE)
    return _applied(polynomials, _integral_series())


def _applied(matrix: FloatArray, columns: FloatArray) -> FloatArray:
    """Return matrix · columns, summed in one order whatever the number of columns (BLAS does not promise that)."""
    total = np.zeros((len(matrix), *columns.shape[1:]))
    for weights, row in zip(matrix.T, columns, strict=True):
        total += weights[:, None] * row
    return total
