"""Detections per sensor and second of the last two minutes, counted exactly."""

import threading
from collections.abc import Sequence
from typing import Any

import numpy as np

from opir_core.arrays import IndexArray, IntArray

#: Time covered, s.
SECONDS = 120


class Activity:
    """Counts of detections by sensor and second of detection, for the last `seconds`; bounded."""

    def __init__(self, sensor_ids: Sequence[str], seconds: int = SECONDS) -> None:
        self._ids = tuple(sensor_ids)
        self._seconds = seconds
        self._counts: dict[int, IntArray] = {}
        self._lock = threading.Lock()

    def add(self, sensor: IndexArray, time_us: IntArray) -> None:
        """Add detections by the index of their sensor and their Unix time, microseconds; both
        (n,).
        """
        second = time_us // 1_000_000
        with self._lock:
            for key in np.unique(second).tolist():
                count = np.bincount(sensor[second == key], minlength=len(self._ids))
                self._counts[key] = self._counts.get(key, 0) + count
            newest = max(self._counts, default=0)
            for old in [key for key in self._counts if key <= newest - self._seconds - 1]:
                del self._counts[old]

    def document(self, now_us: int | None = None) -> dict[str, Any]:
        """Return the first second, Unix time, and for each sensor the counts of all seconds from it
        up to `now_us`.

        Without `now_us` up to the last detection.
        """
        with self._lock:
            end = max(self._counts, default=0) if now_us is None else now_us // 1_000_000
            seconds = range(end - self._seconds, end + 1)
            zeros = np.zeros(len(self._ids), dtype=np.int64)
            table = np.stack([self._counts.get(second, zeros) for second in seconds])
        columns = table.T.tolist()
        return {"first_s": seconds[0], "sensors": dict(zip(self._ids, columns, strict=True))}
