"""States in the frames of celestial mechanics, TEME, MOD and EME2000, to ECEF: precession,
nutation, sidereal time.
"""

from typing import Any

import numpy as np

from opir_core.arrays import FloatArray
from opir_core.constants import EARTH_ROTATION_RAD_S
from opir_core.geometry import gmst_rad

_ARCSECOND = np.pi / 648000.0
_DEGREE = np.pi / 180.0
_J2000_UNIX_S = 946728000.0
_CENTURY_S = 36525.0 * 86400.0

#: Terrestrial time less UTC, s, from 2017; precession in this time is 2e-10 rad, so earlier years
#: may use it too.
_TT_LESS_UTC_S = 69.184

#: Mean anomalies of Moon and Sun, argument of latitude of the Moon, its elongation, and the
#: longitude of its node: degrees at J2000.0, and a century and a century squared on (Seidelmann,
#: Explanatory Supplement, 1992, table 3.222.2).
_ARGUMENTS = (
    (134.96298139, 1325 * 360.0 + 198.8673981, 0.0086972),
    (357.52772333, 99 * 360.0 + 359.0503400, -0.0001603),
    (93.27191028, 1342 * 360.0 + 82.0175381, -0.0036825),
    (297.85036306, 1236 * 360.0 + 307.1114800, -0.0019142),
    (125.04452222, -(5 * 360.0 + 134.1362608), 0.0020708),
)

#: The largest terms of nutation (the same, table 3.222.1): multiples of the arguments; in longitude
#: and in obliquity 1e-4 arcseconds, and these a century. Omitted terms are below 0.05 arcseconds
#: together.
_NUTATION = (
    ((0, 0, 0, 0, 1), -171996.0, -174.2, 92025.0, 8.9),
    ((0, 0, 2, -2, 2), -13187.0, -1.6, 5736.0, -3.1),
    ((0, 0, 2, 0, 2), -2274.0, -0.2, 977.0, -0.5),
    ((0, 0, 0, 0, 2), 2062.0, 0.2, -895.0, 0.5),
    ((0, 1, 0, 0, 0), 1426.0, -3.4, 54.0, -0.1),
    ((1, 0, 0, 0, 0), 712.0, 0.1, -7.0, 0.0),
    ((0, 1, 2, -2, 2), -517.0, 1.2, 224.0, -0.6),
    ((0, 0, 2, 0, 1), -386.0, -0.4, 200.0, 0.0),
    ((1, 0, 2, 0, 2), -301.0, 0.0, 129.0, -0.1),
    ((0, -1, 2, -2, 2), 217.0, -0.5, -95.0, 0.3),
    ((1, 0, 0, -2, 0), -158.0, 0.0, -1.0, 0.0),
    ((0, 0, 2, -2, 1), 129.0, 0.1, -70.0, 0.0),
    ((-1, 0, 2, 0, 2), 123.0, 0.0, -53.0, 0.0),
)


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
    sidereal = gmst_rad(np.datetime64(epoch_us, "us"), time_s)
    if frame != "TEME":
        centuries = (epoch_us * 1e-6 + time_s + _TT_LESS_UTC_S - _J2000_UNIX_S) / _CENTURY_S
        longitude, obliquity, shift = nutation_rad(centuries)
        turns = [("x", obliquity), ("z", -longitude), ("x", -obliquity - shift)]
        if frame == "EME2000":
            turns = [*_precession(centuries), *turns]
        position_m, velocity_m_s = (
            _turned(vectors, turns) for vectors in (position_m, velocity_m_s)
        )
        sidereal = sidereal + longitude * np.cos(obliquity)
    position, velocity = (
        _turned(vectors, (("z", sidereal),)) for vectors in (position_m, velocity_m_s)
    )
    velocity[:, 0] += EARTH_ROTATION_RAD_S * position[:, 1]
    velocity[:, 1] -= EARTH_ROTATION_RAD_S * position[:, 0]
    return position, velocity


def _precession(t: FloatArray) -> tuple[Any, ...]:
    """Return the turns from J2000.0 to the mean equator and equinox of date (Lieske and others,
    1977).
    """
    zeta = (2306.2181 + (0.30188 + 0.017998 * t) * t) * t * _ARCSECOND
    z = (2306.2181 + (1.09468 + 0.018203 * t) * t) * t * _ARCSECOND
    theta = (2004.3109 - (0.42665 + 0.041833 * t) * t) * t * _ARCSECOND
    return ("z", -zeta), ("y", theta), ("z", -z)


@np.errstate(over="ignore", invalid="ignore")
def nutation_rad(t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return nutation in longitude, the mean obliquity, and nutation in obliquity, rad."""
    t = np.asarray(t, dtype=np.float64)
    arguments = [(start + (rate + bend * t) * t) * _DEGREE for start, rate, bend in _ARGUMENTS]
    longitude = np.zeros_like(t)
    shift = np.zeros_like(t)
    for multiples, sine, sine_rate, cosine, cosine_rate in _NUTATION:
        angle = sum(
            multiple * argument for multiple, argument in zip(multiples, arguments, strict=True)
        )
        longitude = longitude + (sine + sine_rate * t) * np.sin(angle)
        shift = shift + (cosine + cosine_rate * t) * np.cos(angle)
    obliquity = (84381.448 - (46.8150 + (0.00059 - 0.001813 * t) * t) * t) * _ARCSECOND
    return longitude * 1e-4 * _ARCSECOND, obliquity, shift * 1e-4 * _ARCSECOND


def _turned(vectors: FloatArray, turns: Any) -> FloatArray:
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
