"""Launch points of young tracks: their paths followed back, or what the law of boosts says of what
flies already.
"""

from typing import NamedTuple

import numpy as np
from attrs import frozen
from opir_estimation import PredictedMeasurements, emission_s
from opir_forecast import (
    BEFORE_S,
    FirstMotion,
    InFlight,
    LaunchDelayPrior,
    LaunchPoints,
    are_in_orbit,
    delays_at_once,
    launch_of,
    launches,
    on_ground,
    path_moments,
    updated_points,
)

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_trackers.imm.models import TrackingModels
from opir_trackers.imm.report import to_earth
from opir_trackers.imm.state import TrackerState
from opir_trackers.onset.motion_statistics import LAUNCH, MotionStatistics
from opir_trackers.track_priors import first_motion


@frozen
class YoungLaw:
    """When launch points are estimated."""

    #: The launch point is estimated for tracks no older than this, s, or than some scans: of
    #: scanners of 10 s, what it is becomes known in them.
    young_s: float = 10.0
    young_scans: float = 3.0

    #: A path that is followed back for longer than this, s, from the middle of its lines is
    #: compared with ascents instead: no boost is a cubic from rest through its pitch-over.
    cubic_s: float = 10.0

    #: Time from one comparison with ascents to the next, s: it takes milliseconds.
    every_s: float = 2.0

    #: One sensor alone sees neither height nor climb, which ascents are compared by.
    sensors: int = 2

    #: Light is under way for less than this, s.
    light_s: float = 0.5


LAW = YoungLaw()

#: Signs of place and time of launch by place and time since launch: the one grows as the other falls.
_LAUNCH_SIGN = np.array([1.0, 1.0, 1.0, -1.0])


class _Young(NamedTuple):
    """Young tracks: paths, motions by few lines, and (n,) times at which the light of first
    detections was emitted; which sensors see each.

    `at_once` (n, times) is the prior of the times to first detections of what is seen from the
    ground, `biased` (n, 3, 3) the covariances of positions due to the sensors' errors, if there are
    any.
    """

    path: PredictedMeasurements
    motion: MotionStatistics
    first_s: FloatArray
    visible: BoolArray
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
        motion = self.motion.take(rows)
        first_s = self.first_s[rows]
        return _Young(path, motion, first_s, self.visible[rows], self.at_once[rows], biased)


def with_launch_points(models: TrackingModels, state: TrackerState, span_s: float) -> TrackerState:
    """Return the state, after a slice of a length, with the launch points of young tracks."""
    table = state.table
    oldest_s = max(LAW.young_s, LAW.young_scans * models.slowest_s)
    # Tracks are in order of their initiation.
    if not table.number.size or state.time_s - table.begun_s[-1] > oldest_s:
        return state
    scans_s = LAW.young_scans * models.longest(models.period_s, table)
    is_young = state.time_s - table.begun_s <= np.maximum(LAW.young_s, scans_s)
    rows = (is_young & (table.estimates.weight[:, 0] > 0.5)).nonzero()[0]
    if not len(rows):
        return state
    points = _new_points(models, state, rows, span_s)
    points.covariance[:, 2, 2] += models.config.clock_sigma_s**2
    earlier = LaunchPoints(table.launch[rows], table.launch_covariance[rows])
    launch = table.launch.copy()
    covariance = table.launch_covariance.copy()
    launch[rows], covariance[rows] = updated_points(earlier, points)
    long_ago = rows[launch[rows, 2] < table.first_s[rows] - BEFORE_S]
    if long_ago.size:
        # An orbit does not tell how long it has lasted: no boost leads back to its launch.
        orbiting = long_ago[are_in_orbit(table.estimates.likelier_state[long_ago])]
        launch[orbiting] = np.nan
        covariance[orbiting] = np.nan
    return state._replace(table=table.changed(launch=launch, launch_covariance=covariance))


def _are_like_ascents(young: _Young, points: LaunchPoints) -> BoolArray:
    """Return which tracks (n,) are too old for a cubic, and seen by enough sensors to be compared
    with ascents.
    """
    is_old = ~(young.middle_s - points.place[:, 2] <= LAW.cubic_s)
    return is_old & (young.visible.sum(axis=1) >= LAW.sensors)


def _new_points(
    models: TrackingModels, state: TrackerState, rows: IntArray, span_s: float
) -> LaunchPoints:
    """Return the launch points of tracks by the slice's estimates, unknown between comparisons with
    ascents.
    """
    young = _young(models, state, rows)
    points = _followed_back(models, young)
    probability = state.table.motion.probability[rows, LAUNCH]
    is_launch = probability >= models.config.least_launch_probability
    old = (is_launch & _are_like_ascents(young, points)).nonzero()[0]
    if not len(old):
        return points
    due = old[_are_due(models, state, rows[old], span_s)]
    cubic = LaunchPoints(points.place[due], points.covariance[due])
    by_ascents = updated_points(cubic, _by_ascents(models, young.take(due)))
    points.place[old] = np.nan
    points.covariance[old] = np.nan
    points.place[due], points.covariance[due] = by_ascents
    return points


