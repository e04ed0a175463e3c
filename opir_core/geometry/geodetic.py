"""Geodetic latitude, longitude and height, and back."""

from collections.abc import Callable
from typing import Any, NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from opir_core.arrays import FloatArray
from opir_core.geometry.ellipsoid import WGS84, Ellipsoid, normal_at_foot, support_m
from opir_core.geometry.vectors import (
    NEVER_ZERO,
    components,
    exact_sum,
    floats,
    lengths_and_remainders,
    select,
    vector,
)

#: pi / 2 as the sum of two doubles.
_HALF_PI = 1.5707963267948966
_HALF_PI_REMAINDER = 6.123233995736766e-17


class Geodetic(NamedTuple):
    """Geodetic latitude in [-pi/2, pi/2] and longitude in [-pi, pi], rad, and height above the
    ellipsoid, m.
    """

    latitude_rad: FloatArray
    longitude_rad: FloatArray
    height_m: FloatArray


@np.errstate(invalid="ignore", over="ignore")
def geodetic_to_ecef(
    latitude_rad: ArrayLike,
    longitude_rad: ArrayLike,
    height_m: ArrayLike,
    *,
    ellipsoid: Ellipsoid = WGS84,
) -> FloatArray:
    """Return ECEF positions (..., 3), m, of geodetic latitude and longitude (rad) and height above
    the ellipsoid (m).

    Any finite angle and height: a latitude past a pole is the point on its far side. Not finite in,
    `nan` out. Source: Torge, Geodesy, 3rd ed., section 4.1.3.
    """
    latitude = floats(latitude_rad)
    longitude = floats(longitude_rad)
    height = floats(height_m)
    sine = np.sin(latitude)
    cosine = np.cos(latitude)
    eccentricity_squared = ellipsoid.eccentricity_squared
    normal_radius = ellipsoid.equatorial_radius_m / np.sqrt(
        1.0 - eccentricity_squared * sine * sine
    )
    rho = (normal_radius + height) * cosine
    z = ((1.0 - eccentricity_squared) * normal_radius + height) * sine
    return vector(rho * np.cos(longitude), rho * np.sin(longitude), z)


@np.errstate(all="ignore")
def ecef_to_geodetic(position_m: ArrayLike, *, ellipsoid: Ellipsoid = WGS84) -> Geodetic:
    """Return geodetic latitude, longitude (rad) and height (m) of ECEF positions (..., 3), m.

    The height is the signed distance to the ellipsoid, the latitude that of its nearest point.
    Together the three name the position to 3e-9 m below 10 000 km from the centre, to 1.5e-8 m at
    geostationary distance and to 1.2e-7 m at the Moon's, where rounding a longitude near pi costs
    8.5e-8 m by itself.

    On the equatorial disc within a e² = 42.7 km of the centre two nearest points mirror each other:
    the northern one is returned, so latitude jumps across the disc, and at its rim the error of
    latitude is the square root of rounding; height and position keep the bound above. At the centre
    itself latitude is +pi/2 and height minus the polar radius. On the axis longitude is 0. Not
    finite, or beyond 1e77 m: `nan`.
    """
    x, y, z = components(position_m)
    a = ellipsoid.equatorial_radius_m
    b = ellipsoid.polar_radius_m
    rho, rho_remainder, distance, distance_remainder = lengths_and_remainders(x, y, z)
    sine, cosine = normal_at_foot(rho, z, a, b)
    # Distance minus support, corrected for the angle between normal and radius: at the Moon's
    # distance rho cos + z sin alone would have too large a rounding error.
    lean = sine * rho - cosine * z
    along = cosine * rho + sine * z
    height, rounding = exact_sum(distance, -support_m(sine, cosine, a, b))
    height = height + (
        rounding + (distance_remainder - lean * lean / (distance + along + NEVER_ZERO))
    )
    longitude = _longitude(x + 0.0, y + 0.0) + 0.0 * height
    return Geodetic(_latitude(rho, rho_remainder, z, sine, cosine, a, b), longitude, height)


def _longitude(x: FloatArray, y: FloatArray) -> FloatArray:
    """Return the angle from the x axis, rad, to little more than half a unit in the last place.

    It is measured from the nearest half axis: arctan2 of numpy loses another quarter of a unit on
    processors with AVX-512.
    """
    side = np.copysign(1.0, y)
    beside = np.abs(y) > np.abs(x)
    behind = (x < 0.0) & ~beside
    angle = np.arctan2(
        select(beside, -x * side, select(behind, -y, y)), select(beside, np.abs(y), np.abs(x))
    )
    quarters = select(beside, side, select(behind, 2.0 * side, 0.0))
    longitude, rounding = exact_sum(quarters * _HALF_PI, angle)
    return longitude + (rounding + quarters * _HALF_PI_REMAINDER)


