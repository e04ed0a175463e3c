"""Accelerations by a zonal gravity field and by drag, over columns of arcs (3, n) and for the
numbers of one arc.

Drag needs the geodetic height above the WGS 84 ellipsoid, here in closed form. Each arc stays
within one layer of the air during a step.
"""

from collections.abc import Callable
from math import sqrt

import numpy as np
from numpy.typing import NDArray

from opir_core.arrays import FloatArray
from opir_core.constants import EARTH_ECCENTRICITY_SQUARED, EARTH_EQUATORIAL_RADIUS_M
from opir_core.flight.atmosphere_density import log_density, log_density_alone
from opir_core.flight.forces import ZonalField

#: The expansion is clamped at this a/r, so that the height stays negative and finite towards the
#: centre.
_DEEPEST = 2.0


def height_m(position: FloatArray, inverse_radius: FloatArray) -> FloatArray:
    """Return geodetic heights (n,), m, of positions (3, n), m, given their 1/r.

    The foot's normal is taken along (x, y, z/k) with k = 1 - e² N/(N + h) expanded to second order
    in the flattening; an error in the normal's direction enters the height squared. Within 2e-8 m
    from 5 km below the ellipsoid to geostationary height; below the ellipsoid's evolute only the
    sign is meaningful.
    """
    return _height_and_normal(position, inverse_radius)[0]


def height_alone_m(x: float, y: float, z: float, inverse_radius: float) -> float:
    """Return the height, m, of one position, with the operations of `height_m` in the same
    order.
    """
    e2 = EARTH_ECCENTRICITY_SQUARED
    ratio = min(EARTH_EQUATORIAL_RADIUS_M * inverse_radius, _DEEPEST)
    sine = z * inverse_radius
    stretched_z = z / (((0.5 - ratio) * (sine * sine) * e2 + 1.0) * ratio * -e2 + 1.0)
    equatorial = x * x + y * y
    inverse_norm = 1.0 / sqrt(stretched_z * stretched_z + equatorial)
    normal_z = stretched_z * inverse_norm
    foot = sqrt(normal_z * normal_z * -e2 + 1.0) * EARTH_EQUATORIAL_RADIUS_M
    return (z * stretched_z + equatorial) * inverse_norm - foot


def height_and_climb(
    position: FloatArray, velocity: FloatArray, inverse_radius: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return heights, m, and their rates, m/s: the velocity along the ellipsoid's normal."""
    height, stretched_z, inverse_norm = _height_and_normal(position, inverse_radius)
    climb = position[0] * velocity[0]
    climb += position[1] * velocity[1]
    climb += stretched_z * velocity[2]
    climb *= inverse_norm
    return height, climb


def height_and_up(
    position: FloatArray, inverse_radius: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return heights (n,), m, and the directions (3, n) in which they grow, to 1e-7 rad."""
    height, stretched_z, inverse_norm = _height_and_normal(position, inverse_radius)
    up = position.copy()
    up[2] = stretched_z
    up *= inverse_norm
    return height, up


def _height_and_normal(
    position: FloatArray, inverse_radius: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    x, y, z = position
    # k = 1 - e² q (1 + e² s² (1/2 - q)), with q = a/r and s = z/r.
    ratio = EARTH_EQUATORIAL_RADIUS_M * inverse_radius
    np.minimum(ratio, _DEEPEST, out=ratio)
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
    inverse_norm = stretched_z * stretched_z
    inverse_norm += equatorial
    np.sqrt(inverse_norm, out=inverse_norm)
    np.divide(1.0, inverse_norm, out=inverse_norm)
    foot = stretched_z * inverse_norm
    foot *= foot
    foot *= -EARTH_ECCENTRICITY_SQUARED
    foot += 1.0
    np.sqrt(foot, out=foot)
    foot *= EARTH_EQUATORIAL_RADIUS_M
    height = z * stretched_z
    height += equatorial
    height *= inverse_norm
    height -= foot
    return height, stretched_z, inverse_norm


#: A right side for one arc: position and velocity as six numbers in, acceleration as three out.
Alone = Callable[[float, float, float, float, float, float], tuple[float, float, float]]


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
        """Return the acceleration as a function of one arc's numbers: the same operations in the
        same order.
        """
        with_inverse_radius = self.alone_with_inverse_radius

        def acceleration(
            x: float, y: float, z: float, *_velocity: float
        ) -> tuple[float, float, float]:
            return with_inverse_radius(x, y, z)[:3]

        return acceleration

    def alone_with_inverse_radius(
        self, x: float, y: float, z: float
    ) -> tuple[float, float, float, float]:
        """Return the acceleration, m/s², and 1/r, 1/m, at one position; raise ZeroDivisionError at
        the centre.
        """
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

    def _harmonics(
        self, inverse_square: FloatArray, z: FloatArray, ss: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
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
        layer_parameters: NDArray[np.float64],
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

    def alone(self, arc: int) -> Alone:
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
            height = height_alone_m(x, y, z, inverse_radius)
            wx = vx + omega * y
            wy = vy - omega * x
            factor = float(np.exp(log_density_alone(parameters, height) + logarithm))
            factor *= sqrt(wx * wx + wy * wy + vz * vz)
            return ax - wx * factor, ay - wy * factor, az - vz * factor

        return acceleration
