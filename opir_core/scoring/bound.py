"""Cramér–Rao bounds of a target's state: what the looks that detected could tell at best.

`state_bound` takes the motion as known up to the state: two-body gravity and the true thrust. A filter that does not
know the thrust cannot reach it. `free_bound` takes the thrust as unknown: specific force and jerk are part of the
state, and the jerk wanders. A tracker below it had more to go by than directions: a pad to start from, a profile.
"""

import numpy as np

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

#: With the thrust known they are in steps no longer than this, s, over which the gravity gradient counts as constant.
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
    bounds = np.full((len(tick_s), 6, 6), np.nan)
    if not len(look_s):
        return bounds
    information = np.diag(1.0 / np.square(PRIOR_SIGMA))
    target, sensor = (ecef_to_eci(position, look_s) for position in (target_ecef_m, sensor_ecef_m))
    slopes = _slopes(target - sensor, sigma_rad)
    now, row = float(look_s[0]), 0
    for number, tick in enumerate(tick_s.tolist()):
        if tick < look_s[0]:
            continue
        for end in np.linspace(now, tick, 1 + max(1, int(np.ceil((tick - now) / _STEP_S))))[1:].tolist():
            near = target[min(row, len(target) - 1)]
            back = _transitions(near, np.array([now - end]))[0]
            last = int(np.searchsorted(look_s, end, side="right"))
            gained = (slopes[row:last] @ _transitions(near, look_s[row:last] - end)[:, :3]).reshape(-1, 6)
            information = back.T @ information @ back + gained.T @ gained
            now, row = end, last
        bounds[number] = np.linalg.inv(0.5 * (information + information.T))
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


def _transitions(position_m: FloatArray, span_s: FloatArray) -> FloatArray:
    """Return how small differences of state grow over short spans (n,) under two-body gravity near a position (3,).

    (n, 6, 6), to second order in time, and their effect on the position to third.
    """
    radius = np.linalg.norm(position_m)
    unit = position_m / radius
    gradient = EARTH_MU_M3_S2 / radius**3 * (3.0 * np.outer(unit, unit) - np.eye(3))
    span, bent = span_s[:, None, None], 0.5 * span_s[:, None, None] ** 2 * gradient
    grown = np.zeros((len(span_s), 6, 6))
    grown[:, :3, :3] = grown[:, 3:, 3:] = np.eye(3) + bent
    grown[:, :3, 3:] = span * (np.eye(3) + bent / 3.0)
    grown[:, 3:, :3] = span * gradient
    return grown


def position_and_velocity(bounds: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the root mean square errors of position, m, and velocity, m/s, that covariances (n, 6, 6) stand for."""
    variance = np.diagonal(bounds, axis1=1, axis2=2)
    return np.sqrt(variance[:, :3].sum(axis=1)), np.sqrt(variance[:, 3:].sum(axis=1))
