"""What trackers take the sensors of a scene to be: how often each looks, and how likely it sees."""

from collections.abc import Sequence

import numpy as np
from attrs import frozen

from opir_core.arrays import BoolArray, FloatArray
from opir_core.interfaces.protocols import Sensor
from opir_core.scene.scene import TARGET_TYPES

#: The chance of detection of a sensor that states none for a type.
_UNSTATED = 0.5


@frozen(eq=False)
class SensorSchedule:
    """Scan periods (sensors,), s, chances of detection (sensors, types), spreads of bias (sensors,), and who follows.

    A sensor that `follows` bodies sees them after the burn too: of its end it tells nothing.
    """

    period_s: FloatArray
    chance: FloatArray
    bias_sigma_rad: FloatArray
    follows: BoolArray

    @classmethod
    def of(cls, sensors: Sequence[Sensor], *, least: float, most: float) -> "SensorSchedule":
        """Return the watch of a scene's sensors; what they state of their chances is believed from least to most."""
        chance = [[sensor.detection_probability.get(kind, _UNSTATED) for kind in TARGET_TYPES] for sensor in sensors]
        stated = np.array(chance, dtype=np.float64).reshape(len(sensors), len(TARGET_TYPES))
        return cls(
            period_s=np.array([sensor.scan.period_ns * 1e-9 for sensor in sensors]),
            chance=np.clip(stated, least, most),
            bias_sigma_rad=np.array([sensor.line_of_sight_bias_sigma_rad for sensor in sensors]),
            follows=np.array([sensor.follows_bodies for sensor in sensors], dtype=np.bool_),
        )


def looks_a_second(sensors: Sequence[Sensor]) -> float:
    """Return how many detections a second sensors promise of a target that all of them see, over all types alike."""
    watch = SensorSchedule.of(sensors, least=0.01, most=1.0)
    return float(np.sum(watch.chance.mean(axis=1) / watch.period_s))
