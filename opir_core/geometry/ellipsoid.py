"""The Earth's ellipsoid, WGS 84 by default, and the foot of the perpendicular from a point to an
ellipse.

A point has one nearest foot in its own quadrant, which is used here, so the height is the signed
distance to the ellipse. Only points on the major axis within a e² of the centre (42.7 km for the
Earth) have two, mirror images of each other; the northern one is used.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from opir_core.arrays import BoolArray, FloatArray
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_FLATTENING
from opir_core.geometry.vectors import FloatPair, floats


class Ellipsoid(NamedTuple):
    """An oblate ellipsoid of revolution about z: its equatorial radius (m) and its flattening
    (dimensionless).
    """

    equatorial_radius_m: float
    flattening: float

    @property
    def polar_radius_m(self) -> float:
        """The semi-minor axis, m."""
        return self.equatorial_radius_m * (1.0 - self.flattening)

    @property
    def eccentricity_squared(self) -> float:
        """The square of the first eccentricity."""
        return self.flattening * (2.0 - self.flattening)


#: World Geodetic System 1984 (NIMA TR8350.2, 3rd ed., table 3.1).
WGS84 = Ellipsoid(EARTH_EQUATORIAL_RADIUS_M, EARTH_FLATTENING)


def normal_at_foot(
    rho: FloatArray, z: FloatArray, semi_major_m: ArrayLike, semi_minor_m: ArrayLike
) -> FloatPair:
    """Return sine and cosine of the latitude of the outward normal at the foot of points (rho >= 0,
    z), m.

    Two steps of Bowring's formula (Survey Review 23, 1976, 323-327) from his start for all heights
    (Survey Review 28, 1985, 202-206) are exact to rounding above 0.1 a; below 0.2 a bisection is
    used.
    """
    a = floats(semi_major_m)
    b = floats(semi_minor_m)
    focus_squared = (a - b) * (a + b)
    evolute_rho = focus_squared / a
    evolute_z = focus_squared / b
    distance = np.sqrt(rho * rho + z * z)
    sine, cosine = _unit(b * z * (distance + evolute_z), a * rho * distance)
    for _ in range(2):
        up = z + evolute_z * (sine * sine * sine)
        out = rho - evolute_rho * (cosine * cosine * cosine)
        sine, cosine = _unit(b * up, a * out)
    sine, cosine = _unit(up, out)
    # Nearer to the centre than this share of the semi-major axis, bisection replaces Bowring's
    # formula.
    deep = distance < 0.2 * a
    return _with_bisected(sine, cosine, rho, z, a, b, deep) if np.any(deep) else (sine, cosine)


def height_along_normal(
    rho: FloatArray,
    z: FloatArray,
    sine: FloatArray,
    cosine: FloatArray,
    semi_major_m: ArrayLike,
    semi_minor_m: ArrayLike,
) -> FloatArray:
    """Return the signed distance, m, from the ellipse's tangent with that normal to points (rho,
    z).

    At the foot's own normal it is stationary: an error d of the normal costs d² in height.
    """
    return rho * cosine + z * sine - support_m(sine, cosine, semi_major_m, semi_minor_m)


def support_m(
    sine: FloatArray, cosine: FloatArray, semi_major_m: ArrayLike, semi_minor_m: ArrayLike
) -> FloatArray:
    """Return the distance, m, from the centre to the ellipse's tangent whose normal has that
    latitude.
    """
    axial = floats(semi_minor_m) * sine
    radial = floats(semi_major_m) * cosine
    return np.sqrt(axial * axial + radial * radial)


def _with_bisected(
    sine: FloatArray,
    cosine: FloatArray,
    rho: FloatArray,
    z: FloatArray,
    a: FloatArray,
    b: FloatArray,
    deep: BoolArray,
) -> FloatPair:
    """Return the normals with those of the deep points replaced by bisection."""
    shape = np.shape(deep)
    sine = np.array(np.broadcast_to(sine, shape))
    cosine = np.array(np.broadcast_to(cosine, shape))
    deep_rho, deep_z, deep_a, deep_b = (
        np.broadcast_to(values, shape)[deep] for values in (rho, z, a, b)
    )
    deep_sine, cosine[deep] = _bisected_normal(deep_rho, np.abs(deep_z), deep_a, deep_b)
    sine[deep] = np.where(deep_z < 0.0, -deep_sine, deep_sine)
    return sine, cosine


def _bisected_normal(rho: FloatArray, z: FloatArray, a: FloatArray, b: FloatArray) -> FloatPair:
    """Return sine and cosine of the normal's latitude for z >= 0, at the centre and on the evolute
    too.

    (a² - b²) - a rho / cos t + b z / sin t only falls as the parametric latitude t goes from
    equator to pole, so its one zero is the foot in this quadrant. Halving the angle between two
    unit vectors needs no trigonometry.
    """
    focus_squared = (a - b) * (a + b)
    low_sine, low_cosine, high_sine, high_cosine = (
        np.full_like(rho, value) for value in (0.0, 1.0, 1.0, 0.0)
    )
    for _ in range(60):
        sine, cosine = _unit(low_sine + high_sine, low_cosine + high_cosine)
        poleward = (focus_squared * cosine - a * rho) * sine + b * z * cosine > 0.0
        low_sine = np.where(poleward, sine, low_sine)
        low_cosine = np.where(poleward, cosine, low_cosine)
        high_sine = np.where(poleward, high_sine, sine)
        high_cosine = np.where(poleward, high_cosine, cosine)
    return _unit(a * sine, b * cosine)


def _unit(sine: FloatArray, cosine: FloatArray) -> FloatPair:
    """Return a pair scaled to the unit circle."""
    norm = np.sqrt(sine * sine + cosine * cosine)
    return sine / norm, cosine / norm
