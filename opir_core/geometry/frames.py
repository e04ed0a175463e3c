"""Frames and time: ECEF to ECI and back, Julian dates, and Greenwich sidereal time.

ECI is ECEF frozen at the scene epoch: the frames coincide at `time_s` = 0 and differ by one
rotation about z. Epochs are `numpy.datetime64` in UTC (arrays, or text without a zone). UTC is used
for UT1, from which it differs by at most 0.9 s: 6.6e-5 rad of Earth rotation. Leap seconds are not
counted: a day has 86 400 s, as in `numpy`. Not a time: `nan`.
"""

import numpy as np
from numpy.typing import ArrayLike

from opir_core.arrays import FloatArray
from opir_core.constants import EARTH_ROTATION_RAD_S
from opir_core.geometry.vectors import FloatPair, components, floats, select, vector

Epoch = ArrayLike | np.datetime64

#: The Julian date of J2000.0, 2000-01-01T12:00:00.
J2000_JULIAN_DATE = 2451545.0

#: Days of a Julian century.
DAYS_PER_CENTURY = 36525.0

#: The Julian date of 1970-01-01T00:00:00.
UNIX_JULIAN_DATE = 2440587.5

#: Seconds of a day; leap seconds are not counted.
SECONDS_PER_DAY = 86400.0


@np.errstate(all="ignore")
def julian_date(epoch: Epoch, time_s: ArrayLike = 0.0) -> FloatArray:
    """Return the Julian date (UTC), days, `time_s` seconds after an epoch.

    One double holds it to 4e-5 s.
    """
    day, second = day_and_second(epoch, time_s)
    return (day + UNIX_JULIAN_DATE) + second / SECONDS_PER_DAY


@np.errstate(all="ignore")
def gmst_rad(epoch: Epoch, time_s: ArrayLike = 0.0) -> FloatArray:
    """Return Greenwich mean sidereal time of 1982, rad, in [0, 2 pi), `time_s` seconds after an
    epoch.

    Source: Aoki et al., Astron. Astrophys. 105 (1982), 359-361; Vallado, section 3.5. Day and
    second are separate, so that the rounding error is below 1e-12 rad.
    """
    day, second = day_and_second(epoch, time_s)
    centuries = (
        (day + (UNIX_JULIAN_DATE - J2000_JULIAN_DATE)) + second / SECONDS_PER_DAY
    ) / DAYS_PER_CENTURY
    # The leading term of the formula, 876600 h per century, is the rotation by the day: whole days
    # of it drop out.
    drift = (8640184.812866 + (0.093104 - 6.2e-6 * centuries) * centuries) * centuries
    seconds = 67310.54841 - 43200.0 + second + drift
    angle = np.mod(seconds * (np.pi / 43200.0), 2.0 * np.pi)
    return select(angle < 2.0 * np.pi, angle, angle * 0.0)


def day_and_second(epoch: Epoch, time_s: ArrayLike) -> FloatPair:
    """Return whole days since 1970 and seconds since their midnight."""
    instant = np.asarray(epoch, dtype="datetime64")
    midnight = instant.astype("datetime64[D]")
    second = (instant - midnight) / np.timedelta64(1, "s") + floats(time_s)
    day = (midnight - np.datetime64(0, "D")) / np.timedelta64(1, "D")
    return day, second


@np.errstate(all="ignore")
def ecef_to_eci(position_m: ArrayLike, time_s: ArrayLike) -> FloatArray:
    """Return ECEF vectors (..., 3) in ECI at `time_s` seconds since scene epoch."""
    return _turned(position_m, EARTH_ROTATION_RAD_S * floats(time_s))


@np.errstate(all="ignore")
def eci_to_ecef(position_m: ArrayLike, time_s: ArrayLike) -> FloatArray:
    """Return ECI vectors (..., 3) in ECEF at `time_s` seconds since scene epoch."""
    return _turned(position_m, -EARTH_ROTATION_RAD_S * floats(time_s))


@np.errstate(all="ignore")
def ecef_to_eci_state(
    position_m: ArrayLike, velocity_m_s: ArrayLike, time_s: ArrayLike
) -> FloatPair:
    """Return position (m) and velocity (m/s) in ECI of a state given in ECEF: v + omega x r,
    rotated.
    """
    position, velocity = np.broadcast_arrays(floats(position_m), floats(velocity_m_s))
    x, y, _ = components(position)
    vx, vy, vz = components(velocity)
    carried = vector(vx - EARTH_ROTATION_RAD_S * y, vy + EARTH_ROTATION_RAD_S * x, vz)
    return ecef_to_eci(position, time_s), ecef_to_eci(carried, time_s)


@np.errstate(all="ignore")
def eci_to_ecef_state(
    position_m: ArrayLike, velocity_m_s: ArrayLike, time_s: ArrayLike
) -> FloatPair:
    """Return position (m) and velocity (m/s) relative to the rotating Earth of a state given in
    ECI.
    """
    inertial_position, inertial_velocity = np.broadcast_arrays(
        floats(position_m), floats(velocity_m_s)
    )
    position = eci_to_ecef(inertial_position, time_s)
    x, y, _ = components(position)
    vx, vy, vz = components(eci_to_ecef(inertial_velocity, time_s))
    return position, vector(vx + EARTH_ROTATION_RAD_S * y, vy - EARTH_ROTATION_RAD_S * x, vz)


def _turned(vectors: ArrayLike, angle_rad: FloatArray) -> FloatArray:
    """Return vectors rotated about z by an angle."""
    x, y, z = components(vectors)
    cosine = np.cos(angle_rad)
    sine = np.sin(angle_rad)
    return vector(cosine * x - sine * y, sine * x + cosine * y, z)
