"""The tracker `boost-profile`: association by the stereo filter, estimates by the fit of boost profiles.

Tracks that begin with rays from before they were known: the fit goes through that time as if it had known them.
"""

import numpy as np
from attrs import evolve

from opir_core.arrays import FloatArray, IntArray
from opir_core.estimation.lines_of_sight import LinesOfSight, no_lines_of_sight
from opir_core.interfaces.contexts import TrackerContext
from opir_core.interfaces.protocols import Sensor
from opir_core.interfaces.records import Detections, Tracks
from opir_core.scene.scene import TARGET_TYPES
from opir_trackers.configs import BoostProfileConfig
from opir_trackers.profile import hypotheses as hypotheses_of
from opir_trackers.profile.bank import Fitting
from opir_trackers.profile.family import priors_of
from opir_trackers.profile.fit import Hypotheses
from opir_trackers.profile.report import Basis, report
from opir_trackers.profile.strain import OffModelFilters
from opir_trackers.profile.trust import apart, blended, chances, typed
from opir_trackers.sensors import SensorSchedule
from opir_trackers.stereo.tracker import StereoTracker


def caught_up(
    fitting: Fitting,
    bank: OffModelFilters,
    track: IntArray,
    rays: LinesOfSight,
    stray: FloatArray,
    cadence_s: float,
    now_s: float,
) -> OffModelFilters:
    """Return the bank with tracks that begin with rays (m,) from up to a tick, given to them by number (m,).

    All at once they would leave the fit far from where it begins. So each tick that one of the tracks was seen in is
    taken by itself. `stray` (m,) is the share of strays among each ray's track's.
    """
    young = OffModelFilters.empty(bank.seen.hits.shape[1])
    ticks_s = np.minimum((np.floor(rays.time_s / cadence_s) + 1.0) * cadence_s, now_s)
    for tick_s in np.unique(ticks_s).tolist():
        mine = np.flatnonzero(ticks_s == tick_s)
        young = fitting.stepped(young, tick_s, track[mine], rays.take(mine), stray[mine])
    return bank.joined(young)


#: Rays that belong to no track are kept for this long, s, or this many scans, for a track that begins later.
_POOL_S, _POOL_SCANS = 20.0, 20

#: Of what sensors state of their chances of detection no more is believed than lies in between.
_LEAST_STATED, _MOST_STATED = 0.02, 0.999

#: No type is ruled out by what sensors report.
_LEAST_CHANCE = 1e-6


