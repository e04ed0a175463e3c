"""Speeds of telemetry against its altitudes: the unit in which a lift-off climbs as fast as it
flies, and a coast keeps its energy.
"""

import numpy as np

from opir_core.arrays import FloatArray
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_MU_M3_S2, EARTH_ROTATION_RAD_S
from opir_readers.interpolation import rows_apart

#: Units of speed that telemetry is published in, m/s, and how one goes to m/s.
SPEED_UNITS = {"km/h": 1.0 / 3.6, "mph": 0.44704, "ft/s": 0.3048, "knots": 1852.0 / 3600.0}

#: Coasts are looked for above this height, m, where drag is a thousandth of gravity, over steps of this, s: speeds
#: rounded to 1 m/s leave 0.1 m/s² of acceleration along the path.
AIRLESS_M = 60_000.0
STEP_S = 5.0

#: Launches climb nearly straight up to this height, m: their path is at most so many times
#: as long. Of a longer one the unit is doubted from here on.
VERTICAL_M = 3000.0
MOST_SLANT = 1.25
LEAST_DOUBTED = 1.6

#: Speeds with the Earth's rotation begin above this, m/s, but near the poles.
PAD_SPEED_M_S = 150.0

#: A coast: the acceleration along the path is gravity's to this, m/s², in so many steps and this share of all.
TOLERANCE_M_S2 = 0.3
MIN_STEPS = 5
MIN_SHARE = 0.1


def misread_speeds(time_s: FloatArray, speed_m_s: FloatArray, height_m: FloatArray) -> str:
    """Return in which unit speeds over the ground (n,) seem to be, with the figures and the remedy; "" where they are
    right, or no coast shows it.
    """
    rows = np.flatnonzero(np.isfinite(speed_m_s) & np.isfinite(height_m))
    rows = rows[rows_apart(time_s[rows], STEP_S)]
    flight = time_s[rows], speed_m_s[rows], height_m[rows]
    given = _coasting_share(*flight, 1.0)
    if given >= MIN_SHARE:
        return ""
    shares = {unit: _coasting_share(*flight, factor) for unit, factor in SPEED_UNITS.items()}
    unit = max(shares, key=lambda each: shares[each])
    if (
        shares[unit] < MIN_SHARE
        or shares[unit] * (len(rows) - 1) < MIN_STEPS
        or given > 0.25 * shares[unit]
    ):
        return _lift_off_complaint(_path_over_climb(*flight), speed_m_s[rows[0]])
    return (
        f"read with speeds in {unit}, {100.0 * shares[unit]:.0f} % of the flight is a coast that keeps"
        f" its energy; as given {100.0 * given:.0f} %; multiply them by {SPEED_UNITS[unit]:.6g}"
    )


def _coasting_share(
    time_s: FloatArray, speed: FloatArray, height_m: FloatArray, factor: float
) -> float:
    """Return the share of steps in which energy over the turning Earth is kept, with speeds times a factor."""
    speed_m_s = factor * speed
    radius_m = EARTH_EQUATORIAL_RADIUS_M + height_m
    turning = EARTH_ROTATION_RAD_S * radius_m
    energy = 0.5 * speed_m_s**2 - EARTH_MU_M3_S2 / radius_m - 0.5 * turning**2
    mean_m_s = 0.5 * (speed_m_s[:-1] + speed_m_s[1:])
    push = np.diff(energy) / np.diff(time_s) / np.maximum(mean_m_s, 1.0)
    is_coast = (
        (height_m[:-1] > AIRLESS_M)
        & (np.abs(push) < TOLERANCE_M_S2)
        & (np.abs(np.diff(height_m)) > 100.0)
    )
    return float(np.count_nonzero(is_coast)) / max(len(push), 1)


def _path_over_climb(time_s: FloatArray, speed_m_s: FloatArray, height_m: FloatArray) -> float:
    """Return the length of the path from lift-off to `VERTICAL_M` over that height, nan where a
    flight has no lift-off.
    """
    if height_m[0] > 0.1 * VERTICAL_M or height_m.max() < VERTICAL_M:
        return float("nan")
    last = int(np.argmax(height_m >= VERTICAL_M))
    steps_m = 0.5 * (speed_m_s[1:] + speed_m_s[:-1]) * np.diff(time_s)
    return float(np.add.reduce(steps_m[:last]) / (height_m[last] - height_m[0]))


def _lift_off_complaint(ratio: float, first_m_s: float) -> str:
    """Return what the ratio of a path to its climb says of speeds, "" for nothing."""
    if not ratio > LEAST_DOUBTED:
        return ""
    units = [unit for unit, factor in SPEED_UNITS.items() if 0.95 < ratio * factor < MOST_SLANT]
    if not units:
        return ""
    reason = f"its speeds are {ratio:.2g} times its climb to {VERTICAL_M / 1e3:g} km"
    if first_m_s > PAD_SPEED_M_S:
        return (
            f"{reason}, and {first_m_s:.0f} m/s on the pad: do they contain the Earth's rotation?"
            " give speeds over the ground, in m/s"
        )
    return f"{reason}: are they in {' or '.join(units)}? give them in m/s"
