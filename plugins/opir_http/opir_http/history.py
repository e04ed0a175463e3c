"""The latest detections, as columns to filter and encoded lines; a bounded number."""

import threading
from collections.abc import Sequence

import numpy as np
from attrs import frozen

from opir_core.arrays import BoolArray, IntArray
from opir_core.plugin import Detections


@frozen(kw_only=True)
class Filter:
    """A filter of detections; None matches any value. Times are Unix microseconds, `sensors`
    indices.
    """

    sensors: tuple[int, ...] | None = None
    types: tuple[int, ...] | None = None
    track: int | None = None
    since_us: int | None = None
    until_us: int | None = None
    confidence: float | None = None


class History:
    """The latest `size` detections; sequence numbers count all detections of the run, from 0."""

    def __init__(self, size: int) -> None:
        self._size = size
        self._lines: list[bytes] = [b""] * size
        self._time_us = np.zeros(size, dtype=np.int64)
        self._sensor = np.zeros(size, dtype=np.int32)
        self._type = np.zeros(size, dtype=np.uint8)
        self._track = np.zeros(size, dtype=np.int64)
        self._confidence = np.zeros(size)
        self._lock = threading.Lock()
        #: Number of detections added so far.
        self.total = 0

    def add(self, detections: Detections, time_us: IntArray, lines: Sequence[bytes]) -> None:
        """Add detections with their Unix times and encoded lines, in order."""
        rows = slice(max(0, len(lines) - self._size), None)
        newest = lines[rows]
        with self._lock:
            self.total += len(lines)
            place = np.arange(self.total - len(newest), self.total) % self._size
            self._time_us[place] = time_us[rows]
            self._sensor[place] = detections.sensor[rows]
            self._type[place] = detections.reported_type[rows]
            self._track[place] = detections.track[rows]
            self._confidence[place] = detections.confidence[rows]
            for at, line in zip(place.tolist(), newest, strict=True):
                self._lines[at] = line

    def between(self, number: int, end: int, limit: int | None) -> tuple[list[bytes], int]:
        """Return at most `limit` lines after the first `number` detections and up to the first
        `end`, and how many before them are lost.
        """
        with self._lock:
            first = min(max(number, self.total - self._size), end)
            last = end if limit is None else min(first + limit, end)
            return [self._lines[at % self._size] for at in range(first, last)], first - number

    def page(self, criteria: Filter, end: int | None, limit: int) -> tuple[list[bytes], int | None]:
        """Return the newest `limit` selected lines, newest first, and the sequence number of the
        next page, or None.
        """
        with self._lock:
            oldest = max(0, self.total - self._size)
            stop = self.total if end is None else min(end, self.total)
            number = np.arange(oldest, max(stop, oldest))
            if criteria != Filter():
                number = number[self._is_selected(criteria, number % self._size)]
            newest = number[-limit:]
            lines = [self._lines[at] for at in (newest[::-1] % self._size).tolist()]
        return lines, int(newest[0]) if len(number) > limit else None

    def _is_selected(self, criteria: Filter, place: IntArray) -> BoolArray:
        keep: BoolArray = np.ones(len(place), dtype=np.bool_)
        if criteria.sensors is not None:
            keep &= np.isin(self._sensor[place], criteria.sensors)
        if criteria.types is not None:
            keep &= np.isin(self._type[place], criteria.types)
        if criteria.track is not None:
            keep &= self._track[place] == criteria.track
        if criteria.since_us is not None:
            keep &= self._time_us[place] >= criteria.since_us
        if criteria.until_us is not None:
            keep &= self._time_us[place] < criteria.until_us
        if criteria.confidence is not None:
            keep &= self._confidence[place] >= criteria.confidence
        return keep
