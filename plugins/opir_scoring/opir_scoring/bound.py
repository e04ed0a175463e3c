"""Cramér–Rao bounds of a target's state from the looks that detected it.

`state_bound` assumes a known motion, two-body gravity and the true thrust; a filter that does not
know the thrust cannot reach it. `free_bound` assumes an unknown thrust: specific force and jerk are
part of the state, and the jerk is a random walk. A tracker below it used more than directions, as a
launch site or a profile. Constant sensor biases are part of the state of both.
"""

from typing import NamedTuple

import numpy as np

from opir_core.arrays import FloatArray
from opir_core.constants import EARTH_MU_M3_S2
from opir_core.estimation import BOOST, Motion, tangent_axes, taylor_weights
from opir_core.estimation.square_root import covariance, time_update, triangular
from opir_core.flight import Forces
from opir_core.geometry import ecef_to_eci

#: Prior standard deviations before the first look, m and m/s, which keep the information
#: invertible.
PRIOR_SIGMA = (1e6, 1e6, 1e6, 1e4, 1e4, 1e4)

#: Process-noise density of the jerk where the thrust is unknown, m/s³/√s (notional), and the prior
#: standard deviations of specific force and jerk, m/s² and m/s³.
JERK_NOISE_M_S3 = 0.3
FREE_PRIOR_SIGMA = (*PRIOR_SIGMA, 1e2, 1e2, 1e2, 1e1, 1e1, 1e1)

#: Longest step of the bound with unknown thrust, s.
_SLICE_S = 0.5

#: Longest step with known thrust, s, over which the gravity gradient is constant.
_STEP_S = 1.0


class DetectedLooks(NamedTuple):
    """Looks (n,) that detected a target, in order of time.

    `target_ecef_m` and `sensor_ecef_m` (n, 3) are the positions then, `sigma_rad` (n,) the standard
    deviation of each direction, per axis. `turn_ecef_rad` (n, p, 3) are the rotations of each
    look's sensor by one standard deviation of each of p biases, 0 for those of other sensors.
    """

    look_s: FloatArray
    target_ecef_m: FloatArray
    sensor_ecef_m: FloatArray
    sigma_rad: FloatArray
    turn_ecef_rad: FloatArray

    @classmethod
    def unbiased(
        cls,
        look_s: FloatArray,
        target_ecef_m: FloatArray,
        sensor_ecef_m: FloatArray,
        sigma_rad: FloatArray,
    ) -> "DetectedLooks":
        """Return looks of sensors without biases."""
        return cls(look_s, target_ecef_m, sensor_ecef_m, sigma_rad, np.zeros((len(look_s), 0, 3)))


def state_bound(tick_s: FloatArray, detected: DetectedLooks) -> FloatArray:
    """Return the bound's covariances (ticks, 6, 6) of inertial position and velocity at ticks.

    Source: Tichavský, Muravchik and Nehorai, IEEE Trans. Signal Processing 46 (1998), 1386, without
    process noise; biases are constant parts of the state, of unit variance.
    """
    bounds = np.full((len(tick_s), 6, 6), np.nan)
    if not len(detected.look_s):
        return bounds
    looks = _Looks.of(detected)
    information = np.diag(1.0 / np.square([*PRIOR_SIGMA, *[1.0] * looks.biases]))
    now = float(looks.time_s[0])
    row = 0
    for number, tick in enumerate(tick_s.tolist()):
        if tick < looks.time_s[0]:
            continue
        for end in _steps(now, tick, _STEP_S):
            near = looks.near(row)
            last = int(np.searchsorted(looks.time_s, end, side="right"))
            back = _widened(_transitions(near, np.array([now - end]))[0], looks.biases)
            rows_ = looks.slope[row:last] @ _transitions(near, looks.time_s[row:last] - end)[:, :3]
            rows_ = np.concatenate([rows_, looks.bias_slope[row:last]], axis=2).reshape(
                -1, len(information)
            )
            information = back.T @ information @ back + rows_.T @ rows_
            now = end
            row = last
        bounds[number] = np.linalg.inv(0.5 * (information + information.T))[:6, :6]
    return bounds


