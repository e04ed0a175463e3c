"""Calendar time to Julian date and to the angle of the turning Earth."""

import numpy as np
from numpy.typing import ArrayLike

from opir_core.geometry.vectors import Floats

#: The Julian date of 1970-01-01T00:00:00.
UNIX_EPOCH_JULIAN_DATE = 2440587.5

#: The Julian date of J2000.0, 2000-01-01T12:00:00.
J2000_JULIAN_DATE = 2451545.0

_SECONDS_PER_DAY = 86400.0


def julian_date(epoch: ArrayLike | np.datetime64, time_s: ArrayLike = 0.0) -> Floats:
    """Return the Julian date of `time_s` seconds after an epoch (`numpy.datetime64`, UTC)."""
    day, second = _day_and_second(epoch, time_s)
    return day + UNIX_EPOCH_JULIAN_DATE + second / _SECONDS_PER_DAY


def gmst_rad(epoch: ArrayLike | np.datetime64, time_s: ArrayLike = 0.0) -> Floats:
    """Return Greenwich mean sidereal time (IAU 1982), rad, in [0, 2 pi)."""
    day, second = _day_and_second(epoch, time_s)
    centuries = (day + UNIX_EPOCH_JULIAN_DATE - J2000_JULIAN_DATE + second / _SECONDS_PER_DAY) / 36525.0
    seconds = (
        67310.54841 + second - 43200.0 + 8640184.812866 * centuries + 0.093104 * centuries**2 - 6.2e-6 * centuries**3
    )
    return np.mod(seconds * (np.pi / 43200.0), 2.0 * np.pi)


def _day_and_second(epoch: ArrayLike | np.datetime64, time_s: ArrayLike) -> tuple[Floats, Floats]:
    """Return whole days since 1970 and seconds of day, which together lose nothing."""
    instant = np.asarray(epoch, dtype="datetime64[us]")
    midnight = instant.astype("datetime64[D]")
    second = (instant - midnight) / np.timedelta64(1, "s") + np.asarray(time_s, dtype=np.float64)
    return midnight.astype(np.int64).astype(np.float64), second
