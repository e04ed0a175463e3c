"""Rays of detections, worked out once: a tracker's labels and its estimates ask for the same.

What trackers take the sensors of a scene to be: how often each looks, and how likely it sees.

What the constant biases of sensors add to an estimate: they are not estimated, and do not average out.

A filter that takes single lines of sight for as wide as noise and bias together neither loses biased rays nor trusts
them too much at once; what it gains by averaging, the bias takes back. So the covariance of the place that biased rays
meet in is added to what is told (a consider analysis after Schmidt; Tapley, Schutz and Born, "Statistical Orbit
Determination", 2004, 6.2).
"""

from collections.abc import Callable, Sequence
from operator import attrgetter
from typing import Any

import numpy as np
from attrs import Factory, evolve, field, frozen

from opir_core.arrays import BoolArray, FloatArray
from opir_core.estimation.lines_of_sight import LinesOfSight, turned
from opir_core.interfaces.protocols import Sensor
from opir_core.interfaces.records import Detections
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


#: Where rays say nothing of a direction, a place is known this well beforehand, m.
_BEFOREHAND_M = 30e3


@frozen(eq=False)
class Biases:
    """The sensors of a scene, the standard deviation of each one's bias (sensors,), rad, and whether there is any."""

    sensors: tuple[Sensor, ...]
    sigma_rad: FloatArray
    any: bool = field(default=Factory(lambda self: bool(self.sigma_rad.any()), takes_self=True), init=False)

    @classmethod
    def of(cls, sensors: Sequence[Sensor]) -> "Biases":
        """Return the biases of sensors."""
        return cls(tuple(sensors), np.array([sensor.line_of_sight_bias_sigma_rad for sensor in sensors]))

    def widened(self, rays: LinesOfSight) -> LinesOfSight:
        """Return rays as uncertain as noise and the biases of their sensors together make each of them."""
        if not self.any:
            return rays
        return evolve(rays, sigma_rad=np.hypot(rays.sigma_rad, self.sigma_rad[rays.sensor]))

    def covariance(self, position_m: FloatArray, time_s: float, seen: BoolArray) -> FloatArray:
        """Return the covariance (n, 3, 3), m², that biases add to inertial positions (n, 3) at a time.

        `seen` (n, sensors) says which sensors see each target.
        """
        if not self.any or not len(position_m):
            return np.zeros((len(position_m), 3, 3))
        return position_covariance(position_m, *self._geometry(time_s, seen), self.sigma_rad)

    def of_others(self, position_m: FloatArray, time_s: float, seen: BoolArray) -> FloatArray:
        """Return what `covariance` does, (n, sensors, 3, 3), of the biases of all sensors but each in turn."""
        geometry, added = self._geometry(time_s, seen), np.zeros((len(position_m), len(self.sensors), 3, 3))
        for number in range(len(self.sensors)):
            others = np.where(np.arange(len(self.sensors)) == number, 0.0, self.sigma_rad)
            if others.any() and len(position_m):
                added[:, number] = position_covariance(position_m, *geometry, others)
        return added

    def _geometry(self, time_s: float, seen: BoolArray) -> tuple[FloatArray, BoolArray, FloatArray]:
        """Return the sensors' places, who sees which target, and how much their angles count."""
        when = np.full(1, time_s)
        origin = np.concatenate([turned(sensor.orbit.position_ecef_m(when), when) for sensor in self.sensors])
        noise = np.array([sensor.line_of_sight_sigma_rad for sensor in self.sensors])
        period_s = np.array([sensor.scan.period_ns * 1e-9 for sensor in self.sensors])
        return origin, seen, 1.0 / (period_s * (noise**2 + self.sigma_rad**2))


def position_covariance(
    position_m: FloatArray, origin_m: FloatArray, seen: BoolArray, weight: FloatArray, bias_sigma_rad: FloatArray
) -> FloatArray:
    """Return the covariance (n, 3, 3), m², that biases add to positions (n, 3) found by weighted least squares.

    `origin_m` (s, 3) are the sensors' places, `seen` (n, s) says which sensor sees which target, and `weight` (s,) how
    much a sensor's angles count, 1/rad² a second: looks over the square of their error.
    """
    apart = position_m[:, None] - origin_m
    range_square = np.sum(apart * apart, axis=2)
    across = np.eye(3) - apart[:, :, :, None] * apart[:, :, None, :] / range_square[:, :, None, None]
    told = np.where(seen, weight / range_square, 0.0)
    # A second's rays count far more than what was known beforehand, in whatever direction they tell anything.
    total = np.sum(told[:, :, None, None] * across, axis=1) + np.eye(3) / _BEFOREHAND_M**2
    moved = np.sum((told * told * range_square * np.square(bias_sigma_rad))[:, :, None, None] * across, axis=1)
    inverse = np.linalg.inv(total)
    added = inverse @ moved @ inverse
    symmetric: FloatArray = 0.5 * (added + added.transpose(0, 2, 1))
    return symmetric


#: What makes detections rays.
_seen = attrgetter("time_ns", "sensor", "scan", "line_of_sight_ecef", "sensor_ecef_m", "line_of_sight_sigma_rad")


class LineOfSightCache:
    """The rays that some way makes of detections; those asked for last are kept."""

    def __init__(self, way: Callable[[Detections], LinesOfSight]) -> None:
        self._way = way
        self._met: tuple[Detections, LinesOfSight] | None = None

    def of(self, detections: Detections) -> LinesOfSight:
        """Return the rays of detections: the same record for the same rays."""
        if self._met is None or not _alike(self._met[0], detections):
            self._met = detections, self._way(detections)
        elif self._met[0] is not detections:
            self._met = detections, self._met[1]
        return self._met[1]


def _alike(one: Detections, other: Detections) -> bool:
    """Return whether the rays of two records are the same, to the last bit."""
    if one is other:
        return True
    if len(one.time_ns) != len(other.time_ns):
        return False
    return all(map(_same, _seen(one), _seen(other)))


def _same(one: Any, other: Any) -> bool:
    return one is other or one.tobytes() == other.tobytes()
