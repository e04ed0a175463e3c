"""Launch points of young tracks: their paths followed back, or what the law of boosts says of what
flies already.
"""

from typing import NamedTuple

import numpy as np

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_trackers.filter.estimates import PredictedMeasurements
from opir_trackers.forecast.since_launch import InFlight, launch_of
from opir_trackers.imm.models import TrackingModels
from opir_trackers.imm.state import TrackerState
from opir_trackers.launch_points import (
    LaunchDelayPrior,
    LaunchPoints,
    delays_at_once,
    launches,
    on_ground,
    path_moments,
    updated_points,
)
from opir_trackers.lines_of_sight import SPIN, earth_rotated, emission_s
from opir_trackers.onset.motion_statistics import LAUNCH
from opir_trackers.track_priors import first_motion

#: The launch point is estimated for tracks no older than this, s, or than some scans: of scanners
#: of 10 s, what it is becomes known in them.
_YOUNG_S = 10.0
_YOUNG_SCANS = 3.0

#: A path that is followed back for longer than this, s, from the middle of its lines is compared
#: with ascents instead: no boost is a cubic from rest through its pitch-over. A comparison takes
#: milliseconds: it is made so often, in s.
_CUBIC_S = 10.0
_EVERY_S = 2.0

#: One sensor alone sees neither height nor climb, which ascents are compared by.
_SENSORS = 2


class _Young(NamedTuple):
    """Young tracks: paths, and (n,) times at which the light of first detections was emitted; which
    sensors see each.

    `at_once` (n, times) is the prior of the times to first detections of what is seen from the
    ground, `biased` (n, 3, 3) the covariances of positions due to the sensors' errors, if there are
    any.
    """

    path: PredictedMeasurements
    first_s: FloatArray
    seen: BoolArray
    at_once: FloatArray
    biased: FloatArray | None

    @property
    def middle_s(self) -> FloatArray:
        """Return the times (n,) in the middle of the lines of sight."""
        return 0.5 * (self.first_s + self.path.time_s)

    def take(self, rows: IntArray) -> "_Young":
        """Return some of the tracks."""
        path = self.path._replace(derivative=self.path.derivative[rows], root=self.path.root[rows])
        biased = None if self.biased is None else self.biased[rows]
        return _Young(path, self.first_s[rows], self.seen[rows], self.at_once[rows], biased)


def with_launch_points(models: TrackingModels, now: TrackerState, span_s: float) -> TrackerState:
    """Return the state, after a slice of a length, with the launch points of young tracks."""
    limit_s = np.maximum(_YOUNG_S, _YOUNG_SCANS * models.longest(models.period_s, now.table))
    fresh = now.time_s - now.table.begun_s <= limit_s
    if not np.count_nonzero(fresh):
        return now
    rows = np.flatnonzero(fresh & (now.estimates.weight[:, 0] > 0.5))
    if not len(rows):
        return now
    young = _young(models, now, rows)
    points = _followed_back(models, young)
    is_launch = now.motion.probability[rows, LAUNCH] >= models.config.least_launch_probability
    is_far = ~(young.middle_s - points.place[:, 2] <= _CUBIC_S)
    far = np.flatnonzero(is_far & is_launch & (young.seen.sum(axis=1) >= _SENSORS))
    if len(far):
        # Between two comparisons the last one stays.
        found = LaunchPoints.nowhere(len(far))
        due = _due(models, now, rows[far], span_s).nonzero()[0]
        cubic = LaunchPoints(points.place[far[due]], points.covariance[far[due]])
        found.place[due], found.covariance[due] = updated_points(
            cubic, _by_ascents(models, young.take(far[due]))
        )
        points.place[far], points.covariance[far] = found
    points.covariance[:, 2, 2] += models.config.clock_sigma_s**2
    known = LaunchPoints(now.table.launch[rows], now.table.launch_covariance[rows])
    launch = now.table.launch.copy()
    covariance = now.table.launch_covariance.copy()
    launch[rows], covariance[rows] = updated_points(known, points)
    return now.after(now.time_s, now.estimates, now.table.with_launches(launch, covariance))


def _due(models: TrackingModels, now: TrackerState, rows: IntArray, span_s: float) -> BoolArray:
    """Return which tracks (n,) are compared with ascents after a slice: those seen in it, every
    `_EVERY_S` at most.
    """
    table = now.table.take(rows)
    is_time = now.time_s // _EVERY_S > (now.time_s - span_s) // _EVERY_S
    is_slow = models.longest(models.period_s, table) >= _EVERY_S
    return np.asarray((now.time_s - table.seen_s < span_s) & (is_slow | is_time))


def _young(models: TrackingModels, now: TrackerState, rows: IntArray) -> _Young:
    table = now.table.part(rows)
    estimates = now.estimates.part(rows)
    seen = table.reports >= 0
    shared = models.shared_covariance(now, estimates, table)
    range_m = models.biases.ranges_m(estimates.likelier_position_m, now.time_s, seen)
    return _Young(
        path=models.path(estimates, now.time_s),
        first_s=emission_s(table.first_s, range_m, models.light_time),
        seen=seen,
        at_once=delays_at_once(models.period_s, models.association.detection_probability, seen),
        biased=None if shared is None else shared[:, :3, :3],
    )


def _followed_back(models: TrackingModels, young: _Young) -> LaunchPoints:
    """Return the launch points of paths that are followed back to rest on the ground."""
    thrust = models.config.thrust
    inland = models.config.hypotheses.inland_share
    motion = first_motion(young.path, young.first_s, young.seen.sum(axis=1) < _SENSORS, thrust)
    prior = LaunchDelayPrior(young.at_once, motion, inland)
    return launches(young.path, young.first_s, prior, thrust.launch_noise_m_s2, young.biased)


def _by_ascents(models: TrackingModels, young: _Young) -> LaunchPoints:
    """Return the launch points that ascents of the law of boosts say; unknown where none is like
    the track.
    """
    when_s = young.middle_s
    inland = models.config.hypotheses.inland_share
    if not len(when_s):
        return LaunchPoints.nowhere(0)
    place, velocity, covariance = path_moments(
        young.path, when_s, models.config.thrust.launch_noise_m_s2, young.biased
    )
    points = LaunchPoints.nowhere(len(when_s))
    for row, time_s in enumerate(when_s.tolist()):
        turn = earth_rotated(np.eye(3), np.full(3, -time_s)).T
        over_ground = np.block([[turn, np.zeros((3, 3))], [-turn @ SPIN, turn]])
        state = over_ground @ np.concatenate([place[:, row], velocity[:, row]])
        spread = over_ground @ covariance[:, :, row] @ over_ground.T
        since_s = time_s - float(young.first_s[row])
        found = launch_of(
            models.single.ascents, InFlight(state, spread, since_s, young.at_once[row], inland)
        )
        if found is not None:
            mean, spread = found
            # The time of launch falls as that since then grows.
            mean[3] = time_s - mean[3]
            back = np.diag([1.0, 1.0, 1.0, -1.0])
            points.place[row : row + 1], points.covariance[row : row + 1] = on_ground(
                mean[None], (back @ spread @ back)[None]
            )
    return points
