"""Accelerations by a zonal gravity field and by drag, over columns of arcs (3, n) and for the
numbers of one arc.

Drag needs the geodetic height above the WGS 84 ellipsoid, here in closed form. Each arc stays
within one layer of the air during a step.
"""

from math import sqrt
from typing import Any

import numpy as np

from opir_core.arrays import FloatArray
from opir_core.constants import EARTH_ECCENTRICITY_SQUARED, EARTH_EQUATORIAL_RADIUS_M
from opir_core.flight.atmosphere_density import log_density
from opir_core.flight.dop853 import FloatAcceleration
from opir_core.flight.forces import ZonalField
from opir_core.geometry.vectors import FloatPair


def height_m(position: FloatArray, inverse_radius: FloatArray) -> FloatArray:
    """Return geodetic heights (n,), m, of positions (3, n), m, given their 1/r.

    The foot's normal is taken along (x, y, z/k) with k = 1 - e² N/(N + h) expanded to second order
    in the flattening; an error in the normal's direction enters the height squared. Within 2e-8 m
    from 5 km below the ellipsoid to geostationary height; below the ellipsoid's evolute only the
    sign is meaningful.
    """
    return _height_and_normal(inverse_radius, *position)[0]


def height_and_climb(
    position: FloatArray, velocity: FloatArray, inverse_radius: FloatArray
) -> FloatPair:
    """Return heights, m, and their rates, m/s: the velocity along the ellipsoid's normal."""
    height, stretched_z, inverse_norm = _height_and_normal(inverse_radius, *position)
    along = position[0] * velocity[0] + position[1] * velocity[1] + stretched_z * velocity[2]
    return height, along * inverse_norm


def height_and_up(position: FloatArray, inverse_radius: FloatArray) -> FloatPair:
    """Return heights (n,), m, and the directions (3, n) in which they grow, to 1e-7 rad."""
    height, stretched_z, inverse_norm = _height_and_normal(inverse_radius, *position)
    up = position.copy()
    up[2] = stretched_z
    up *= inverse_norm
    return height, up


def _height_and_normal(
    inverse_radius: Any,
    x: Any,
    y: Any,
    z: Any,
    *,
    sqrt: Any = np.sqrt,
    minimum: Any = np.minimum,
) -> tuple[Any, Any, Any]:
    """Return the height, m, z stretched towards the normal, and the reciprocal length of (x, y,
    it), 1/m: of rows (n,), or of numbers with the `sqrt` and `minimum` of numbers.
    """
    # k = 1 - e² q (1 + e² s² (1/2 - q)), with q = a/r and s = z/r. Clamped at q = 2, so that the
    # height stays negative and finite towards the centre.
    ratio = minimum(EARTH_EQUATORIAL_RADIUS_M * inverse_radius, 2.0)
    sine_squared = z * inverse_radius
    sine_squared *= sine_squared
    factor = 0.5 - ratio
    factor *= sine_squared
    factor *= EARTH_ECCENTRICITY_SQUARED
    factor += 1.0
    factor *= ratio
    factor *= -EARTH_ECCENTRICITY_SQUARED
    factor += 1.0
    stretched_z = z / factor
    equatorial = x * x
    equatorial += y * y
    inverse_norm = 1.0 / sqrt(stretched_z * stretched_z + equatorial)
    foot = stretched_z * inverse_norm
    foot *= foot
    foot *= -EARTH_ECCENTRICITY_SQUARED
    foot += 1.0
    foot = sqrt(foot)
    foot *= EARTH_EQUATORIAL_RADIUS_M
    height = z * stretched_z
    height += equatorial
    height *= inverse_norm
    height -= foot
    return height, stretched_z, inverse_norm


