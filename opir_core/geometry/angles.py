"""Azimuth, elevation and range of targets seen from observers, and lines of sight.

One convention throughout (docs/reference/angles.md): local axes are geodetic east, north and up *at
the observer*; azimuth is clockwise from true north, elevation above the local horizontal. A sensor
in orbit sees the Earth at negative elevations, and the point below it at -90 degrees.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from opir_core.arrays import FloatArray
from opir_core.geometry.ellipsoid import WGS84, normal_at_foot
from opir_core.geometry.vectors import NEVER_ZERO, components, floats, length, select, vector

_Vector = tuple[FloatArray, FloatArray, FloatArray]
_Rows = tuple[_Vector, _Vector, _Vector]


class AzimuthElevationRange(NamedTuple):
    """Azimuth in [0, 2 pi) clockwise from true north, rad; elevation in [-pi/2, pi/2], rad; range,
    m.
    """

    azimuth_rad: FloatArray
    elevation_rad: FloatArray
    range_m: FloatArray


@np.errstate(all="ignore")
def east_north_up_axes(latitude_rad: ArrayLike, longitude_rad: ArrayLike) -> FloatArray:
    """Return the local axes (..., 3, 3) at geodetic latitudes and longitudes, rad: rows east, north
    and up, in ECEF.
    """
    latitude = floats(latitude_rad)
    longitude = floats(longitude_rad)
    return _stacked(
        _rows_at(np.sin(latitude), np.cos(latitude), np.sin(longitude), np.cos(longitude))
    )


@np.errstate(all="ignore")
def local_axes(position_ecef_m: ArrayLike) -> FloatArray:
    """Return the local axes (..., 3, 3) at ECEF positions (..., 3), m: rows east, north and up, in
    ECEF.

    The axes of `east_north_up_axes` at the geodetic coordinates, without angles. On the Earth's
    axis longitude is 0.
    """
    return _stacked(_rows_under(position_ecef_m))


@np.errstate(all="ignore")
def azimuth_elevation_range(
    observer_ecef_m: ArrayLike, target_ecef_m: ArrayLike
) -> AzimuthElevationRange:
    """Return azimuth and elevation (rad) and range (m) of targets seen from observers, both ECEF
    (..., 3), m.

    Straight above or below the observer azimuth is undefined: 0 or rounding. Where target and
    observer coincide, azimuth and elevation are `nan` and range is 0. Not finite: `nan`. Fixed
    observers are cheapest with shape (3,) or (n, 1, 3), broadcast.
    """
    return _angles(_offset(observer_ecef_m, target_ecef_m), _rows_under(observer_ecef_m))


@np.errstate(all="ignore")
def azimuth_elevation_range_in_axes(
    offset_ecef_m: ArrayLike, axes: ArrayLike
) -> AzimuthElevationRange:
    """Return azimuth and elevation (rad) and range (m) of target minus observer (..., 3), m, in
    given axes (..., 3, 3).

    With `axes` from `local_axes(observer)` the results have the bits of `azimuth_elevation_range`.
    """
    return _angles(components(offset_ecef_m), _rows_of(axes))


@np.errstate(all="ignore")
def elevation_rad(observer_ecef_m: ArrayLike, target_ecef_m: ArrayLike) -> FloatArray:
    """Return the elevation of targets above the geodetic horizontal of observers, both ECEF (...,
    3), m; rad.

    The bits of `azimuth_elevation_range`; `nan` where the two coincide or are not finite.
    """
    offset = _offset(observer_ecef_m, target_ecef_m)
    east, north, up = (_along(row, offset) for row in _rows_under(observer_ecef_m))
    return _elevation(east, north, up)


@np.errstate(all="ignore")
def nadir_angle_rad(sensor_ecef_m: ArrayLike, target_ecef_m: ArrayLike) -> FloatArray:
    """Return the angle at sensors between the Earth's centre and targets, both ECEF (..., 3), m;
    rad, in [0, pi].

    Accurate to rounding (1e-15 rad), near 0 and pi too. `nan` where a direction does not exist: the
    sensor at the centre or at the target. The direction to the centre is not the geodetic vertical:
    off the equator the two differ by up to 0.19 degrees near the ground, by less in proportion to
    the distance from the centre.
    """
    sx, sy, sz = components(sensor_ecef_m)
    tx, ty, tz = components(target_ecef_m)
    dx = tx - sx
    dy = ty - sy
    dz = tz - sz
    across = length(sy * dz - sz * dy, sz * dx - sx * dz, sx * dy - sy * dx)
    towards_centre = -(sx * dx + sy * dy + sz * dz)
    return select(
        (across > 0.0) | (towards_centre != 0.0), np.arctan2(across, towards_centre), np.nan
    )


@np.errstate(all="ignore")
def line_of_sight(
    observer_ecef_m: ArrayLike, azimuth_rad: ArrayLike, elevation_rad: ArrayLike
) -> FloatArray:
    """Return ECEF unit vectors (..., 3) from observers (ECEF, m) at azimuth and elevation, rad.

    The inverse of `azimuth_elevation_range`.
    """
    azimuth = floats(azimuth_rad)
    elevation = floats(elevation_rad)
    east, north, up = _rows_under(observer_ecef_m)
    level = np.cos(elevation)
    rise = np.sin(elevation)
    eastward = np.sin(azimuth) * level
    northward = np.cos(azimuth) * level
    x, y, z = (
        eastward * e + northward * n + rise * u for e, n, u in zip(east, north, up, strict=True)
    )
    return vector(x, y, z)


def _angles(offset: _Vector, rows: _Rows) -> AzimuthElevationRange:
    """Return azimuth, elevation and range of an offset."""
    east, north, up = (_along(row, offset) for row in rows)
    turned = np.arctan2(east + 0.0, north + 0.0)
    # Half the spacing of doubles at 2 pi: an azimuth closer to a full turn would round to it, so
    # it is 0.
    azimuth = np.maximum(turned + (turned < -4.5e-16) * (2.0 * np.pi), 0.0)
    elevation = _elevation(east, north, up)
    return AzimuthElevationRange(azimuth + 0.0 * elevation, elevation, length(*offset) + 0.0 * up)


def _elevation(east: FloatArray, north: FloatArray, up: FloatArray) -> FloatArray:
    """Return the angle above the horizontal, +-pi/2 straight up and down, nan without direction."""
    return np.arctan(up / np.sqrt(east * east + north * north))


def _offset(observer_ecef_m: ArrayLike, target_ecef_m: ArrayLike) -> _Vector:
    """Return target minus observer."""
    ox, oy, oz = components(observer_ecef_m)
    tx, ty, tz = components(target_ecef_m)
    return tx - ox, ty - oy, tz - oz


def _along(row: _Vector, offset: _Vector) -> FloatArray:
    """Return the component of an offset along a unit vector."""
    return row[0] * offset[0] + row[1] * offset[1] + row[2] * offset[2]


def _rows_under(position_ecef_m: ArrayLike) -> _Rows:
    """Return east, north and up at positions."""
    x, y, z = components(position_ecef_m)
    rho = np.sqrt(x * x + y * y)
    sin_latitude, cos_latitude = normal_at_foot(
        rho, z, WGS84.equatorial_radius_m, WGS84.polar_radius_m
    )
    on_axis = rho < NEVER_ZERO
    divisor = rho + NEVER_ZERO
    sin_longitude = select(on_axis, 0.0, y / divisor)
    cos_longitude = select(on_axis, 1.0, x / divisor)
    return _rows_at(sin_latitude, cos_latitude, sin_longitude, cos_longitude)


def _rows_at(
    sin_latitude: FloatArray,
    cos_latitude: FloatArray,
    sin_longitude: FloatArray,
    cos_longitude: FloatArray,
) -> _Rows:
    """Return east, north and up at a latitude and longitude."""
    east = -sin_longitude, cos_longitude, np.zeros(())
    north = -sin_latitude * cos_longitude, -sin_latitude * sin_longitude, cos_latitude
    up = cos_latitude * cos_longitude, cos_latitude * sin_longitude, sin_latitude
    return east, north, up


def _rows_of(axes: ArrayLike) -> _Rows:
    """Return the rows of axes (..., 3, 3)."""
    array = floats(axes)
    return components(array[..., 0, :]), components(array[..., 1, :]), components(array[..., 2, :])


def _stacked(rows: _Rows) -> FloatArray:
    """Return rows as axes (..., 3, 3)."""
    axes = np.empty((*np.shape(rows[2][0]), 3, 3))
    for index, row in enumerate(rows):
        axes[..., index, :] = vector(*row)
    return axes
