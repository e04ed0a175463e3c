"""The tracker `imm`: its tick, as steps from one frozen `TrackerState` to the next.

Each slice makes a new state. Late detections are processed by returning to the state before them
and stepping again, so the result is the same as if they had arrived in time.
"""

from bisect import bisect_right
from collections.abc import Iterator
from math import ceil

import numpy as np
from attrs import evolve, frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.flight import Forces, forces_of
from opir_core.plugin import TARGET_TYPES, Detections, Hypothesis, TrackerContext
from opir_trackers.configs import ImmConfig
from opir_trackers.forecast.outcomes import hypothesis_log_likelihood
from opir_trackers.imm.associate import associate, track_numbers
from opir_trackers.imm.initiate import initiate
from opir_trackers.imm.launches import with_launch_points
from opir_trackers.imm.models import TrackingModels
from opir_trackers.imm.predict import predict
from opir_trackers.imm.prune import prune
from opir_trackers.imm.renewal import renewed
from opir_trackers.imm.report import ReportedTracks, tracks_of, type_evidence, type_log_likelihoods
from opir_trackers.imm.state import EndedTracks, TrackerState
from opir_trackers.imm.update import update
from opir_trackers.launch_points import grounds
from opir_trackers.lines_of_sight import LinesOfSight, earth_rotated
from opir_trackers.onset.brevity import are_brief
from opir_trackers.onset.motion_priors import WIDE_M
from opir_trackers.onset.motion_statistics import MotionStatistics
from opir_trackers.registration.registration import Registration, registration_of
from opir_trackers.track_priors import standing_estimates


