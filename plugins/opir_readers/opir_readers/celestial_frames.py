"""States in the frames of celestial mechanics, TEME, MOD and EME2000, to ECEF: precession,
nutation, sidereal time.
"""

from collections.abc import Iterable

import numpy as np

from opir_core.arrays import FloatArray
from opir_core.constants import EARTH_ROTATION_RAD_S
from opir_core.geometry import components, gmst_rad, vector
from opir_readers.published import published

ARCSECOND_RAD = np.pi / 648000.0

#: A turn about an axis, x, y or z, by angles (n,), rad.
Turn = tuple[str, FloatArray]


def centuries_since_j2000(epoch_us: int, time_s: FloatArray) -> FloatArray:
    """Julian centuries (n,) of terrestrial time from J2000.0 to scene times (n,), s.

    Terrestrial time is ahead of UTC by 69.184 s from 2017 on. Precession in a few leap seconds is
    below 2e-10 rad, so earlier years take the same.
    """
    j2000_unix_s = 946_728_000.0
    century_s = 36525.0 * 86400.0
    return (epoch_us * 1e-6 + time_s + 69.184 - j2000_unix_s) / century_s


def ecef_state(
    frame: str, position_m: FloatArray, velocity_m_s: FloatArray, epoch_us: int, time_s: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return ECEF positions and velocities relative to the Earth (n, 3) of states in ITRF, TEME,
    MOD or EME2000.

    Times (n,) are scene times; the epoch is in microseconds of UTC since 1970. States in ITRF are
    returned unchanged.
    """
    if frame == "ITRF":
        return position_m, velocity_m_s
    turns = []
    sidereal = gmst_rad(np.datetime64(epoch_us, "us"), time_s)
    if frame != "TEME":
        centuries = centuries_since_j2000(epoch_us, time_s)
        longitude, obliquity, shift = nutation_rad(centuries)
        turns = [("x", obliquity), ("z", -longitude), ("x", -obliquity - shift)]
        if frame == "EME2000":
            turns = [*_precession(centuries), *turns]
        sidereal = sidereal + longitude * np.cos(obliquity)
    turns.append(("z", sidereal))
    position = turned(position_m, turns)
    return position, turned(velocity_m_s, turns) - earth_rotation_m_s(position)


def earth_rotation_m_s(position_m: FloatArray) -> FloatArray:
    """Return the velocity of the rotating Earth (..., 3) in ECEF at positions (..., 3)."""
    x, y, _ = components(position_m)
    return EARTH_ROTATION_RAD_S * vector(-y, x, 0.0)


def _precession(t: FloatArray) -> list[Turn]:
    """Return the turns from J2000.0 to the mean equator and equinox of date (Lieske and others,
    1977).
    """
    zeta = (2306.2181 + (0.30188 + 0.017998 * t) * t) * t * ARCSECOND_RAD
    z = (2306.2181 + (1.09468 + 0.018203 * t) * t) * t * ARCSECOND_RAD
    theta = (2004.3109 - (0.42665 + 0.041833 * t) * t) * t * ARCSECOND_RAD
    return [("z", -zeta), ("y", theta), ("z", -z)]


@np.errstate(over="ignore", invalid="ignore")
def nutation_rad(t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return nutation in longitude, the mean obliquity, and nutation in obliquity, rad, at Julian
    centuries from J2000.0.

    Of the series of 1980 the 13 largest terms are taken: the others are below 0.05 arcseconds
    together. `data/nutation.json` has degrees at J2000.0, a century and a century squared on of the
    mean anomalies of Moon and Sun, the argument of latitude of the Moon, its elongation, and the
    longitude of its node; and of each term the multiples of these, and 1e-4 arcseconds in longitude
    and in obliquity, each with its change in a century.
    """
    t = np.asarray(t, dtype=np.float64)
    series = published("nutation")
    arguments = [np.radians(1.0) * (a + (b + c * t) * t) for a, b, c in series["arguments"]]
    longitude = np.zeros_like(t)
    shift = np.zeros_like(t)
    for multiples, sine, sine_rate, cosine, cosine_rate in series["terms"]:
        angle = sum(
            multiple * argument for multiple, argument in zip(multiples, arguments, strict=True)
        )
        longitude = longitude + (sine + sine_rate * t) * np.sin(angle)
        shift = shift + (cosine + cosine_rate * t) * np.cos(angle)
    obliquity = (84381.448 - (46.8150 + (0.00059 - 0.001813 * t) * t) * t) * ARCSECOND_RAD
    return longitude * 1e-4 * ARCSECOND_RAD, obliquity, shift * 1e-4 * ARCSECOND_RAD


def turned(vectors: FloatArray, turns: Iterable[Turn]) -> FloatArray:
    """Return vectors (n, 3) in axes turned about x, y or z by angles (n,), one turn after the
    other.
    """
    columns = list(vectors.T)
    for axis, angle in turns:
        first, second = {"x": (1, 2), "y": (2, 0), "z": (0, 1)}[axis]
        a = columns[first]
        b = columns[second]
        cosine = np.cos(angle)
        sine = np.sin(angle)
        columns[first] = cosine * a + sine * b
        columns[second] = cosine * b - sine * a
    return np.stack(columns, axis=1)
