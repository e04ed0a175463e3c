"""References of geometry: frames, angles, the ellipsoid, lines of sight and the Sun, each from its
definition.
"""

import mpmath as mp
import numpy as np

import opir_core.geometry as geometry
from exact_cases import draws
from exact_cases.measure import Case, bound_of, cross, dot, less, norm, plus, times
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_FLATTENING, EARTH_ROTATION_RAD_S
from opir_core.geometry import sun_series
from opir_core.geometry.sun import ASTRONOMICAL_UNIT_M, SUN_RADIUS_M

with mp.workdps(60):
    A = mp.mpf(EARTH_EQUATORIAL_RADIUS_M)
    F = mp.mpf(EARTH_FLATTENING)
    OMEGA = mp.mpf(EARTH_ROTATION_RAD_S)
    B = A * (1 - F)
    E2 = F * (2 - F)


def turned(vector, angle):
    """Return a vector rotated about z."""
    c = mp.cos(angle)
    s = mp.sin(angle)
    return [c * vector[0] - s * vector[1], s * vector[0] + c * vector[1], vector[2]]


def inertial(position, time):
    return turned(position, OMEGA * time)


def fixed(position, time):
    return turned(position, -OMEGA * time)


def inertial_state(position, velocity, time):
    return inertial(position, time), inertial(plus(velocity, cross([0, 0, OMEGA], position)), time)


def fixed_state(position, velocity, time):
    place = fixed(position, time)
    return place, less(fixed(velocity, time), cross([0, 0, OMEGA], place))


def ecef(latitude, longitude, height):
    normal = A / mp.sqrt(1 - E2 * mp.sin(latitude) ** 2)
    rho = (normal + height) * mp.cos(latitude)
    return [
        rho * mp.cos(longitude),
        rho * mp.sin(longitude),
        (normal * (1 - E2) + height) * mp.sin(latitude),
    ]


def geodetic(position):
    """Return latitude, longitude and height of a point more than 100 km from the centre, by
    Newton's method.
    """
    rho = mp.hypot(position[0], position[1])
    z = position[2]
    # On the ellipse through (a cos t, b sin t): the zero of the tangential part of the way to the
    # point.
    t = mp.atan2(A * z, B * rho)
    for _ in range(60):
        sine = mp.sin(t)
        cosine = mp.cos(t)
        value = (A * A - B * B) * sine * cosine - rho * A * sine + z * B * cosine
        step = value / (
            (A * A - B * B) * (cosine * cosine - sine * sine) - rho * A * cosine - z * B * sine
        )
        t -= step
        if abs(step) < mp.mpf(10) ** (-mp.mp.dps + 3):
            break
    latitude = mp.atan2(A * mp.sin(t), B * mp.cos(t))
    normal = A / mp.sqrt(1 - E2 * mp.sin(latitude) ** 2)
    height = rho * mp.cos(latitude) + z * mp.sin(latitude) - A * A / normal
    return latitude, mp.atan2(position[1], position[0]) if rho else mp.mpf(0), height


def axes(latitude, longitude):
    """Return east, north and up."""
    s = mp.sin(latitude)
    c = mp.cos(latitude)
    sl = mp.sin(longitude)
    cl = mp.cos(longitude)
    return [-sl, cl, mp.mpf(0)], [-s * cl, -s * sl, c], [c * cl, c * sl, s]


def axes_at(position):
    return axes(*geodetic(position)[:2])


def pointed(offset, east, north, up):
    e = dot(east, offset)
    n = dot(north, offset)
    u = dot(up, offset)
    return mp.atan2(e, n) % (2 * mp.pi), mp.atan2(u, mp.hypot(e, n)), norm(offset)


def azimuth_elevation_range(observer, target):
    return pointed(less(target, observer), *axes_at(observer))