class ProfileTracker:
    """The tracker `boost-profile`."""

    def __init__(self, config: BoostProfileConfig, context: TrackerContext, inner: StereoTracker) -> None:
        self._tick_s = config.cadence_s
        self.cadence_s: float | None = config.cadence_s
        self._inner = inner
        self._fitting = Fitting(priors_of(config.priors), _watch_of(context.sensors), context.light_time)
        self._forces = context.forces
        self._largest_impact_m = 1e3 * config.largest_impact_km
        self._impacts_in_burn = config.impacts_in_burn
        self._bank = OffModelFilters.empty(len(context.sensors))
        self._pool = no_lines_of_sight()

    def associate(self, detections: Detections) -> IntArray:
        """Return track numbers (n,), -1 for none, judged by the tracks as of the last tick; changes nothing."""
        return self._inner.associate(detections)

    def set_sensors(self, sensors: tuple[Sensor, ...]) -> None:
        """Take the sensors to be these from the last tick on: as many, with other settings."""
        self._inner.set_sensors(sensors)
        before, watch = self._fitting.watch, _watch_of(sensors)
        share = (
            before.period_s / watch.period_s * (watch.detection_probability / before.detection_probability).mean(axis=1)
        )
        self._fitting = evolve(self._fitting, watch=watch)
        seen = self._bank.seen
        self._bank = evolve(self._bank, seen=evolve(seen, hits=seen.hits * share))

    def step(self, tick_s: float, detections: Detections) -> Tracks:
        """Take in the detections since the last tick and return the estimates at this one."""
        followed = self._inner.step(tick_s, detections)
        mine = detections.track >= 0
        rays = LinesOfSight.of(detections)
        track = detections.track[mine]
        stray = self._inner.outlier_fractions(track)
        self._bank = self._fitting.stepped(self._bank, tick_s, track, rays.take(mine), stray)
        self._bank = self._bank.without(np.setdiff1d(self._bank.seen.track, followed.track))
        self._wait(rays.take(~mine), tick_s)
        self._begin(np.setdiff1d(followed.track, self._bank.seen.track), tick_s)
        return self._told(followed, tick_s)

    def _wait(self, free: LinesOfSight, tick_s: float) -> None:
        """Keep rays that belong to no track for tracks to come."""
        keep_s = np.maximum(_POOL_S, _POOL_SCANS * self._fitting.watch.period_s)[self._pool.sensor]
        self._pool = LinesOfSight.concatenate([self._pool.take(self._pool.time_s > tick_s - keep_s), free])

    def _begin(self, track: IntArray, tick_s: float) -> None:
        """Begin tracks by number with the rays that wait and are theirs."""
        if not len(track) or not len(self._pool):
            return
        owner = self._inner.owners(track, self._pool)
        mine, free = np.flatnonzero(owner >= 0), np.flatnonzero(owner < 0)
        told = owner[mine], self._pool.take(mine), self._inner.outlier_fractions(owner[mine])
        self._bank = caught_up(self._fitting, self._bank, *told, self._tick_s, tick_s)
        self._pool = self._pool.take(free)

    def _told(self, followed: Tracks, tick_s: float) -> Tracks:
        """Return the estimates of all tracks with a fit; of the others, what the stereo filter tells."""
        if not len(self._bank.hypotheses):
            return typed(followed)
        finer = self._fitting.parts(self._bank, tick_s)
        parts = None if finer is None else _weighed(finer, followed)
        mixed = _weighed(self._bank.hypotheses, followed)
        memory = self._fitting.memory(self._bank)
        falls = None if self._impacts_in_burn else self._burnt_out(followed, tick_s)
        basis = Basis(self._fitting.priors, self._forces, memory, self._largest_impact_m, falls)
        told = report(*mixed, tick_s, basis, parts)
        sound = np.isfinite(told.state).all(axis=1) & np.isfinite(told.state_covariance).all(axis=(1, 2))
        followed = typed(followed)
        told = self._trusted(told.take(sound), followed, tick_s)
        rest = followed.take(~np.isin(followed.track, told.track))
        every = Tracks.concatenate([told, rest])
        return every.take(np.argsort(every.track, kind="stable"))

    def _burnt_out(self, followed: Tracks, tick_s: float) -> IntArray:
        """Return the numbers of tracks whose burn is over by what no class tells: silence, or the filter."""
        seen = self._bank.seen
        falls = followed.track[np.isfinite(followed.impact).all(axis=1)]
        return np.union1d(seen.track[seen.are_out(tick_s, self._fitting.watch)], falls)

    def _trusted(self, told: Tracks, followed: Tracks, tick_s: float) -> Tracks:
        """Return what is told, mixed with what the filter tells by the chance that a target flies otherwise."""
        row = np.searchsorted(followed.track, told.track)
        present = np.flatnonzero(followed.track[np.minimum(row, len(followed) - 1)] == told.track)
        filtered, fitted = followed.take(row[present]), told.take(present)
        seen = self._bank.seen.of(filtered.track)
        odds = seen.otherwise + apart(fitted, filtered)
        mixed = blended(
            fitted, filtered, chances(odds, seen.seen_by_one_sensor(seen.track)), seen.time_since_last_s(tick_s)
        )
        every = Tracks.concatenate([told.take(~np.isin(told.track, mixed.track)), mixed])
        return every.take(np.argsort(every.track, kind="stable"))


def _watch_of(sensors: tuple[Sensor, ...]) -> SensorSchedule:
    return SensorSchedule.of(sensors, least=_LEAST_STATED, most=_MOST_STATED)


def _weighed(hypotheses: Hypotheses, followed: Tracks) -> tuple[Hypotheses, FloatArray]:
    """Return hypotheses and their probabilities, with what sensors' reports of the type say of them."""
    said = _reported(followed, hypotheses.track, hypotheses.kind)
    return hypotheses, hypotheses_of.probability(evolve(hypotheses, evidence=hypotheses.evidence + said))


def _reported(followed: Tracks, track: IntArray, kind: IntArray) -> FloatArray:
    """Return what sensors' reports of the type say of hypotheses (n,), as log likelihoods."""
    types = followed.type_probability[np.searchsorted(followed.track, track), : len(TARGET_TYPES)]
    chance = types[np.arange(len(kind)), kind]
    said = np.isfinite(types).all(axis=1) & (types.sum(axis=1) > 0.5)
    log: FloatArray = np.where(said, np.log(np.maximum(np.nan_to_num(chance), _LEAST_CHANCE)), 0.0)
    return log


def boost_profile_tracker(config: BoostProfileConfig, context: TrackerContext) -> ProfileTracker:
    """Return the tracker `boost-profile`."""
    from opir_trackers.stereo.tracker import stereo_filter

    return ProfileTracker(config, context, stereo_filter(config.stereo_filter(), context))
