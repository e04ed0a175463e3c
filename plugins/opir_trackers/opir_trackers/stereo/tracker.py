"""The tracker `stereo-filter` as scenes name it, with late detections.

Whose rays are that came before their tracks were sure: those of a track's beginning, and of before it.

A track's labels begin once it has been seen often enough; with sensors that look seldom most of a burn is over by then.
"""

from collections import deque

import numpy as np
from attrs import evolve

from opir_core.arrays import FloatArray, IntArray
from opir_core.estimation.lines_of_sight import LinesOfSight
from opir_core.interfaces.contexts import TrackerContext
from opir_core.interfaces.protocols import Sensor
from opir_core.interfaces.records import Detections, Tracks
from opir_trackers.association import associate_nearest, nobody
from opir_trackers.configs import StereoFilterConfig
from opir_trackers.gating import candidates, gated
from opir_trackers.sensors import LineOfSightCache, looks_a_second
from opir_trackers.stereo.measurement_weights import SHARES, Outliers
from opir_trackers.stereo.tracking import StereoTracking, TrackerState


def earlier_owners(tracking: StereoTracking, now: TrackerState, number: IntArray, rays: LinesOfSight) -> IntArray:
    """Return which of tracks by number (k,) each ray (n,) is of, -1 for none, judged by their paths followed back."""
    rows = np.flatnonzero(np.isin(now.roster.number, number))
    if not len(rows) or not len(rays.time_s):
        return nobody(len(rays.time_s))
    gate, light_time = tracking.config.gate_sigma, tracking.following.light_time
    path = tracking.filter.outlook(now.bank.take(rows), now.time_s)
    rays, span = tracking.biases.widened(rays), now.time_s - float(rays.time_s.min())
    pairs = gated(path, rays, *candidates(path, rays, span, gate, light_time), gate, light_time)
    owner = associate_nearest(pairs, rays, tracking.following.chances).owner
    whose: IntArray = np.append(now.roster.number[rows], -1)[owner]
    return whose


class StereoTracker:
    """The tracker `stereo-filter`."""

    def __init__(self, tracking: StereoTracking, context: TrackerContext) -> None:
        self.cadence_s: float | None = tracking.config.cadence_s
        self._tracking = tracking
        self._context = context
        self._now = tracking.start()
        self._past: deque[tuple[TrackerState, float, Detections]] = deque()
        self._early = Detections.empty()
        self._rays = LineOfSightCache(tracking.rays_of)

    def associate(self, detections: Detections) -> IntArray:
        """Return track numbers (n,), -1 for none, judged by the tracks as of the last tick; changes nothing."""
        return self._tracking.nearest(self._now, self._rays.of(detections))

    def step(self, tick_s: float, detections: Detections) -> Tracks:
        """Take in the detections since the last tick, and late ones, and return the estimates at this tick.

        With `late_s` above 0 they may come in any order, more than once, and before the tick that they are for.
        """
        if self._tracking.config.late_s:
            detections = self._due(tick_s, detections)
        late = self._rays.of(detections).time_s < self._now.time_s
        if np.count_nonzero(late):
            self._go_back(detections.take(np.flatnonzero(late)))
            detections = detections.take(np.flatnonzero(~late))
        self._advance(tick_s, detections)
        return self._tracking.told(self._now)

    def set_sensors(self, sensors: tuple[Sensor, ...]) -> None:
        """Take the sensors to be these from the last tick on: as many, with other settings.

        How often a target is seen while it burns changes as what its sensors promise does.
        """
        share = looks_a_second(sensors) / looks_a_second(self._context.sensors)
        self._context = evolve(self._context, sensors=sensors)
        self._tracking = StereoTracking.of(self._tracking.config, self._context)
        self._rays = LineOfSightCache(self._tracking.rays_of)
        pace = self._now.bank.pace * [share, 1.0, 1.0]
        self._now = evolve(self._now, bank=evolve(self._now.bank, pace=pace))

    def stray_shares(self, track: IntArray) -> FloatArray:
        """Return the shares (n,) of strays among the rays of tracks by number (n,), as known at the last tick."""
        roster = self._now.roster
        known = Outliers(np.concatenate([roster.strays, np.zeros((1, len(SHARES)))])).share
        row = np.searchsorted(roster.number, track)
        here = np.append(roster.number, -1)[row] == track
        return known[np.where(here, row, len(roster))]

    def owners(self, track: IntArray, rays: LinesOfSight) -> IntArray:
        """Return which of tracks by number (k,) each earlier ray (n,) is of, -1 for none, as known at the last tick."""
        return earlier_owners(self._tracking, self._now, track, rays)

    def _due(self, tick_s: float, detections: Detections) -> Detections:
        """Return, once each and in order, what is from before a tick, of these and of what waits; the rest waits."""
        every = _once_in_order(Detections.concatenate([self._early, detections]))
        due = int(np.searchsorted(every.time_s, tick_s))
        self._early = every.take(slice(due, None))
        return every.take(slice(due))

    def _advance(self, tick_s: float, detections: Detections) -> None:
        late_s = self._tracking.config.late_s
        if late_s:
            self._past.append((self._now, tick_s, detections))
            while self._past and self._past[0][1] <= tick_s - late_s:
                self._past.popleft()
        self._now = self._tracking.stepped(self._now, tick_s, detections, self._rays.of(detections))

    def _go_back(self, late: Detections) -> None:
        """Step again from before the late detections; those from before the remembered past are left out."""
        steps = [
            (before, tick_s, _with_late(known, late, before.time_s, tick_s)) for before, tick_s, known in self._past
        ]
        changed = (
            len(whole.time_ns) > len(known.time_ns)
            for (_, _, whole), (_, _, known) in zip(steps, self._past, strict=True)
        )
        first = next((number for number, more in enumerate(changed) if more), None)
        if first is None:
            return
        while len(self._past) > first:
            self._past.pop()
        self._now = steps[first][0]
        for _, tick_s, whole in steps[first:]:
            self._advance(tick_s, whole)


def _with_late(known: Detections, late: Detections, start_s: float, end_s: float) -> Detections:
    """Return a tick's detections with the late ones that are from its time."""
    mine = np.flatnonzero((late.time_s >= start_s) & (late.time_s < end_s))
    return _once_in_order(Detections.concatenate([known, late.take(mine)])) if len(mine) else known


def _once_in_order(detections: Detections) -> Detections:
    """Return detections once each, by time, then sensor, then what was measured: whatever the order they came in.

    Two of one sensor and instant in the same direction, to the last bit, are one that came twice.
    """
    line = detections.line_of_sight_ecef
    keys = (*line.T, detections.scan, detections.sensor, detections.time_ns)
    order = np.lexsort(keys)
    once = np.ones(len(order), dtype=np.bool_)
    once[1:] = np.any([key[order[1:]] != key[order[:-1]] for key in keys], axis=0)
    return detections.take(order[once])


def stereo_filter(config: StereoFilterConfig, context: TrackerContext) -> StereoTracker:
    """Return the tracker `stereo-filter`."""
    return StereoTracker(StereoTracking.of(config, context), context)
