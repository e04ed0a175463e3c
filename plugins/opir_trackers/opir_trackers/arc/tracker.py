"""The tracker `kepler-arc` of the paper: association by `imm`, estimates by a Keplerian arc.

A thrusting missile is not on a Keplerian arc (docs/explanation/paper-errata.md): this is the
baseline for the others.
"""

import numpy as np
from attrs import evolve

from opir_core.arrays import FloatArray, IntArray
from opir_core.geometry import great_circle_m
from opir_core.interfaces import IMPACT_METHODS
from opir_core.plugin import (
    TARGET_TYPES,
    Detections,
    Sensor,
    SensorHealth,
    Tracker,
    TrackerContext,
    Tracks,
)
from opir_trackers.arc import fit as arc_fit
from opir_trackers.arc.ends import (
    expected_looks,
    impacts,
    latency_s,
    launches,
    states_at,
    trajectory_parameters,
)
from opir_trackers.arc.fit import ArcFits
from opir_trackers.arc.launch_hypotheses import LaunchHypotheses
from opir_trackers.arc.range_types import type_probabilities
from opir_trackers.association import associate_nearest
from opir_trackers.configs import KeplerArcConfig
from opir_trackers.gating import candidates, gated
from opir_trackers.imm.report import type_posterior
from opir_trackers.imm.tracking import ImmTracking
from opir_trackers.launch_points import site_height_m
from opir_trackers.lines_of_sight import LinesOfSight, no_lines_of_sight
from opir_trackers.onset.composition import Composition
from opir_trackers.onset.motion_statistics import LAUNCH
from opir_trackers.registration.health import sensor_health
from opir_trackers.sensors import LineOfSightCache, SensorSchedule

#: Least number of detections of an arc.
LEAST_LOOKS = 3

#: Unassigned lines are kept for this time, s, or this number of scans, for tracks that begin later.
_POOL_S = 20.0
_POOL_SCANS = 20

#: Lower bound on the detection probability, which limits the expected latency.
_LEAST_CHANCE = 0.01


