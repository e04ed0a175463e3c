"""Geodetic latitude, longitude and height, and back."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from opir_core.geometry.ellipsoid import WGS84, Ellipsoid
from opir_core.geometry.foot import normal_and_height
from opir_core.geometry.vectors import Floats, components, vector


class Geodetic(NamedTuple):
    """Geodetic latitude in [-pi/2, pi/2] and longitude in (-pi, pi], rad, and height above the ellipsoid, m."""

    latitude_rad: Floats
    longitude_rad: Floats
    height_m: Floats


@np.errstate(invalid="ignore", over="ignore")
def geodetic_to_ecef(
    latitude_rad: ArrayLike, longitude_rad: ArrayLike, height_m: ArrayLike, *, ellipsoid: Ellipsoid = WGS84
) -> Floats:
    """Return the ECEF position, m."""
    sin_latitude, cos_latitude = np.sin(latitude_rad), np.cos(latitude_rad)
    eccentricity_squared = ellipsoid.eccentricity_squared
    normal_radius = ellipsoid.equatorial_radius_m / np.sqrt(1.0 - eccentricity_squared * sin_latitude * sin_latitude)
    axis_distance = (normal_radius + height_m) * cos_latitude
    z = ((1.0 - eccentricity_squared) * normal_radius + height_m) * sin_latitude
    return vector(axis_distance * np.cos(longitude_rad), axis_distance * np.sin(longitude_rad), z)


@np.errstate(invalid="ignore", over="ignore", divide="ignore")
def ecef_to_geodetic(position_m: ArrayLike, *, ellipsoid: Ellipsoid = WGS84) -> Geodetic:
    """Return geodetic latitude, longitude and height of ECEF positions (..., 3)."""
    x, y, z = components(position_m)
    axis_distance = np.sqrt(x * x + y * y)
    a, b = ellipsoid.equatorial_radius_m, ellipsoid.polar_radius_m
    sin_latitude, cos_latitude, height = normal_and_height(axis_distance, z, a, b)
    return Geodetic(np.arctan2(sin_latitude, cos_latitude), np.arctan2(y + 0.0, x + 0.0), height)