def _are_due(
    models: TrackingModels, state: TrackerState, rows: IntArray, span_s: float
) -> BoolArray:
    """Return which tracks (n,) are compared with ascents after a slice: those seen in it, now and
    then.
    """
    table = state.table.take(rows)
    is_time = state.time_s // LAW.every_s > (state.time_s - span_s) // LAW.every_s
    is_slow = models.longest(models.period_s, table) >= LAW.every_s
    return (state.time_s - table.seen_s < span_s) & (is_slow | is_time)


def _young(models: TrackingModels, state: TrackerState, rows: IntArray) -> _Young:
    table = state.table.part(rows)
    estimates = table.estimates
    visible = table.seen
    shared = models.shared_covariance(state, table)
    range_m = models.biases.ranges_m(estimates.likelier_position_m, state.time_s, visible)
    return _Young(
        path=models.path(estimates, state.time_s),
        motion=table.motion,
        first_s=emission_s(table.first_s, range_m, models.light_time),
        visible=visible,
        at_once=delays_at_once(models.unreported, visible),
        biased=None if shared is None else shared[:, :3, :3],
    )


def _first_motion(models: TrackingModels, young: _Young) -> FirstMotion:
    """Return what the filter assumes of tracks at their first detections."""
    alone = young.visible.sum(axis=1) < LAW.sensors
    return first_motion(young.path, young.first_s, alone, models.config.thrust)


def _followed_back(models: TrackingModels, young: _Young) -> LaunchPoints:
    """Return the launch points of paths that are followed back to rest on the ground."""
    thrust = models.config.thrust
    inland = models.config.hypotheses.inland_share
    prior = LaunchDelayPrior(young.at_once, _first_motion(models, young), inland)
    return launches(young.path, young.first_s, prior, thrust.launch_noise_m_s2, young.biased)


def _by_ascents(models: TrackingModels, young: _Young) -> LaunchPoints:
    """Return the launch points that ascents of the law of boosts say; unknown where none is like
    the track.
    """
    when_s = young.middle_s
    points = LaunchPoints.nowhere(len(when_s))
    if not len(when_s):
        return points
    states, covariances = _midway(models, young)
    for row in range(len(when_s)):
        target = InFlight(
            states[row],
            covariances[row],
            float(when_s[row] - young.first_s[row]),
            young.at_once[row],
            models.config.hypotheses.inland_share,
        )
        launch = launch_of(models.single.ascents, target)
        if launch is None:
            continue
        mean, covariance = launch
        mean[3] = when_s[row] - mean[3]
        points.place[row : row + 1], points.covariance[row : row + 1] = on_ground(
            mean[None], (_LAUNCH_SIGN[:, None] * covariance * _LAUNCH_SIGN)[None]
        )
    return points


def _midway(models: TrackingModels, young: _Young) -> tuple[FloatArray, FloatArray]:
    """Return the states (n, 6), relative to the rotating Earth, and covariances (n, 6, 6) of tracks
    in the middle of their lines.

    The filter forgets what it saw half of the time ago; of few lines, the cubic that fits them all
    is better.
    """
    states, covariances = _by_filter(models, young)
    # Statistics that have begun anew lack lines; others begin as the light of the first one arrives.
    is_whole = young.motion.are_few & (young.motion.epoch_s <= young.first_s + LAW.light_s)
    few = is_whole.nonzero()[0]
    if len(few):
        states[few], covariances[few] = _by_cubic(models, young.take(few))
    return states, covariances


def _by_cubic(models: TrackingModels, young: _Young) -> tuple[FloatArray, FloatArray]:
    """Return the states (n, 6) and covariances (n, 6, 6) of `_midway` by cubics of all lines."""
    first = _first_motion(models, young)
    _, _, force, growth = first.sigmas
    since_s = young.middle_s - young.first_s
    ones = np.ones(len(since_s))
    lift = np.array([first.acceleration, force * ones])
    jerk = np.array([first.jerk, growth])[:, None] * ones
    states, covariances = young.motion.moved(since_s, lift, jerk)
    if young.biased is not None:
        covariances[:, :3, :3] += young.biased
    return states, covariances


def _by_filter(models: TrackingModels, young: _Young) -> tuple[FloatArray, FloatArray]:
    """Return the states (n, 6) and covariances (n, 6, 6) of `_midway` by the filter."""
    noise = models.config.thrust.launch_noise_m_s2
    when_s = young.middle_s
    position, velocity, covariance = path_moments(young.path, when_s, noise, young.biased)
    changes = np.array([to_earth(time_s) for time_s in when_s.tolist()])
    states = changes @ np.concatenate([position, velocity]).T[:, :, None]
    spread = covariance.transpose(2, 0, 1)
    return states[:, :, 0], changes @ spread @ changes.mT
