"""Views along lines of sight: the point on the Earth, its illumination, or the tangent point beyond
the limb.
"""

import numpy as np

from opir_core.arrays import BoolArray, FloatArray
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_POLAR_RADIUS_M
from opir_core.geometry import (
    components,
    dot,
    ecef_to_geodetic,
    intersection_with_ellipsoid,
    length,
    sun_ecef_m,
    vector,
)
from opir_core.plugin import Views


@np.errstate(invalid="ignore")
def views(
    sensor_ecef_m: FloatArray, direction_ecef: FloatArray, time_s: FloatArray, epoch_us: int
) -> Views:
    """Return the views along lines of sight (n, 3), of any length but 0, of sensors (n, 3) at scene
    times (n,).

    `epoch_us` is the epoch of the scene in microseconds of UTC since 1970. The view of a line that
    misses the Earth is at the point nearest to the Earth's centre; along the line it is within 22
    km of the point nearest to the ellipsoid, with its height within 40 m.
    """
    ground = intersection_with_ellipsoid(sensor_ecef_m, direction_ecef)
    hits = np.isfinite(ground[:, 0])
    along = _unit(direction_ecef)
    # Signed distance, m, to the point nearest to the Earth's centre.
    distance_m = -dot(sensor_ecef_m, along)
    point = np.where(hits[:, None], ground, _at_distance(sensor_ecef_m, along, distance_m))
    up = _up(point)
    to_sun = _unit(sun_ecef_m(time_s, epoch_us) - point)
    return Views(
        height_m=_heights_m(point, hits, distance_m > 0.0),
        elevation_sine=np.where(hits, np.clip(-dot(up, along), 0.0, 1.0), 0.0),
        sun_elevation_sine=np.clip(dot(up, to_sun), -1.0, 1.0),
        point_ecef_m=point,
        time_s=time_s,
        line_of_sight_ecef=along,
    )


def _at_distance(sensor: FloatArray, along: FloatArray, distance_m: FloatArray) -> FloatArray:
    return sensor + np.maximum(distance_m, 0.0)[:, None] * along


def _heights_m(point: FloatArray, hits: BoolArray, is_ahead: BoolArray) -> FloatArray:
    """Return heights: 0 on the Earth, tangent heights beyond the limb, inf for lines away from the
    Earth.
    """
    height = np.where(hits, 0.0, np.inf)
    beyond = np.flatnonzero(~hits & is_ahead)
    height[beyond] = np.maximum(ecef_to_geodetic(point[beyond]).height_m, np.finfo(np.float64).tiny)
    return height


def _up(point: FloatArray) -> FloatArray:
    """Return the normals (n, 3) of ellipsoids like the Earth's through points: the vertical on the
    Earth itself.
    """
    x, y, z = components(point)
    return _unit(vector(x, y, z * (EARTH_EQUATORIAL_RADIUS_M / EARTH_POLAR_RADIUS_M) ** 2))


def _unit(vectors: FloatArray) -> FloatArray:
    return vectors / length(*components(vectors))[:, None]
