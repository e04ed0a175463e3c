"""Cramér–Rao bounds of a target's state: what the looks that detected could tell at best.

`state_bound` takes the motion as known up to the state: two-body gravity and the true thrust. A filter that does not
know the thrust cannot reach it. `free_bound` takes the thrust as unknown: specific force and jerk are part of the
state, and the jerk wanders. A tracker below it had more to go by than directions: a pad to start from, a profile.
"""

import numpy as np
from numpy.typing import NDArray

from opir_core.constants import EARTH_MU_M3_S2
from opir_core.flight.forces import Forces
from opir_core.geometry import ecef_to_eci
from opir_core.records import FloatArray
from opir_core.tracking.filter.motion import BOOST, Motion, weights_at
from opir_core.tracking.filter.square_root import covariance, moved, triangular
from opir_core.tracking.rays import axes_across

#: Before the first look a state is known this poorly: m, m/s. It keeps the information invertible.
PRIOR_SIGMA = (1e6, 1e6, 1e6, 1e4, 1e4, 1e4)

#: How fast the jerk wanders where the thrust is not known, m/s³/√s (the stereo filter's boost model `jerk`;
#: notional), and how poorly specific force and jerk are known before the first look, m/s² and m/s³.
JERK_NOISE_M_S3 = 0.3
FREE_PRIOR_SIGMA = (*PRIOR_SIGMA, 1e2, 1e2, 1e2, 1e1, 1e1, 1e1)

#: Looks are taken in, and the jerk wanders, in slices no longer than this, s.
_SLICE_S = 0.5

#: The longest step over which the gravity gradient counts as constant, s.
_STEP_S = 1.0


def state_bound(
    tick_s: FloatArray,
    look_s: FloatArray,
    target_ecef_m: FloatArray,
    sensor_ecef_m: FloatArray,
    sigma_rad: FloatArray,
) -> FloatArray:
    """Return the bound's covariances (ticks, 6, 6) of inertial position and velocity at ticks.

    `look_s` (n,), in order, are the times of the looks that detected, `target_ecef_m` and `sensor_ecef_m` (n, 3) where
    target and sensor then stood, `sigma_rad` (n,) the standard deviation of each direction, per axis. Source:
    Tichavský, Muravchik and Nehorai, IEEE Trans. Signal Processing 46 (1998), 1386, without process noise.
    """
    information = np.diag(1.0 / np.square(PRIOR_SIGMA))
    target, sensor = (ecef_to_eci(position, look_s) for position in (target_ecef_m, sensor_ecef_m))
    told = _directions(target - sensor, sigma_rad)
    bounds = np.full((len(tick_s), 6, 6), np.nan)
    now, row = (look_s[0] if len(look_s) else np.inf), 0
    for number, tick in enumerate(tick_s.tolist()):
        while row < len(look_s) and look_s[row] <= tick:
            information = _carried(information, target[row], look_s[row] - now)
            information[:3, :3] += told[row]
            now, row = look_s[row], row + 1
        if row:
            information = _carried(information, target[row - 1], tick - now)
            now = tick
            bounds[number] = np.linalg.inv(information)
    return bounds


def free_bound(
    tick_s: FloatArray,
    look_s: FloatArray,
    target_ecef_m: FloatArray,
    sensor_ecef_m: FloatArray,
    sigma_rad: FloatArray,
) -> FloatArray:
    """Return the bound's covariances (ticks, 6, 6) at ticks where the thrust is not known; arguments as above.

    The posterior bound of Tichavský, Muravchik and Nehorai for a specific force whose rate is a random walk.
    """
    bounds = np.full((len(tick_s), 6, 6), np.nan)
    if not len(look_s):
        return bounds
    motion = Motion(BOOST, JERK_NOISE_M_S3, Forces(zonal=()))
    target, sensor = (ecef_to_eci(position, look_s) for position in (target_ecef_m, sensor_ecef_m))
    slopes = _slopes(target - sensor, sigma_rad)
    root = np.diag(1.0 / np.array(FREE_PRIOR_SIGMA))[None]
    now, row = float(look_s[0]), 0
    for number, tick in enumerate(tick_s.tolist()):
        if tick < look_s[0]:
            continue
        for end in np.linspace(now, tick, 1 + max(1, int(np.ceil((tick - now) / _SLICE_S))))[1:].tolist():
            step = np.array([end - now])
            root = moved(root, motion.transition(target[[min(row, len(target) - 1)]], -step), motion.noise_root(step))
            last = int(np.searchsorted(look_s, end, side="right"))
            gained = slopes[row:last, :, None, :] * weights_at(look_s[row:last] - end)[:, None, :4, None]
            root = triangular(np.concatenate([root[0], gained.reshape(-1, BOOST)])[None])
            now, row = end, last
        bounds[number] = covariance(root)[0, :6, :6]
    return bounds


def _slopes(line_m: FloatArray, sigma_rad: FloatArray) -> FloatArray:
    """Return how directions along lines (n, 3) change with the position, in standard deviations a metre, (n, 2, 3)."""
    range_m = np.linalg.norm(line_m, axis=1)
    across: FloatArray = axes_across(line_m / range_m[:, None])[:, :2] / (range_m * sigma_rad)[:, None, None]
    return across


def _directions(line_m: FloatArray, sigma_rad: FloatArray) -> FloatArray:
    """Return the information (n, 3, 3) on position that directions along lines (n, 3) give."""
    range_m = np.linalg.norm(line_m, axis=1)
    unit = line_m / range_m[:, None]
    across = np.eye(3) - unit[:, :, None] * unit[:, None, :]
    informed: FloatArray = across / np.square(range_m * sigma_rad)[:, None, None]
    return informed


def _carried(information: FloatArray, position_m: FloatArray, span_s: float) -> FloatArray:
    """Return the information a span of time later, near a position, in steps in which the gradient is constant."""
    steps = max(1, int(np.ceil(span_s / _STEP_S)))
    back = np.linalg.matrix_power(_transition(position_m, -span_s / steps), steps)
    moved: FloatArray = back.T @ information @ back
    return 0.5 * (moved + moved.T)


def _transition(position_m: FloatArray, span_s: float) -> NDArray[np.float64]:
    """Return how small differences of state grow over a short span under two-body gravity: second order in time."""
    radius = np.linalg.norm(position_m)
    unit = position_m / radius
    gradient = EARTH_MU_M3_S2 / radius**3 * (3.0 * np.outer(unit, unit) - np.eye(3))
    rate = np.zeros((6, 6))
    rate[:3, 3:], rate[3:, :3] = np.eye(3), gradient
    return np.asarray(np.eye(6) + rate * span_s + rate @ rate * (0.5 * span_s**2))


def position_and_velocity(bounds: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the root mean square errors of position, m, and velocity, m/s, that covariances (n, 6, 6) stand for."""
    variance = np.diagonal(bounds, axis1=1, axis2=2)
    return np.sqrt(variance[:, :3].sum(axis=1)), np.sqrt(variance[:, 3:].sum(axis=1))
