"""The tracker `imm`: its tick, as steps from one frozen `TrackerState` to the next.

Each slice makes a new state. Late detections are processed by returning to the state before them
and stepping again, so the result is the same as if they had arrived in time.
"""

from bisect import bisect_right
from itertools import pairwise
from math import ceil

import numpy as np
from attrs import frozen
from opir_estimation import LinesOfSight, Registration, air_velocity, dot
from opir_forecast import grounds, hypothesis_log_likelihood

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.flight import Forces, forces_of
from opir_core.plugin import TARGET_TYPES, Detections, Hypothesis, TrackerContext
from opir_trackers.configs import ImmConfig
from opir_trackers.imm.associate import associate, track_numbers
from opir_trackers.imm.burnouts import with_burn_ends
from opir_trackers.imm.initiate import initiate
from opir_trackers.imm.launches import with_launch_points
from opir_trackers.imm.models import TrackingModels
from opir_trackers.imm.predict import predict
from opir_trackers.imm.prune import FLASH, prune
from opir_trackers.imm.report import ReportedTracks, type_evidence, type_log_likelihoods
from opir_trackers.imm.state import EndedTracks, TrackerState
from opir_trackers.imm.update import update
from opir_trackers.onset.brevity import are_brief
from opir_trackers.onset.motion_priors import FASTEST_AIRCRAFT_M_S, WIDE_M
from opir_trackers.onset.posterior import standing
from opir_trackers.sensors import registration_of
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

    def stepped(
        self,
        state: TrackerState,
        tick_s: float,
        detections: Detections,
        cached: LinesOfSight | None = None,
    ) -> TrackerState:
        """Return the state at a tick, after the detections since the last one; `cached` are their
        lines of sight.
        """
        lines = LinesOfSight.of(detections) if cached is None else cached
        if state.ended is not None:
            state = state._replace(ended=None)
        step_s = tick_s - state.time_s
        slice_s = min(self.config.slice_s, self.config.cadence_s)
        ends = _slice_ends(state.time_s, tick_s, slice_s)
        if state.is_empty:
            if not len(lines.time_s):
                return state._replace(time_s=tick_s)
            # Slices before the first line change nothing; a line at the tick is of the last one.
            idle = bisect_right(ends[:-1], lines.time_s.min())
            state = state._replace(time_s=[state.time_s, *ends][idle])
            ends = ends[idle:]
        reported = detections.reported_type.astype(np.int64)
        if len(ends) == 1 and (not len(lines.time_s) or lines.time_s[0] >= state.time_s):
            state = self._after_slice(state, tick_s, lines, reported)
            return self._standing(self._assessed(state, step_s))
        cuts = np.searchsorted(lines.time_s, [state.time_s, *ends[:-1], np.inf]).tolist()
        for end_s, (start, stop) in zip(ends, pairwise(cuts), strict=True):
            rows = slice(start, stop)
            state = self._after_slice(state, end_s, lines.take(rows), reported[rows])
        return self._standing(self._assessed(state, step_s))

    def _after_slice(
        self, state: TrackerState, end_s: float, raw: LinesOfSight, reported: IntArray
    ) -> TrackerState:
        """Return the state after a slice with lines of sight and their reported types (m,)."""
        models = self.models
        lines = models.corrected(state.registration, raw)
        prediction = predict(models, state, end_s, lines)
        association = associate(models, state, prediction)
        owner = association.owner
        state = update(models, state, prediction, association, reported)
        state = initiate(models, state, prediction, owner, raw, reported)
        state = _with_noise(state, prediction.registration)
        state = with_launch_points(models, state, prediction.span_s)
        state = with_burn_ends(models, state)
        return prune(models, state, lines, owner, association.existence)

    def _assessed(self, state: TrackerState, step_s: float) -> TrackerState:
        """Return the state with the probabilities of what each track is, a tick of a length after
        the last one.
        """
        table = state.table
        motion = table.motion
        is_settled = False not in motion.is_decided
        if is_settled and not motion.are_launches(state.time_s).any():
            return state
        pause_s = self.models.longest(self.models.period_s, table)
        silent_s = self.models.silent_s(table, state.time_s)
        motion = self.models.areas.assessed(
            motion,
            state.time_s,
            step_s,
            first_s=table.first_s,
            seen_s=table.seen_s,
            pause_s=pause_s,
            silent_s=silent_s,
            is_rocket=_move_as_rockets(table.estimates.likelier_state),
        )
        if motion.epoch_s is not table.motion.epoch_s:
            place_m = table.estimates.likelier_position_m
            motion = motion.moved_on(table.motion, place_m, state.time_s)
        return state._replace(table=table.changed(motion=motion))

    def _standing(self, state: TrackerState) -> TrackerState:
        """Return the state with the tracks that are ground sources for good where they stand,
        whatever the filter says.

        Lines of what rises from there leave their gate and initiate a track of their own.
        """
        table = state.table
        motion = table.motion
        rows = standing(motion).nonzero()[0]
        if not rows.size:
            return state
        kinds = np.array(grounds(self.config.hypotheses.inland_share))
        where = table.motion.take(rows).of_all_lines().inertial_places(kinds, WIDE_M, state.time_s)
        drift_m_s = self.config.hypotheses.ground_drift_m_s
        still = standing_estimates(table.estimates.take(rows), *where, drift_m_s, self.config)
        return state._replace(table=table.with_estimates(table.estimates.put(rows, still)))

    def track_numbers(self, state: TrackerState, lines: LinesOfSight) -> IntArray:
        """Return the track number (n,) of each line of sight of the next tick, -1 for none."""
        return track_numbers(self.models, state, lines)

    def reported_tracks(self, state: TrackerState) -> ReportedTracks:
        """Return the confirmed tracks and those that ended since the last tick."""
        tracks = self.confirmed_and_ended(state)
        table = tracks.table
        mean, covariance = self.models.moments(table.estimates)
        added = self.models.shared_covariance(state, table)
        if added is not None:
            covariance = covariance + added
        is_brief = self.are_brief(tracks, state.time_s)
        reports = self.models.memo.of_column("reports", self._log_reports, table.reports)
        return ReportedTracks(state.time_s, table, mean, covariance, is_brief, reports, tracks.end)

    def _log_reports(self, reports: IntArray) -> FloatArray:
        """Return the log likelihoods (n, H) of the sensors' reports (n, sensors)."""
        types = type_evidence(reports, self.type_log_likelihood)
        return hypothesis_log_likelihood(types, self.hypotheses, TARGET_TYPES)

    def are_brief(self, ended: EndedTracks, time_s: float) -> BoolArray:
        """Return which tracks (n,) went out, or go on silent for too long, before their looks could
        tell a launch.
        """
        table = ended.table
        silent_s = self.models.silent_s(table, time_s)
        silent = silent_s > self.models.longest(self.models.silence_limit_s, table)
        are_over = np.where(ended.end > 0, ended.end >= FLASH, silent)
        if True not in are_over:
            return are_over
        return are_over & are_brief(table.motion, table.first_s, table.seen_s)

    def confirmed_and_ended(self, state: TrackerState) -> EndedTracks:
        """Return the confirmed tracks and those that ended since the last tick, by number; `end` is
        0 if not yet.
        """
        table = state.table
        tracks = EndedTracks(table, np.zeros(table.number.size, dtype=np.uint8))
        confirmed = self.models.confirmed(state)
        if False in confirmed:
            tracks = tracks.take(confirmed.nonzero()[0])
        if state.ended is None:
            return tracks
        tracks = state.ended.and_others(tracks)
        return tracks.take(np.argsort(tracks.table.number, kind="stable"))


def _with_noise(state: TrackerState, before: Registration) -> TrackerState:
    """Return the state with covariances of tracks as wide as the noise that a slice has shown."""
    table = state.table
    factor = state.registration.widening(before, table.seen)
    if factor is None:
        return state
    return state._replace(table=table.with_estimates(table.estimates.widened(factor)))


def _slice_ends(start_s: float, end_s: float, slice_s: float) -> list[float]:
    """Return the ends of equal slices no longer than `slice_s`."""
    span_s = end_s - start_s
    count = max(1, ceil(span_s / slice_s - 1e-9))
    return [start_s + span_s * number / count for number in range(1, count)] + [end_s]


def _move_as_rockets(state: FloatArray) -> BoolArray:
    """Return which states (n, 6), inertial, climb faster over the ground than aircraft fly."""
    velocity_m_s = air_velocity(state)
    is_climbing = dot(state[:, :3], velocity_m_s) > 0.0
    return is_climbing & (dot(velocity_m_s, velocity_m_s) > FASTEST_AIRCRAFT_M_S**2)
