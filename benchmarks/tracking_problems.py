"""The problems of tracking.py: targets in free flight seen by two geostationary sensors, as columns
of rays.
"""

from typing import NamedTuple

import numpy as np
from opir_trackers.filter.estimates import ModeEstimates
from opir_trackers.filter.switching import ImmFilter
from opir_trackers.lines_of_sight import AngleMeasurements, LinesOfSight, earth_rotated

from opir_core.estimation import square_root, tangent_axes
from opir_core.estimation.motion import BOOST, COAST, Motion, taylor_positions, taylor_weights
from opir_core.flight.forces import Forces
from opir_core.flight.kepler import propagate_kepler
from opir_core.geometry import ecef_to_eci, eci_to_ecef

KEPLER = Forces(zonal=())
SIGMA_RAD = 2e-5
RATE_HZ = 10
CHANCE = 0.9
CLUTTER = 20
PRIOR_M = 1000.0
PRIOR_M_S = 50.0
SENSORS_M = 42164e3 * np.array([[np.cos(a), np.sin(a), 0.0] for a in np.radians([10.0, 100.0])])


class Problem(NamedTuple):
    """Rays in order of time, whose each is (-1 for clutter), the true states at time 0 and the
    noisy prior means.
    """

    rays: LinesOfSight
    target: np.ndarray
    start: np.ndarray
    prior: np.ndarray
    seconds: int

    def truth(self, time_s: float) -> np.ndarray:
        """Return the true states (n, 6) at a time, inertial."""
        when = np.full(len(self.start), time_s)
        return np.concatenate(propagate_kepler(self.start[:, :3], self.start[:, 3:], when), axis=1)


def problem(
    targets: int, seconds: int, seed: int, half_width_m: float, chance: float, clutter: int
) -> Problem:
    """Return targets about one place, in a square of twice the half width, on like paths."""
    rng = np.random.default_rng(seed)
    latitude, longitude = np.radians([35.0, 55.0])
    up = np.array(
        [
            np.cos(latitude) * np.cos(longitude),
            np.cos(latitude) * np.sin(longitude),
            np.sin(latitude),
        ]
    )
    east = np.array([-np.sin(longitude), np.cos(longitude), 0.0])
    north = np.cross(up, east)
    place = 6578137.0 * up + rng.uniform(-half_width_m, half_width_m, (targets, 2)) @ np.stack(
        [east, north]
    )
    speed = 3000.0 * up + 4500.0 * north + 30.0 * rng.normal(size=(targets, 3))
    start = np.concatenate([place, speed], axis=1)
    noise = rng.normal(size=start.shape) * np.repeat([PRIOR_M, PRIOR_M_S], 3)
    parts = []
    whose = []
    for look in range(1, seconds * RATE_HZ + 1):
        for sensor in (1, 0):
            time_s = look / RATE_HZ - 0.5 * sensor / RATE_HZ
            seen = np.flatnonzero(rng.random(targets) < chance)
            when = np.full(targets, time_s)
            position = propagate_kepler(start[:, :3], start[:, 3:], when)[0]
            stray = position.mean(axis=0) + 1.5 * rng.uniform(
                -half_width_m, half_width_m, (clutter, 2)
            ) @ np.stack([east, north])
            points = np.concatenate([position[seen], stray])
            parts.append(frame(points, time_s, sensor, look, rng))
            whose.append(np.concatenate([seen, np.full(clutter, -1)]))
    return Problem(
        LinesOfSight.concatenate(parts), np.concatenate(whose), start, start + noise, seconds
    )


def frame(
    points: np.ndarray, time_s: float, sensor: int, look: int, rng: np.random.Generator
) -> LinesOfSight:
    """Return what one sensor measures of points at one time."""
    count = len(points)
    apart = points - ecef_to_eci(SENSORS_M[sensor], time_s)
    axes = tangent_axes(apart / np.linalg.norm(apart, axis=1)[:, None])
    error = SIGMA_RAD * rng.normal(size=(count, 2))
    direction = axes[:, 2] + axes[:, 0] * error[:, :1] + axes[:, 1] * error[:, 1:]
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    return LinesOfSight(
        np.full(count, time_s),
        np.full(count, sensor, dtype=np.int32),
        np.full(count, look),
        np.tile(SENSORS_M[sensor], (count, 1)),
        eci_to_ecef(direction, np.full(count, time_s)),
        np.full(count, SIGMA_RAD),
    )


def coasting_filter(rounds: int = 4) -> ImmFilter:
    """Return a filter of free flight without noise: the problem's own motion."""
    return ImmFilter(Motion(BOOST, 1.0, KEPLER), Motion(COAST, 0.0, KEPLER), np.inf, np.inf, rounds)


def first_bank(prior: np.ndarray, burning: float = 0.0) -> ModeEstimates:
    """Return the bank of noisy priors."""
    count = len(prior)
    sigma = np.repeat([PRIOR_M, PRIOR_M_S, 20.0, 0.5], 3)
    root = np.tile(np.diag(1.0 / sigma), (count, 1, 1))
    mean = np.concatenate([prior, np.zeros((count, 6))], axis=1)
    weight = np.tile([burning, 1.0 - burning], (count, 1))
    return ModeEstimates(
        weight, mean, root, prior.copy(), root[:, :COAST, :COAST].copy(), np.ones((count, 3))
    )


def known_sights(rays: LinesOfSight, track: np.ndarray) -> AngleMeasurements:
    """Return rays as sights of tracks that are known, without light time."""
    origin = earth_rotated(rays.origin_ecef_m, rays.time_s)
    direction = earth_rotated(rays.direction_ecef, rays.time_s)
    whitener = np.eye(2) / rays.sigma_rad[:, None, None]
    return AngleMeasurements(
        track, rays.time_s, origin, tangent_axes(direction), np.zeros((len(rays), 2)), whitener
    )


def bound_m(case: Problem) -> np.ndarray:
    """Return the Cramér-Rao bound (n,) on the position error at the end, all axes together,
    association known.

    Looks are linearised at the truth; the motion is free of noise.
    """
    filter_ = coasting_filter()
    motion = filter_.coast
    root = first_bank(case.prior).coast_root
    for second in range(1, case.seconds + 1):
        state = case.truth(float(second))
        step = np.ones(len(case.start))
        middle = case.truth(second - 0.5)[:, :3]
        root = square_root.time_update(root, motion.transition(middle, -step), None)
        mine = (case.rays.time_s > second - 1) & (case.rays.time_s <= second) & (case.target >= 0)
        sights = known_sights(case.rays.take(mine), case.target[mine])
        weight = taylor_weights(sights.time_s - second)
        _, slope = sights.residuals(taylor_positions(motion.taylor(state)[sights.track], weight))
        rows = (slope[:, :, None, :] * weight[:, None, :2, None]).reshape(-1, 2, COAST)
        gathered = root.transpose(0, 2, 1) @ root
        np.add.at(gathered, sights.track, rows.transpose(0, 2, 1) @ rows)
        root = np.linalg.cholesky(gathered).transpose(0, 2, 1)
    return np.sqrt(np.trace(square_root.covariance(root)[:, :3, :3], axis1=1, axis2=2))