def free_bound(tick_s: FloatArray, detected: DetectedLooks) -> FloatArray:
    """Return the bound's covariances (ticks, 6, 6) at ticks for unknown thrust.

    The posterior bound of Tichavský, Muravchik and Nehorai for a specific force whose rate is a
    random walk; biases are constant parts of the state, of unit variance.
    """
    bounds = np.full((len(tick_s), 6, 6), np.nan)
    if not len(detected.look_s):
        return bounds
    looks = _Looks.of(detected)
    motion = Motion(BOOST, JERK_NOISE_M_S3, Forces(zonal=()))
    root: FloatArray = np.diag(1.0 / np.array([*FREE_PRIOR_SIGMA, *[1.0] * looks.biases]))[None]
    now = float(looks.time_s[0])
    row = 0
    for number, tick in enumerate(tick_s.tolist()):
        if tick < looks.time_s[0]:
            continue
        for end in _steps(now, tick, _SLICE_S):
            step = np.array([end - now])
            last = int(np.searchsorted(looks.time_s, end, side="right"))
            back = _widened(motion.transition(looks.near(row)[None], -step)[0], looks.biases)
            noise = motion.noise_root(step)
            wide = None if noise is None else np.pad(noise, ((0, 0), (0, looks.biases), (0, 0)))
            weight = taylor_weights(looks.time_s[row:last] - end)[:, None, :4, None]
            rows_ = (looks.slope[row:last, :, None, :] * weight).reshape(last - row, 2, BOOST)
            rows = np.concatenate([rows_, looks.bias_slope[row:last]], axis=2).reshape(
                -1, root.shape[1]
            )
            root = triangular(np.concatenate([time_update(root, back[None], wide)[0], rows])[None])
            now = end
            row = last
        bounds[number] = covariance(root)[0, :6, :6]
    return bounds


class _Looks(NamedTuple):
    """Looks in the inertial frame: target positions (n, 3) and whitened Jacobians of the
    directions.

    `slope` (n, 2, 3), 1/m, is by the position, `bias_slope` (n, 2, p) by the biases.
    """

    time_s: FloatArray
    target_m: FloatArray
    slope: FloatArray
    bias_slope: FloatArray

    @classmethod
    def of(cls, detected: DetectedLooks) -> "_Looks":
        target, sensor = (
            ecef_to_eci(place, detected.look_s)
            for place in (detected.target_ecef_m, detected.sensor_ecef_m)
        )
        line_m = target - sensor
        # The whitened Jacobians (n, 2, 3), 1/m, of directions along lines (n, 3) by the position.
        range_m = np.linalg.norm(line_m, axis=1)
        slope = (
            tangent_axes(line_m / range_m[:, None])[:, :2]
            / (range_m * detected.sigma_rad)[:, None, None]
        )
        # A turn moves the direction, and so what is a metre off at the target's distance, across
        # the line.
        count, biases, _ = detected.turn_ecef_rad.shape
        turn = ecef_to_eci(
            detected.turn_ecef_rad.reshape(-1, 3), np.repeat(detected.look_s, biases)
        ).reshape(count, biases, 3)
        shift = np.cross(turn, (target - sensor)[:, None])
        return cls(detected.look_s, target, slope, slope @ shift.transpose(0, 2, 1))

    @property
    def biases(self) -> int:
        return int(self.bias_slope.shape[2])

    def near(self, row: int) -> FloatArray:
        """Return the target position (3,) about the time of a look."""
        return self.target_m[min(row, len(self.target_m) - 1)]


def _steps(start_s: float, end_s: float, longest_s: float) -> list[float]:
    """Return the ends of equal steps from one time to another."""
    count = max(1, int(np.ceil((end_s - start_s) / longest_s)))
    return np.linspace(start_s, end_s, count + 1)[1:].tolist()


def _widened(transition: FloatArray, biases: int) -> FloatArray:
    """Return a transition (d, d) extended by constant biases."""
    size = len(transition)
    wide = np.eye(size + biases)
    wide[:size, :size] = transition
    return wide


def _transitions(position_m: FloatArray, span_s: FloatArray) -> FloatArray:
    """Return transition matrices (n, 6, 6) of short spans (n,) under two-body gravity near a
    position (3,).

    To second order in time, their effect on the position to third.
    """
    radius = np.linalg.norm(position_m)
    unit = position_m / radius
    gradient = EARTH_MU_M3_S2 / radius**3 * (3.0 * np.outer(unit, unit) - np.eye(3))
    span = span_s[:, None, None]
    bent = 0.5 * span_s[:, None, None] ** 2 * gradient
    grown = np.zeros((len(span_s), 6, 6))
    grown[:, :3, :3] = grown[:, 3:, 3:] = np.eye(3) + bent
    grown[:, :3, 3:] = span * (np.eye(3) + bent / 3.0)
    grown[:, 3:, :3] = span * gradient
    return grown


def position_and_velocity(bounds: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the root mean square errors of position, m, and velocity, m/s, of covariances (n, 6,
    6).
    """
    variance = np.diagonal(bounds, axis1=1, axis2=2)
    return np.sqrt(variance[:, :3].sum(axis=1)), np.sqrt(variance[:, 3:].sum(axis=1))
