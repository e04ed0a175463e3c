"""Where the Sun is, and whether it shines on a point."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

from opir_core.geometry.ellipsoid import WGS84
from opir_core.geometry.frames import ecef_to_eci
from opir_core.geometry.sidereal import J2000_JULIAN_DATE, gmst_rad, julian_date
from opir_core.geometry.vectors import Floats, components, length, vector

#: The astronomical unit, m (IAU 2012 resolution B2, exact).
ASTRONOMICAL_UNIT_M = 149597870700.0

#: The nominal solar radius, m (IAU 2015 resolution B3).
SUN_RADIUS_M = 6.957e8


def sun_position_of_date_m(julian_date: ArrayLike) -> Floats:
    """Return the geocentric position of the Sun (..., 3), m, in the mean equator and equinox of date (Vallado, alg. 29)."""
    centuries = (np.asarray(julian_date, dtype=np.float64) - J2000_JULIAN_DATE) / 36525.0
    mean_longitude = 280.460 + 36000.77 * centuries
    anomaly = np.radians(357.5277233 + 35999.05034 * centuries)
    longitude = np.radians(mean_longitude + 1.914666471 * np.sin(anomaly) + 0.019994643 * np.sin(2.0 * anomaly))
    distance = ASTRONOMICAL_UNIT_M * (
        1.000140612 - 0.016708617 * np.cos(anomaly) - 0.000139589 * np.cos(2.0 * anomaly)
    )
    obliquity = np.radians(23.439291 - 0.0130042 * centuries)
    sine = np.sin(longitude)
    return vector(
        distance * np.cos(longitude), distance * np.cos(obliquity) * sine, distance * np.sin(obliquity) * sine
    )


def sun_position_ecef_m(epoch: ArrayLike | np.datetime64, time_s: ArrayLike = 0.0) -> Floats:
    """Return the position of the Sun (..., 3) in ECEF, m, `time_s` seconds after an epoch (UTC)."""
    x, y, z = components(sun_position_of_date_m(julian_date(epoch, time_s)))
    angle = gmst_rad(epoch, time_s)
    cosine, sine = np.cos(angle), np.sin(angle)
    return vector(cosine * x + sine * y, cosine * y - sine * x, z)


def sun_position_eci_m(epoch: ArrayLike | np.datetime64, time_s: ArrayLike = 0.0) -> Floats:
    """Return the position of the Sun (..., 3), m, in ECI (ECEF frozen at the epoch), `time_s` seconds after it."""
    return ecef_to_eci(sun_position_ecef_m(epoch, time_s), time_s)


@np.errstate(invalid="ignore", over="ignore", divide="ignore")
def sunlit_fraction(position_m: ArrayLike, sun_position_m: ArrayLike) -> Floats:
    """Return the share of the Sun's disc that the Earth leaves in view, in [0, 1]."""
    stretch = WGS84.equatorial_radius_m / WGS84.polar_radius_m
    x, y, z = components(position_m)
    u, v, w = components(sun_position_m)
    z, u, v, w = z * stretch, u - x, v - y, w * stretch - z * stretch
    radius, distance = length(x, y, z), length(u, v, w)
    sun = np.arcsin(np.minimum(1.0, SUN_RADIUS_M / distance))
    earth = np.arcsin(np.minimum(1.0, WGS84.equatorial_radius_m / radius))
    cross = length(y * w - z * v, z * u - x * w, x * v - y * u)
    separation = np.arctan2(cross, -(x * u + y * v + z * w))
    chord = (separation * separation + sun * sun - earth * earth) / (2.0 * separation)
    half = np.sqrt(np.maximum(0.0, (sun - chord) * (sun + chord)))
    far = separation - chord
    hidden = (
        sun * sun * np.arccos(np.clip(chord / sun, -1.0, 1.0))
        + earth * earth * np.arccos(np.clip(far / earth, -1.0, 1.0))
        - separation * half
    )
    fraction = 1.0 - hidden / (np.pi * sun * sun)
    fraction = np.where(separation >= sun + earth, 1.0, np.where(separation <= earth - sun, 0.0, fraction))
    return np.where(np.isnan(radius * distance), np.nan, fraction)


def is_sunlit(position_m: ArrayLike, sun_position_m: ArrayLike) -> NDArray[np.bool_]:
    """Return whether any part of the Sun's disc is in view: the point is outside the umbra."""
    return sunlit_fraction(position_m, sun_position_m) > 0.0
