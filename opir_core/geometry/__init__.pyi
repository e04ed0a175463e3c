from opir_core.geometry.angles import (
    AzimuthElevationRange as AzimuthElevationRange,
    azimuth_elevation_range as azimuth_elevation_range,
    azimuth_elevation_range_in_axes as azimuth_elevation_range_in_axes,
    east_north_up_axes as east_north_up_axes,
    elevation_rad as elevation_rad,
    line_of_sight as line_of_sight,
    local_axes as local_axes,
    nadir_angle_rad as nadir_angle_rad,
)
from opir_core.geometry.crossings import (
    Crossings as Crossings,
    zero_crossings as zero_crossings,
)
from opir_core.geometry.ellipsoid import (
    WGS84 as WGS84,
    Ellipsoid as Ellipsoid,
)
from opir_core.geometry.frames import (
    ecef_to_eci as ecef_to_eci,
    ecef_to_eci_state as ecef_to_eci_state,
    eci_to_ecef as eci_to_ecef,
    eci_to_ecef_state as eci_to_ecef_state,
    gmst_rad as gmst_rad,
    julian_date as julian_date,
)
from opir_core.geometry.geodetic import (
    DistanceBearing as DistanceBearing,
    Geodetic as Geodetic,
    LatitudeLongitude as LatitudeLongitude,
    ecef_to_geodetic as ecef_to_geodetic,
    geodesic_direct as geodesic_direct,
    geodesic_inverse as geodesic_inverse,
    geodetic_to_ecef as geodetic_to_ecef,
)
from opir_core.geometry.occlusion import (
    grazing_height_m as grazing_height_m,
    intersection_with_ellipsoid as intersection_with_ellipsoid,
    is_occluded as is_occluded,
)
from opir_core.geometry.sphere import (
    AzimuthalEquidistant as AzimuthalEquidistant,
    great_circle_m as great_circle_m,
    unit_vectors as unit_vectors,
)
from opir_core.geometry.sun import (
    ASTRONOMICAL_UNIT_M as ASTRONOMICAL_UNIT_M,
    SUN_RADIUS_M as SUN_RADIUS_M,
    is_sunlit as is_sunlit,
    limb_angle_rad as limb_angle_rad,
    shadow_margins_rad as shadow_margins_rad,
    sun_ecef_m as sun_ecef_m,
    sun_position_ecef_m as sun_position_ecef_m,
    sun_position_eci_m as sun_position_eci_m,
    sun_position_of_date_m as sun_position_of_date_m,
    sunlit_fraction as sunlit_fraction,
)
from opir_core.geometry.vectors import (
    angle_between_rad as angle_between_rad,
    components as components,
    dot as dot,
    length as length,
    vector as vector,
)
