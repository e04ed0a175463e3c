"""The position of the Sun, to 0.001 degrees from 1970 to 2099, and its eclipse by the Earth."""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from opir_core.arrays import BoolArray, FloatArray
from opir_core.geometry.ellipsoid import WGS84
from opir_core.geometry.frames import (
    DAYS_PER_CENTURY,
    J2000_JULIAN_DATE,
    SECONDS_PER_DAY,
    UNIX_JULIAN_DATE,
    Epoch,
    day_and_second,
    ecef_to_eci,
    eci_to_ecef,
    gmst_rad,
)
from opir_core.geometry.sun_series import geometric_longitude_rad, nutation_rad
from opir_core.geometry.vectors import NEVER_ZERO, components, floats, length, select, vector

#: The astronomical unit, m (IAU 2012 resolution B2, exact).
ASTRONOMICAL_UNIT_M = 149597870700.0

#: The nominal radius of the Sun, m (IAU 2015 resolution B3).
SUN_RADIUS_M = 6.957e8


#: Step of the Sun's position in ECI, s, linear between: an error of at most 1e-7 rad.
_SUN_STEP_S = 3600.0


@np.errstate(all="ignore")
def sun_position_of_date_m(julian_date: ArrayLike) -> FloatArray:
    """Return the geocentric apparent position of the Sun (..., 3), m, in the mean equator and
    equinox of date.

    From 1970 to 2099 its direction is good to 0.001 degrees and its distance to 1.1e-4 of itself,
    against the theory of the Earth's motion in ERFA. Julian dates are UTC; dynamical time is taken
    69.184 s ahead of it, as since 2017. Sources: longitude as in opir_core/geometry/sun_series.py,
    distance Vallado, Fundamentals of Astrodynamics and Applications, algorithm 29.
    """
    centuries = _dynamical_centuries(floats(julian_date) - J2000_JULIAN_DATE, 0.0)
    return _position_m(centuries, np.zeros(()), np.zeros(()))


@np.errstate(all="ignore")
def sun_position_ecef_m(epoch: Epoch, time_s: ArrayLike = 0.0) -> FloatArray:
    """Return the position of the Sun (..., 3) in ECEF, m, `time_s` seconds after an epoch
    (`numpy.datetime64`, UTC).

    With the nutation of the Earth's axis; from 1970 to 2099 good to 0.001 degrees, beside the 0.004
    degrees by which the Earth's rotation may differ where UTC stands in for UT1 (`gmst_rad`).
    """
    day, second = day_and_second(epoch, time_s)
    centuries = _dynamical_centuries(day + (UNIX_JULIAN_DATE - J2000_JULIAN_DATE), second)
    in_longitude, in_obliquity = nutation_rad(centuries)
    x, y, z = components(_position_m(centuries, in_longitude, in_obliquity))
    # Apparent sidereal time: mean, and the equation of the equinoxes.
    angle = gmst_rad(epoch, time_s) + in_longitude * np.cos(
        _obliquity_rad(centuries) + in_obliquity
    )
    cosine = np.cos(angle)
    sine = np.sin(angle)
    return vector(cosine * x + sine * y, cosine * y - sine * x, z)


def _dynamical_centuries(day: FloatArray, second: FloatArray | float) -> FloatArray:
    """Return Julian centuries of dynamical time since J2000.0, from days since then and seconds of
    UTC.

    Apart, for one double holds a Julian date to 4e-5 s: 8e-12 rad of the Sun's direction.
    """
    # Dynamical time minus UTC, s: 32.184 s and the 37 leap seconds in force since 2017 (IERS
    # Bulletin C).
    return np.asarray((day + (second + 69.184) / SECONDS_PER_DAY) / DAYS_PER_CENTURY)


def _obliquity_rad(centuries: FloatArray) -> FloatArray:
    """Return the mean obliquity of the ecliptic (Meeus, Astronomical Algorithms, 22.2)."""
    return np.radians(23.43929111 - 0.0130041667 * centuries)


def _position_m(
    centuries: FloatArray, in_longitude: FloatArray, in_obliquity: FloatArray
) -> FloatArray:
    """Return apparent positions of the Sun, with nutations, rad."""
    anomaly = np.radians(357.5277233 + 35999.05034 * centuries)
    radius_au = 1.000140612 - 0.016708617 * np.cos(anomaly) - 0.000139589 * np.cos(2.0 * anomaly)
    # The constant of aberration, rad (20.49552 arcseconds, IAU 1976), by which the Sun lags
    # behind its place.
    longitude = (
        geometric_longitude_rad(centuries)
        - np.radians(20.49552 / 3600.0) / radius_au
        + in_longitude
    )
    obliquity = _obliquity_rad(centuries) + in_obliquity
    distance = ASTRONOMICAL_UNIT_M * radius_au
    aside = distance * np.sin(longitude)
    return vector(
        distance * np.cos(longitude), aside * np.cos(obliquity), aside * np.sin(obliquity)
    )


@np.errstate(all="ignore")
def sun_position_eci_m(epoch: Epoch, time_s: ArrayLike = 0.0) -> FloatArray:
    """Return the position of the Sun (..., 3), m, in ECI, `time_s` seconds after an epoch
    (`numpy.datetime64`, UTC).

    ECI is ECEF frozen at that epoch, as everywhere in opir; for the equator and equinox of date see
    `sun_position_of_date_m`.
    """
    return ecef_to_eci(sun_position_ecef_m(epoch, time_s), time_s)


