"""The tracker `stereo-filter`: association, track management, the IMM filter; each slice makes a new `TrackerState`.

All that the tracker `stereo-filter` knows at a time, as one frozen record: a step makes a new one.

So late detections are taken in by going back to the situation before them and stepping forward again: the result is
that of their having been in time.
"""

from collections.abc import Iterator
from math import ceil

import numpy as np
from attrs import evolve, field, frozen

from opir_core.arrays import FloatArray, IntArray
from opir_core.estimation.lines_of_sight import LinesOfSight, no_rays, no_sights
from opir_core.flight.forces import Forces, forces_of
from opir_core.interfaces.contexts import TrackerContext
from opir_core.interfaces.records import Detections, Tracks
from opir_trackers import initiation
from opir_trackers.association import Chances, associate_nearest, nobody, plain
from opir_trackers.configs import StereoFilterConfig
from opir_trackers.filter.estimates import ModeEstimates
from opir_trackers.filter.mode_mixing import SPEED_SIGMA_M_S
from opir_trackers.filter.switching import ImmFilter
from opir_trackers.ground_points import GroundPoints, launches, renewed
from opir_trackers.sensors import Biases
from opir_trackers.stereo import track_management
from opir_trackers.stereo.associate_and_update import AssociateAndUpdate, AssociationResult
from opir_trackers.stereo.ghosts import RANGE_M
from opir_trackers.stereo.histories import (
    LONGEST_S,
    Histories,
    asked,
    kept,
    lasting_s,
    mean_sights,
    slice_sights,
    turned,
)
from opir_trackers.stereo.history_assignment import decided
from opir_trackers.stereo.report import estimates, evidence_of, free_flights, type_posterior
from opir_trackers.stereo.track_management import SharedDetections, TrackTable, doubles, remembered_s
from opir_trackers.track_priors import filter_of, first_bank


@frozen(eq=False)
class TrackerState:
    """All a tracker knows at a time: estimates, roster, recent rays that belong to no track, and the next number.

    `doubtful` are the numbers of tracks that may have others' histories, and what is told of them; `recent` says in
    which scans tracks were seen lately.
    """

    time_s: float
    bank: ModeEstimates
    roster: TrackTable
    pool: LinesOfSight
    reported: IntArray
    histories: Histories = field(factory=Histories.none)
    doubtful: tuple[IntArray, ModeEstimates] = field(
        factory=lambda: (np.empty(0, dtype=np.int64), ModeEstimates.empty())
    )
    next_number: int = 0
    recent: SharedDetections = field(factory=SharedDetections.empty)

    def after(self, time_s: float, bank: ModeEstimates, roster: TrackTable, histories: Histories) -> "TrackerState":
        """Return the situation at a time with its tracks as they are then."""
        known = self.doubtful, self.next_number, self.recent
        return TrackerState(time_s, bank, roster, self.pool, self.reported, histories, *known)

    @classmethod
    def first(cls, sensors: int) -> "TrackerState":
        """Return the situation before the first detection, of a scene with so many sensors."""
        return cls(0.0, ModeEstimates.empty(), TrackTable.of(sensors), no_rays(), np.empty(0, dtype=np.int64))


#: A track's launch is worked out as long as it is no older than this, s.
_YOUNG_S = 10.0

_NOBODY = np.array([-1])


