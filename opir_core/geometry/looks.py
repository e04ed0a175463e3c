"""Where a target stands, seen from an observer: azimuth, elevation, range, nadir angle."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from opir_core.geometry.ellipsoid import WGS84
from opir_core.geometry.foot import normal_and_height
from opir_core.geometry.vectors import Floats, components, vector


class AzimuthElevationRange(NamedTuple):
    """Azimuth in [0, 2 pi) clockwise from true north, rad; elevation above the local horizontal, rad; range, m."""

    azimuth_rad: Floats
    elevation_rad: Floats
    range_m: Floats


def east_north_up_axes(latitude_rad: ArrayLike, longitude_rad: ArrayLike) -> Floats:
    """Return the local axes (..., 3, 3): its rows are the unit vectors east, north and up, in ECEF."""
    sin_lat, cos_lat = np.sin(latitude_rad), np.cos(latitude_rad)
    sin_lon, cos_lon = np.sin(longitude_rad), np.cos(longitude_rad)
    shape = np.broadcast_shapes(np.shape(latitude_rad), np.shape(longitude_rad))
    axes = np.empty((*shape, 3, 3))
    axes[..., 0, :] = vector(-sin_lon, cos_lon, 0.0)
    axes[..., 1, :] = vector(-sin_lat * cos_lon, -sin_lat * sin_lon, cos_lat)
    axes[..., 2, :] = vector(cos_lat * cos_lon, cos_lat * sin_lon, sin_lat)
    return axes


@np.errstate(invalid="ignore", over="ignore", divide="ignore")
def azimuth_elevation_range(observer_ecef_m: ArrayLike, target_ecef_m: ArrayLike) -> AzimuthElevationRange:
    """Return azimuth, elevation and range of targets (..., 3) seen from observers (..., 3)."""
    east, north, up, distance = _local_offset(observer_ecef_m, target_ecef_m)
    azimuth = np.arctan2(east + 0.0, north + 0.0)
    azimuth = np.where(azimuth < 0.0, azimuth + 2.0 * np.pi, azimuth)
    azimuth = np.where(azimuth >= 2.0 * np.pi, 0.0, azimuth)
    elevation = np.arctan2(up, np.sqrt(east * east + north * north))
    nowhere = distance == 0.0
    return AzimuthElevationRange(
        np.where(nowhere, np.nan, azimuth), np.where(nowhere, np.nan, elevation), distance
    )


@np.errstate(invalid="ignore", over="ignore", divide="ignore")
def elevation_rad(observer_ecef_m: ArrayLike, target_ecef_m: ArrayLike) -> Floats:
    """Return the elevation of targets (..., 3) above the local horizontal of observers (..., 3), rad."""
    east, north, up, distance = _local_offset(observer_ecef_m, target_ecef_m)
    elevation = np.arctan2(up, np.sqrt(east * east + north * north))
    return np.where(distance == 0.0, np.nan, elevation)


@np.errstate(invalid="ignore", over="ignore", divide="ignore")
def nadir_angle_rad(sensor_ecef_m: ArrayLike, target_ecef_m: ArrayLike) -> Floats:
    """Return the angle at the sensor between the Earth's centre and the target, rad, in [0, pi]."""
    sx, sy, sz = components(sensor_ecef_m)
    tx, ty, tz = components(target_ecef_m)
    dx, dy, dz = tx - sx, ty - sy, tz - sz
    cx, cy, cz = sy * dz - sz * dy, sz * dx - sx * dz, sx * dy - sy * dx
    angle: Floats = np.arctan2(np.sqrt(cx * cx + cy * cy + cz * cz), -(sx * dx + sy * dy + sz * dz))
    return angle


@np.errstate(invalid="ignore", over="ignore", divide="ignore")
def line_of_sight(observer_ecef_m: ArrayLike, azimuth_rad: ArrayLike, elevation_rad: ArrayLike) -> Floats:
    """Return the ECEF unit vector (..., 3) from an observer in a direction given by azimuth and elevation."""
    sin_lat, cos_lat, sin_lon, cos_lon = _local_vertical(observer_ecef_m)
    cos_elevation, up = np.cos(elevation_rad), np.sin(elevation_rad)
    east, north = np.sin(azimuth_rad) * cos_elevation, np.cos(azimuth_rad) * cos_elevation
    outward = cos_lat * up - sin_lat * north
    return vector(
        cos_lon * outward - sin_lon * east, sin_lon * outward + cos_lon * east, sin_lat * up + cos_lat * north
    )


def _local_vertical(observer_ecef_m: ArrayLike) -> tuple[Floats, Floats, Floats, Floats]:
    """Return sine and cosine of geodetic latitude, sine and cosine of longitude (0 on the axis)."""
    x, y, z = components(observer_ecef_m)
    axis_distance = np.sqrt(x * x + y * y)
    sin_lat, cos_lat, _ = normal_and_height(axis_distance, z, WGS84.equatorial_radius_m, WGS84.polar_radius_m)
    on_axis = axis_distance == 0.0
    return sin_lat, cos_lat, np.where(on_axis, 0.0, y / axis_distance), np.where(on_axis, 1.0, x / axis_distance)


def _local_offset(observer_ecef_m: ArrayLike, target_ecef_m: ArrayLike) -> tuple[Floats, Floats, Floats, Floats]:
    """Return the east, north and up components of target minus observer, and its length, m."""
    ox, oy, oz = components(observer_ecef_m)
    tx, ty, tz = components(target_ecef_m)
    dx, dy, dz = tx - ox, ty - oy, tz - oz
    sin_lat, cos_lat, sin_lon, cos_lon = _local_vertical(observer_ecef_m)
    outward = cos_lon * dx + sin_lon * dy
    east = cos_lon * dy - sin_lon * dx
    north = cos_lat * dz - sin_lat * outward
    up = cos_lat * outward + sin_lat * dz
    return east, north, up, np.sqrt(dx * dx + dy * dy + dz * dz)