class ArcTracker(Tracker):
    """The tracker `kepler-arc`."""

    def __init__(
        self, config: KeplerArcConfig, context: TrackerContext, tracking: ImmTracking
    ) -> None:
        self.cadence_s: float | None = config.cadence_s
        self._config = config
        self._tracking = tracking
        self._context = context
        self._now = tracking.start()
        #: The tracks of the last tick, and those that ended since the one before.
        self._last = tracking.confirmed_and_ended(self._now)
        self._watch = SensorSchedule.of(context.sensors, least=_LEAST_CHANCE, most=1.0)
        self._light_time = context.light_time
        self._rays = LineOfSightCache(LinesOfSight.of)
        self._pool = no_lines_of_sight()
        self._arcs = ArcFits.none(len(context.sensors))
        self._composition = Composition.of(context.hypotheses)
        self._launches = LaunchHypotheses.of(context.hypotheses)

    def associate(self, detections: Detections) -> IntArray:
        """Return track numbers (n,), -1 for none, by the tracks as of the last tick; the state is
        unchanged.
        """
        return self._tracking.track_numbers(self._now, self._rays.of(detections))

    def sensor_health(self) -> SensorHealth:
        """Return the sensors' biases, clocks and noise as far as their lines of sight show them."""
        return sensor_health(
            self._now.registration, tuple(sensor.id for sensor in self._context.sensors)
        )

    def set_sensors(self, sensors: tuple[Sensor, ...]) -> None:
        """Set the sensors from the last tick on: the same number, with other settings."""
        self._context = evolve(self._context, sensors=sensors)
        self._tracking = ImmTracking.of(self._tracking.config, self._context)
        self._watch = SensorSchedule.of(sensors, least=_LEAST_CHANCE, most=1.0)

    def is_idle(self) -> bool:
        """Return whether there is neither a track nor a line of sight that may begin one."""
        return self._now.is_empty and not len(self._pool)

    def step(self, tick_s: float, detections: Detections) -> Tracks:
        """Return the estimates at this tick, after the detections since the last one."""
        before_s = self._now.time_s
        lines = self._rays.of(detections)
        self._now = self._tracking.stepped(self._now, tick_s, detections, lines)
        tracks = self._tracking.confirmed_and_ended(self._now)
        was_reported = np.isin(tracks.table.number, self._arcs.number)
        self._last = tracks.take(np.flatnonzero(was_reported | (tracks.end == 0)))
        self._update_arcs(self._last.table.number)
        if self._config.memory_s is not None:
            self._arcs = self._arcs.discounted(
                float(np.exp((before_s - tick_s) / self._config.memory_s))
            )
        self._take_in(lines, before_s)
        return self._tracks(tick_s)

    def _update_arcs(self, number: IntArray) -> None:
        """Drop the arcs of deleted tracks, and add those of new ones."""
        old = self._arcs.take(np.isin(self._arcs.number, number))
        new = ArcFits.unfitted(np.setdiff1d(number, old.number), len(self._watch.period_s))
        arcs = ArcFits.concatenate([old, new])
        self._arcs = arcs.take(np.argsort(arcs.number, kind="stable"))

    def _take_in(self, lines: LinesOfSight, before_s: float) -> None:
        """Update the fitted arcs with this tick's lines, and initialise others with the pool."""
        owner = self._owners(lines, self._now.time_s - before_s)
        follows = np.isin(owner, np.flatnonzero(self._arcs.is_fitted))
        if follows.any():
            rows = np.flatnonzero(follows)
            fitted_lines = (
                lines.take(rows),
                owner[rows],
                self._launch_s(),
                self._config.climb_m_s2,
                self._light_time,
            )
            self._arcs = arc_fit.updated(self._arcs, *fitted_lines)
        pool = LinesOfSight.concatenate([self._pool, lines.take(~follows)])
        keep_s = np.maximum(_POOL_S, _POOL_SCANS * self._watch.period_s)[pool.sensor]
        self._pool = pool.take(pool.time_s > self._now.time_s - keep_s)
        if len(self._arcs) and not self._arcs.is_fitted.all() and len(self._pool):
            self._begin()

    def _begin(self) -> None:
        """Initialise the arcs of tracks with enough detections."""
        owner = self._owners(self._pool, self._now.time_s - float(self._pool.time_s[0]))
        waits = (owner >= 0) & ~self._arcs.is_fitted[owner]
        looks = np.bincount(owner[waits], minlength=len(self._arcs))
        pool_rows = np.flatnonzero(waits & (looks[owner] >= LEAST_LOOKS))
        rows = np.unique(owner[pool_rows])
        if not len(rows):
            return
        lines = self._pool.take(pool_rows)
        owner_row = np.searchsorted(rows, owner[pool_rows])
        site_m = site_height_m(self._config.hypotheses.inland_share)
        launch = launches(lines, owner_row, len(rows), self._watch, self._light_time, site_m)
        arcs = ArcFits.unfitted(self._arcs.number[rows], len(self._watch.period_s))
        arcs = evolve(arcs, launch=launch.place, launch_covariance=launch.covariance)
        arcs = arc_fit.initialised(
            arcs, lines, owner_row, launch.place[:, 2], self._config.climb_m_s2, self._light_time
        )
        is_fitted = arcs.is_fitted
        other_rows = np.setdiff1d(np.arange(len(self._arcs)), rows[is_fitted])
        arcs_ = ArcFits.concatenate([self._arcs.take(other_rows), arcs.take(is_fitted)])
        self._arcs = arcs_.take(np.argsort(arcs_.number, kind="stable"))
        self._pool = self._pool.take(
            np.setdiff1d(np.arange(len(self._pool)), pool_rows[is_fitted[owner_row]])
        )

    def _launch_s(self) -> FloatArray:
        return np.where(
            np.isfinite(self._arcs.launch[:, 2]), self._arcs.launch[:, 2], self._arcs.epoch_s
        )

    def _owners(self, lines: LinesOfSight, span_s: float) -> IntArray:
        """Return the arc row (n,) of each line of the last span, by the tracks as of this tick, -1
        for none.

        Tracks are those of lines without the known errors of their sensors, so lines are compared
        without them.
        """
        owner = np.full(len(lines), -1, dtype=np.int64)
        rows = np.flatnonzero(np.isin(self._now.table.number, self._arcs.number))
        if not len(rows) or not len(lines):
            return owner
        tracking = self._tracking
        lines = self._now.registration.corrected(lines)
        predicted = tracking.models.filter.predicted_measurements(
            self._now.estimates.take(rows), self._now.time_s
        )
        gate = tracking.config.gate_sigma
        track, line = candidates(predicted, lines, span_s, gate, self._light_time)
        pairs = gated(predicted, lines, track, line, gate, self._light_time)
        owner_row = associate_nearest(pairs, lines, tracking.models.association).owner
        number = self._now.table.number[rows]
        return np.where(owner_row >= 0, np.searchsorted(self._arcs.number, number[owner_row]), -1)

    def _tracks(self, tick_s: float) -> Tracks:
        """Return the estimates of all tracks, nan without an arc."""
        arcs = self._arcs
        count = len(self._arcs)
        unknown = np.full((count, 7, 7), np.nan)
        silent = np.tile([0.0, 0.0, 0.0, 1.0], (count, 1))
        tracks = Tracks(
            tick_s=np.full(count, tick_s),
            track=arcs.number,
            state=unknown[:, 0, :6].copy(),
            state_covariance=unknown[:, :6, :6].copy(),
            launch=arcs.launch.copy(),
            launch_covariance=arcs.launch_covariance.copy(),
            impact=unknown[:, 0, :3].copy(),
            impact_covariance=unknown[:, :3, :3].copy(),
            type_probability=silent,
            burnout=unknown[:, 0].copy(),
            burnout_covariance=unknown,
            impact_method=np.full(count, IMPACT_METHODS.index("paper"), dtype=np.uint8),
            end=self._last.end,
            seen_s=self._last.table.seen_s - self._last.table.first_s,
            is_brief=self._tracking.are_brief(self._last, tick_s),
        )
        begun = np.flatnonzero(arcs.is_fitted)
        if len(begun):
            self._fill(tracks, begun, tick_s)
        return self._with_hypotheses(tracks)

    def _with_hypotheses(self, tracks: Tracks) -> Tracks:
        """Return tracks with the probabilities of hypotheses; what is probably no launch has no
        launch and no impact.

        Whether it is a launch follows from its motion, as in `imm`; what was launched, from its
        arc.
        """
        groups = self._last.motion.probability
        no_launch = tracks.is_brief | (groups[:, LAUNCH] < self._config.least_launch_probability)
        in_orbit = self._arcs.is_fitted & np.isnan(tracks.impact[:, 2])
        given_launch = self._launches.given_launch(tracks.type_probability, in_orbit)
        for column in (
            tracks.launch,
            tracks.launch_covariance,
            tracks.impact,
            tracks.impact_covariance,
        ):
            column[no_launch] = np.nan
        return self._composition.composed(tracks, groups, given_launch)

    def _fill(self, tracks: Tracks, rows: IntArray, tick_s: float) -> None:
        """Write the estimates of the arcs of rows."""
        arcs = self._arcs.take(rows)
        tracks.state[rows], tracks.state_covariance[rows] = states_at(
            arcs, np.full(len(rows), tick_s)
        )
        state, covariance = states_at(arcs, arcs.last_s)
        tracks.burnout[rows] = np.concatenate([state, arcs.last_s[:, None]], axis=1)
        tracks.burnout_covariance[rows] = self._with_end(covariance, arcs)
        impact = impacts(arcs)
        range_m = great_circle_m(arcs.launch, impact)
        sigma_m = self._sigma_m(arcs)
        shot = trajectory_parameters(state)
        pace = np.maximum(shot.speed_m_s * np.cos(shot.flight_path_angle_rad), 1.0)
        variance = np.square(np.stack([sigma_m, sigma_m, sigma_m / pace], axis=1))
        has_impact = ~np.isnan(impact[:, 2])
        tracks.impact[rows] = np.where(has_impact[:, None], impact, np.nan)
        tracks.impact_covariance[rows] = np.where(
            has_impact[:, None, None], variance[:, :, None] * np.eye(3), np.nan
        )
        tracks.type_probability[rows] = type_probabilities(range_m, sigma_m)

    def _sigma_m(self, arcs: ArcFits) -> FloatArray:
        """Return the paper's σ₀ exp(-k n/N) of each arc, with n of N expected detections, n ≤ N;
        after the boost n = N.

        N is that of the boost by its time since launch and the reported types, not by the range of
        the arc: an arc through a boost falls short.
        """
        rows = np.searchsorted(self._last.table.number, arcs.number)
        launch_s = np.where(np.isfinite(arcs.launch[:, 2]), arcs.launch[:, 2], arcs.epoch_s)
        types = type_posterior(self._last.table.reports[rows], self._tracking.type_log_likelihood)
        types_ = types[:, : len(TARGET_TYPES)] + types[:, len(TARGET_TYPES) :]
        expected = expected_looks(self._watch, arcs.seen, arcs.last_s - launch_s, types_)
        share = np.minimum(arcs.looks / np.maximum(expected, 1.0), 1.0)
        share = np.where(self._last.estimates.weight[rows, 1] > 0.5, 1.0, share)
        sigma_m: FloatArray = self._config.sigma_0_m * np.exp(-self._config.convergence * share)
        return sigma_m

    def _with_end(self, covariance: FloatArray, arcs: ArcFits) -> FloatArray:
        """Return covariances (n, 7, 7) that include the uncertainty of burnout: one expected
        latency.
        """
        late_s = np.where(arcs.seen, latency_s(self._watch)[0], np.inf).min(axis=1)
        covariance_ = np.zeros((len(arcs), 7, 7))
        covariance_[:, :6, :6] = covariance
        covariance_[:, 6, 6] = np.square(late_s)
        return covariance_


def kepler_arc_tracker(config: KeplerArcConfig, context: TrackerContext) -> ArcTracker:
    """Return the tracker `kepler-arc`."""

    return ArcTracker(config, context, ImmTracking.of(config.imm(), context))
