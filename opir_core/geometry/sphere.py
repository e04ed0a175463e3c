"""A round Earth: great circles, and the azimuthal equidistant map about a point.

Regions on the ground are drawn and tested on this map: directions and distances from its centre are
true, so poles and the 180th meridian are no exceptions. Source: Snyder, "Map Projections: A Working
Manual", USGS Professional Paper 1395 (1987), chapter 25. The radius is the equatorial one; on the
ellipsoid distances differ by up to 0.6 %.
"""

from math import atan2, cos, sin

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M


def unit_vectors(place: FloatArray) -> FloatArray:
    """Return unit vectors (n, 3) of places (n, 2 or more), latitude and longitude first, rad."""
    latitude = place[:, 0]
    longitude = place[:, 1]
    vectors = np.empty((len(place), 3))
    flat = np.cos(latitude)
    vectors[:, 0] = flat * np.cos(longitude)
    vectors[:, 1] = flat * np.sin(longitude)
    vectors[:, 2] = np.sin(latitude)
    return vectors


def great_circle_m(start: FloatArray, end: FloatArray) -> FloatArray:
    """Return great-circle distances (n,), m, between places (n, 2 or more), latitude and longitude
    first, rad.

    From the haversine and its complement: exact to rounding from short distances to antipodes.
    """
    spread = np.cos(end[:, 0]) * np.cos(start[:, 0])
    turn = 0.5 * (end[:, 1] - start[:, 1])
    haversine = np.sin(0.5 * (end[:, 0] - start[:, 0])) ** 2 + spread * np.sin(turn) ** 2
    complement = np.sin(0.5 * (end[:, 0] + start[:, 0])) ** 2 + spread * np.cos(turn) ** 2
    half_angle = np.arctan2(np.sqrt(np.abs(haversine)), np.sqrt(np.abs(complement)))
    return 2.0 * EARTH_EQUATORIAL_RADIUS_M * half_angle


@frozen(eq=False)
class AzimuthalEquidistant:
    """The map about a centre: points (n, 2) are east and north, m.

    `axes` (3, 3) are the unit vectors of east, north and up at the centre; at a pole, those of
    longitude 0.
    """

    axes: FloatArray

    @classmethod
    def about(cls, up: FloatArray) -> "AzimuthalEquidistant":
        """Return the map about the direction of a vector (3,) from the Earth's centre."""
        x, y, z = (up / np.sqrt(up @ up)).tolist()
        longitude = atan2(y, x)
        east_x = -sin(longitude)
        east_y = cos(longitude)
        north = [-z * east_y, z * east_x, x * east_y - y * east_x]
        return cls(np.array([[east_x, east_y, 0.0], north, [x, y, z]]))

    @property
    def centre(self) -> tuple[float, float]:
        """Return latitude and longitude of the centre, rad."""
        latitude, longitude = self.places(np.zeros((1, 2)))[0].tolist()
        return latitude, longitude

    def points(self, place: FloatArray) -> FloatArray:
        """Return the points (n, 2), m, of places (n, 2 or more), latitude and longitude first, rad.

        The antipode of the centre, which lies in all directions, is put to the east.
        """
        unit = unit_vectors(place)
        level = unit @ self.axes[:2].T
        sine = np.sqrt(np.add.reduce(level * level, axis=1))
        angle = np.arctan2(sine, unit @ self.axes[2])
        ratio = np.where(sine > 1e-12, angle / np.maximum(sine, 1e-300), 1.0)
        point: FloatArray = level * (EARTH_EQUATORIAL_RADIUS_M * ratio)[:, None]
        point[(sine <= 1e-12) & (angle > 1.0)] = np.pi * EARTH_EQUATORIAL_RADIUS_M, 0.0
        return point

    def places(self, point: FloatArray) -> FloatArray:
        """Return latitudes and longitudes (n, 2), rad, of points (n, 2), m."""
        far_m = np.sqrt(np.add.reduce(point * point, axis=1))
        angle = far_m / EARTH_EQUATORIAL_RADIUS_M
        ratio = np.where(
            far_m > 1e-6, np.sin(angle) / np.maximum(far_m, 1e-300), 1.0 / EARTH_EQUATORIAL_RADIUS_M
        )
        x, y, z = self.axes[:2].T @ (point * ratio[:, None]).T + self.axes[2, :, None] * np.cos(
            angle
        )
        return np.array([np.arctan2(z, np.sqrt(x * x + y * y)), np.arctan2(y, x)]).T