class Gravity:
    """The acceleration -mu/r² { r̂ [1 - Σ J_n (R/r)^n P'_{n+1}(s)] + ẑ Σ J_n (R/r)^n P'_n(s) },
    with s = z/r.

    This is the gradient of mu/r [1 - Σ J_n (R/r)^n P_n(s)] (Montenbruck and Gill, Satellite Orbits,
    3.2), simplified with (n+1) P_n + s P'_n = P'_{n+1}. Singular at the Earth's centre.
    """

    needs_velocity = False

    def __init__(self, field: ZonalField, zonal: tuple[str, ...]) -> None:
        self._mu = field.mu_m3_s2
        self._j2 = field.j2 * field.radius_m**2 if "j2" in zonal else 0.0
        self._j3 = field.j3 * field.radius_m**3 if "j3" in zonal else 0.0
        self._j4 = field.j4 * field.radius_m**4 if "j4" in zonal else 0.0
        self._is_round = not (self._j2 or self._j3 or self._j4)

    def __call__(self, position: FloatArray, velocity: FloatArray | None = None) -> FloatArray:
        """Return accelerations (3, n), m/s², at positions (3, n), m, from the Earth's centre."""
        return self.with_inverse_radius(position)[0]

    def with_inverse_radius(self, position: FloatArray) -> FloatPair:
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

    def of_arc(self, arc: int) -> FloatAcceleration:
        """Return the acceleration as a function of one arc's numbers: the same operations in the
        same order.
        """
        return lambda x, y, z, *velocity: self.alone_with_inverse_radius(x, y, z)[:3]

    def alone_with_inverse_radius(
        self, x: float, y: float, z: float
    ) -> tuple[float, float, float, float]:
        """Return the acceleration, m/s², and 1/r, 1/m, at one position; raise ZeroDivisionError at
        the centre.
        """
        inverse_square = 1.0 / (x * x + y * y + z * z)
        inverse_radius = sqrt(inverse_square)
        attraction = inverse_square * inverse_radius * -self._mu
        if self._is_round:
            return x * attraction, y * attraction, z * attraction, inverse_radius
        ss = z * z * inverse_square
        radial, axial = self._harmonics(inverse_square, z, ss)
        radial *= attraction
        return x * radial, y * radial, z * radial + axial * attraction, inverse_radius

    def _harmonics(self, inverse_square: Any, z: Any, ss: Any) -> tuple[Any, Any]:
        """Return 1 - Σ J_n (R/r)^n P'_{n+1}(s) and r Σ J_n (R/r)^n P'_n(s), given 1/r² and s²: rows
        or numbers."""
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
        return radial, axial


class GravityAndDrag:
    """The zonal field, and -rho |w| w / (2 beta) with w the velocity relative to air that turns
    about z.

    `layer_parameters`, (13, n), are those of `AirLayers` for each arc; `log_half_inverse_beta` is
    ln(1/(2 beta)).
    """

    needs_velocity = True

    def __init__(
        self,
        gravity: Gravity,
        layer_parameters: FloatArray,
        log_half_inverse_beta: FloatArray,
        air_rotation_rad_s: float,
    ) -> None:
        self._gravity = gravity
        self._parameters = layer_parameters
        self._log_half_inverse_beta = log_half_inverse_beta
        self._rotation = air_rotation_rad_s

    def __call__(self, position: FloatArray, velocity: FloatArray) -> FloatArray:
        """Return accelerations (3, n), m/s²."""
        acceleration, inverse_radius = self._gravity.with_inverse_radius(position)
        factor = log_density(self._parameters, height_m(position, inverse_radius))
        factor += self._log_half_inverse_beta
        np.exp(factor, out=factor)
        wind = velocity.copy()
        wind[0] += self._rotation * position[1]
        wind[1] -= self._rotation * position[0]
        squares = wind * wind
        speed = squares[0] + squares[1]
        speed += squares[2]
        factor *= np.sqrt(speed, out=speed)
        wind *= factor
        acceleration -= wind
        return acceleration

    def of_arc(self, arc: int) -> FloatAcceleration:
        """Return the acceleration as a function of one arc's numbers: the same operations in the
        same order.
        """
        gravity = self._gravity.alone_with_inverse_radius
        omega = self._rotation
        parameters = self._parameters[:, arc].tolist()
        logarithm = float(self._log_half_inverse_beta[arc])

        def acceleration(
            x: float, y: float, z: float, vx: float, vy: float, vz: float
        ) -> tuple[float, float, float]:
            ax, ay, az, inverse_radius = gravity(x, y, z)
            height, _, _ = _height_and_normal(inverse_radius, x, y, z, sqrt=sqrt, minimum=min)
            wx = vx + omega * y
            wy = vy - omega * x
            factor = float(np.exp(log_density(parameters, height) + logarithm))
            factor *= sqrt(wx * wx + wy * wy + vz * vz)
            return ax - wx * factor, ay - wy * factor, az - vz * factor

        return acceleration