def line_of_sight(observer, azimuth, elevation):
    east, north, up = axes_at(observer)
    level = plus(times(mp.sin(azimuth), east), north, mp.cos(azimuth))
    return plus(times(mp.cos(elevation), level), up, mp.sin(elevation))


def nadir_angle(sensor, target):
    offset = less(target, sensor)
    return mp.atan2(norm(cross(sensor, offset)), -dot(sensor, offset))


def julian_date(epoch, time):
    return mp.mpf("2440587.5") + (mp.mpf(int(epoch.astype(np.int64))) / 10**6 + time) / 86400


def gmst(epoch, time):
    """Aoki et al. 1982, with UTC for UT1, undivided: the polynomial of the whole time."""
    centuries = (julian_date(epoch, time) - 2451545) / 36525
    seconds = (
        mp.mpf("67310.54841")
        + (876600 * 3600 + mp.mpf("8640184.812866")) * centuries
        + mp.mpf("0.093104") * centuries**2
        - mp.mpf("6.2e-6") * centuries**3
    )
    return (seconds * mp.pi / 43200) % (2 * mp.pi)


def radians(value):
    return value * mp.pi / 180


def text(value):
    """Return the decimal number that a float of the source was written as."""
    return mp.mpf(repr(value))


def sun_of_centuries(centuries, in_longitude=0, in_obliquity=0):
    series = mp.fsum(
        text(size) * mp.sin(radians(text(phase) + text(rate) * centuries))
        for size, phase, rate in sun_series._longitude_terms()
    )
    geometric = (
        radians(mp.mpf("282.7771834") + mp.mpf("36000.76953744") * centuries) + series / 10**7
    )
    anomaly = radians(mp.mpf("357.5277233") + mp.mpf("35999.05034") * centuries)
    radius = (
        mp.mpf("1.000140612")
        - mp.mpf("0.016708617") * mp.cos(anomaly)
        - mp.mpf("0.000139589") * mp.cos(2 * anomaly)
    )
    longitude = geometric - radians(mp.mpf("20.49552") / 3600) / radius + in_longitude
    obliquity = obliquity_of(centuries) + in_obliquity
    distance = mp.mpf(ASTRONOMICAL_UNIT_M) * radius
    return [
        distance * mp.cos(longitude),
        distance * mp.sin(longitude) * mp.cos(obliquity),
        distance * mp.sin(longitude) * mp.sin(obliquity),
    ]


def obliquity_of(centuries):
    return radians(mp.mpf("23.43929111") - mp.mpf("0.0130041667") * centuries)


def dynamical_centuries(date):
    return (date - 2451545 + mp.mpf("69.184") / 86400) / 36525


def nutation(centuries):
    node = radians(mp.mpf("125.04452") - mp.mpf("1934.136261") * centuries)
    sun = 2 * radians(mp.mpf("280.4665") + mp.mpf("36000.7698") * centuries)
    moon = 2 * radians(mp.mpf("218.3165") + mp.mpf("481267.8813") * centuries)
    sines = [
        ("-17.20", mp.sin(node)),
        ("-1.32", mp.sin(sun)),
        ("-0.23", mp.sin(moon)),
        ("0.21", mp.sin(2 * node)),
    ]
    cosines = [
        ("9.20", mp.cos(node)),
        ("0.57", mp.cos(sun)),
        ("0.10", mp.cos(moon)),
        ("-0.09", mp.cos(2 * node)),
    ]
    return tuple(
        radians(mp.fsum(mp.mpf(size) * wave for size, wave in terms) / 3600)
        for terms in (sines, cosines)
    )


def sun_ecef(epoch, time):
    centuries = dynamical_centuries(julian_date(epoch, time))
    in_longitude, in_obliquity = nutation(centuries)
    angle = gmst(epoch, time) + in_longitude * mp.cos(obliquity_of(centuries) + in_obliquity)
    return turned(sun_of_centuries(centuries, in_longitude, in_obliquity), -angle)


def sun_eci(epoch, time):
    return inertial(sun_ecef(epoch, time), time)


