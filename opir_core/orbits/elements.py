"""Kepler elements of a closed orbit about the Earth, in radians and metres; plain numbers, no
arrays.

The elements are at the scene epoch, in ECI: ECEF frozen at that time. So the node is given by its
longitude on the Earth, and the ground track does not depend on the date of the scene.
"""

import math

from attrs import frozen

from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_MU_M3_S2, EARTH_ROTATION_RAD_S

#: A position or a velocity: x, y, z.
Vector = tuple[float, float, float]


@frozen(kw_only=True)
class Elements:
    """Kepler elements at the scene epoch.

    `node_longitude_rad` is the east longitude, at the scene epoch, of the ascending node: where the
    orbit's plane crosses the equator northwards, not where the satellite is. It is the right
    ascension of the node less the sidereal time at Greenwich. `ValueError` for elements of an open
    orbit.
    """

    semi_major_axis_m: float
    eccentricity: float
    inclination_rad: float
    node_longitude_rad: float
    argument_of_perigee_rad: float
    mean_anomaly_rad: float

    def __attrs_post_init__(self) -> None:
        angles = (
            self.inclination_rad,
            self.node_longitude_rad,
            self.argument_of_perigee_rad,
            self.mean_anomaly_rad,
        )
        if not all(math.isfinite(angle) for angle in angles):
            raise ValueError("the angles of an orbit must be finite")
        if not 0.0 < self.semi_major_axis_m < math.inf:
            raise ValueError(
                f"the semi-major axis must be above zero and finite, not {self.semi_major_axis_m} m"
            )
        if not 0.0 <= self.eccentricity < 1.0:
            raise ValueError(
                f"the eccentricity of a closed orbit is in [0, 1), not {self.eccentricity}"
            )

    @property
    def mean_motion_rad_s(self) -> float:
        """Return the mean angular velocity."""
        return math.sqrt(EARTH_MU_M3_S2 / self.semi_major_axis_m) / self.semi_major_axis_m

    @property
    def period_s(self) -> float:
        """Return the time of one turn in ECI."""
        return 2.0 * math.pi / self.mean_motion_rad_s

    @property
    def perigee_radius_m(self) -> float:
        """Return the least distance from the Earth's centre."""
        return self.semi_major_axis_m * (1.0 - self.eccentricity)

    @property
    def apogee_radius_m(self) -> float:
        """Return the greatest distance from the Earth's centre."""
        return self.semi_major_axis_m * (1.0 + self.eccentricity)

    @property
    def perigee_time_s(self) -> float:
        """Return the scene time of the passage of perigee nearest to the scene epoch."""
        return -math.remainder(self.mean_anomaly_rad, 2.0 * math.pi) / self.mean_motion_rad_s

    def perigee_state_eci(self) -> tuple[Vector, Vector]:
        """Return position, m, and velocity, m/s, at perigee, in ECI."""
        towards, along = perigee_axes(self)
        radius_m = self.perigee_radius_m
        speed_m_s = math.sqrt(EARTH_MU_M3_S2 / radius_m * (1.0 + self.eccentricity))
        return _scaled(towards, radius_m), _scaled(along, speed_m_s)


def perigee_axes(elements: Elements) -> tuple[Vector, Vector]:
    """Return the unit vectors in the orbit's plane towards perigee and 90 degrees ahead of it, in
    ECI.

    Source: Vallado, Fundamentals of Astrodynamics and Applications, section 2.6 (the perifocal
    frame).
    """
    cos_node = math.cos(elements.node_longitude_rad)
    sin_node = math.sin(elements.node_longitude_rad)
    cos_tilt = math.cos(elements.inclination_rad)
    sin_tilt = math.sin(elements.inclination_rad)
    cosine = math.cos(elements.argument_of_perigee_rad)
    sine = math.sin(elements.argument_of_perigee_rad)
    towards = (
        cos_node * cosine - sin_node * sine * cos_tilt,
        sin_node * cosine + cos_node * sine * cos_tilt,
        sine * sin_tilt,
    )
    along = (
        -cos_node * sine - sin_node * cosine * cos_tilt,
        -sin_node * sine + cos_node * cosine * cos_tilt,
        cosine * sin_tilt,
    )
    return towards, along


