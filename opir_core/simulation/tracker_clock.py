"""Tracking on ticks of scene time: whatever the windows, a tracker sees the same detections at the same ticks."""

from collections.abc import Sequence

import numpy as np
from attrs import evolve, frozen

from opir_core.arrays import IntArray
from opir_core.interfaces.protocols import Sensor, Tracker
from opir_core.interfaces.records import Detections, Tracks

_NS = 1_000_000_000


@frozen(eq=False)
class Tracked:
    """A window's detections with their tracks, its ticks' estimates, and the estimates the detections point to."""

    detections: Detections
    tracks: Tracks
    estimates: Tracks


class ScheduledTracker:
    """Steps a tracker at whole multiples of its cadence and at the scene's end, and associates what lies between."""

    def __init__(self, tracker: Tracker, end_ns: int) -> None:
        self._tracker = tracker
        self._end_ns = end_ns
        self._cadence_ns = None if tracker.cadence_s is None else max(1, round(tracker.cadence_s * _NS))
        self._pending: list[Detections] = []
        self._in_force = Tracks.empty()

    def set_sensors(self, sensors: tuple[Sensor, ...]) -> None:
        """Tell the tracker, where it cares, that the sensors are these from here on: as many, with other settings."""
        told = getattr(self._tracker, "set_sensors", None)
        if told is not None:
            told(sensors)

    def absorb(self, detections: Detections, start_ns: int, end_ns: int) -> Tracked:
        """Take in the detections of [start, end), sorted by time."""
        if self._cadence_ns is None:
            return Tracked(detections, Tracks.empty(), Tracks.empty())
        edges = self._edges(start_ns, end_ns, self._cadence_ns)
        cuts = np.searchsorted(detections.time_ns, edges)
        associated, told, in_force, rows = [], [], [], 0
        for number, edge in enumerate(edges[1:]):
            part = self._associated(detections.take(slice(cuts[number], cuts[number + 1])), rows)
            associated.append(part)
            in_force.append(self._in_force)
            rows += len(self._in_force)
            told += self._stepped(edge)
        parts = (Detections.concatenate(associated), Tracks.concatenate(told), Tracks.concatenate(in_force))
        return Tracked(*parts)

    def _edges(self, start_ns: int, end_ns: int, cadence_ns: int) -> Sequence[int]:
        inner = range((start_ns // cadence_ns + 1) * cadence_ns, end_ns, cadence_ns)
        return [start_ns, *inner, end_ns]

    def _associated(self, detections: Detections, offset: int) -> Detections:
        seen = as_trackers_see(detections)
        track = self._tracker.associate(seen) if len(detections) else np.empty(0, dtype=np.int64)
        self._pending.append(evolve(seen, track=track))
        return evolve(detections, track=track, estimate=_rows_of(self._in_force.track, track, offset))

    def _stepped(self, edge_ns: int) -> list[Tracks]:
        assert self._cadence_ns is not None
        if edge_ns % self._cadence_ns and edge_ns < self._end_ns:
            return []
        # What came in one piece is passed on as it came: trackers then know the arrays they were asked about before.
        since = self._pending[0] if len(self._pending) == 1 else Detections.concatenate(self._pending)
        self._in_force, self._pending = self._tracker.step(edge_ns / _NS, since), []
        return [self._in_force]


def as_trackers_see(detections: Detections) -> Detections:
    """Return detections without what the simulator knows of them and no sensor does.

    A count of one target's detections says which of them belong together, and the confidence holds that count and the
    true elevation: to a tracker the counts are 0 and the confidences nan.
    """
    count = len(detections)
    return evolve(detections, detection_count=np.zeros(count, dtype=np.int32), confidence=np.full(count, np.nan))


def _rows_of(known: IntArray, track: IntArray, offset: int) -> IntArray:
    """Return where tracks stand among the known ones (which are sorted), counted from `offset`, or -1."""
    if not len(known):
        return np.full(len(track), -1, dtype=np.int64)
    place = np.minimum(np.searchsorted(known, track), len(known) - 1)
    return np.where(known[place] == track, place + offset, -1)
