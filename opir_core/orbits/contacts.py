"""When a ground station sees a satellite, and when two satellites see each other.

Times are found by sampling and bisection (`opir_core.geometry.crossings`), to a millisecond for the
orbits given.
"""

from opir_core.arrays import FloatArray
from opir_core.geometry import elevation_rad, grazing_height_m
from opir_core.geometry.crossings import intervals_below
from opir_core.interfaces.sensors import Orbit

#: Longest step between samples, s. A pass in a low orbit takes minutes; a shorter one is found by
#: its culmination.
_STEP_S = 30.0


def contact_intervals(
    orbit: Orbit,
    station_ecef_m: FloatArray,
    *,
    mask_rad: float,
    start_s: float,
    stop_s: float,
) -> FloatArray:
    """Return the intervals (k, 2) of scene time, s, in which a satellite is above a station's mask.

    The station is at (3,), ECEF, m; the elevation is geometric, above the plane normal to the
    vertical of WGS 84, without refraction and light time.
    """

    def below_mask_rad(time_s: FloatArray) -> FloatArray:
        return mask_rad - elevation_rad(station_ecef_m, orbit.position_ecef_m(time_s))

    return intervals_below(below_mask_rad, start_s, stop_s, step_s=_STEP_S)


def crosslink_intervals(
    orbit: Orbit, other_orbit: Orbit, *, clearance_m: float, start_s: float, stop_s: float
) -> FloatArray:
    """Return the intervals (k, 2) of scene time, s, in which the line between two satellites stays
    `clearance_m` above the WGS 84 ellipsoid.
    """

    def lacking_m(time_s: FloatArray) -> FloatArray:
        ends_m = orbit.position_ecef_m(time_s), other_orbit.position_ecef_m(time_s)
        return clearance_m - grazing_height_m(*ends_m)

    return intervals_below(lacking_m, start_s, stop_s, step_s=_STEP_S)
