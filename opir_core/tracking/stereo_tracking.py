"""The tracker `stereo-filter`: association, track management and the switching filter, slice by slice.

What is known is one frozen `Situation`; a step makes a new one. So late detections are taken in by going back to the
situation before them and stepping forward again: the result is that of their having been in time.
"""

from collections.abc import Callable, Iterator
from typing import Any, TypeVar

import numpy as np
from attrs import evolve, field, frozen

from opir_core.flight.forces import Forces, forces_of
from opir_core.geometry import ecef_to_geodetic
from opir_core.protocols import TrackerContext
from opir_core.records import Detections, FloatArray, IntArray, Tracks
from opir_core.tracking import initiation, upkeep
from opir_core.tracking.association import (
    Associated,
    Chances,
    as_owned,
    associate_joint,
    associate_nearest,
    crowded,
    related,
    scan_numbers,
)
from opir_core.tracking.biases import Biases
from opir_core.tracking.configs import StereoFilterConfig
from opir_core.tracking.gating import Pairs, candidates, gated
from opir_core.tracking.ghosts import RANGE_M, Slice, without_ghosts
from opir_core.tracking.ground_points import GroundPoints, surer
from opir_core.tracking.launch_points import launches
from opir_core.tracking.outlook import Outlook
from opir_core.tracking.rays import Rays, alike, no_rays, no_sights
from opir_core.tracking.stereo_report import estimates, evidence_of
from opir_core.tracking.switching_filter import Bank, SwitchingFilter
from opir_core.tracking.track_priors import filter_of, first_bank

#: A settled assignment may reach this much farther than the first gate, in standard deviations.
_SETTLING_GATE = 6.0


#: Rays are assigned anew where a slice moved a track by more than this share of one look's error.
_RESTLESS = 0.3

#: A track's launch is worked out as long as it is no older than this, s.
_YOUNG_S = 10.0


_Answer = TypeVar("_Answer")

_NONE = np.empty(0, dtype=np.int64)


@frozen(eq=False)
class Situation:
    """All a tracker knows at a time: estimates, roster, recent rays that belong to no track, and the next number."""

    time_s: float
    bank: Bank
    roster: upkeep.Roster
    pool: Rays
    reported: IntArray
    next_number: int = 0


