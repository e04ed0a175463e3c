"""The tracker `imm`: association, track management and the IMM filter, as steps of one frozen `TrackerState`.

Each slice makes a new state. Late detections are processed by returning to the state before them and stepping again, so
the result is the same as if they had arrived in time.
"""

from bisect import bisect_right
from collections.abc import Iterator
from math import ceil

import numpy as np
from attrs import evolve, frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.flight import Forces, forces_of
from opir_core.interfaces import TRACK_ENDS
from opir_core.plugin import TARGET_TYPES, Detections, Hypothesis, TrackerContext
from opir_trackers import initiation
from opir_trackers.association import AssociationModel, associate_nearest, unassigned
from opir_trackers.configs import ImmConfig
from opir_trackers.filter.estimates import ModeEstimates
from opir_trackers.filter.mode_mixing import SPEED_SIGMA_M_S
from opir_trackers.filter.switching import ImmFilter
from opir_trackers.forecast.outcomes import Outcomes, hypothesis_log_likelihood
from opir_trackers.forecast.vehicles import vehicle_model
from opir_trackers.gating import GatedPairs
from opir_trackers.imm import crowds as crowd, registering, track_management
from opir_trackers.imm.associate_and_update import AssociateAndUpdate
from opir_trackers.imm.renewal import renewed
from opir_trackers.imm.report import ReportedTracks, tracks_of, type_evidence, type_log_likelihoods
from opir_trackers.imm.single_sensor import SingleSensor
from opir_trackers.imm.state import EndedTracks, TrackerState
from opir_trackers.imm.track_management import duplicates, sighting_memory_s
from opir_trackers.launch_points import LaunchDelayPrior, LaunchPoints, delays_at_once, launches, updated_points
from opir_trackers.lines_of_sight import LinesOfSight, earth_rotated, emission_s, no_measurements
from opir_trackers.onset.motion_priors import GROUND_SIGMA_M, WIDE_M
from opir_trackers.onset.motion_statistics import MotionStatistics
from opir_trackers.onset.posterior import GroupPosterior
from opir_trackers.registration.registration import Registration, registration_of
from opir_trackers.sensors import Biases, clutter_per_sr
from opir_trackers.track_priors import filter_of, first_motion, prior_estimates, standing_estimates

#: The launch point is estimated for tracks no older than this, s.
_YOUNG_S = 10.0

_NOBODY, _NONE = np.array([-1]), np.empty(0, dtype=np.int64)

#: Codes of ends.
IMPACT, LOST = TRACK_ENDS.index("impact"), TRACK_ENDS.index("lost")