def _latitude(
    rho: FloatArray,
    rho_remainder: FloatArray,
    z: FloatArray,
    sine: FloatArray,
    cosine: FloatArray,
    a: float,
    b: float,
) -> FloatArray:
    """Return the angle of the normal after one step of Bowring's formula, to half a unit in the
    last place and a bit.

    The two sides of the step lead from the centre of curvature to the point. The angle is measured
    from the nearer axis, where the arctangent rounds finer; rounding errors of the sides and of
    pi/2 are added at the end. At the centre of curvature, on the rim of the disc, the sides are
    noise: no step is made.
    """
    evolute_rho = (a - b) * (a + b) / a
    evolute_z = (a - b) * (a + b) / b
    norm = np.sqrt(b * b * sine * sine + a * a * cosine * cosine)
    parametric_sine = b * np.abs(sine) / norm
    parametric_cosine = a * cosine / norm
    up, up_remainder = exact_sum(
        np.abs(z), evolute_z * (parametric_sine * parametric_sine * parametric_sine)
    )
    out, out_remainder = exact_sum(
        rho, -evolute_rho * (parametric_cosine * parametric_cosine * parametric_cosine)
    )
    to_centre_squared = up * up + out * out
    remainder_rad = (up_remainder * out - (out_remainder + rho_remainder) * up) / (
        to_centre_squared + NEVER_ZERO
    )
    # Nearer than 1 m to the centre of curvature a point's own normal is better than a further
    # step.
    at_centre = to_centre_squared < 1.0
    if np.any(at_centre):
        up = select(at_centre, np.abs(sine), up)
        out = select(at_centre, cosine, out)
        remainder_rad = select(at_centre, 0.0, remainder_rad)
    steep = up > out
    angle = np.arctan2(select(steep, -out, up), select(steep, up, out))
    latitude, rounding = exact_sum(select(steep, _HALF_PI, 0.0), angle)
    latitude = latitude + (rounding + (remainder_rad + select(steep, _HALF_PI_REMAINDER, 0.0)))
    return select(sine < 0.0, -latitude, latitude)


class DistanceBearing(NamedTuple):
    """Length of a geodesic, m, and its bearing at the first point, rad, in [0, 2 pi), clockwise
    from true north.
    """

    distance_m: FloatArray
    bearing_rad: FloatArray


class LatitudeLongitude(NamedTuple):
    """Geodetic latitude in [-pi/2, pi/2] and longitude in [-pi, pi], rad."""

    latitude_rad: FloatArray
    longitude_rad: FloatArray


def geodesic_inverse(
    latitude_1_rad: ArrayLike,
    longitude_1_rad: ArrayLike,
    latitude_2_rad: ArrayLike,
    longitude_2_rad: ArrayLike,
) -> DistanceBearing:
    """Return length and initial bearing of the geodesics from first points to second ones; any
    shapes that broadcast.

    Where the two coincide the distance is 0 and the bearing `nan`. A latitude beyond a pole, or
    anything not finite: `nan`.
    """
    geodesic = _geographiclib()

    def line(*point_pair_deg: float) -> tuple[float, float]:
        solution = geodesic.WGS84.Inverse(*point_pair_deg, geodesic.DISTANCE | geodesic.AZIMUTH)
        return solution["s12"], solution["azi1"]

    angles = [
        np.degrees(floats(a))
        for a in (latitude_1_rad, longitude_1_rad, latitude_2_rad, longitude_2_rad)
    ]
    distance, bearing_deg = _each(line, *angles)
    bearing = np.radians(select(bearing_deg < 0.0, bearing_deg + 360.0, bearing_deg))
    return DistanceBearing(distance, select(distance > 0.0, bearing, np.nan))


def geodesic_direct(
    latitude_rad: ArrayLike, longitude_rad: ArrayLike, bearing_rad: ArrayLike, distance_m: ArrayLike
) -> LatitudeLongitude:
    """Return the points reached along geodesics from points at bearings (rad) over distances (m,
    backward below 0).

    Any shapes that broadcast. A latitude beyond a pole, or anything not finite: `nan`.
    """
    geodesic = _geographiclib()

    def line(*start_deg_and_distance_m: float) -> tuple[float, float]:
        solution = geodesic.WGS84.Direct(
            *start_deg_and_distance_m, geodesic.LATITUDE | geodesic.LONGITUDE
        )
        return solution["lat2"], solution["lon2"]

    angles = [np.degrees(floats(a)) for a in (latitude_rad, longitude_rad, bearing_rad)]
    latitude_deg, longitude_deg = _each(line, *angles, floats(distance_m))
    return LatitudeLongitude(np.radians(latitude_deg), np.radians(longitude_deg))


def _geographiclib() -> Any:
    """Return GeographicLib's class `Geodesic`, imported for those scenes that need it."""
    from geographiclib.geodesic import Geodesic

    return Geodesic


def _each(
    line: Callable[..., tuple[float, float]], *columns: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the two results of a scalar function for every element of broadcast columns."""
    table = np.broadcast_arrays(*columns)
    rows = zip(*(column.ravel().tolist() for column in table), strict=True)
    results = np.array([line(*row) for row in rows], dtype=np.float64).reshape(*table[0].shape, 2)
    return results[..., 0], results[..., 1]
