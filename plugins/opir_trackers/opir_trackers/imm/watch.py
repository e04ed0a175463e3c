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

    def in_slice(
        self, end_s: float, span_s: float, visible: BoolArray, has_look: BoolArray
    ) -> LookTimes:
        """Return how long tracks (n,) were looked at in a slice of a length; of the sensors
        `visible` (n, sensors) of each, one at least, those that saw it, `has_look` (n, sensors),
        looked whatever they say.

        Else the looks of a sensor that never says where it looks would be those of the others.
        """
        start, end = self._until_s(np.array([end_s - span_s, end_s]))
        looked_s = np.where(visible, end - start, 0.0)
        looked_s[has_look & (looked_s == 0.0)] = span_s
        rate = np.where(visible, self.rate, 0.0)
        expected_s = np.sum(looked_s * rate, axis=1) / np.sum(rate, axis=1)
        return LookTimes(expected_s, looked_s.max(axis=1, initial=0.0))

    def silent_s(self, time_s: FloatArray, seen_s: FloatArray, visible: BoolArray) -> FloatArray:
        """Return for how long (n,), s, a sensor looked between times `seen_s` and `time_s` (n,):
        the longest of those that see each track.
        """
        looked_s = self._until_s(time_s) - self._until_s(seen_s)
        return np.where(visible, looked_s, 0.0).max(axis=1, initial=0.0)

    def _until_s(self, time_s: FloatArray) -> FloatArray:
        """Return the times (n, sensors) that the sensors looked before times (n,)."""
        return np.stack([sensor.watched_until_s(time_s) for sensor in self.sensors], axis=1)
