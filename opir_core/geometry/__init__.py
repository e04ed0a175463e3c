"""Geometry of sensors, targets, the Earth and the Sun: arrays in, arrays out, the last axis x, y, z.

Functions of the Sun and of sidereal time are imported when they are first used.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from opir_core.geometry.angles import (
    AzimuthElevationRange,
    azimuth_elevation_range,
    azimuth_elevation_range_in_axes,
    east_north_up_axes,
    elevation_rad,
    line_of_sight,
    local_axes,
    nadir_angle_rad,
)
from opir_core.geometry.ellipsoid import Ellipsoid
from opir_core.geometry.frames import (
    ecef_to_eci,
    ecef_to_eci_state,
    eci_to_ecef,
    eci_to_ecef_state,
    gmst_rad,
    julian_date,
)
from opir_core.geometry.geodetic import (
    DistanceBearing,
    Geodetic,
    LatitudeLongitude,
    ecef_to_geodetic,
    geodesic_direct,
    geodesic_inverse,
    geodetic_to_ecef,
)
from opir_core.geometry.occlusion import grazing_height_m, intersection_with_ellipsoid, is_occluded

if TYPE_CHECKING:
    from opir_core.geometry.sun import (
        is_sunlit,
        sun_position_ecef_m,
        sun_position_eci_m,
        sun_position_of_date_m,
        sunlit_fraction,
    )

#: The module of each name, by which it is imported when it is first used.
_HOMES = {
    "sun": "is_sunlit sun_position_ecef_m sun_position_eci_m sun_position_of_date_m sunlit_fraction",
}

__all__ = [
    "AzimuthElevationRange",
    "DistanceBearing",
    "Ellipsoid",
    "Geodetic",
    "LatitudeLongitude",
    "azimuth_elevation_range",
    "azimuth_elevation_range_in_axes",
    "east_north_up_axes",
    "ecef_to_eci",
    "ecef_to_eci_state",
    "ecef_to_geodetic",
    "eci_to_ecef",
    "eci_to_ecef_state",
    "elevation_rad",
    "geodesic_direct",
    "geodesic_inverse",
    "geodetic_to_ecef",
    "gmst_rad",
    "grazing_height_m",
    "intersection_with_ellipsoid",
    "is_occluded",
    "is_sunlit",
    "julian_date",
    "line_of_sight",
    "local_axes",
    "nadir_angle_rad",
    "sun_position_ecef_m",
    "sun_position_eci_m",
    "sun_position_of_date_m",
    "sunlit_fraction",
]


def __getattr__(name: str) -> Any:
    for home, names in _HOMES.items():
        if name in names.split():
            value = globals()[name] = getattr(import_module(f"opir_core.geometry.{home}"), name)
            return value
    raise AttributeError(f"module 'opir_core.geometry' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
