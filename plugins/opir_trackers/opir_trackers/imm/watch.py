"""What was looked at: only where a sensor looked does silence say that nothing shone."""

from collections.abc import Sequence

import numpy as np
from attrs import frozen
from opir_estimation import LookTimes

from opir_core.arrays import BoolArray, FloatArray
from opir_core.plugin import Sensor


@frozen(eq=False)
class LookSpans:
    """The looks of sensors that do not look throughout; `rate` (sensors,) are their detections a
    second of a target in view.
    """

    sensors: tuple[Sensor, ...]
    rate: FloatArray

    @classmethod
    def of(
        cls, sensors: Sequence[Sensor], period_s: FloatArray, detection_probability: FloatArray
    ) -> "LookSpans | None":
        """Return the looks of sensors, None where all look throughout."""
        if all(sensor.watched_s is None for sensor in sensors):
            return None
        return cls(tuple(sensors), detection_probability / period_s)

    def in_slice(self, start_s: float, end_s: float, visible: BoolArray) -> LookTimes:
        """Return how long the tracks (n,) of sensors `visible` (n, sensors) were looked at in a
        slice.
        """
        start, end = self._until_s(np.array([start_s, end_s]))
        looked_s = np.where(visible, end - start, 0.0)
        rate = np.where(visible, self.rate, 0.0)
        total = np.sum(rate, axis=1)
        expected_s = np.sum(looked_s * rate, axis=1) / np.where(total > 0.0, total, 1.0)
        span_s = end_s - start_s
        return LookTimes(
            np.where(total > 0.0, expected_s, span_s),
            np.where(total > 0.0, looked_s.max(axis=1, initial=0.0), span_s),
        )

    def silent_s(self, time_s: FloatArray, seen_s: FloatArray, visible: BoolArray) -> FloatArray:
        """Return for how long (n,), s, a sensor looked between times `seen_s` and `time_s` (n,):
        the longest of those that see each track.
        """
        looked_s = self._until_s(time_s) - self._until_s(seen_s)
        return np.where(visible, looked_s, 0.0).max(axis=1, initial=0.0)

    def _until_s(self, time_s: FloatArray) -> FloatArray:
        """Return the times (n, sensors) that the sensors looked before times (n,)."""
        return np.stack([sensor.watched_until_s(time_s) for sensor in self.sensors], axis=1)
