"""Elements of the orbits that sensors fly: geosynchronous slots, circular orbits, Molniya, Tundra, Walker patterns."""

import math

from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_MU_M3_S2, EARTH_ROTATION_RAD_S
from opir_core.orbits.elements import Elements

#: The inclination at which the Earth's oblateness does not turn the line of apsides: 4 - 5 sin² i = 0, so sin² i = 4/5
#: (Vallado, Fundamentals of Astrodynamics and Applications, section 9.6).
CRITICAL_INCLINATION_RAD = math.asin(2.0 / math.sqrt(5.0))


def synchronous_semi_major_axis_m(turns_a_day: float) -> float:
    """Return the semi-major axis of an orbit with so many turns, in ECI, to one rotation of the Earth."""
    return float((EARTH_MU_M3_S2 / (turns_a_day * EARTH_ROTATION_RAD_S) ** 2) ** (1.0 / 3.0))


def slot_elements(
    longitude_rad: float,
    *,
    inclination_rad: float = 0.0,
    eccentricity: float = 0.0,
    argument_of_perigee_rad: float = 0.0,
    mean_argument_of_latitude_rad: float = 0.0,
) -> Elements:
    """Return a geosynchronous orbit about a slot: `longitude_rad` is the mean of the satellite's longitude.

    The mean argument of latitude (argument of perigee plus mean anomaly) is that at the scene epoch; with 0, a circular
    orbit crosses the equator northwards, over the slot, at that moment.
    """
    return Elements(
        semi_major_axis_m=synchronous_semi_major_axis_m(1.0),
        eccentricity=eccentricity,
        inclination_rad=inclination_rad,
        node_longitude_rad=longitude_rad - mean_argument_of_latitude_rad,
        argument_of_perigee_rad=argument_of_perigee_rad,
        mean_anomaly_rad=mean_argument_of_latitude_rad - argument_of_perigee_rad,
    )


def circular_elements(
    altitude_m: float, inclination_rad: float, node_longitude_rad: float, argument_of_latitude_rad: float = 0.0
) -> Elements:
    """Return a circular orbit of the given height above the Earth's equatorial radius.

    The argument of latitude is the angle, at the scene epoch, from the ascending node to the satellite.
    """
    return Elements(
        semi_major_axis_m=EARTH_EQUATORIAL_RADIUS_M + altitude_m,
        eccentricity=0.0,
        inclination_rad=inclination_rad,
        node_longitude_rad=node_longitude_rad,
        argument_of_perigee_rad=0.0,
        mean_anomaly_rad=argument_of_latitude_rad,
    )


def highly_elliptical_elements(
    turns_a_day: float,
    eccentricity: float,
    apogee_longitude_rad: float,
    apogee_time_s: float = 0.0,
    *,
    inclination_rad: float = CRITICAL_INCLINATION_RAD,
    argument_of_perigee_rad: float = 1.5 * math.pi,
) -> Elements:
    """Return an orbit that passes its apogee over a longitude at a scene time.

    With two turns a day (Molniya) every other apogee is half a turn of the Earth away; with one (Tundra) all are over
    the same longitude.
    """
    axis_m = synchronous_semi_major_axis_m(turns_a_day)
    apogee_rad = argument_of_perigee_rad + math.pi
    from_node_rad = math.atan2(math.cos(inclination_rad) * math.sin(apogee_rad), math.cos(apogee_rad))
    mean_motion_rad_s = turns_a_day * EARTH_ROTATION_RAD_S
    return Elements(
        semi_major_axis_m=axis_m,
        eccentricity=eccentricity,
        inclination_rad=inclination_rad,
        node_longitude_rad=apogee_longitude_rad + EARTH_ROTATION_RAD_S * apogee_time_s - from_node_rad,
        argument_of_perigee_rad=argument_of_perigee_rad,
        mean_anomaly_rad=math.pi - mean_motion_rad_s * apogee_time_s,
    )


def walker_pattern(
    total: int,
    planes: int,
    phasing: int,
    altitude_m: float,
    inclination_rad: float,
    *,
    star: bool = False,
    first_node_longitude_rad: float = 0.0,
    first_argument_of_latitude_rad: float = 0.0,
) -> list[Elements]:
    """Return the circular orbits of a Walker pattern i: total / planes / phasing, plane by plane.

    Nodes are spread over a whole turn (delta) or, with `star`, over half of one. Within a plane satellites are
    evenly spread; from one plane to the next they are ahead by `phasing` units of 2 pi / total. A `ValueError` where
    `planes` does not divide `total` or `phasing` is not in [0, planes).

    Source: Walker, J. Brit. Interplanetary Soc. 37 (1984), 559-572; Wertz and Larson, Space Mission Analysis and
    Design, 3rd ed., section 7.6.
    """
    complaint = walker_complaint(total, planes, phasing)
    if complaint:
        raise ValueError(complaint)
    node_step_rad = (math.pi if star else 2.0 * math.pi) / planes
    return [
        circular_elements(
            altitude_m,
            inclination_rad,
            first_node_longitude_rad + plane * node_step_rad,
            first_argument_of_latitude_rad + units * (2.0 * math.pi / total),
        )
        for plane, units in _walker_places(total, planes, phasing)
    ]


def _walker_places(total: int, planes: int, phasing: int) -> list[tuple[int, int]]:
    """Return the plane of each satellite, and its place there: whole units of 2 pi / total, reduced to one turn."""
    a_plane = total // planes
    return [(plane, (place * planes + plane * phasing) % total) for plane in range(planes) for place in range(a_plane)]


def walker_complaint(total: int, planes: int, phasing: int) -> str | None:
    """Return what is wrong with the numbers of a Walker pattern, or None."""
    if total < 1 or planes < 1 or total % planes:
        return f"{total} satellites cannot be shared evenly among {planes} planes"
    if not 0 <= phasing < planes:
        return f"phasing: {phasing} is not in [0, {planes}), the number of planes"
    return None
