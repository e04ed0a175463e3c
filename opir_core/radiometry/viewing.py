"""Where lines of sight end: on the Earth, in what light, or beyond the limb."""

import numpy as np

from opir_core.geometry import ecef_to_geodetic, intersection_with_ellipsoid, local_axes, sun_position_ecef_m
from opir_core.geometry.vectors import components, length
from opir_core.radiometry.records import Views
from opir_core.records import FloatArray


@np.errstate(invalid="ignore")
def views(sensor_ecef_m: FloatArray, direction_ecef: FloatArray, time_s: FloatArray, epoch_us: int) -> Views:
    """Return what lines of sight (n, 3) of sensors (n, 3) end on at scene times (n,); directions of any length but 0.

    `epoch_us` is the scene's epoch in microseconds of UTC since 1970. A line that misses the Earth ends where it comes
    nearest to the Earth's centre; that is within 22 km along the line of where it comes nearest to the ellipsoid, and
    its height there within 40 m.
    """
    ground = intersection_with_ellipsoid(sensor_ecef_m, direction_ecef)
    hits = np.isfinite(ground[:, 0])
    along = direction_ecef / length(*components(direction_ecef))[:, None]
    ahead = -_dot(sensor_ecef_m, along)
    limb = sensor_ecef_m + np.maximum(ahead, 0.0)[:, None] * along
    point = np.where(hits[:, None], ground, limb)
    tangent_m = np.maximum(ecef_to_geodetic(limb).height_m, np.finfo(np.float64).tiny)
    beyond = np.where(ahead > 0.0, tangent_m, np.inf)
    up = local_axes(point)[:, 2]
    epoch = np.datetime64(epoch_us, "us")
    return Views(
        height_m=np.where(hits, 0.0, beyond),
        elevation_sine=np.where(hits, np.clip(-_dot(up, along), 0.0, 1.0), 0.0),
        sun_elevation_sine=_sine_above(up, sun_position_ecef_m(epoch, time_s) - point),
        point_ecef_m=point,
        time_s=time_s,
    )


def _sine_above(up: FloatArray, offset: FloatArray) -> FloatArray:
    return np.clip(_dot(up, offset) / length(*components(offset)), -1.0, 1.0)


def _dot(one: FloatArray, other: FloatArray) -> FloatArray:
    (ax, ay, az), (bx, by, bz) = components(one), components(other)
    product: FloatArray = ax * bx + ay * by + az * bz
    return product