def discs(position, sun):
    """Return the angular radii of Sun and Earth and their separation, in the space stretched along
    z.
    """
    stretch = A / B
    here = [position[0], position[1], position[2] * stretch]
    place = [sun[0], sun[1], sun[2] * stretch]
    offset = less(place, here)
    normal = cross(here, offset)
    slope = (normal[0] * offset[1] - normal[1] * offset[0]) / (norm(normal) * norm(offset))
    radius = mp.mpf(SUN_RADIUS_M) * mp.sqrt(1 + (stretch * stretch - 1) * slope * slope)
    separation = mp.atan2(norm(normal), -dot(here, offset))
    return mp.asin(radius / norm(offset)), mp.asin(min(mp.mpf(1), A / norm(here))), separation


def sunlit_fraction(position, sun):
    s, e, d = discs(position, sun)
    if d >= s + e:
        return mp.mpf(1)
    if d <= abs(e - s):
        return 1 - min(mp.mpf(1), e / s) ** 2
    chord = (d * d + s * s - e * e) / (2 * d)
    half = mp.sqrt(s * s - chord * chord)
    lens = s * s * mp.atan2(half, chord) + e * e * mp.atan2(half, d - chord) - d * half
    return 1 - lens / (mp.pi * s * s)


def intersection(origin, ray, height):
    sides = [A + height] * 2 + [B + height]
    o = [p / s for p, s in zip(origin, sides, strict=True)]
    d = [p / s for p, s in zip(ray, sides, strict=True)]
    dd = dot(d, d)
    od = dot(o, d)
    oo = dot(o, o) - 1
    if dd == 0 or od * od < dd * oo:
        return None
    root = mp.sqrt(od * od - dd * oo)
    steps = (-od - root) / dd, (-od + root) / dd
    return next((plus(origin, ray, step) for step in steps if step >= 0), None)


def lowest(observer, target):
    """Return the share of a segment at which it is lowest, and the height there: the slope's zero,
    by bisection.
    """
    offset = less(target, observer)

    def slope(share):
        place = plus(observer, offset, share)
        return dot(axes_at(place)[2], offset)

    low = mp.mpf(0)
    high = mp.mpf(1)
    if slope(low) >= 0:
        return low, geodetic(observer)[2]
    if slope(high) <= 0:
        return high, geodetic(target)[2]
    # A height is stationary at its minimum: half the digits of the share give all of the height's.
    share = mp.findroot(slope, (low, high), solver="anderson", tol=mp.mpf(10) ** -24, verify=False)
    return share, geodetic(plus(observer, offset, share))[2]


def grazing_condition(observer, target):
    """The height of the lowest point moves with the ends as that point does: by the envelope
    theorem.
    """
    share, height = lowest(observer, target)
    up = axes_at(plus(observer, less(target, observer), share))[2]
    terms = [
        abs(weight * u * p)
        for weight, end in ((1 - share, observer), (share, target))
        for u, p in zip(up, end, strict=True)
    ]
    return [mp.fsum(terms) / abs(height)]


def lines(rng, n):
    """Return observers and targets (n, 3): lines that graze the Earth, some clear of it, some
    through it.
    """
    observer = draws.positions(rng, n, 6.7e6, 4.3e7)
    target = draws.positions(rng, n, 6.4e6, 8e6)
    return observer, target


def lit(rng, n):
    """Return positions about the Earth's shadow, and the Sun's (n, 3)."""
    sun = draws.directions(rng, n) * 1.496e11
    radius = draws.log_uniform(rng, n, 6.6e6, 4.3e7)
    offset = -sun / 1.496e11
    across = np.cross(offset, draws.directions(rng, n))
    across /= np.maximum(np.sqrt((across**2).sum(axis=1, keepdims=True)), 1e-300)
    miss = 6.37e6 * (1.0 + rng.normal(scale=0.01, size=n))
    along = np.sqrt(np.maximum(radius**2 - miss**2, 0.0))
    return offset * along[:, None] + across * miss[:, None], sun


