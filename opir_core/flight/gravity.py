"""Acceleration by a zonal gravity field, over columns of arcs, and for one arc's numbers."""

from collections.abc import Callable
from math import sqrt

import numpy as np

from opir_core.arrays import FloatArray
from opir_core.flight.forces import ZonalField

#: A right side for one arc: position and velocity as six numbers in, acceleration as three out.
Alone = Callable[[float, float, float, float, float, float], tuple[float, float, float]]


class Gravity:
    """The acceleration -mu/r² { r̂ [1 - Σ J_n (R/r)^n P'_{n+1}(s)] + ẑ Σ J_n (R/r)^n P'_n(s) }, with s = z/r.

    This is the gradient of mu/r [1 - Σ J_n (R/r)^n P_n(s)] (Montenbruck and Gill, Satellite Orbits, 3.2), simplified
    with (n+1) P_n + s P'_n = P'_{n+1}. Singular at the Earth's centre.
    """

    needs_velocity = False

    def __init__(self, field: ZonalField, zonal: tuple[str, ...]) -> None:
        self._mu = field.mu_m3_s2
        self._j2 = field.j2 * field.radius_m**2 if "j2" in zonal else 0.0
        self._j3 = field.j3 * field.radius_m**3 if "j3" in zonal else 0.0
        self._j4 = field.j4 * field.radius_m**4 if "j4" in zonal else 0.0

    def __call__(self, position: FloatArray, velocity: FloatArray | None = None) -> FloatArray:
        """Return accelerations (3, n), m/s², at positions (3, n), m, from the Earth's centre."""
        return self.with_inverse_radius(position)[0]

    def with_inverse_radius(self, position: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the accelerations, m/s², and 1/r, 1/m."""
        squares = position * position
        zz = squares[2]
        inverse_square = squares[0] + squares[1]
        inverse_square += zz
        np.divide(1.0, inverse_square, out=inverse_square)
        inverse_radius = np.sqrt(inverse_square)
        zz *= inverse_square
        radial, axial = self._harmonics(inverse_square, position[2], zz)
        attraction = inverse_square * inverse_radius
        attraction *= -self._mu
        radial *= attraction
        axial *= attraction
        acceleration = position * radial
        acceleration[2] += axial
        return acceleration, inverse_radius

    def alone(self, arc: int = 0) -> Alone:
        """Return the right side for one arc, every arc's being the same: the same operations in the same order.

        So it gives the same bits, and for a few arcs, where numpy's calls cost more than its arithmetic, far sooner.
        """
        with_inverse_radius = self.alone_with_inverse_radius

        def acceleration(x: float, y: float, z: float, *_velocity: float) -> tuple[float, float, float]:
            return with_inverse_radius(x, y, z)[:3]

        return acceleration

    def alone_with_inverse_radius(self, x: float, y: float, z: float) -> tuple[float, float, float, float]:
        """Return the acceleration, m/s², and 1/r, 1/m, at one position; raise ZeroDivisionError at the centre."""
        inverse_square = 1.0 / (x * x + y * y + z * z)
        inverse_radius = sqrt(inverse_square)
        ss = z * z * inverse_square
        weight = inverse_square * self._j2
        radial = (ss * -7.5 + 1.5) * weight + 1.0
        axial = weight * z * 3.0
        if self._j3:
            weight = inverse_square * self._j3
            radial -= weight * inverse_square * z * (17.5 * ss - 7.5)
            axial += weight * (7.5 * ss - 1.5)
        if self._j4:
            weight = inverse_square * inverse_square * self._j4
            radial -= weight * ((39.375 * ss - 26.25) * ss + 1.875)
            axial += weight * z * (17.5 * ss - 7.5)
        attraction = inverse_square * inverse_radius * -self._mu
        radial *= attraction
        return x * radial, y * radial, z * radial + axial * attraction, inverse_radius

    def _harmonics(self, inverse_square: FloatArray, z: FloatArray, ss: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return 1 - Σ J_n (R/r)^n P'_{n+1}(s) and r Σ J_n (R/r)^n P'_n(s), given 1/r² and s²."""
        weight = inverse_square * self._j2
        radial = ss * -7.5
        radial += 1.5
        radial *= weight
        radial += 1.0
        axial = weight * z
        axial *= 3.0
        if self._j3:
            weight = inverse_square * self._j3
            radial -= weight * inverse_square * z * (17.5 * ss - 7.5)
            axial += weight * (7.5 * ss - 1.5)
        if self._j4:
            weight = inverse_square * inverse_square * self._j4
            radial -= weight * ((39.375 * ss - 26.25) * ss + 1.875)
            axial += weight * z * (17.5 * ss - 7.5)
        return radial, axial