@frozen(eq=False)
class ImmTracking:
    """The transition from one `TrackerState` to the next."""

    config: ImmConfig
    needed_scans: int
    filter: ImmFilter
    association: AssociateAndUpdate
    period_s: FloatArray
    biases: Biases
    registration: Registration
    forces: Forces
    type_log_likelihood: FloatArray
    memory_s: FloatArray
    silence_limit_s: FloatArray
    groups: GroupPosterior
    hypotheses: tuple[Hypothesis, ...]
    single: SingleSensor

    @classmethod
    def of(cls, config: ImmConfig, context: TrackerContext) -> "ImmTracking":
        """Return the tracking of a scene's sensors."""
        chance = [
            np.mean(list(sensor.detection_probability.values()) or [track_management.UNSTATED])
            for sensor in context.sensors
        ]
        model = AssociationModel(track_management.clipped(chance), config.false_alarms_per_sr)
        period_s = np.array([sensor.scan.period_ns * 1e-9 for sensor in context.sensors])
        filter_, biases = filter_of(config, context), Biases.of(context.sensors, config.clock_sigma_s)
        return cls(
            config=config,
            needed_scans=config.needed_scans or needed_scans(period_s),
            filter=filter_,
            association=AssociateAndUpdate(config, filter_, model, context.light_time, biases),
            period_s=period_s,
            biases=biases,
            registration=registration_of(config, context.sensors),
            forces=forces_of(context.forces),
            type_log_likelihood=type_log_likelihoods(context.sensors),
            memory_s=sighting_memory_s(period_s, min(config.slice_s, config.cadence_s), config.recent_scans),
            silence_limit_s=track_management.longest_silence_s(context.sensors, config.recent_scans),
            groups=GroupPosterior.of(
                config.hypotheses, clutter_per_sr(context, config.false_alarms_per_sr), model.detection_probability
            ),
            hypotheses=context.hypotheses,
            single=SingleSensor(
                Outcomes(vehicle_model(config.boost_prior), context.hypotheses), filter_, biases, period_s
            ),
        )

    def start(self) -> TrackerState:
        """Return the state before the first detection."""
        return TrackerState.first(len(self.period_s), self.registration)

    def lines_of_sight(self, detections: Detections) -> LinesOfSight:
        """Return the lines of sight of detections."""
        return LinesOfSight.of(detections)

    def stepped(
        self, now: TrackerState, tick_s: float, detections: Detections, cached: LinesOfSight | None = None
    ) -> TrackerState:
        """Return the state at a tick, after the detections since the last one; `cached` are their lines of sight."""
        lines = self.lines_of_sight(detections) if cached is None else cached
        now = now if now.ended is None else evolve(now, ended=None)
        is_idle = now.is_empty
        if is_idle and not len(lines.time_s):
            return evolve(now, time_s=tick_s)
        reported = detections.reported_type.astype(np.int64)
        ends = list(_slice_ends(now.time_s, tick_s, min(self.config.slice_s, self.config.cadence_s)))
        if is_idle:
            idle = bisect_right(ends, lines.time_s.min())
            now, ends = evolve(now, time_s=[now.time_s, *ends][idle]), ends[idle:]
        if len(ends) == 1 and (not len(lines.time_s) or lines.time_s[0] >= now.time_s):
            return self._standing(self._assessed(self._after_slice(now, tick_s, lines, reported)))
        cuts = np.searchsorted(lines.time_s, [now.time_s, *ends[:-1], np.inf]).tolist()
        for end, first, last in zip(ends, cuts[:-1], cuts[1:], strict=True):
            now = self._after_slice(now, end, lines.take(slice(first, last)), reported[first:last])
        return self._standing(self._assessed(now))

    def _assessed(self, now: TrackerState) -> TrackerState:
        """Return the state with the probabilities of what each track is."""
        table, motion = now.table, now.motion
        if not len(motion) or motion.is_decided.all():
            return now
        pause_s = self._longest_of_sensors(self.period_s, table)
        motion = self.groups.assessed(motion, now.time_s, table.first_s, table.seen_s, pause_s)
        return now.after(now.time_s, now.estimates, table, motion)

    def _standing(self, now: TrackerState) -> TrackerState:
        """Return the state with the tracks that are ground sources for good where they stand, whatever the filter says.

        Lines of what rises from there leave their gate and initiate a track of their own.
        """
        rows = np.flatnonzero(now.motion.is_decided & now.motion.stands)
        if not len(rows):
            return now
        where = self._static_estimates(now.motion.take(rows), now.time_s)
        drift_m_s = self.config.hypotheses.ground_drift_m_s
        still = standing_estimates(now.estimates.take(rows), *where, drift_m_s, self.config)
        return evolve(now, estimates=now.estimates.put(rows, still))

    def _static_estimates(self, motion: MotionStatistics, time_s: float) -> tuple[FloatArray, FloatArray]:
        """Return inertial positions (n, 3) and covariances (n, 3, 3) of sources that stand on the ground."""
        position, covariance = motion.static_estimates(GROUND_SIGMA_M, WIDE_M)
        turn = earth_rotated(np.eye(3), np.full(3, time_s)).T
        return position @ turn.T, turn @ covariance @ turn.T

    def _after_slice(self, now: TrackerState, end_s: float, lines: LinesOfSight, reported: IntArray) -> TrackerState:
        """Return the state after a slice."""
        span = end_s - now.time_s
        right = registering.corrected(self.association, now.registration, lines)
        then, owner = self.associated(now, end_s, right)
        if len(owner):
            table = then.table.with_detections(owner, lines.time_s, lines.sensor, reported)
            motion = then.motion.with_lines(owner, right, self.groups.log_clutter)
            estimates = self.single.with_ascents(then.estimates, table, motion, then.table.seen_s, end_s)
            then = then.after(end_s, estimates, table, motion)
        then, claimed = registering.with_explained(self.association, then, right, owner, span)
        then = self._with_unclaimed(then, lines, claimed, reported, span)
        then = self._pruned(self._with_launch_points(self._with_initiated(then)), lines, owner)
        if not then.crowds.are_there:
            return then
        then = evolve(then, crowds=crowd.pruned(then.crowds, end_s, self.period_s))
        return renewed(then, self.association.view(then.registration), self.filter, self.config)

    def _with_unclaimed(
        self, now: TrackerState, lines: LinesOfSight, owner: IntArray, reported: IntArray, span: float
    ) -> TrackerState:
        """Return the state with the unassigned lines added, and old ones removed."""
        is_free = owner < 0
        if not len(now.unclaimed.time_s) and not np.count_nonzero(is_free):
            return now
        free = np.flatnonzero(is_free)
        unclaimed = LinesOfSight.concatenate([now.unclaimed, lines.take(free)]) if len(free) else now.unclaimed
        types = np.concatenate([now.reported, reported[free]])
        recent_s = self.config.recent_scans * self.period_s[unclaimed.sensor] + span
        fresh = np.flatnonzero(now.time_s - unclaimed.time_s <= recent_s)
        return evolve(now, unclaimed=unclaimed.take(fresh), reported=types[fresh])

    def associated(self, now: TrackerState, end_s: float, lines: LinesOfSight) -> tuple[TrackerState, IntArray]:
        """Return the state with a slice's lines associated with the tracks, and the track row of each line."""
        span, owner = end_s - now.time_s, unassigned(len(lines.time_s))
        if not len(now.estimates.weight):
            return evolve(now, time_s=end_s), owner
        estimates = self.association.predicted(now.estimates, span)
        if not len(owner):
            after = self.filter.updated(estimates, end_s, no_measurements(), span)
            after = self.filter.with_open_coast(after, estimates, now.estimates, span)
            return now.after(end_s, after, now.table), owner
        known = now.table, now.crowds, now.registration
        result = self.association.updated_tracks(estimates, end_s, lines, span, *known)
        table = now.table if result.outliers is None else now.table.with_outliers(result.outliers)
        estimates = self.filter.with_open_coast(result.estimates, estimates, now.estimates, span)
        then = now.after(end_s, estimates, table)
        then = then if result.crowds is now.crowds else evolve(then, crowds=result.crowds)
        then = registering.registered_state(self.association, then, result.assigned, lines, result.pairs)
        return then, result.owner

    def _with_launch_points(self, now: TrackerState) -> TrackerState:
        """Return the state with the launch points of young tracks."""
        fresh = now.time_s - now.table.begun_s <= _YOUNG_S
        if not np.count_nonzero(fresh):
            return now
        young = np.flatnonzero(fresh & (now.estimates.weight[:, 0] > 0.5))
        if not len(young):
            return now
        table, estimates = now.table.part(young), now.estimates.part(young)
        predicted, thrust = self.association.predicted_measurements(estimates, now.time_s), self.config.thrust
        place, seen = estimates.likelier_position_m, table.reports >= 0
        biased = registering.shared_covariance(self.association, now, estimates, table)
        first_s = emission_s(table.first_s, self.biases.ranges_m(place, now.time_s, seen), self.association.light_time)
        at_once = delays_at_once(self.period_s, self.association.model.detection_probability, seen)
        prior = LaunchDelayPrior(at_once, first_motion(predicted, first_s, seen.sum(axis=1) < 2, thrust))
        points = launches(
            predicted, first_s, prior, thrust.launch_noise_m_s2, None if biased is None else biased[:, :3, :3]
        )
        points.covariance[:, 2, 2] += self.config.clock_sigma_s**2
        launch, covariance = now.table.launch.copy(), now.table.launch_covariance.copy()
        launch[young], covariance[young] = updated_points(LaunchPoints(table.launch, table.launch_covariance), points)
        return now.after(now.time_s, now.estimates, now.table.with_launches(launch, covariance))

    def _with_initiated(self, now: TrackerState) -> TrackerState:
        """Return the state with tracks initiated from unassigned lines."""
        if len(now.unclaimed.time_s) < self.needed_scans:
            return now
        lines = registering.corrected(self.association, now.registration, now.unclaimed)
        initiation_ = initiation.track_candidates(lines, self.needed_scans, now.registration.loose_rad)
        if not len(initiation_.begun):
            return now
        first, span = (
            prior_estimates(initiation_.begun, now.time_s, self.config),
            now.time_s - float(lines.time_s.min()),
        )
        pairs = self.association.gated_pairs(self.filter.predicted_measurements(first, now.time_s), lines, span)
        pairs = pairs.take(np.flatnonzero(initiation_.owned(pairs.track, pairs.line, lines.sensor[pairs.line])))
        association = associate_nearest(pairs, lines, self.association.model)
        estimates = self.filter.updated(first, now.time_s, association.measurements, span)
        return self._with_new_tracks(now, first, estimates, association.owner)

    def _with_new_tracks(
        self, now: TrackerState, first: ModeEstimates, after: ModeEstimates, lines_of: IntArray
    ) -> TrackerState:
        """Return the state with the new tracks that have enough lines, numbered in order."""
        hits = np.bincount(lines_of[lines_of >= 0], minlength=len(first))
        good = hits >= self.needed_scans
        row = np.append(np.where(good, np.cumsum(good) - 1, -1), -1)
        owner, count = row[lines_of], int(good.sum())
        number = np.arange(now.next_number, now.next_number + count)
        fresh = track_management.TrackTable.fresh(number, now.time_s, len(self.period_s))
        fresh = fresh.with_detections(owner, now.unclaimed.time_s, now.unclaimed.sensor, now.reported)
        lines = registering.corrected(self.association, now.registration, now.unclaimed)
        motion = MotionStatistics.fresh(first.likelier_position_m[good], now.time_s, fresh.first_s, self.groups.prior)
        motion = motion.with_lines(owner, lines, self.groups.log_clutter)
        left = np.flatnonzero(owner < 0)
        then = evolve(
            now,
            estimates=ModeEstimates.concatenate([now.estimates, after.take(np.flatnonzero(good))]),
            table=track_management.TrackTable.concatenate([now.table, fresh]),
            unclaimed=now.unclaimed.take(left),
            reported=now.reported[left],
            next_number=now.next_number + count,
            motion=MotionStatistics.concatenate([now.motion, motion]),
        )
        return self._with_neighbours(then, count)

    def _with_neighbours(self, now: TrackerState, fresh: int) -> TrackerState:
        """Return the state with the last `fresh` tracks, and those near them, in a crowd, where several are near."""
        seen = now.table.reports >= 0
        rows = crowd.begun_near(now.estimates.likelier_position_m, fresh, seen) if fresh else _NONE
        rows = rows[~now.crowds.holds(now.table.number[rows])]
        if not len(rows):
            return now
        path = self.filter.predicted_measurements(now.estimates, now.time_s)
        view = self.association.view(now.registration)
        return evolve(now, crowds=crowd.joined(now.crowds, now.table.number, rows, path, seen, view))

    def _pruned(self, now: TrackerState, lines: LinesOfSight, owner: IntArray) -> TrackerState:
        """Return the state without duplicate, lost and unconfirmed tracks, and those of false alarms."""
        if not len(now.estimates.weight):
            return now
        (state, covariance), table = self.association.moments(now.estimates), now.table
        config, place, needed = self.config, state[:, :3], 3 * self.needed_scans
        silent_s = now.time_s - table.seen_s
        drop = (silent_s > config.silence_s) | (now.motion.is_decided & now.motion.are_noise)
        down = np.zeros(len(table), dtype=np.bool_)
        uncertain, below_ground = (
            track_management.are_uncertain(covariance, config.lost_sigma_m),
            track_management.are_below_ground(place),
        )
        fast_uncertain = covariance[:, 3, 3] + covariance[:, 4, 4] + covariance[:, 5, 5] > SPEED_SIGMA_M_S**2
        if table.hits.min() < needed or np.count_nonzero(uncertain | below_ground | fast_uncertain):
            rows = fast_uncertain.nonzero()[0]
            if len(rows):
                now = evolve(now, estimates=self.association.with_velocity_prior(now.estimates, rows))
            rows = (below_ground & (now.estimates.weight[:, 0] > 0.5)).nonzero()[0]
            if len(rows):
                now = evolve(now, estimates=self.filter.above_ground(now.estimates, rows))
            unseen = silent_s > self._longest_of_sensors(self.silence_limit_s, table)
            drop |= track_management.are_idle(table, uncertain, needed, unseen)
            down = below_ground & track_management.have_come_down(place, covariance, unseen)
            drop |= down
        if len(state) > 1:
            now = evolve(now, sightings=now.sightings.after(table.number, owner, lines, now.time_s, self.memory_s))
            added = registering.shared_covariance(self.association, now, now.estimates, table)
            wider = covariance.copy() if added is None else covariance + added
            fast = track_management.are_too_fast(state[:, 3:])
            # The covariance of a track that is nowhere may be nothing that can be solved with.
            wider[fast] = np.eye(6)
            are_fresh, seen = table.begun_s == now.time_s, table.reports >= 0
            drop |= fast | duplicates(table.number, state, wider, now.sightings, table.hits, seen, are_fresh)
        if not np.count_nonzero(drop):
            return now
        gone = np.flatnonzero(drop & self.confirmed(now))
        end = np.where(down[gone], IMPACT, LOST).astype(np.uint8)
        ended = EndedTracks(now.estimates.take(gone), table.take(gone), now.motion.take(gone), end)
        return evolve(now.without(drop), ended=ended.and_others(now.ended) if len(gone) else now.ended)

    def _longest_of_sensors(self, time_s: FloatArray, table: track_management.TrackTable) -> FloatArray:
        """Return the longest of times (sensors,) of the sensors that saw each track (n,), s."""
        longest: FloatArray = np.max(np.where(table.reports >= 0, time_s, 0.0), axis=1, initial=0.0)
        return longest

    def confirmed(self, now: TrackerState) -> BoolArray:
        """Return which tracks (n,) are reported: those with enough detections that are probably no false alarms."""
        return np.asarray((now.table.hits >= 2 * self.needed_scans) & ~now.motion.are_noise)

    def reported_tracks(self, now: TrackerState) -> ReportedTracks:
        """Return the confirmed tracks, without impacts, and what their forecast and composition need."""
        confirmed = self.confirmed(now)
        table, motion = now.table, now.motion
        estimates = now.estimates
        if now.crowds.are_there:
            estimates = now.crowds.mixtures.mixed(estimates, table.number, now.time_s)
        if np.count_nonzero(confirmed) < len(confirmed):
            estimates, table, motion = estimates.take(confirmed), table.take(confirmed), motion.take(confirmed)
        last = EndedTracks(estimates, table, motion, np.zeros(len(table), dtype=np.uint8))
        if now.ended is not None:
            last = now.ended.and_others(last)
            order = np.argsort(last.table.number, kind="stable")
            estimates, table, motion = last.estimates.take(order), last.table.take(order), last.motion.take(order)
            last = EndedTracks(estimates, table, motion, last.end[order])
        state, covariance = self.association.moments(estimates)
        added = registering.shared_covariance(self.association, now, estimates, table)
        if added is not None:
            covariance = covariance + added
        tracks = tracks_of(state, covariance, table, now.time_s)
        types = type_evidence(table.reports, self.type_log_likelihood)
        reports = hypothesis_log_likelihood(types, self.hypotheses, TARGET_TYPES)
        return ReportedTracks(tracks, estimates, reports, motion.probability, last.end)

    def track_numbers(self, now: TrackerState, lines: LinesOfSight) -> IntArray:
        """Return the track number (n,) of each line of sight, -1 for none.

        Only lines of one sensor and one instant compete, so the result does not depend on how the scene is cut into
        calls.
        """
        if not len(now.estimates.weight) or not len(lines.time_s):
            return unassigned(len(lines.time_s))
        ahead = now.time_s + self.config.cadence_s
        moved = self.association.predicted(now.estimates, self.config.cadence_s)
        lines = registering.corrected(self.association, now.registration, lines)
        predicted = self.association.with_bias_covariance(moved, ahead, now.table.reports, now.registration)
        if not now.crowds.are_there:
            pairs = self.association.gated_pairs(predicted, lines, self.config.cadence_s)
        else:
            pairs = self.association.lone_pairs(predicted, lines, self.config.cadence_s, now.table, now.crowds)
            theirs = crowd.label_pairs(
                now.crowds, now.table.number, lines, self.config.cadence_s, self.config.gate_sigma
            )
            pairs = GatedPairs.concatenate([pairs, theirs])
        confirmed = self.confirmed(now)
        if np.count_nonzero(confirmed) < len(confirmed):
            pairs = pairs.take(np.flatnonzero(confirmed[pairs.track]))
        owner = self.association.nearest_association(pairs, lines.of_instants()).owner
        return np.concatenate([now.table.number, _NOBODY])[owner]


#: Scans that a track needs, and the time, s, within which the fastest sensor must make them; else the fewest.
_NEEDED, _SOON_S, _FEWEST = 4, 4.0, 2


def needed_scans(period_s: FloatArray) -> int:
    """Return M of M-of-N track initiation for sensors with scan periods (n,), s.

    A track is reported after 2 M detections. At 10 s per scan four scans are most of a burn: of 30 launches before two
    sensors 21 were tracked, after 74 s in the median; with M = 2 all, after 31 s. What it costs: no false track in two
    hours with sensors that confirm their detections over scans. Where every false alarm is reported (two scanners, 17 a
    scan), 29 tracks of noise have enough detections in ten minutes; all are recognised as noise, and none is reported.
    """
    soon = _NEEDED * float(period_s.min(initial=np.inf)) <= _SOON_S
    return _NEEDED if soon else _FEWEST


def _slice_ends(start_s: float, end_s: float, slice_s: float) -> Iterator[float]:
    """Yield the ends of equal slices no longer than `slice_s`."""
    count = max(1, ceil((end_s - start_s) / slice_s - 1e-9))
    for number in range(1, count):
        yield start_s + (end_s - start_s) * number / count
    yield end_s