def rays(rng, n):
    """Return origins, directions towards the Earth and beside it, and heights."""
    origin = draws.positions(rng, n, 6.6e6, 4.3e7)
    aim = draws.directions(rng, n) * (6.3e6 * rng.uniform(0.0, 1.1, n))[:, None]
    return (
        origin,
        (aim - origin) * draws.log_uniform(rng, n, 1e-9, 1e9)[:, None],
        rng.choice([0.0, 1e5, -1e3], n),
    )


def _state(rng, n):
    return (
        draws.positions(rng, n),
        draws.directions(rng, n) * draws.log_uniform(rng, n, 1.0, 1e4)[:, None],
        draws.times(rng, n),
    )


def _at(rng, n):
    return draws.epochs(rng, n), draws.times(rng, n)


def _pairs(rng, n):
    return draws.positions(rng, n), draws.positions(rng, n)


def _with_axes(rng, n):
    observer, target = _pairs(rng, n)
    rows = geometry.local_axes(observer)
    return target - observer, rows[:, 0], rows[:, 1], rows[:, 2]


def _three(result):
    return result[:, 0], result[:, 1], result[:, 2]


CASES = (
    Case(
        "geometry.ecef_to_eci",
        lambda r, n: (draws.positions(r, n), draws.times(r, n)),
        geometry.ecef_to_eci,
        inertial,
    ),
    Case(
        "geometry.eci_to_ecef",
        lambda r, n: (draws.positions(r, n), draws.times(r, n)),
        geometry.eci_to_ecef,
        fixed,
    ),
    Case("geometry.ecef_to_eci_state", _state, geometry.ecef_to_eci_state, inertial_state),
    Case("geometry.eci_to_ecef_state", _state, geometry.eci_to_ecef_state, fixed_state),
    Case(
        "geometry.geodetic_to_ecef",
        lambda r, n: (
            draws.latitudes(r, n),
            draws.angles(r, n),
            draws.uniform(r, n, -6e3, 4e7, (0.0, 5e-324, 3.8e8)),
        ),
        geometry.geodetic_to_ecef,
        ecef,
    ),
    Case(
        "geometry.ecef_to_geodetic",
        lambda r, n: (draws.positions(r, n, 2e6, 4e8),),
        lambda p: tuple(geometry.ecef_to_geodetic(p)),
        geodetic,
        share=0.3,
    ),
    Case(
        "geometry.east_north_up_axes",
        lambda r, n: (draws.latitudes(r, n), draws.angles(r, n)),
        lambda *place: _three(geometry.east_north_up_axes(*place)),
        axes,
    ),
    Case(
        "geometry.local_axes",
        lambda r, n: (draws.positions(r, n),),
        lambda p: _three(geometry.local_axes(p)),
        axes_at,
        share=0.3,
    ),
    Case(
        "geometry.azimuth_elevation_range",
        _pairs,
        lambda *ends: tuple(geometry.azimuth_elevation_range(*ends)),
        azimuth_elevation_range,
        angles=(0,),
        share=0.2,
    ),
    Case(
        "geometry.azimuth_elevation_range_in_axes",
        _with_axes,
        lambda offset, *rows: tuple(
            geometry.azimuth_elevation_range_in_axes(offset, np.stack(rows, axis=1))
        ),
        pointed,
        angles=(0,),
    ),
    Case(
        "geometry.elevation_rad",
        _pairs,
        geometry.elevation_rad,
        lambda *ends: azimuth_elevation_range(*ends)[1],
        share=0.2,
    ),
    Case(
        "geometry.line_of_sight",
        lambda r, n: (draws.positions(r, n), draws.angles(r, n), draws.latitudes(r, n)),
        geometry.line_of_sight,
        line_of_sight,
        share=0.3,
    ),
    Case("geometry.nadir_angle_rad", _pairs, geometry.nadir_angle_rad, nadir_angle),
    Case("geometry.julian_date", _at, geometry.julian_date, julian_date),
    Case(
        "geometry.grazing_height_m",
        lines,
        geometry.grazing_height_m,
        lambda *ends: lowest(*ends)[1],
        condition=grazing_condition,
        share=0.05,
    ),
    Case(
        "geometry.is_occluded",
        lines,
        geometry.is_occluded,
        lambda *ends: mp.mpf(0 < lowest(*ends)[0] < 1 and lowest(*ends)[1] < 0),
        share=0.05,
    ),
    Case(
        "geometry.intersection_with_ellipsoid",
        rays,
        geometry.intersection_with_ellipsoid,
        intersection,
    ),
    Case(
        "geometry.sun_position_of_date_m",
        lambda r, n: (r.uniform(2440587.5, 2488069.5, n),),
        geometry.sun_position_of_date_m,
        lambda date: sun_of_centuries(dynamical_centuries(date)),
        share=0.2,
    ),
    Case("geometry.sunlit_fraction", lit, geometry.sunlit_fraction, sunlit_fraction, scale=(1.0,)),
    Case(
        "geometry.limb_angle_rad",
        lit,
        geometry.limb_angle_rad,
        lambda *row: discs(*row)[2] - discs(*row)[1],
        scale=(1.0,),
    ),
    Case(
        "geometry.is_sunlit",
        lit,
        geometry.is_sunlit,
        lambda *row: mp.mpf(discs(*row)[2] > discs(*row)[1] - discs(*row)[0]),
    ),
)


