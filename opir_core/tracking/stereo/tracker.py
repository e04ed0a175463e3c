"""The tracker `stereo-filter` as scenes name it, with late detections."""

from collections import deque

import numpy as np

from opir_core.protocols import TrackerContext
from opir_core.records import Detections, FloatArray, IntArray, Tracks
from opir_core.tracking.configs import StereoFilterConfig
from opir_core.tracking.rays_of_last import RaysOfLast
from opir_core.tracking.stereo.situation import Situation
from opir_core.tracking.stereo.stray_rays import SHARES, Strays
from opir_core.tracking.stereo.tracking import StereoTracking


class StereoTracker:
    """The tracker `stereo-filter`."""

    def __init__(self, tracking: StereoTracking) -> None:
        self.cadence_s: float | None = tracking.config.cadence_s
        self._tracking = tracking
        self._now = tracking.start()
        self._past: deque[tuple[Situation, float, Detections]] = deque()
        self._rays = RaysOfLast(tracking.rays_of)

    def associate(self, detections: Detections) -> IntArray:
        """Return track numbers (n,), -1 for none, judged by the tracks as of the last tick; changes nothing."""
        return self._tracking.nearest(self._now, self._rays.of(detections))

    def step(self, tick_s: float, detections: Detections) -> Tracks:
        """Take in the detections since the last tick, and late ones, and return the estimates at this tick."""
        late = self._rays.of(detections).time_s < self._now.time_s
        if np.count_nonzero(late):
            self._go_back(detections.take(np.flatnonzero(late)))
            detections = detections.take(np.flatnonzero(~late))
        self._advance(tick_s, detections)
        return self._tracking.told(self._now)

    def stray_shares(self, track: IntArray) -> FloatArray:
        """Return the shares (n,) of strays among the rays of tracks by number (n,), as known at the last tick."""
        roster = self._now.roster
        known = Strays(np.concatenate([roster.strays, np.zeros((1, len(SHARES)))])).share
        row = np.searchsorted(roster.number, track)
        here = np.append(roster.number, -1)[row] == track
        return known[np.where(here, row, len(roster))]

    def _advance(self, tick_s: float, detections: Detections) -> None:
        late_s = self._tracking.config.late_s
        if late_s:
            self._past.append((self._now, tick_s, detections))
            while self._past and self._past[0][1] <= tick_s - late_s:
                self._past.popleft()
        self._now = self._tracking.stepped(self._now, tick_s, detections, self._rays.of(detections))

    def _go_back(self, late: Detections) -> None:
        """Step again from before the late detections; those from before the remembered past are left out."""
        steps = list(self._past)
        if not steps:
            return
        self._past.clear()
        earliest = late.time_s.min()
        again = next((k for k, (_, tick_s, _) in enumerate(steps) if earliest < tick_s), len(steps))
        self._past.extend(steps[:again])
        if again == len(steps):
            return
        self._now = steps[again][0]
        for _, tick_s, known in steps[again:]:
            mine = (late.time_s >= self._now.time_s) & (late.time_s < tick_s)
            self._advance(tick_s, _merged(known, late.take(np.flatnonzero(mine))))


def _merged(known: Detections, late: Detections) -> Detections:
    """Return all detections in the order in which they would have come."""
    every = Detections.concatenate([known, late])
    return every.take(np.lexsort((every.scan, every.sensor, every.time_ns)))


def stereo_filter(config: StereoFilterConfig, context: TrackerContext) -> StereoTracker:
    """Return the tracker `stereo-filter`."""
    return StereoTracker(StereoTracking.of(config, context))
