"""What trackers assume of the sensors: schedule, detection probability, stated biases, and their
lines of sight.
"""

from collections.abc import Callable, Sequence
from operator import attrgetter

import numpy as np
from attrs import Factory, field, frozen
from numpy.typing import ArrayLike
from opir_estimation import ErrorFilter, LinesOfSight, Registration, Vantages, earth_rotated

from opir_core.arrays import BoolArray, FloatArray
from opir_core.plugin import TARGET_TYPES, Detections, Sensor, TrackerContext
from opir_trackers.configs import ImmConfig

#: Detection probability of a sensor that states none for a type.
_UNSTATED = 0.5


@frozen(eq=False)
class SensorSchedule:
    """Scan periods (sensors,), s, and detection probabilities (sensors, types)."""

    period_s: FloatArray
    detection_probability: FloatArray

    @classmethod
    def of(cls, sensors: Sequence[Sensor], *, least: float, most: float) -> "SensorSchedule":
        """Return the schedule of a scene's sensors, with detection probabilities clipped to [least,
        most].
        """
        chance = [
            [sensor.detection_probability.get(kind, _UNSTATED) for kind in TARGET_TYPES]
            for sensor in sensors
        ]
        stated = np.array(chance, dtype=np.float64).reshape(len(sensors), len(TARGET_TYPES))
        return cls(
            period_s=np.array([sensor.scan.period_ns * 1e-9 for sensor in sensors]),
            detection_probability=np.clip(stated, least, most),
        )


def expected_detection_rate(sensors: Sequence[Sensor]) -> float:
    """Return the expected detections per second of a target in view of all sensors, mean over
    types.
    """
    schedule = SensorSchedule.of(sensors, least=0.01, most=1.0)
    return float(np.sum(schedule.detection_probability.mean(axis=1) / schedule.period_s))


def clutter_per_sr(context: TrackerContext, assumed: float) -> FloatArray:
    """Return the false alarms (sensors,) per scan and steradian of the field of regard; `assumed`
    where unknown.
    """
    if context.false_alarms_per_scan is None:
        return np.full(len(context.sensors), assumed)
    half_rad = np.array([sensor.field_of_regard_half_angle_rad for sensor in context.sensors])
    return np.array(context.false_alarms_per_scan) / (
        4.0 * np.pi * np.square(np.sin(0.5 * half_rad))
    )


#: Least error of an angle, rad: 4 cm at geostationary range.
_LEAST_RAD = 1e-9


@frozen(eq=False)
class Biases:
    """The sensors of a scene, the standard deviation of each bias (sensors,), rad, and whether
    there is any.

    `clock_sigma_s` is the standard deviation of the constant offset of each sensor's clock.
    """

    sensors: tuple[Sensor, ...]
    sigma_rad: FloatArray
    clock_sigma_s: float = 0.0
    any: bool = field(
        default=Factory(lambda self: bool(self.sigma_rad.any()), takes_self=True), init=False
    )

    @classmethod
    def of(cls, sensors: Sequence[Sensor], clock_sigma_s: float = 0.0) -> "Biases":
        """Return the biases of sensors."""
        sigma_rad = np.array([sensor.line_of_sight_bias_sigma_rad for sensor in sensors])
        return cls(tuple(sensors), sigma_rad, clock_sigma_s)

    def ranges_m(self, position_m: FloatArray, time_s: float, visible: BoolArray) -> FloatArray:
        """Return the mean distance (n,), m, of inertial positions (n, 3) from the sensors that see
        them.
        """
        offset = position_m[:, None] - self.geometry(time_s, visible)[0]
        distance = np.sqrt(np.sum(offset * offset, axis=2))
        return np.sum(distance * visible, axis=1) / np.maximum(visible.sum(axis=1), 1)

    def geometry(
        self, time_s: float, visible: BoolArray
    ) -> tuple[FloatArray, BoolArray, FloatArray]:
        """Return the sensors' positions, visibility and weights of their angles."""
        when = np.full(1, time_s)
        origin = np.concatenate(
            [earth_rotated(sensor.orbit.position_ecef_m(when), when) for sensor in self.sensors]
        )
        return origin, visible, self.weights(self.sigma_rad)

    def weights(self, shared_rad: FloatArray) -> FloatArray:
        """Return the weights (sensors,) of angles with noise and shared errors (sensors,), 1/rad²
        per second.
        """
        noise = np.array([sensor.line_of_sight_sigma_rad for sensor in self.sensors])
        period_s = np.array([sensor.scan.period_ns * 1e-9 for sensor in self.sensors])
        return 1.0 / (period_s * np.maximum(noise**2 + shared_rad**2, _LEAST_RAD**2))