def _turn(_, time):
    """Return the bound of an angle that turns with the Earth: 1e-12 and the rounding of the
    time.
    """
    return 1e-12 + 1e-19 * np.abs(time)


BOUNDS = (
    bound_of(
        "geometry.gmst_rad",
        "1e-12 rad and rounding of the time",
        _at,
        geometry.gmst_rad,
        gmst,
        _turn,
        scale=(2.0 * np.pi,),
        angles=(0,),
    ),
    bound_of(
        "geometry.sun_position_ecef_m",
        "1e-12 rad and rounding of the time",
        _at,
        geometry.sun_position_ecef_m,
        sun_ecef,
        _turn,
    ),
    bound_of(
        "geometry.sun_position_eci_m",
        "1e-12 rad and rounding of the time",
        _at,
        geometry.sun_position_eci_m,
        sun_eci,
        _turn,
    ),
)

LEFT_OUT = {
    **dict.fromkeys(("ASTRONOMICAL_UNIT_M", "SUN_RADIUS_M", "WGS84"), "a constant"),
    **dict.fromkeys(
        ("components", "dot", "length", "vector"), "arithmetic of components, a few operations each"
    ),
    "AzimuthalEquidistant": "a map for drawing and areas; against geographiclib"
    " (tests/core/geometry)",
    "Crossings": "a record",
    "angle_between_rad": "through nadir_angle_rad",
    "great_circle_m": "a distance on the sphere, for maps (tests/core/geometry)",
    "shadow_margins_rad": "through is_sunlit and sunlit_fraction",
    "sun_ecef_m": "through sun_position_ecef_m",
    "unit_vectors": "places on the unit sphere, for maps (tests/core/geometry)",
    "zero_crossings": "a search to a stated tolerance (tests/core/geometry)",
    "AzimuthElevationRange": "a record",
    "DistanceBearing": "a record",
    "Ellipsoid": "a record",
    "Geodetic": "a record",
    "LatitudeLongitude": "a record",
    "geodesic_direct": "GeographicLib's, exact to 15 nm"
    " (tests/against/test_against_geographiclib_geometry.py)",
    "geodesic_inverse": "GeographicLib's, exact to 15 nm"
    " (tests/against/test_against_geographiclib_geometry.py)",
}
