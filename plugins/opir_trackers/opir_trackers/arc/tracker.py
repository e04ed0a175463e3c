"""The tracker `kepler-arc` of the paper: association by `imm`, estimates by a Keplerian arc.

A thrusting missile is not on a Keplerian arc (docs/explanation/paper-errata.md): this is the
baseline for the others.
"""

import numpy as np
from attrs import evolve
from opir_estimation import LinesOfSight, no_lines_of_sight, sensor_health
from opir_forecast import site_height_m

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
from opir_trackers.arc.fit import ArcFits, AssumedHeights
from opir_trackers.arc.launch_hypotheses import LaunchHypotheses
from opir_trackers.arc.range_types import type_probabilities
from opir_trackers.association import associate_nearest
from opir_trackers.configs import KeplerArcConfig
from opir_trackers.imm.report import type_posterior
from opir_trackers.imm.tracking import ImmTracking
from opir_trackers.onset.composition import Composition
from opir_trackers.onset.motion_statistics import LAUNCH
from opir_trackers.sensors import LineOfSightCache, SensorSchedule

#: Least number of detections of an arc.
LEAST_LOOKS = 3


class ArcTracker(Tracker):
    """The tracker `kepler-arc`."""

    def __init__(
        self, config: KeplerArcConfig, context: TrackerContext, tracking: ImmTracking
    ) -> None:
        self.cadence_s: float | None = config.cadence_s
        self._config = config
        self._tracking = tracking
        self._context = context
        self._state = tracking.start()
        #: The tracks of the last tick, and those that ended since the one before.
        self._reported = tracking.confirmed_and_ended(self._state)
        self._watch = SensorSchedule.of(context.sensors, least=0.01, most=1.0)
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
        return self._tracking.track_numbers(self._state, self._rays.of(detections))

    def sensor_health(self) -> SensorHealth:
        """Return the sensors' biases, clocks and noise as far as their lines of sight show them."""
        return sensor_health(
            self._state.registration, tuple(sensor.id for sensor in self._context.sensors)
        )

    def set_sensors(self, sensors: tuple[Sensor, ...]) -> None:
        """Set the sensors from the last tick on: the same number, with other settings."""
        self._context = evolve(self._context, sensors=sensors)
        self._tracking = ImmTracking.of(self._tracking.config, self._context)
        self._watch = SensorSchedule.of(sensors, least=0.01, most=1.0)

    def is_idle(self) -> bool:
        """Return whether there is neither a track nor a line of sight that may begin one."""
        return self._state.is_empty and not len(self._pool)

    def step(self, tick_s: float, detections: Detections) -> Tracks:
        """Return the estimates at this tick, after the detections since the last one."""
        before_s = self._state.time_s
        lines = self._rays.of(detections)
        self._state = self._tracking.stepped(self._state, tick_s, detections, lines)
        tracks = self._tracking.confirmed_and_ended(self._state)
        was_reported = np.isin(tracks.table.number, self._arcs.number)
        self._reported = tracks.take(np.flatnonzero(was_reported | (tracks.end == 0)))
        self._update_arcs(self._reported.table.number)
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
        owner = self._owners(lines, self._state.time_s - before_s)
        follows = np.isin(owner, np.flatnonzero(self._arcs.is_fitted))
        rows = np.flatnonzero(follows)
        if len(rows):
            heights = AssumedHeights(_launch_s(self._arcs), self._config.climb_m_s2)
            self._arcs = arc_fit.updated(
                self._arcs, lines.take(rows), owner[rows], heights, self._light_time
            )
        pool = LinesOfSight.concatenate([self._pool, lines.take(~follows)])
        # Unassigned lines are kept for 20 s, or 20 scans, for tracks that begin later.
        keep_s = np.maximum(20.0, 20.0 * self._watch.period_s)[pool.sensor]
        self._pool = pool.take(pool.time_s > self._state.time_s - keep_s)
        if len(self._arcs) and not self._arcs.is_fitted.all() and len(self._pool):
            self._begin()

    def _begin(self) -> None:
        """Initialise the arcs of tracks with enough detections."""
        owner = self._owners(self._pool, self._state.time_s - float(self._pool.time_s[0]))
        waits = (owner >= 0) & ~self._arcs.is_fitted[owner]
        looks = np.bincount(owner[waits], minlength=len(self._arcs))
        pool_rows = np.flatnonzero(waits & (looks[owner] >= LEAST_LOOKS))
        rows = np.unique(owner[pool_rows])
        if not len(rows):
            return
        lines = self._pool.take(pool_rows)
        row = np.searchsorted(rows, owner[pool_rows])
        arcs = self._first_arcs(lines, row, self._arcs.number[rows])
        is_fitted = arcs.is_fitted
        unchanged = np.setdiff1d(np.arange(len(self._arcs)), rows[is_fitted])
        arcs = ArcFits.concatenate([self._arcs.take(unchanged), arcs.take(is_fitted)])
        self._arcs = arcs.take(np.argsort(arcs.number, kind="stable"))
        used = pool_rows[is_fitted[row]]
        self._pool = self._pool.take(np.setdiff1d(np.arange(len(self._pool)), used))

    def _first_arcs(self, lines: LinesOfSight, row: IntArray, number: IntArray) -> ArcFits:
        """Return new arcs of tracks `number` (n,), fitted to their lines (m,) of `row`, and their
        launch points.
        """
        site_m = site_height_m(self._config.hypotheses.inland_share)
        launch = launches(lines, row, len(number), self._watch, self._light_time, site_m)
        arcs = ArcFits.unfitted(number, len(self._watch.period_s))
        arcs = evolve(arcs, launch=launch.place, launch_covariance=launch.covariance)
        heights = AssumedHeights(launch.place[:, 2], self._config.climb_m_s2)
        return arc_fit.initialised(arcs, lines, row, heights, self._light_time)

    def _owners(self, lines: LinesOfSight, span_s: float) -> IntArray:
        """Return the arc row (n,) of each line of the last span, by the tracks as of this tick, -1
        for none.

        Tracks are those of lines without the known errors of their sensors, so lines are compared
        without them.
        """
        owner = np.full(len(lines), -1, dtype=np.int64)
        rows = np.flatnonzero(np.isin(self._state.table.number, self._arcs.number))
        if not len(rows) or not len(lines):
            return owner
        models = self._tracking.models
        lines = self._state.registration.corrected(lines)
        estimates = self._state.table.estimates.take(rows)
        predicted = models.filter.predicted_measurements(estimates, self._state.time_s)
        pairs = models.gated_pairs(predicted, lines, span_s)
        row = associate_nearest(pairs, lines, models.association).owner
        number = self._state.table.number[rows]
        return np.where(row >= 0, np.searchsorted(self._arcs.number, number[row]), -1)

    def _tracks(self, tick_s: float) -> Tracks:
        """Return the estimates of all tracks, nan without an arc."""
        arcs = self._arcs
        count = len(arcs)
        unknown = np.full((count, 7, 7), np.nan)
        tracks = Tracks(
            tick_s=np.full(count, tick_s),
            track=arcs.number,
            state=unknown[:, 0, :6].copy(),
            state_covariance=unknown[:, :6, :6].copy(),
            launch=arcs.launch.copy(),
            launch_covariance=arcs.launch_covariance.copy(),
            impact=unknown[:, 0, :3].copy(),
            impact_covariance=unknown[:, :3, :3].copy(),
            type_probability=np.tile([0.0, 0.0, 0.0, 1.0], (count, 1)),
            burnout=unknown[:, 0].copy(),
            burnout_covariance=unknown,
            impact_method=np.full(count, IMPACT_METHODS.index("paper"), dtype=np.uint8),
            end=self._reported.end,
            seen_s=self._reported.table.seen_s - self._reported.table.first_s,
            is_brief=self._tracking.are_brief(self._reported, tick_s),
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
        groups = self._reported.table.motion.probability
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
        return evolve(tracks, **self._composition.columns(groups, given_launch))

    def _fill(self, tracks: Tracks, rows: IntArray, tick_s: float) -> None:
        """Write the estimates of the arcs of rows."""
        arcs = self._arcs.take(rows)
        ticks_s = np.full(len(rows), tick_s)
        tracks.state[rows], tracks.state_covariance[rows] = states_at(arcs, ticks_s)
        state, covariance = states_at(arcs, arcs.last_s)
        tracks.burnout[rows] = np.concatenate([state, arcs.last_s[:, None]], axis=1)
        tracks.burnout_covariance[rows] = self._with_end(covariance, arcs)
        impact = impacts(arcs)
        sigma_m = self._sigma_m(arcs)
        shot = trajectory_parameters(state)
        pace = np.maximum(shot.speed_m_s * np.cos(shot.flight_path_angle_rad), 1.0)
        variance = np.square(np.stack([sigma_m, sigma_m, sigma_m / pace], axis=1))
        no_impact = np.isnan(impact[:, 2])
        impact[no_impact] = np.nan
        variance[no_impact] = np.nan
        tracks.impact[rows] = impact
        tracks.impact_covariance[rows] = variance[:, :, None] * np.eye(3)
        range_m = great_circle_m(arcs.launch, impact)
        tracks.type_probability[rows] = type_probabilities(range_m, sigma_m)

    def _sigma_m(self, arcs: ArcFits) -> FloatArray:
        """Return the paper's σ₀ exp(-k n/N) of each arc, with n of N expected detections, n ≤ N;
        after the boost n = N.

        N is that of the boost by its time since launch and the reported types, not by the range of
        the arc: an arc through a boost falls short.
        """
        reported = self._reported
        rows = np.searchsorted(reported.table.number, arcs.number)
        types = type_posterior(reported.table.reports[rows], self._tracking.type_log_likelihood)
        kinds = types[:, : len(TARGET_TYPES)] + types[:, len(TARGET_TYPES) :]
        elapsed_s = arcs.last_s - _launch_s(arcs)
        expected = expected_looks(self._watch, arcs.seen, elapsed_s, kinds)
        share = np.minimum(arcs.looks / np.maximum(expected, 1.0), 1.0)
        share = np.where(reported.table.estimates.weight[rows, 1] > 0.5, 1.0, share)
        return self._config.sigma_0_m * np.exp(-self._config.convergence * share)

    def _with_end(self, covariance: FloatArray, arcs: ArcFits) -> FloatArray:
        """Return covariances (n, 7, 7) that include the uncertainty of burnout: one expected
        latency.
        """
        late_s = np.where(arcs.seen, latency_s(self._watch)[0], np.inf).min(axis=1)
        bordered = np.zeros((len(arcs), 7, 7))
        bordered[:, :6, :6] = covariance
        bordered[:, 6, 6] = np.square(late_s)
        return bordered


def _launch_s(arcs: ArcFits) -> FloatArray:
    """Return launch times (n,), s; first emissions where these are unknown."""
    return np.where(np.isfinite(arcs.launch[:, 2]), arcs.launch[:, 2], arcs.epoch_s)


def kepler_arc_tracker(config: KeplerArcConfig, context: TrackerContext) -> ArcTracker:
    """Return the tracker `kepler-arc`."""

    return ArcTracker(config, context, ImmTracking.of(config.imm(), context))