@frozen(eq=False)
class StereoTracking:
    """How one situation leads to the next."""

    config: StereoFilterConfig
    filter: SwitchingFilter
    chances: Chances
    period_s: FloatArray
    biases: Biases
    light_time: bool
    forces: Forces
    evidence: FloatArray
    #: The last bank moved, and the last one looked out from and held against rays: labels and estimates ask the same.
    last: dict[str, tuple[Bank, float, Any]] = field(factory=dict)
    met: list[tuple[Outlook, float, Rays, Pairs]] = field(factory=list)

    @classmethod
    def of(cls, config: StereoFilterConfig, context: TrackerContext) -> "StereoTracking":
        """Return the tracking of a scene's sensors."""
        chance = [np.mean(list(sensor.detection_probability.values()) or [0.8]) for sensor in context.sensors]
        return cls(
            config=config,
            filter=filter_of(config, context),
            chances=Chances(np.clip(np.array(chance, dtype=np.float64), 0.05, 0.98), config.false_alarms_per_sr),
            period_s=np.array([sensor.scan.period_ns * 1e-9 for sensor in context.sensors]),
            biases=Biases.of(context.sensors),
            light_time=context.light_time,
            forces=forces_of(context.forces),
            evidence=evidence_of(context.sensors),
        )

    def start(self) -> Situation:
        """Return the situation before the first detection."""
        roster = upkeep.Roster.of(len(self.period_s))
        return Situation(0.0, Bank.empty(), roster, no_rays(), np.empty(0, dtype=np.int64))

    def stepped(self, now: Situation, tick_s: float, detections: Detections) -> Situation:
        """Return the situation at a tick, with the detections since the last one."""
        time_s = detections.time_s
        for end in _slice_ends(now.time_s, tick_s, min(self.config.slice_s, self.config.cadence_s)):
            rows = slice(*np.searchsorted(time_s, [now.time_s, end if end < tick_s else np.inf]))
            part = detections.take(rows)
            now = self._sliced(now, end, self.biases.widened(Rays.of(part)), part.reported_type.astype(np.int64))
        return now

    def _moved(self, bank: Bank, step_s: float) -> Bank:
        return self._remembered("moved", self.filter.moved, bank, step_s)

    def _outlook(self, bank: Bank, time_s: float) -> Outlook:
        return self._remembered("outlook", self.filter.outlook, bank, time_s)

    def _remembered(self, name: str, way: Callable[[Bank, float], _Answer], bank: Bank, value: float) -> _Answer:
        known = self.last.get(name)
        if known is None or known[0] is not bank or known[1] != value:
            known = self.last[name] = bank, value, way(bank, value)
        answer: _Answer = known[2]
        return answer

    def _sliced(self, now: Situation, end_s: float, rays: Rays, reported: IntArray) -> Situation:
        span = end_s - now.time_s
        bank = self._moved(now.bank, span)
        owner = np.full(len(rays), -1, dtype=np.int64)
        if len(bank) and len(rays):
            bank, owner = self.followed(bank, end_s, rays, span)
        elif len(bank):
            bank = self.filter.updated(bank, end_s, no_sights(), span)
        roster = now.roster.seen(owner, rays.time_s, rays.sensor.astype(np.int64), reported)
        free = np.flatnonzero(owner < 0)
        pool = Rays.concatenate([now.pool, rays.take(free)]) if len(free) else now.pool
        told = np.concatenate([now.reported, reported[free]])
        fresh = np.flatnonzero(end_s - pool.time_s <= self.config.recent_scans * self.period_s[pool.sensor] + span)
        then = evolve(now, time_s=end_s, bank=bank, roster=roster, pool=pool.take(fresh), reported=told[fresh])
        return self._kept(self._launched(self._begun(then)), rays, owner)

    def _launched(self, now: Situation) -> Situation:
        """Return the situation with what the young tracks' paths say of their launches."""
        young = np.flatnonzero((now.time_s - now.roster.begun_s <= _YOUNG_S) & (now.bank.weight[:, 0] > 0.5))
        if not len(young):
            return now
        told = now.roster.take(young)
        outlook = self.filter.outlook(now.bank.take(young), now.time_s)
        fresh = launches(outlook, told.first_s, self._slowest(told), self.config.jerk_noise_m_s3)
        best = surer(GroundPoints(told.launch, told.launch_covariance), fresh)
        launch, covariance = now.roster.launch.copy(), now.roster.launch_covariance.copy()
        launch[young], covariance[young] = best
        return evolve(now, roster=evolve(now.roster, launch=launch, launch_covariance=covariance))

    def followed(self, bank: Bank, end_s: float, rays: Rays, span: float) -> tuple[Bank, IntArray]:
        """Return the bank with a slice's rays taken in, and the row that each ray was given to.

        The rays are assigned anew by the estimates they led to, until nothing changes or `settling` says stop: among
        near targets a whole slice tells more than one scan does.
        """
        pairs = self._paired(self._outlook(bank, end_s), rays, span)
        found = self._associated(pairs, rays)
        after = self.filter.updated(bank, end_s, found.sights, span)
        busy = self._restless(bank, after, pairs, rays) if self.config.settling else _NONE
        if not len(busy):
            return after, found.owner
        return self._settled(bank, after, end_s, rays, span, pairs, busy, found.owner)

    def _restless(self, bank: Bank, after: Bank, pairs: Pairs, rays: Rays) -> IntArray:
        """Return the tracks that have rivals, of clusters in which a track moved enough for other rays to be its."""
        rivals = crowded(pairs, rays)
        shift = after.take(rivals).likelier_position_m - bank.take(rivals).likelier_position_m
        far = np.sqrt(np.sum(shift * shift, axis=1)) > _RESTLESS * rays.sigma_rad.max(initial=0.0) * RANGE_M
        return rivals[related(pairs, rivals[far])[rivals]]

    def _settled(
        self,
        bank: Bank,
        after: Bank,
        end_s: float,
        rays: Rays,
        span: float,
        pairs: Pairs,
        busy: IntArray,
        owner: IntArray,
    ) -> tuple[Bank, IntArray]:
        """Return bank and owners with the rays of the tracks `busy`, which have rivals, assigned anew."""
        place = np.full(len(bank), -1, dtype=np.int64)
        place[busy] = np.arange(len(busy))
        rows = np.flatnonzero(place[pairs.track] >= 0)
        track, ray, before, then = place[pairs.track[rows]], pairs.ray[rows], bank.take(busy), after.take(busy)
        mine = place[owner]
        for turn in range(self.config.settling):
            outlook = self.filter.outlook(then, end_s)
            closer = gated(outlook, rays, track, ray, _SETTLING_GATE, self.light_time)
            found = self._associated(closer, rays)
            if turn == 0:
                found = self._unghosted(before, end_s, closer, rays, found)
            if np.array_equal(found.owner, mine):
                break
            mine = found.owner
            then = self.filter.updated(before, end_s, found.sights, span)
        others = np.where((owner >= 0) & (place[owner] < 0), owner, -1)
        return after.put(busy, then), np.where(mine >= 0, busy[mine], others)

    def _unghosted(self, bank: Bank, end_s: float, pairs: Pairs, rays: Rays, found: Associated) -> Associated:
        """Return the association with the rays of one sensor exchanged where that explains the slice better."""
        used = found.owner[pairs.ray] == pairs.track
        known = Slice(self.filter, self.chances, self.light_time, bank, end_s, rays)
        better = without_ghosts(known, pairs, used)
        return found if np.array_equal(better, used) else as_owned(pairs, rays, better)

    def _paired(self, outlook: Outlook, rays: Rays, span: float) -> Pairs:
        """Return the gated pairs of all tracks and the rays of a span; the same question twice is worked out once."""
        if self.met:
            before, reach, known, pairs = self.met[0]
            if before is outlook and reach == span and alike(known, rays):
                return pairs
        gate = self.config.gate_sigma
        pairs = gated(outlook, rays, *candidates(outlook, rays, span, gate, self.light_time), gate, self.light_time)
        self.met[:] = [(outlook, span, rays, pairs)]
        return pairs

    def _associated(self, pairs: Pairs, rays: Rays) -> Associated:
        way = associate_joint if self.config.association == "joint" else associate_nearest
        return way(pairs, rays, self.chances)

    def _begun(self, now: Situation) -> Situation:
        """Return the situation with tracks begun where unclaimed rays show a target."""
        if len(now.pool) < self.config.needed_scans:
            return now
        begun = initiation.beginnings(now.pool, self.config.needed_scans)
        if not len(begun):
            return now
        bank = first_bank(begun, now.time_s, self.config)
        span = now.time_s - float(now.pool.time_s.min())
        outlook = self.filter.outlook(bank, now.time_s)
        found = associate_nearest(self._paired(outlook, now.pool, span), now.pool, self.chances)
        bank = self.filter.updated(bank, now.time_s, found.sights, span)
        return self._joined(now, bank, found.owner)

    def _joined(self, now: Situation, bank: Bank, owner: IntArray) -> Situation:
        """Return the situation with those new tracks that got their rays, numbered in order."""
        hits = np.bincount(owner[owner >= 0], minlength=len(bank))
        good = np.flatnonzero(hits >= self.config.needed_scans)
        row = np.full(len(bank) + 1, -1, dtype=np.int64)
        row[good] = np.arange(len(good))
        owner = row[owner]
        count, sensors = len(good), len(self.period_s)
        fresh = upkeep.Roster.fresh(np.arange(now.next_number, now.next_number + count), now.time_s, sensors)
        fresh = fresh.seen(owner, now.pool.time_s, now.pool.sensor.astype(np.int64), now.reported)
        left = np.flatnonzero(owner < 0)
        return evolve(
            now,
            bank=Bank.concatenate([now.bank, bank.take(good)]),
            roster=upkeep.Roster.concatenate([now.roster, fresh]),
            pool=now.pool.take(left),
            reported=now.reported[left],
            next_number=now.next_number + count,
        )

    def _kept(self, now: Situation, rays: Rays, owner: IntArray) -> Situation:
        """Return the situation without doubles and without tracks that are lost or came to nothing."""
        if not len(now.bank):
            return now
        state, covariance = self.filter.moments(now.bank)
        known = now.roster.hits >= 0
        scan = scan_numbers(rays.sensor, rays.scan)
        drop = upkeep.doubles(state[:, :3], state, covariance, owner, scan, now.roster.hits)
        patience = self.config.recent_scans * self._slowest(now.roster)
        drop |= upkeep.came_to_nothing(now.roster, now.time_s, 3 * self.config.needed_scans, patience)
        height = ecef_to_geodetic(state[:, :3]).height_m
        config = self.config
        drop |= upkeep.lost(now.roster, covariance, height, now.time_s, config.silence_s, config.lost_sigma_m)
        keep = np.flatnonzero(known & ~drop)
        if len(keep) == len(now.bank):
            return now
        return evolve(now, bank=now.bank.take(keep), roster=now.roster.take(keep))

    def _slowest(self, roster: upkeep.Roster) -> FloatArray:
        """Return the longest scan period of the sensors that saw each track, s."""
        slowest: FloatArray = np.max(np.where(roster.reports >= 0, self.period_s, 0.0), axis=1, initial=0.0)
        return slowest

    def told(self, now: Situation) -> Tracks:
        """Return what is told of the tracks seen often enough."""
        sure = np.flatnonzero(now.roster.hits >= 2 * self.config.needed_scans)
        bank, roster = now.bank.take(sure), now.roster.take(sure)
        biased = self.biases.covariance(bank.likelier_position_m, now.time_s, roster.reports >= 0)
        return estimates(self.filter, bank, roster, now.time_s, self.forces, self.evidence, biased)

    def nearest(self, now: Situation, rays: Rays) -> IntArray:
        """Return the number of the track (n,) that each ray is likeliest to belong to; -1 for none.

        Rays of one sensor and one instant are weighed against each other, and no others: whatever part of the scene is
        asked for at once, these are in it together.
        """
        number = np.full(len(rays), -1, dtype=np.int64)
        if not len(now.bank) or not len(rays):
            return number
        ahead = now.time_s + self.config.cadence_s
        outlook = self._outlook(self._moved(now.bank, self.config.cadence_s), ahead)
        pairs = self._paired(outlook, rays, self.config.cadence_s)
        sure = now.roster.hits >= 2 * self.config.needed_scans
        pairs = pairs.take(np.flatnonzero(sure[pairs.track]))
        owner = associate_nearest(
            pairs, evolve(rays, scan=np.round(rays.time_s * 1e9).astype(np.int64)), self.chances
        ).owner
        known = owner >= 0
        number[known] = now.roster.number[owner[known]]
        return number


def _slice_ends(start_s: float, end_s: float, slice_s: float) -> Iterator[float]:
    """Yield the ends of equal slices no longer than `slice_s`."""
    count = max(1, int(np.ceil((end_s - start_s) / slice_s - 1e-9)))
    for number in range(1, count):
        yield start_s + (end_s - start_s) * number / count
    yield end_s
