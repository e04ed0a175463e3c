"""The ground that a sensor can see: the boundary on the ellipsoid, in closed form."""

import numpy as np

from opir_core.arrays import FloatArray
from opir_core.geometry import WGS84, Ellipsoid, ecef_to_geodetic
from opir_core.plugin import Sensor

#: Points of a boundary: the polygon has 5e-5 less area than its circle.
POINTS = 360
#: Halvings of the interval of the nadir angle: to 1e-15 rad.
_HALVINGS = 50


def sensor_footprint(sensor: Sensor, position_ecef_m: FloatArray) -> FloatArray:
    """Return the `footprint` of a sensor at a position (3,), ECEF, m."""
    return footprint(
        position_ecef_m, sensor.field_of_regard_half_angle_rad, sensor.minimum_elevation_rad
    )


def footprint(
    position_ecef_m: FloatArray,
    half_angle_rad: float,
    minimum_elevation_rad: float = -0.5 * np.pi,
    *,
    ellipsoid: Ellipsoid = WGS84,
) -> FloatArray:
    """Return the boundary (`POINTS` + 1, 2) of the ground that a sensor sees.

    The position (3,), ECEF, m, is outside the ellipsoid. Points are latitude_rad and longitude_rad;
    the last equals the first. The ground is bounded by a cone about the direction to the Earth's
    centre with a half angle, by the horizon, and by the least elevation of the sensor.
    """
    axes_m = np.array(
        [ellipsoid.equatorial_radius_m, ellipsoid.equatorial_radius_m, ellipsoid.polar_radius_m]
    )
    nadir = -position_ecef_m / np.linalg.norm(position_ecef_m)
    tangents = _tangents(nadir)
    # With axes scaled to 1 the ellipsoid is a sphere, and lines stay lines.
    sensor = position_ecef_m / axes_m
    down = nadir / axes_m
    across = tangents / axes_m
    nadir_angle_rad = np.minimum(_horizon_rad(sensor, down, across), half_angle_rad)
    if minimum_elevation_rad > 0.0:
        nadir_angle_rad = _elevated(
            sensor, down, across, axes_m, nadir_angle_rad, minimum_elevation_rad
        )
    place = ecef_to_geodetic(
        _ground(sensor, down, across, nadir_angle_rad) * axes_m, ellipsoid=ellipsoid
    )
    ring = np.stack([place.latitude_rad, place.longitude_rad], axis=1)
    return np.concatenate([ring, ring[:1]])


def _tangents(nadir: FloatArray) -> FloatArray:
    """Return unit vectors (`POINTS`, 3) across a unit vector, in equal steps around it."""
    axis = np.cross(nadir, np.eye(3)[np.argmin(np.abs(nadir))])
    axis /= np.linalg.norm(axis)
    other_axis = np.cross(nadir, axis)
    angle = np.arange(POINTS)[:, np.newaxis] * (2.0 * np.pi / POINTS)
    tangents: FloatArray = np.cos(angle) * axis + np.sin(angle) * other_axis
    return tangents


def _horizon_rad(sensor: FloatArray, down: FloatArray, across: FloatArray) -> FloatArray:
    """Return the nadir angles (k,) of the lines of sight that touch the unit sphere.

    A line along cos(angle) down + sin(angle) across touches it where the discriminant of its
    intersection is 0: a quadratic equation in tan(angle), with one positive root.
    """
    outside = sensor @ sensor - 1.0
    along = sensor @ down
    beside = across @ sensor
    constant = along * along - outside * (down @ down)
    linear = along * beside - outside * (across @ down)
    square = beside * beside - outside * np.einsum("ki,ki->k", across, across)
    angle: FloatArray = np.arctan2(linear + np.sqrt(linear * linear - constant * square), -square)
    return angle


def _ground(
    sensor: FloatArray, down: FloatArray, across: FloatArray, nadir_angle_rad: FloatArray
) -> FloatArray:
    """Return the nearer intersections (k, 3) of lines of sight with the unit sphere."""
    cosine = np.cos(nadir_angle_rad)[:, np.newaxis]
    sine = np.sin(nadir_angle_rad)[:, np.newaxis]
    direction = cosine * down + sine * across
    length2 = np.einsum("ki,ki->k", direction, direction)
    along = direction @ sensor
    # Rounding may leave the horizon's own lines a little outside.
    root = np.sqrt(np.maximum(along * along - length2 * (sensor @ sensor - 1.0), 0.0))
    points: FloatArray = sensor + ((-along - root) / length2)[:, np.newaxis] * direction
    return points


def _elevated(
    sensor: FloatArray,
    down: FloatArray,
    across: FloatArray,
    axes_m: FloatArray,
    largest_rad: FloatArray,
    minimum_elevation_rad: float,
) -> FloatArray:
    """Return the largest nadir angles (k,) at which the sensor has the minimum elevation."""
    low = np.zeros_like(largest_rad)
    high = largest_rad
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        point = _ground(sensor, down, across, middle)
        up = point / axes_m
        sight = (sensor - point) * axes_m
        lengths = np.linalg.norm(up, axis=1) * np.linalg.norm(sight, axis=1)
        is_high = np.einsum("ki,ki->k", up, sight) >= np.sin(minimum_elevation_rad) * lengths
        low = np.where(is_high, middle, low)
        high = np.where(is_high, high, middle)
    # Where even the largest angle is high enough, the interval has shrunk to it.
    return low
