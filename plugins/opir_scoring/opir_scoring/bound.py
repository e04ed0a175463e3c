"""Cramér–Rao bounds of a target's state from the looks that detected it.

`state_bound` assumes a known motion, two-body gravity and the true thrust; a filter that does not
know the thrust cannot reach it. `free_bound` assumes an unknown thrust: specific force and jerk are
part of the state, and the jerk is a random walk. A tracker below it used more than directions, as a
launch site or a profile. Constant sensor biases are part of the state of both.
"""

from typing import NamedTuple

import numpy as np
from opir_estimation import BOOST, Motion, tangent_axes, taylor_weights
from opir_estimation.square_root import covariance, time_update, triangular

from opir_core.arrays import FloatArray
from opir_core.constants import EARTH_MU_M3_S2
from opir_core.flight import Forces
from opir_core.geometry import ecef_to_eci

#: Prior standard deviations before the first look, m and m/s, which keep the information
#: invertible.
PRIOR_SIGMA = (1e6, 1e6, 1e6, 1e4, 1e4, 1e4)

#: Process-noise density of the jerk where the thrust is unknown, m/s³/√s (notional), and the prior
#: standard deviations of specific force and jerk, m/s² and m/s³.
JERK_NOISE_M_S3 = 0.3
FREE_PRIOR_SIGMA = (*PRIOR_SIGMA, 1e2, 1e2, 1e2, 1e1, 1e1, 1e1)


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
    looks = _InertialLooks.of(detected)
    information = np.diag(1.0 / np.square([*PRIOR_SIGMA, *[1.0] * looks.biases]))
    time_s = float(looks.time_s[0])
    row = 0
    for number, tick in enumerate(tick_s.tolist()):
        if tick < looks.time_s[0]:
            continue
        # The gravity gradient is constant over a second.
        for end_s in _steps(time_s, tick, 1.0):
            rows = looks.until(row, end_s)
            place_m = looks.place_m(row)
            back = _widened(_transitions(place_m, np.array([time_s - end_s]))[0], looks.biases)
            transitions = _transitions(place_m, looks.time_s[rows] - end_s)[:, :3]
            jacobian = looks.with_biases(looks.slope[rows] @ transitions, rows)
            information = back.T @ information @ back + jacobian.T @ jacobian
            time_s = end_s
            row = rows.stop
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
    looks = _InertialLooks.of(detected)
    motion = Motion(BOOST, JERK_NOISE_M_S3, Forces(zonal=()))
    root: FloatArray = np.diag(1.0 / np.array([*FREE_PRIOR_SIGMA, *[1.0] * looks.biases]))[None]
    time_s = float(looks.time_s[0])
    row = 0
    for number, tick in enumerate(tick_s.tolist()):
        if tick < looks.time_s[0]:
            continue
        for end_s in _steps(time_s, tick, 0.5):
            step_s = np.array([end_s - time_s])
            rows = looks.until(row, end_s)
            transition = motion.transition(looks.place_m(row)[None], -step_s)[0]
            noise = motion.noise_root(step_s)
            if noise is not None:
                noise = np.pad(noise, ((0, 0), (0, looks.biases), (0, 0)))
            weight = taylor_weights(looks.time_s[rows] - end_s)[:, None, :4, None]
            slope = (looks.slope[rows, :, None, :] * weight).reshape(-1, 2, BOOST)
            jacobian = looks.with_biases(slope, rows)
            predicted = time_update(root, _widened(transition, looks.biases)[None], noise)[0]
            root = triangular(np.concatenate([predicted, jacobian])[None])
            time_s = end_s
            row = rows.stop
        bounds[number] = covariance(root)[0, :6, :6]
    return bounds


class _InertialLooks(NamedTuple):
    """Looks in the inertial frame: target positions (n, 3) and whitened Jacobians of the
    directions.

    `slope` (n, 2, 3), 1/m, is by the position, `bias_slope` (n, 2, p) by the biases.
    """

    time_s: FloatArray
    target_m: FloatArray
    slope: FloatArray
    bias_slope: FloatArray

    @classmethod
    def of(cls, detected: DetectedLooks) -> "_InertialLooks":
        look_s = detected.look_s
        target_m = ecef_to_eci(detected.target_ecef_m, look_s)
        line_m = target_m - ecef_to_eci(detected.sensor_ecef_m, look_s)
        # The whitened Jacobians (n, 2, 3), 1/m, of directions along lines (n, 3) by the position.
        range_m = np.linalg.norm(line_m, axis=1)
        axes = tangent_axes(line_m / range_m[:, None])[:, :2]
        slope = axes / (range_m * detected.sigma_rad)[:, None, None]
        # A turn moves the direction, and so the point at the target's distance, across the line.
        shape = detected.turn_ecef_rad.shape
        turns = detected.turn_ecef_rad.reshape(-1, 3)
        turn = ecef_to_eci(turns, np.repeat(look_s, shape[1])).reshape(shape)
        shift = np.cross(turn, line_m[:, None])
        return cls(look_s, target_m, slope, slope @ shift.mT)

    @property
    def biases(self) -> int:
        return int(self.bias_slope.shape[2])

    def place_m(self, row: int) -> FloatArray:
        """Return the target position (3,) about the time of a look."""
        return self.target_m[min(row, len(self.target_m) - 1)]

    def until(self, row: int, end_s: float) -> slice:
        """Return the rows from one on up to a time."""
        return slice(row, int(np.searchsorted(self.time_s, end_s, side="right")))

    def with_biases(self, slope: FloatArray, rows: slice) -> FloatArray:
        """Return the Jacobians (2n, d + p) of rows by a state of d components and the biases."""
        jacobian = np.concatenate([slope, self.bias_slope[rows]], axis=2)
        return jacobian.reshape(-1, jacobian.shape[2])


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
    bend = 0.5 * span**2 * gradient
    transition = np.zeros((len(span_s), 6, 6))
    transition[:, :3, :3] = np.eye(3) + bend
    transition[:, 3:, 3:] = np.eye(3) + bend
    transition[:, :3, 3:] = span * (np.eye(3) + bend / 3.0)
    transition[:, 3:, :3] = span * gradient
    return transition


def position_and_velocity(bounds: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the root mean square errors of position, m, and velocity, m/s, of covariances (n, 6,
    6).
    """
    variance = np.diagonal(bounds, axis1=1, axis2=2)
    return np.sqrt(variance[:, :3].sum(axis=1)), np.sqrt(variance[:, 3:].sum(axis=1))
