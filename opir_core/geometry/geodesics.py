"""Shortest paths over the ellipsoid, by GeographicLib (Karney, 2013), accurate to about 15 nm."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from opir_core.geometry.vectors import Floats


class DistanceBearing(NamedTuple):
    """Length of the geodesic, m, and its bearing at the first point, rad, in [0, 2 pi), clockwise from true north."""

    distance_m: Floats
    bearing_rad: Floats


class LatitudeLongitude(NamedTuple):
    """Geodetic latitude and longitude in [-pi, pi], rad."""

    latitude_rad: Floats
    longitude_rad: Floats


def geodesic_inverse(
    latitude_1_rad: ArrayLike, longitude_1_rad: ArrayLike, latitude_2_rad: ArrayLike, longitude_2_rad: ArrayLike
) -> DistanceBearing:
    """Return distance and initial bearing from the first point to the second."""
    from geographiclib.geodesic import Geodesic

    def one(lat1: float, lon1: float, lat2: float, lon2: float) -> tuple[float, float]:
        line = Geodesic.WGS84.Inverse(lat1, lon1, lat2, lon2, Geodesic.DISTANCE | Geodesic.AZIMUTH)
        return line["s12"], line["azi1"]

    arguments = [np.degrees(v) for v in (latitude_1_rad, longitude_1_rad, latitude_2_rad, longitude_2_rad)]
    distance, bearing = np.vectorize(one, otypes=[np.float64, np.float64])(*arguments)
    return DistanceBearing(distance, np.mod(np.radians(bearing), 2.0 * np.pi))


def geodesic_direct(
    latitude_rad: ArrayLike, longitude_rad: ArrayLike, bearing_rad: ArrayLike, distance_m: ArrayLike
) -> LatitudeLongitude:
    """Return the point reached from a first one along a geodesic of given initial bearing and length."""
    from geographiclib.geodesic import Geodesic

    def one(lat1: float, lon1: float, azimuth: float, distance: float) -> tuple[float, float]:
        line = Geodesic.WGS84.Direct(lat1, lon1, azimuth, distance, Geodesic.LATITUDE | Geodesic.LONGITUDE)
        return line["lat2"], line["lon2"]

    arguments = [*(np.degrees(v) for v in (latitude_rad, longitude_rad, bearing_rad)), distance_m]
    latitude, longitude = np.vectorize(one, otypes=[np.float64, np.float64])(*arguments)
    return LatitudeLongitude(np.radians(latitude), np.radians(longitude))