#: The columns that determine the lines of sight of detections.
_line_of_sight_columns = attrgetter(
    "time_ns", "sensor", "scan", "line_of_sight_ecef", "sensor_ecef_m", "line_of_sight_sigma_rad"
)


class LineOfSightCache:
    """The lines of sight of the last detections: labels and estimates need the same."""

    def __init__(self, way: Callable[[Detections], LinesOfSight]) -> None:
        self._way = way
        self._met: tuple[Detections, LinesOfSight] | None = None

    def of(self, detections: Detections) -> LinesOfSight:
        """Return the lines of sight of detections, the same record for the same detections."""
        if self._met is None or not _same_lines_of_sight(self._met[0], detections):
            self._met = detections, self._way(detections)
        elif self._met[0] is not detections:
            self._met = detections, self._met[1]
        return self._met[1]


def _same_lines_of_sight(detections: Detections, reference: Detections) -> bool:
    """Return whether two records have identical lines of sight."""
    if detections is reference:
        return True
    if len(detections.time_ns) != len(reference.time_ns):
        return False
    columns = zip(
        _line_of_sight_columns(detections), _line_of_sight_columns(reference), strict=True
    )
    return not any(
        True
        for column, other in columns
        if column is not other and column.tobytes() != other.tobytes()
    )


def vantages_of(sensors: Sequence[Sensor], time_s: float) -> Vantages:
    """Return the vantages of sensors at a scene time, with equal weights."""
    half_s = 0.5
    times_s = np.array([time_s - half_s, time_s, time_s + half_s])
    places = np.array([sensor.orbit.position_ecef_m(times_s) for sensor in sensors])
    return Vantages.of(places, time_s, 2.0 * half_s)


def registration_of(config: ImmConfig, sensors: Sequence[Sensor]) -> Registration:
    """Return the registration of a scene's sensors before the first look."""
    stated = np.array([sensor.line_of_sight_bias_sigma_rad for sensor in sensors])
    period_s = np.array([sensor.scan.period_ns * 1e-9 for sensor in sensors])
    errors = ErrorFilter.of(stated, config.clock_sigma_s, config.bias_correlation_s)
    return Registration.of(errors, period_s)


#: Detection probability of sensors that state none.
UNSTATED = 0.8


def mean_detection_probability(sensors: Sequence[Sensor]) -> FloatArray:
    """Return detection probabilities (sensors,), means over the types."""
    stated = [
        np.mean(list(sensor.detection_probability.values()) or [UNSTATED]) for sensor in sensors
    ]
    return clipped(stated)


def clipped(stated: ArrayLike) -> FloatArray:
    """Return stated detection probabilities (n,), neither certain nor hopeless."""
    return np.clip(np.asarray(stated, dtype=np.float64), 0.05, 0.98)


def longest_silence_s(sensors: Sequence[Sensor], scans: int) -> FloatArray:
    """Return the longest time (sensors,) without detection that is probable for a track in view, of
    the type with the lowest detection probability.
    """
    seldom = [min(sensor.detection_probability.values(), default=UNSTATED) for sensor in sensors]
    chance = clipped(seldom)
    period_s = np.array([sensor.scan.period_ns * 1e-9 for sensor in sensors])
    # So many consecutive misses have a probability of 1e-4.
    misses = np.log(1e-4) / np.log1p(-chance)
    return np.maximum(scans, misses) * period_s
