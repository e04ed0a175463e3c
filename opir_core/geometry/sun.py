"""The position of the Sun, to 0.0125 degrees from 1970 to 2099, and its eclipse by the Earth."""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from opir_core.arrays import FloatArray
from opir_core.geometry.ellipsoid import WGS84
from opir_core.geometry.frames import DAYS_PER_CENTURY, J2000_JULIAN_DATE, Epoch, ecef_to_eci, gmst_rad, julian_date
from opir_core.geometry.vectors import components, floats, length, select, vector

#: The astronomical unit, m (IAU 2012 resolution B2, exact).
ASTRONOMICAL_UNIT_M = 149597870700.0

#: The nominal radius of the Sun, m (IAU 2015 resolution B3).
SUN_RADIUS_M = 6.957e8


@np.errstate(invalid="ignore", over="ignore", divide="ignore")
def sun_position_of_date_m(julian_date: ArrayLike) -> FloatArray:
    """Return the geocentric apparent position of the Sun (..., 3), m, in the mean equator and equinox of date.

    From 1970 to 2099 its direction is good to 0.012 degrees and its distance to 1.1e-4 of itself, against the theory of
    the Earth's motion in ERFA. Universal time stands in for dynamical time. Source: Vallado, Fundamentals of
    Astrodynamics and Applications, algorithm 29, the mean longitude with all the digits of mean sidereal time.
    """
    centuries = (floats(julian_date) - J2000_JULIAN_DATE) / DAYS_PER_CENTURY
    anomaly = np.radians(357.5277233 + 35999.05034 * centuries)
    mean_longitude = 280.4606184 + 36000.77005361 * centuries
    longitude = np.radians(mean_longitude + 1.914666471 * np.sin(anomaly) + 0.019994643 * np.sin(2.0 * anomaly))
    radius_au = 1.000140612 - 0.016708617 * np.cos(anomaly) - 0.000139589 * np.cos(2.0 * anomaly)
    obliquity = np.radians(23.439291 - 0.0130042 * centuries)
    distance = ASTRONOMICAL_UNIT_M * radius_au
    aside = distance * np.sin(longitude)
    return vector(distance * np.cos(longitude), aside * np.cos(obliquity), aside * np.sin(obliquity))


@np.errstate(invalid="ignore", over="ignore", divide="ignore")
def sun_position_ecef_m(epoch: Epoch, time_s: ArrayLike = 0.0) -> FloatArray:
    """Return the position of the Sun (..., 3) in ECEF, m, `time_s` seconds after an epoch (`numpy.datetime64`, UTC)."""
    x, y, z = components(sun_position_of_date_m(julian_date(epoch, time_s)))
    angle = gmst_rad(epoch, time_s)
    cosine, sine = np.cos(angle), np.sin(angle)
    return vector(cosine * x + sine * y, cosine * y - sine * x, z)


@np.errstate(invalid="ignore", over="ignore", divide="ignore")
def sun_position_eci_m(epoch: Epoch, time_s: ArrayLike = 0.0) -> FloatArray:
    """Return the position of the Sun (..., 3), m, in ECI, `time_s` seconds after an epoch (`numpy.datetime64`, UTC).

    ECI is ECEF frozen at that epoch, as everywhere in opir; for the equator and equinox of date see
    `sun_position_of_date_m`.
    """
    return ecef_to_eci(sun_position_ecef_m(epoch, time_s), time_s)


class _Discs(NamedTuple):
    """The Sun and the Earth as seen from a point: their angular radii and the angle between their centres, rad."""

    sun: FloatArray
    earth: FloatArray
    separation: FloatArray


@np.errstate(invalid="ignore", over="ignore", divide="ignore")
def sunlit_fraction(position_m: ArrayLike, sun_position_m: ArrayLike) -> FloatArray:
    """Return the share of the Sun's disc in view of positions (..., 3), in [0, 1]; both in one Earth-centred frame, m.

    1 in full light, 0 in the umbra, between in the penumbra: the overlap of two discs (Montenbruck and Gill, Satellite
    Orbits, section 3.4.2), without refraction and limb darkening. A stretch along z makes the ellipsoid a sphere, and
    the Sun's disc at most 0.3 % too long. A point below the ellipsoid has the horizon of one on it; `nan` at the
    Earth's centre, and where an input is not finite.
    """
    sun, earth, separation = _discs(position_m, sun_position_m)
    chord = (separation * separation + (sun - earth) * (sun + earth)) / (2.0 * separation)
    half = np.sqrt(np.maximum(0.0, (sun - chord) * (sun + chord)))
    lens = sun * sun * np.arctan2(half, chord) + earth * earth * np.arctan2(half, separation - chord)
    shown = 1.0 - (lens - separation * half) / (np.pi * sun * sun)
    ring = 1.0 - np.square(np.minimum(1.0, earth / sun))
    shown = select(separation <= np.abs(earth - sun), ring, np.clip(shown, 0.0, 1.0))
    return select(separation >= earth + sun, 1.0, shown)


@np.errstate(invalid="ignore", over="ignore", divide="ignore")
def is_sunlit(position_m: ArrayLike, sun_position_m: ArrayLike) -> NDArray[np.bool_]:
    """Return whether positions (..., 3) are outside the umbra: any part of the Sun's disc is in view.

    Both in one Earth-centred frame, m; the discs of `sunlit_fraction`. What is `nan` there is not sunlit.
    """
    sun, earth, separation = _discs(position_m, sun_position_m)
    return separation > earth - sun


def _discs(position_m: ArrayLike, sun_position_m: ArrayLike) -> _Discs:
    """Return the discs of Sun and Earth, after the stretch along z that makes the Earth a sphere."""
    stretch = WGS84.equatorial_radius_m / WGS84.polar_radius_m
    x, y, z = components(position_m)
    u, v, w = components(sun_position_m)
    z, u, v, w = z * stretch, u - x, v - y, (w - z) * stretch
    radius, distance = length(x, y, z), length(u, v, w)
    across = length(y * w - z * v, z * u - x * w, x * v - y * u)
    return _Discs(
        np.arcsin(np.minimum(1.0, SUN_RADIUS_M / distance)),
        np.arcsin(np.minimum(1.0, WGS84.equatorial_radius_m / radius)),
        select(radius > 0.0, np.arctan2(across, -(x * u + y * v + z * w)), np.nan),
    )