def mean_anomaly_rad(true_anomaly_rad: float, eccentricity: float) -> float:
    """Return the mean anomaly, in [-pi, pi], at a true anomaly of a closed orbit (Vallado, section
    2.2).
    """
    half_rad = 0.5 * math.remainder(true_anomaly_rad, 2.0 * math.pi)
    sideways = math.sqrt(1.0 - eccentricity) * math.sin(half_rad)
    forward = math.sqrt(1.0 + eccentricity) * math.cos(half_rad)
    eccentric_rad = 2.0 * math.atan2(sideways, forward)
    return eccentric_rad - eccentricity * math.sin(eccentric_rad)


def _scaled(direction: Vector, factor: float) -> Vector:
    x, y, z = direction
    return x * factor, y * factor, z * factor


#: The inclination at which the Earth's oblateness does not turn the line of apsides: 4 - 5 sin² i =
#: 0, so sin² i = 4/5 (Vallado, Fundamentals of Astrodynamics and Applications, section 9.6).
CRITICAL_INCLINATION_RAD = math.asin(2.0 / math.sqrt(5.0))


def synchronous_semi_major_axis_m(turns_a_day: float) -> float:
    """Return the semi-major axis of an orbit from its number of turns, in ECI, in one rotation of
    the Earth.
    """
    return float((EARTH_MU_M3_S2 / (turns_a_day * EARTH_ROTATION_RAD_S) ** 2) ** (1.0 / 3.0))


def slot_elements(
    longitude_rad: float,
    *,
    inclination_rad: float = 0.0,
    eccentricity: float = 0.0,
    argument_of_perigee_rad: float = 0.0,
    mean_argument_of_latitude_rad: float = 0.0,
) -> Elements:
    """Return a geosynchronous orbit about a slot: `longitude_rad` is the mean of the satellite's
    longitude.

    The mean argument of latitude (argument of perigee plus mean anomaly) is that at the scene
    epoch; with 0, a circular orbit crosses the equator northwards, over the slot, at that moment.
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
    altitude_m: float,
    inclination_rad: float,
    node_longitude_rad: float,
    argument_of_latitude_rad: float = 0.0,
) -> Elements:
    """Return a circular orbit of the given height above the Earth's equatorial radius.

    The argument of latitude is the angle, at the scene epoch, from the ascending node to the
    satellite.
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

    With two turns a day (Molniya) every other apogee is half a turn of the Earth away; with one
    (Tundra) all are over the same longitude.
    """
    axis_m = synchronous_semi_major_axis_m(turns_a_day)
    apogee_rad = argument_of_perigee_rad + math.pi
    from_node_rad = math.atan2(
        math.cos(inclination_rad) * math.sin(apogee_rad), math.cos(apogee_rad)
    )
    mean_motion_rad_s = turns_a_day * EARTH_ROTATION_RAD_S
    return Elements(
        semi_major_axis_m=axis_m,
        eccentricity=eccentricity,
        inclination_rad=inclination_rad,
        node_longitude_rad=apogee_longitude_rad
        + EARTH_ROTATION_RAD_S * apogee_time_s
        - from_node_rad,
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

    Nodes are spread over a whole turn (delta) or, with `star`, over half of one. Within a plane
    satellites are evenly spread; from one plane to the next they are ahead by `phasing` units of 2
    pi / total. A `ValueError` where `planes` does not divide `total` or `phasing` is not in [0,
    planes).

    Source: Walker, J. Brit. Interplanetary Soc. 37 (1984), 559-572; Wertz and Larson, Space Mission
    Analysis and Design, 3rd ed., section 7.6.
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
    """Return the plane of each satellite, and its place there: whole units of 2 pi / total, reduced
    to one turn.
    """
    a_plane = total // planes
    return [
        (plane, (place * planes + plane * phasing) % total)
        for plane in range(planes)
        for place in range(a_plane)
    ]


def walker_complaint(total: int, planes: int, phasing: int) -> str | None:
    """Return the first error in the numbers of a Walker pattern, or None."""
    if total < 1 or planes < 1 or total % planes:
        return f"{total} satellites cannot be shared evenly among {planes} planes"
    if not 0 <= phasing < planes:
        return f"phasing: {phasing} is not in [0, {planes}), the number of planes"
    return None