@frozen(eq=False)
class ImmTracking:
    """The transition from one `TrackerState` to the next."""

    config: ImmConfig
    models: TrackingModels
    registration: Registration
    forces: Forces
    type_log_likelihood: FloatArray
    hypotheses: tuple[Hypothesis, ...]

    @classmethod
    def of(cls, config: ImmConfig, context: TrackerContext) -> "ImmTracking":
        """Return the tracking of a scene's sensors."""
        return cls(
            config=config,
            models=TrackingModels.of(config, context),
            registration=registration_of(config, context.sensors),
            forces=forces_of(context.forces),
            type_log_likelihood=type_log_likelihoods(context.sensors),
            hypotheses=context.hypotheses,
        )

    def start(self) -> TrackerState:
        """Return the state before the first detection."""
        return TrackerState.first(len(self.models.period_s), self.registration)

    def lines_of_sight(self, detections: Detections) -> LinesOfSight:
        """Return the lines of sight of detections."""
        return LinesOfSight.of(detections)

    def stepped(
        self,
        now: TrackerState,
        tick_s: float,
        detections: Detections,
        cached: LinesOfSight | None = None,
    ) -> TrackerState:
        """Return the state at a tick, after the detections since the last one; `cached` are their
        lines of sight.
        """
        lines = self.lines_of_sight(detections) if cached is None else cached
        now = now if now.ended is None else evolve(now, ended=None)
        is_idle = now.is_empty
        step_s = tick_s - now.time_s
        if is_idle and not len(lines.time_s):
            return evolve(now, time_s=tick_s)
        reported = detections.reported_type.astype(np.int64)
        ends = list(
            _slice_ends(now.time_s, tick_s, min(self.config.slice_s, self.config.cadence_s))
        )
        if is_idle:
            idle = bisect_right(ends, lines.time_s.min())
            now = evolve(now, time_s=[now.time_s, *ends][idle])
            ends = ends[idle:]
        if len(ends) == 1 and (not len(lines.time_s) or lines.time_s[0] >= now.time_s):
            return self._standing(
                self._assessed(self._after_slice(now, tick_s, lines, reported), step_s)
            )
        cuts = np.searchsorted(lines.time_s, [now.time_s, *ends[:-1], np.inf]).tolist()
        for end, first, last in zip(ends, cuts[:-1], cuts[1:], strict=True):
            now = self._after_slice(now, end, lines.take(slice(first, last)), reported[first:last])
        return self._standing(self._assessed(now, step_s))

    def _after_slice(
        self, now: TrackerState, end_s: float, raw: LinesOfSight, reported: IntArray
    ) -> TrackerState:
        """Return the state after a slice with lines of sight and their reported types (m,).

        Crowds are paired anew every few seconds.
        """
        models = self.models
        lines = self.models.corrected(now.registration, raw)
        ahead = predict(models, now, end_s, lines)
        found = associate(models, now, ahead)
        then = update(models, now, ahead, found, reported)
        then = initiate(models, then, ahead, found.owner, raw, reported)
        then = prune(models, with_launch_points(models, then, ahead.span_s), lines, found.owner)
        if not then.crowds.are_there:
            return then
        return renewed(then, models.view(then.registration), models.filter, models.config)

    def _assessed(self, now: TrackerState, step_s: float) -> TrackerState:
        """Return the state with the probabilities of what each track is, a tick of a length after
        the last one.
        """
        table = now.table
        motion = now.motion
        if not len(motion) or motion.is_decided.all():
            return now
        pause_s = self.models.longest(self.models.period_s, table)
        motion = self.models.groups.assessed(
            motion, now.time_s, table.first_s, table.seen_s, pause_s, step_s
        )
        return now.after(now.time_s, now.estimates, table, motion)

    def _standing(self, now: TrackerState) -> TrackerState:
        """Return the state with the tracks that are ground sources for good where they stand,
        whatever the filter says.

        Lines of what rises from there leave their gate and initiate a track of their own.
        """
        rows = np.flatnonzero(now.motion.is_decided & now.motion.stands)
        if not len(rows):
            return now
        where = self._static_estimates(now.motion.take(rows), now.time_s)
        drift_m_s = self.config.hypotheses.ground_drift_m_s
        still = standing_estimates(now.estimates.take(rows), *where, drift_m_s, self.config)
        return evolve(now, estimates=now.estimates.put(rows, still))

    def _static_estimates(
        self, motion: MotionStatistics, time_s: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return inertial positions (n, 3) and covariances (n, 3, 3) of sources that stand on the
        ground.
        """
        kinds = np.array(grounds(self.config.hypotheses.inland_share))
        position, covariance = motion.static_estimates(kinds, WIDE_M)
        turn = earth_rotated(np.eye(3), np.full(3, time_s)).T
        return position @ turn.T, turn @ covariance @ turn.T

    def confirmed(self, now: TrackerState) -> BoolArray:
        """Return which tracks (n,) are reported."""
        return self.models.confirmed(now)

    def track_numbers(self, now: TrackerState, lines: LinesOfSight) -> IntArray:
        """Return the track number (n,) of each line of sight of the next tick, -1 for none."""
        return track_numbers(self.models, now, lines)

    def reported_tracks(self, now: TrackerState) -> ReportedTracks:
        """Return the confirmed tracks, without impacts, and what their forecast and composition
        need.
        """
        last = self.confirmed_and_ended(now)
        estimates = last.estimates
        table = last.table
        motion = last.motion
        state, covariance = self.models.moments(estimates)
        added = self.models.shared_covariance(now, estimates, table)
        if added is not None:
            covariance = covariance + added
        tracks = tracks_of(state, covariance, table, now.time_s)
        tracks = evolve(tracks, is_brief=self.are_brief(last, now.time_s))
        types = type_evidence(table.reports, self.type_log_likelihood)
        reports = hypothesis_log_likelihood(types, self.hypotheses, TARGET_TYPES)
        return ReportedTracks(tracks, estimates, reports, motion.probability, last.end)

    def are_brief(self, last: EndedTracks, time_s: float) -> BoolArray:
        """Return which tracks (n,) went out, or are silent for too long, before their looks could
        tell a launch.
        """
        table = last.table
        silent = time_s - table.seen_s > self.models.longest(self.models.silence_limit_s, table)
        return ((last.end > 0) | silent) & are_brief(last.motion, table.first_s, table.seen_s)

    def confirmed_and_ended(self, now: TrackerState) -> EndedTracks:
        """Return the confirmed tracks and those that ended since the last tick, by number; `end` is
        0 if not yet.
        """
        confirmed = self.confirmed(now)
        table = now.table
        motion = now.motion
        estimates = now.estimates
        if now.crowds.are_there:
            estimates = now.crowds.mixtures.mixed(estimates, table.number, now.time_s)
        if np.count_nonzero(confirmed) < len(confirmed):
            estimates = estimates.take(confirmed)
            table = table.take(confirmed)
            motion = motion.take(confirmed)
        last = EndedTracks(estimates, table, motion, np.zeros(len(table), dtype=np.uint8))
        if now.ended is not None:
            last = now.ended.and_others(last)
            last = last.take(np.argsort(last.table.number, kind="stable"))
        return last


def _slice_ends(start_s: float, end_s: float, slice_s: float) -> Iterator[float]:
    """Yield the ends of equal slices no longer than `slice_s`."""
    count = max(1, ceil((end_s - start_s) / slice_s - 1e-9))
    for number in range(1, count):
        yield start_s + (end_s - start_s) * number / count
    yield end_s
