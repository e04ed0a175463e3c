"""The latest detections, as columns to choose by and lines to send: bounded, the oldest give way."""

import threading
from collections.abc import Sequence

import numpy as np
from attrs import frozen

from opir_core.arrays import BoolArray, IntArray
from opir_core.interfaces.records import Detections


@frozen(kw_only=True)
class Wanted:
    """Which detections are wanted; None means any. Times are Unix microseconds, `sensors` indices."""

    sensors: tuple[int, ...] | None = None
    types: tuple[int, ...] | None = None
    track: int | None = None
    since_us: int | None = None
    until_us: int | None = None
    confidence: float | None = None


class History:
    """The latest `size` detections; sequence numbers count all that ever came, from 0."""

    def __init__(self, size: int) -> None:
        self._size = size
        self._lines: list[bytes] = [b""] * size
        self._time_us = np.zeros(size, dtype=np.int64)
        self._sensor = np.zeros(size, dtype=np.int32)
        self._type = np.zeros(size, dtype=np.uint8)
        self._track = np.zeros(size, dtype=np.int64)
        self._confidence = np.zeros(size)
        self._lock = threading.Lock()
        #: The number of detections that ever came.
        self.total = 0

    def add(self, found: Detections, time_us: IntArray, lines: Sequence[bytes]) -> None:
        """Take detections with their Unix times and encoded lines, in order."""
        rows = slice(max(0, len(lines) - self._size), None)
        kept = lines[rows]
        with self._lock:
            self.total += len(lines)
            place = np.arange(self.total - len(kept), self.total) % self._size
            self._time_us[place], self._sensor[place] = time_us[rows], found.sensor[rows]
            self._type[place], self._track[place] = found.reported_type[rows], found.track[rows]
            self._confidence[place] = found.confidence[rows]
            for at, line in zip(place.tolist(), kept, strict=True):
                self._lines[at] = line

    def page(self, wanted: Wanted, before: int | None, limit: int) -> tuple[list[bytes], int | None]:
        """Return the newest `limit` lines wanted, newest first, and where the page before them begins, or None."""
        with self._lock:
            oldest = max(0, self.total - self._size)
            end = self.total if before is None else min(before, self.total)
            number = np.arange(oldest, max(end, oldest))
            if wanted != Wanted():
                number = number[self._is_wanted(wanted, number % self._size)]
            chosen = number[-limit:]
            lines = [self._lines[at] for at in (chosen[::-1] % self._size).tolist()]
        return lines, int(chosen[0]) if len(number) > limit else None

    def _is_wanted(self, wanted: Wanted, place: IntArray) -> BoolArray:
        keep: BoolArray = np.ones(len(place), dtype=np.bool_)
        if wanted.sensors is not None:
            keep &= np.isin(self._sensor[place], wanted.sensors)
        if wanted.types is not None:
            keep &= np.isin(self._type[place], wanted.types)
        if wanted.track is not None:
            keep &= self._track[place] == wanted.track
        if wanted.since_us is not None:
            keep &= self._time_us[place] >= wanted.since_us
        if wanted.until_us is not None:
            keep &= self._time_us[place] < wanted.until_us
        if wanted.confidence is not None:
            keep &= self._confidence[place] >= wanted.confidence
        return keep