@frozen(eq=False)
class StereoTracking:
    """How one situation leads to the next."""

    config: StereoFilterConfig
    filter: ImmFilter
    following: AssociateAndUpdate
    period_s: FloatArray
    biases: Biases
    forces: Forces
    evidence: FloatArray
    boost_lasts_s: float
    memory_s: FloatArray
    patience_s: FloatArray

    @classmethod
    def of(cls, config: StereoFilterConfig, context: TrackerContext) -> "StereoTracking":
        """Return the tracking of a scene's sensors."""
        chance = [np.mean(list(sensor.detection_probability.values()) or [0.8]) for sensor in context.sensors]
        chances = Chances(np.clip(np.array(chance, dtype=np.float64), 0.05, 0.98), config.false_alarms_per_sr)
        period_s = np.array([sensor.scan.period_ns * 1e-9 for sensor in context.sensors])
        look_m = RANGE_M * max((sensor.line_of_sight_sigma_rad for sensor in context.sensors), default=0.0)
        filter_, biases = filter_of(config, context), Biases.of(context.sensors)
        return cls(
            config=config,
            filter=filter_,
            following=AssociateAndUpdate(config, filter_, chances, context.light_time, biases),
            period_s=period_s,
            biases=biases,
            forces=forces_of(context.forces),
            evidence=evidence_of(context.sensors),
            boost_lasts_s=min(lasting_s(config.jerk_noise_m_s3, look_m, float(period_s.min(initial=1.0))), LONGEST_S),
            memory_s=remembered_s(period_s, min(config.slice_s, config.cadence_s), config.recent_scans),
            patience_s=track_management.patience_s(context.sensors, config.recent_scans),
        )

    def start(self) -> TrackerState:
        """Return the situation before the first detection."""
        return TrackerState.first(len(self.period_s))

    def rays_of(self, detections: Detections) -> LinesOfSight:
        """Return the rays of detections, as uncertain as noise and biases make them."""
        return self.biases.widened(LinesOfSight.of(detections))

    def stepped(
        self, now: TrackerState, tick_s: float, detections: Detections, known: LinesOfSight | None = None
    ) -> TrackerState:
        """Return the situation at a tick, with the detections since the last one, whose rays may be `known`."""
        rays = self.rays_of(detections) if known is None else known
        reported = detections.reported_type.astype(np.int64)
        ends = list(_slice_ends(now.time_s, tick_s, min(self.config.slice_s, self.config.cadence_s)))
        if len(ends) == 1 and (not len(rays.time_s) or rays.time_s[0] >= now.time_s):
            return self._sliced(now, tick_s, rays, reported)
        cuts = np.searchsorted(rays.time_s, [now.time_s, *ends[:-1], np.inf]).tolist()
        for end, first, last in zip(ends, cuts[:-1], cuts[1:], strict=True):
            now = self._sliced(now, end, rays.take(slice(first, last)), reported[first:last])
        return now

    def _sliced(self, now: TrackerState, end_s: float, rays: LinesOfSight, reported: IntArray) -> TrackerState:
        span = end_s - now.time_s
        then, owner = self.followed(now, end_s, rays)
        if len(owner):
            roster = then.roster.seen(owner, rays.time_s, rays.sensor, reported)
            then = then.after(end_s, then.bank, roster, then.histories)
        then = self._pooled(then, rays, owner, reported, span)
        return self._kept(self._launched(self._begun(then)), rays, owner)

    def _pooled(
        self, now: TrackerState, rays: LinesOfSight, owner: IntArray, reported: IntArray, span: float
    ) -> TrackerState:
        """Return the situation with the rays that belong to no track in the pool, and those too old for it out."""
        is_free = owner < 0
        if not len(now.pool.time_s) and not np.count_nonzero(is_free):
            return now
        free = np.flatnonzero(is_free)
        pool = LinesOfSight.concatenate([now.pool, rays.take(free)]) if len(free) else now.pool
        told = np.concatenate([now.reported, reported[free]])
        recent_s = self.config.recent_scans * self.period_s[pool.sensor] + span
        fresh = np.flatnonzero(now.time_s - pool.time_s <= recent_s)
        return evolve(now, pool=pool.take(fresh), reported=told[fresh])

    def followed(self, now: TrackerState, end_s: float, rays: LinesOfSight) -> tuple[TrackerState, IntArray]:
        """Return the situation with a slice's rays taken in by the tracks there are, and whose row each ray is."""
        span, owner = end_s - now.time_s, nobody(len(rays.time_s))
        if not len(now.bank.weight):
            return evolve(now, time_s=end_s), owner
        bank = self.following.moved(now.bank, span)
        histories = now.histories.moved(self.filter.moved, span)
        if not len(owner):
            after = self.filter.updated(bank, end_s, no_sights(), span)
            after = self.filter.completed(after, bank, now.bank, span)
            return now.after(end_s, after, now.roster, histories), owner
        young = now.roster.number.searchsorted(histories.number)
        told = self.following.followed(bank, end_s, rays, span, young, now.roster)
        roster = now.roster if told.strays is None else now.roster.with_strays(told.strays)
        bank = self.filter.completed(told.bank, bank, now.bank, span)
        now = now.after(end_s, bank, roster, histories)
        return self._decided(now, told, young, rays, span), told.owner

    def _decided(
        self, now: TrackerState, told: AssociationResult, rows: IntArray, rays: LinesOfSight, span: float
    ) -> TrackerState:
        """Return the situation with the histories of tracks `rows` where they belong, as far as that can be told."""
        known = now.histories
        if not len(known.number):
            return now
        before, age = now.bank.part(rows), now.time_s - known.begun_s
        path = self.following.outlook(before, now.time_s)
        seen = slice_sights(path, told, rows, rays, self.following.chances, span)
        known, bank = turned(self.filter, known.seen(*seen), before, now.time_s)
        found = decided(self.filter, known, bank, now.time_s, self.biases.sigma_rad, asked(known, age, span))
        known, boosts = found.histories, bank.weight[:, 0] > 0.5
        stays = kept(known, age, boosts, self.boost_lasts_s)
        open_ = np.flatnonzero(stays & (known.doubt > 0.0))
        return evolve(
            now,
            bank=now.bank if found.bank is before else now.bank.put(rows, found.bank),
            histories=known.of(stays),
            doubtful=(known.number[open_], found.told.take(open_)),
        )

    def estimated(self, now: TrackerState) -> ModeEstimates:
        """Return the estimates to tell: of a track that may have another's history, all it may have mixed."""
        number, told = now.doubtful
        if not len(number):
            return now.bank
        here = np.flatnonzero(np.isin(number, now.roster.number))
        rows = np.searchsorted(now.roster.number, number[here])
        return now.bank.put(rows, told.take(here)) if len(here) else now.bank

    def _launched(self, now: TrackerState) -> TrackerState:
        """Return the situation with what the young tracks' paths say of their launches."""
        fresh = now.time_s - now.roster.begun_s <= _YOUNG_S
        if not np.count_nonzero(fresh):
            return now
        young = np.flatnonzero(fresh & (now.bank.weight[:, 0] > 0.5))
        if not len(young):
            return now
        told, bank = now.roster.part(young), now.bank.part(young)
        outlook, noise = self.following.outlook(bank, now.time_s), self.config.jerk_noise_back_m_s3
        sure = not self.biases.any
        biased = None if sure else self.biases.covariance(bank.likelier_position_m, now.time_s, told.reports >= 0)
        found = launches(outlook, told.first_s, self._longest(self.period_s, told), noise, biased)
        launch, covariance = now.roster.launch.copy(), now.roster.launch_covariance.copy()
        launch[young], covariance[young] = renewed(GroundPoints(told.launch, told.launch_covariance), found)
        return now.after(now.time_s, now.bank, now.roster.with_launches(launch, covariance), now.histories)

    def _begun(self, now: TrackerState) -> TrackerState:
        """Return the situation with tracks begun where unclaimed rays show a target."""
        if len(now.pool.time_s) < self.config.needed_scans:
            return now
        shown = initiation.beginnings(now.pool, self.config.needed_scans, self.biases.sigma_rad)
        if not len(shown.begun):
            return now
        first, span = first_bank(shown.begun, now.time_s, self.config), now.time_s - float(now.pool.time_s.min())
        pairs = self.following.paired(self.filter.outlook(first, now.time_s), now.pool, span)
        pairs = pairs.take(np.flatnonzero(shown.owned(pairs.track, pairs.ray, now.pool.sensor[pairs.ray])))
        found = associate_nearest(pairs, now.pool, self.following.chances)
        bank = self.filter.updated(first, now.time_s, found.sights, span)
        return self._joined(now, first, AssociationResult(bank, found.owner, found.own, pairs))

    def _joined(self, now: TrackerState, first: ModeEstimates, told: AssociationResult) -> TrackerState:
        """Return the situation with those new tracks that got their rays, numbered in order."""
        hits = np.bincount(told.owner[told.owner >= 0], minlength=len(first))
        good = hits >= self.config.needed_scans
        row = np.append(np.where(good, np.cumsum(good) - 1, -1), -1)
        owner, count = row[told.owner], int(good.sum())
        number = np.arange(now.next_number, now.next_number + count)
        fresh = track_management.TrackTable.fresh(number, now.time_s, len(self.period_s))
        fresh = fresh.seen(owner, now.pool.time_s, now.pool.sensor, now.reported)
        left = np.flatnonzero(owner < 0)
        path = self.filter.outlook(told.bank, now.time_s)
        sensor = now.pool.sensor[told.own.ray].astype(np.int64)
        seen = mean_sights(path, plain(told.own), sensor, self.config.slice_s)
        begun = Histories(np.arange(len(first)), np.full(len(first), now.time_s), first, *seen).of(good)
        return evolve(
            now,
            bank=ModeEstimates.concatenate([now.bank, told.bank.take(np.flatnonzero(good))]),
            roster=track_management.TrackTable.concatenate([now.roster, fresh]),
            pool=now.pool.take(left),
            reported=now.reported[left],
            histories=now.histories.joined(evolve(begun, number=number)),
            next_number=now.next_number + count,
        )

    def _kept(self, now: TrackerState, rays: LinesOfSight, owner: IntArray) -> TrackerState:
        """Return the situation without doubles and without tracks that are lost or came to nothing."""
        if not len(now.bank.weight):
            return now
        (state, covariance), roster = self.following.moments(now.bank), now.roster
        config, place, needed = self.config, state[:, :3], 3 * self.config.needed_scans
        silent_s = now.time_s - roster.seen_s
        drop = silent_s > config.silence_s
        vague, low = track_management.are_vague(covariance, config.lost_sigma_m), track_management.are_low(place)
        loose = covariance[:, 3, 3] + covariance[:, 4, 4] + covariance[:, 5, 5] > SPEED_SIGMA_M_S**2
        if roster.hits.min() < needed or np.count_nonzero(vague | low | loose):
            rows = loose.nonzero()[0]
            if len(rows):
                now = evolve(now, bank=self.following.restrained(now.bank, rows))
            unseen = silent_s > self._longest(self.patience_s, roster)
            drop |= track_management.idle(roster, vague, needed, unseen)
            drop |= low & track_management.came_down(place, covariance, unseen)
        if len(state) > 1:
            now = evolve(now, recent=now.recent.after(roster.number, owner, rays, now.time_s, self.memory_s))
            wider = self._with_biases(now.bank, now.time_s, roster, covariance)
            fast = track_management.are_too_fast(state[:, 3:])
            # The covariance of a track that is nowhere may be nothing that can be solved with.
            wider[fast] = np.eye(6)
            drop |= fast | doubles(roster.number, state, wider, now.recent, roster.hits)
        if not np.count_nonzero(drop):
            return now
        keep = (~drop).nonzero()[0]
        histories = now.histories.of(np.isin(now.histories.number, roster.number[keep]))
        return evolve(now, bank=now.bank.take(keep), roster=roster.take(keep), histories=histories)

    def _longest(self, time_s: FloatArray, roster: track_management.TrackTable) -> FloatArray:
        """Return the longest of times (sensors,) of the sensors that saw each track (n,), s."""
        longest: FloatArray = np.max(np.where(roster.reports >= 0, time_s, 0.0), axis=1, initial=0.0)
        return longest

    def told(self, now: TrackerState) -> Tracks:
        """Return what is told of the tracks seen often enough."""
        sure = now.roster.hits >= 2 * self.config.needed_scans
        bank, roster = self.estimated(now), now.roster
        if np.count_nonzero(sure) < len(sure):
            bank, roster = bank.take(sure), roster.take(sure)
        state, covariance = self.following.moments(bank)
        if self.biases.any:
            covariance = self._with_biases(bank, now.time_s, roster, covariance)
        is_free = free_flights(self.filter, bank)
        return estimates(state, covariance, is_free, roster, now.time_s, self.forces, self._types(roster))

    def _with_biases(
        self, bank: ModeEstimates, time_s: float, roster: track_management.TrackTable, covariance: FloatArray
    ) -> FloatArray:
        """Return covariances (n, 6, 6) with what the sensors' biases add to the positions."""
        wider = covariance.copy()
        wider[:, :3, :3] += self.biases.covariance(bank.likelier_position_m, time_s, roster.reports >= 0)
        return wider

    def _types(self, roster: track_management.TrackTable) -> FloatArray:
        """Return the probabilities (n, types) of tracks' types, worked out anew where a report is new."""
        reports, evidence = roster.reports, self.evidence
        return self.following.remembered("types", lambda one, _: type_posterior(one, evidence), reports, 0.0)

    def nearest(self, now: TrackerState, rays: LinesOfSight) -> IntArray:
        """Return the number of the track (n,) that each ray is likeliest to belong to; -1 for none.

        Rays of one sensor and one instant are weighed against each other, and no others: whatever part of the scene is
        asked for at once, these are in it together.
        """
        if not len(now.bank.weight) or not len(rays.time_s):
            return nobody(len(rays.time_s))
        ahead = now.time_s + self.config.cadence_s
        moved = self.following.moved(now.bank, self.config.cadence_s)
        outlook = self.following.blurred(moved, ahead, now.roster.reports)
        pairs = self.following.paired(outlook, rays, self.config.cadence_s)
        sure = now.roster.hits >= 2 * self.config.needed_scans
        if np.count_nonzero(sure) < len(sure):
            pairs = pairs.take(np.flatnonzero(sure[pairs.track]))
        owner = self.following.nearest(pairs, rays.of_instants()).owner
        return np.concatenate([now.roster.number, _NOBODY])[owner]


def _slice_ends(start_s: float, end_s: float, slice_s: float) -> Iterator[float]:
    """Yield the ends of equal slices no longer than `slice_s`."""
    count = max(1, ceil((end_s - start_s) / slice_s - 1e-9))
    for number in range(1, count):
        yield start_s + (end_s - start_s) * number / count
    yield end_s
