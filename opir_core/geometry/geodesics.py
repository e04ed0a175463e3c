"""Shortest paths over the WGS 84 ellipsoid: distance and bearing, and the way back.

GeographicLib (Karney, J. Geod. 87, 2013, 43-55) computes each path to 15 nm, between points nearly opposite each other
too. It is imported when first called, and goes point by point, at some 100 µs each: for scenes, not for looks.
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from opir_core.arrays import FloatArray
from opir_core.geometry.vectors import floats, select


class DistanceBearing(NamedTuple):
    """Length of a geodesic, m, and its bearing at the first point, rad, in [0, 2 pi), clockwise from true north."""

    distance_m: FloatArray
    bearing_rad: FloatArray


class LatitudeLongitude(NamedTuple):
    """Geodetic latitude in [-pi/2, pi/2] and longitude in [-pi, pi], rad."""

    latitude_rad: FloatArray
    longitude_rad: FloatArray


def geodesic_inverse(
    latitude_1_rad: ArrayLike, longitude_1_rad: ArrayLike, latitude_2_rad: ArrayLike, longitude_2_rad: ArrayLike
) -> DistanceBearing:
    """Return length and initial bearing of the geodesics from first points to second ones; any shapes that broadcast.

    Where the two coincide the distance is 0 and the bearing `nan`. A latitude beyond a pole, or anything not finite:
    `nan`.
    """
    from geographiclib.geodesic import Geodesic

    def line(*point_pair_deg: float) -> tuple[float, float]:
        found = Geodesic.WGS84.Inverse(*point_pair_deg, Geodesic.DISTANCE | Geodesic.AZIMUTH)
        return found["s12"], found["azi1"]

    angles = [np.degrees(floats(a)) for a in (latitude_1_rad, longitude_1_rad, latitude_2_rad, longitude_2_rad)]
    distance, bearing_deg = _each(line, *angles)
    bearing = np.radians(select(bearing_deg < 0.0, bearing_deg + 360.0, bearing_deg))
    return DistanceBearing(distance, select(distance > 0.0, bearing, np.nan))


def geodesic_direct(
    latitude_rad: ArrayLike, longitude_rad: ArrayLike, bearing_rad: ArrayLike, distance_m: ArrayLike
) -> LatitudeLongitude:
    """Return the points reached along geodesics from points at bearings (rad) over distances (m, backward below 0).

    Any shapes that broadcast. A latitude beyond a pole, or anything not finite: `nan`.
    """
    from geographiclib.geodesic import Geodesic

    def line(*start_deg_and_distance_m: float) -> tuple[float, float]:
        found = Geodesic.WGS84.Direct(*start_deg_and_distance_m, Geodesic.LATITUDE | Geodesic.LONGITUDE)
        return found["lat2"], found["lon2"]

    angles = [np.degrees(floats(a)) for a in (latitude_rad, longitude_rad, bearing_rad)]
    latitude_deg, longitude_deg = _each(line, *angles, floats(distance_m))
    return LatitudeLongitude(np.radians(latitude_deg), np.radians(longitude_deg))


def _each(line: Callable[..., tuple[float, float]], *columns: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the two results of a scalar function for every element of broadcast columns."""
    table = np.broadcast_arrays(*columns)
    rows = zip(*(column.ravel().tolist() for column in table), strict=True)
    results = np.array([line(*row) for row in rows], dtype=np.float64).reshape(*table[0].shape, 2)
    return results[..., 0], results[..., 1]
