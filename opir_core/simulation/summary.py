"""What came of a run, in a few figures: counted window by window, so that no run is too long for it."""

from collections.abc import Iterable, Iterator, Mapping
from typing import Any

import numpy as np
from numpy.typing import NDArray

from opir_core.arrays import FloatArray, IndexArray, IntArray
from opir_core.interfaces.records import Window
from opir_core.planning.plan import Plan
from opir_core.scene.scene import EMITTER_TYPES, REPORTED_TYPES
from opir_core.simulation.track_summary import LatestTracks


class Tally:
    """Counts looks, detections and first detections while windows go by."""

    def __init__(self, plan: Plan) -> None:
        sensors, targets = len(plan.sensors), len(plan.targets.ids)
        self._plan = plan
        self._looks = 0
        self._tracks = 0
        self._latest = LatestTracks()
        self._noise = np.zeros(sensors, dtype=np.int64)
        self._detections = np.zeros((sensors, targets), dtype=np.int64)
        self._first_s = np.full((sensors, targets), np.inf)
        self._last_s = np.full((sensors, targets), -np.inf)
        self._reported = np.zeros((targets, len(REPORTED_TYPES)), dtype=np.int64)
        self._confidence = np.zeros(targets)

    def over(self, windows: Iterable[Window]) -> Iterator[Window]:
        """Yield the windows on, counting."""
        for window in windows:
            self.count(window)
            yield window

    def count(self, window: Window) -> None:
        """Take a window into account; its detections are sorted by time."""
        self._looks += window.looks
        self._tracks = max(self._tracks, int(window.tracks.track.max(initial=-1)) + 1)
        self._latest.take(window.tracks)
        found, target = window.detections, window.truth.target
        is_noise = target < 0
        columns: tuple[Any, ...] = (found.sensor, target, found.time_ns, found.reported_type, found.confidence)
        if is_noise.any():
            self._noise += np.bincount(found.sensor[is_noise], minlength=len(self._noise))
            # Of a window's many columns only those are thinned out that are counted.
            rows = np.flatnonzero(~is_noise)
            columns = tuple(column.take(rows) for column in columns)
        self._count(*columns)

    def _count(
        self,
        sensor: IndexArray,
        target: IndexArray,
        time_ns: IntArray,
        reported_type: NDArray[np.uint8],
        confidence: FloatArray,
    ) -> None:
        """Count detections (n,) of targets."""
        sensors, targets = self._detections.shape
        pair = sensor * targets + target
        time_s = time_ns * 1e-9
        self._detections += np.bincount(pair, minlength=sensors * targets).reshape(sensors, targets)
        # Of repeated places the last written stays: written backwards, that is each pair's first detection.
        first_s, last_s = np.full(sensors * targets, np.inf), np.full(sensors * targets, -np.inf)
        first_s[pair[::-1]], last_s[pair] = time_s[::-1], time_s
        np.minimum(self._first_s, first_s.reshape(sensors, targets), out=self._first_s)
        np.maximum(self._last_s, last_s.reshape(sensors, targets), out=self._last_s)
        types = self._reported.shape[1]
        reported = np.bincount(target * types + reported_type, minlength=targets * types)
        self._reported += reported.reshape(targets, types)
        np.maximum.at(self._confidence, target, confidence)

    def counts(self) -> Mapping[str, int]:
        """Return the run's totals."""
        return {
            "sensors": len(self._plan.sensors),
            "targets": len(self._plan.targets.ids),
            "looks": self._looks,
            "detections": int(self._detections.sum() + self._noise.sum()),
            "noise_detections": int(self._noise.sum()),
            "tracks": self._tracks,
        }

    def summary(self) -> Mapping[str, Any]:
        """Return the totals and a row for each sensor, target and track, as plain values."""
        return {
            "counts": self.counts(),
            "sensors": self._sensor_rows(),
            "targets": self._target_rows(),
            "tracks": self._latest.rows(),
        }

    def _sensor_rows(self) -> list[Mapping[str, Any]]:
        looks = np.bincount(self._plan.pairs.sensor, self._plan.pairs.looks, minlength=len(self._plan.sensors))
        return [
            {
                "sensor_id": sensor.id,
                "sensor_type": sensor.type,
                "looks": int(looks[row]),
                "detections": int(self._detections[row].sum() + self._noise[row]),
                "noise_detections": int(self._noise[row]),
                "targets_detected": int((self._detections[row] > 0).sum()),
            }
            for row, sensor in enumerate(self._plan.sensors)
        ]

    def _target_rows(self) -> list[Mapping[str, Any]]:
        return [self._target_row(row) for row in range(len(self._plan.targets.ids))]

    def _target_row(self, row: int) -> Mapping[str, Any]:
        targets, detections = self._plan.targets, self._detections[:, row]
        found = bool(detections.sum())
        first = int(self._first_s[:, row].argmin())
        first_s = float(self._first_s[first, row])
        reported = REPORTED_TYPES[int(self._reported[row].argmax())]
        return {
            "target_id": targets.ids[row],
            "target_type": EMITTER_TYPES[targets.type_code[row]],
            "ignition_s": float(targets.ignition_s[row]),
            "burnout_s": float(targets.burnout_s[row]),
            "detections": int(detections.sum()),
            "sensors": int((detections > 0).sum()),
            "first_detection_s": first_s if found else None,
            "first_sensor_id": self._plan.sensors[first].id if found else None,
            "latency_s": first_s - float(targets.ignition_s[row]) if found else None,
            "last_detection_s": float(self._last_s[:, row].max()) if found else None,
            "reported_type": reported if found else None,
            "highest_confidence": float(self._confidence[row]) if found else None,
        }