def sun_ecef_m(time_s: FloatArray, epoch_us: int) -> FloatArray:
    """Return the Sun's positions (n, 3) in ECEF at scene times (n,), m: `sun_position_ecef_m`
    within 1e-7 rad.
    """
    if not len(time_s):
        return np.empty((0, 3))
    hour = np.floor(time_s / _SUN_STEP_S)
    start = float(hour.min())
    knots = _sun_knots_eci_m(epoch_us, start, float(hour.max()) + 2.0)
    row = (hour - start).astype(np.int64)
    share = (time_s / _SUN_STEP_S - hour)[:, None]
    return eci_to_ecef(knots[row] + share * (knots[row + 1] - knots[row]), time_s)


@lru_cache(maxsize=64)
def _sun_knots_eci_m(epoch_us: int, start: float, stop: float) -> FloatArray:
    """Return the Sun's positions (k, 3) in ECI at the steps from the first to the one before
    `stop`.
    """
    return sun_position_eci_m(np.datetime64(epoch_us, "us"), np.arange(start, stop) * _SUN_STEP_S)


class _Discs(NamedTuple):
    """The Sun and the Earth as seen from a point: their angular radii and the angle between their
    centres, rad.
    """

    sun: FloatArray
    earth: FloatArray
    separation: FloatArray


@np.errstate(all="ignore")
def sunlit_fraction(position_m: ArrayLike, sun_position_m: ArrayLike) -> FloatArray:
    """Return the share of the Sun's disc in view of positions (..., 3), in [0, 1]; both in one
    Earth-centred frame, m.

    1 in full light, 0 in the umbra, between in the penumbra: the overlap of two discs (Montenbruck
    and Gill, Satellite Orbits, section 3.4.2), without refraction and limb darkening. A stretch
    along z makes the ellipsoid a sphere; the discs touch as they do without it, and between
    contacts the share is good to 0.001. A point below the ellipsoid has the horizon of one on it;
    `nan` at the Earth's centre, and where an input is not finite.
    """
    sun, earth, separation = _discs(position_m, sun_position_m)
    chord = (separation * separation + (sun - earth) * (sun + earth)) / (2.0 * separation)
    half = np.sqrt(np.maximum(0.0, (sun - chord) * (sun + chord)))
    lens = sun * sun * np.arctan2(half, chord) + earth * earth * np.arctan2(
        half, separation - chord
    )
    shown = 1.0 - (lens - separation * half) / (np.pi * sun * sun)
    ring = 1.0 - np.square(np.minimum(1.0, earth / sun))
    shown = select(separation <= np.abs(earth - sun), ring, np.clip(shown, 0.0, 1.0))
    return select(separation >= earth + sun, 1.0, shown)


@np.errstate(all="ignore")
def is_sunlit(position_m: ArrayLike, sun_position_m: ArrayLike) -> BoolArray:
    """Return whether positions (..., 3) are outside the umbra: any part of the Sun's disc is in
    view.

    Both in one Earth-centred frame, m; the discs of `sunlit_fraction`. Positions with `nan`
    there are in the dark.
    """
    return shadow_margins_rad(position_m, sun_position_m).umbra > 0.0


class ShadowMargins(NamedTuple):
    """Angles (...), rad, by which the Sun is clear of the Earth: negative in the penumbra, and in
    the umbra.
    """

    penumbra: FloatArray
    umbra: FloatArray


@np.errstate(all="ignore")
def shadow_margins_rad(position_m: ArrayLike, sun_position_m: ArrayLike) -> ShadowMargins:
    """Return how far the Sun is from touching the Earth's disc, and from being behind it, at
    positions (..., 3).

    Both in one Earth-centred frame, m; the discs of `sunlit_fraction`: their gap is negative from
    the first contact on, the part of the Sun beyond the Earth from the second. The penumbra
    includes the umbra.
    """
    sun, earth, separation = _discs(position_m, sun_position_m)
    return ShadowMargins(separation - (earth + sun), separation - (earth - sun))


@np.errstate(all="ignore")
def limb_angle_rad(position_m: ArrayLike, target_m: ArrayLike) -> FloatArray:
    """Return how far targets are from the Earth's limb as seen from positions (..., 3), rad,
    negative before its disc.

    Both in one Earth-centred frame, m. The stretch of `sunlit_fraction` changes angles by up to
    0.4 %, and none that are 0.
    """
    _, earth, separation = _discs(position_m, target_m)
    return separation - earth


def _discs(position_m: ArrayLike, sun_position_m: ArrayLike) -> _Discs:
    """Return the discs of Sun and Earth, after the stretch along z that makes the Earth a sphere.

    The stretched Sun is longer along z; its radius is that towards the Earth's centre, where the
    discs touch.
    """
    stretch = WGS84.equatorial_radius_m / WGS84.polar_radius_m
    x, y, z = components(position_m)
    u, v, w = components(sun_position_m)
    u = u - x
    v = v - y
    w = (w - z) * stretch
    z = z * stretch
    radius = length(x, y, z)
    distance = length(u, v, w)
    normal_x = y * w - z * v
    normal_y = z * u - x * w
    normal_z = x * v - y * u
    across = length(normal_x, normal_y, normal_z)
    slope = (normal_x * v - normal_y * u) / (across * distance + NEVER_ZERO)
    sun_radius_m = SUN_RADIUS_M * np.sqrt(1.0 + (stretch * stretch - 1.0) * slope * slope)
    return _Discs(
        np.arcsin(np.minimum(1.0, sun_radius_m / distance)),
        np.arcsin(np.minimum(1.0, WGS84.equatorial_radius_m / radius)),
        select(radius > 0.0, np.arctan2(across, -(x * u + y * v + z * w)), np.nan),
    )
