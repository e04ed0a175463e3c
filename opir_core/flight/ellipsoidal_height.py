"""Geodetic height above the WGS 84 ellipsoid and its direction, in closed form, over columns of arcs."""

from math import sqrt

import numpy as np

from opir_core.arrays import FloatArray
from opir_core.constants import EARTH_ECCENTRICITY_SQUARED, EARTH_EQUATORIAL_RADIUS_M

#: Deeper than this a/r the expansion is held, so that the height stays negative and finite towards the centre.
_DEEPEST = 2.0


def height_m(position: FloatArray, inverse_radius: FloatArray) -> FloatArray:
    """Return heights (n,), m, of positions (3, n), m, whose 1/r is given.

    The foot's normal is taken along (x, y, z/k) with k = 1 - e² N/(N + h) expanded to second order in the flattening;
    an error in the normal's direction enters the height squared. Within 2e-8 m from 5 km below the ellipsoid to
    geostationary height; below the ellipsoid's evolute only the sign is meaningful.
    """
    return _height_and_normal(position, inverse_radius)[0]


def height_alone_m(x: float, y: float, z: float, inverse_radius: float) -> float:
    """Return the height, m, of one position: the operations of `height_m` in their order."""
    e2, ratio, sine = (
        EARTH_ECCENTRICITY_SQUARED,
        min(EARTH_EQUATORIAL_RADIUS_M * inverse_radius, _DEEPEST),
        z * inverse_radius,
    )
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


def height_and_up(position: FloatArray, inverse_radius: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return heights (n,), m, and the directions (3, n) in which they grow, to 1e-7 rad."""
    height, stretched_z, inverse_norm = _height_and_normal(position, inverse_radius)
    up = position.copy()
    up[2] = stretched_z
    up *= inverse_norm
    return height, up


def _height_and_normal(position: FloatArray, inverse_radius: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    x, y, z = position
    stretched_z = z / _flattening_factor(z, inverse_radius)
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


def _flattening_factor(z: FloatArray, inverse_radius: FloatArray) -> FloatArray:
    """Return k = 1 - e² q (1 + e² s² (1/2 - q)), with q = a/r and s = z/r."""
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
    return factor
