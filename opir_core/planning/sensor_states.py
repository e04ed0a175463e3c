"""Sensor positions, line-of-sight sigmas and pointing biases of a plan, as columns."""

from collections.abc import Sequence

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray, IndexArray, IntArray
from opir_core.geometry import local_axes
from opir_core.interfaces.sensors import Sensor
from opir_core.random_streams.philox import Stream, normal_pairs, stream_key, uniforms_of

#: The purpose of a sensor's stream for its pointing bias.
STREAM = "line-of-sight-bias"


@frozen(eq=False, repr=False)
class PointingBias:
    """The line-of-sight bias of each sensor, (sensors,) rad along east and north: constant during a
    run.

    The sensor is rotated by two small angles about axes of its local horizon, so that a line of
    sight to nadir moves by `east_rad` towards east and by `north_rad` towards north.
    """

    east_rad: FloatArray
    north_rad: FloatArray

    @classmethod
    def drawn(cls, seed: int, sensors: Sequence[Sensor]) -> "PointingBias":
        """Return normal biases with the sensors' standard deviations, each from the sensor's own
        stream.
        """
        bias = np.zeros((2, len(sensors)))
        for number, sensor in enumerate(sensors):
            east, north = normal_pairs(Stream(stream_key(seed, sensor.id, STREAM)).words(0, 1))
            bias[:, number] = np.array([east[0], north[0]]) * sensor.line_of_sight_bias_sigma_rad
        return cls(bias[0], bias[1])

    def applied(
        self,
        x: FloatArray,
        y: FloatArray,
        z: FloatArray,
        sensor: IndexArray,
        sensor_ecef_m: FloatArray,
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return unit vectors (n,) in ECEF as measured by biased sensors (n,) at positions (n, 3),
        ECEF, m.
        """
        return turned(x, y, z, self.east_rad[sensor], self.north_rad[sensor], sensor_ecef_m)

    def by_sensor(self, sensors: Sequence[Sensor]) -> list[dict[str, str | float]]:
        """Return one mapping per sensor, for the truth file and the manifest."""
        rows = zip(sensors, self.east_rad.tolist(), self.north_rad.tolist(), strict=True)
        return [
            {
                "sensor_id": sensor.id,
                "line_of_sight_bias_east_rad": east,
                "line_of_sight_bias_north_rad": north,
            }
            for sensor, east, north in rows
        ]


def turned(
    x: FloatArray,
    y: FloatArray,
    z: FloatArray,
    east_rad: FloatArray,
    north_rad: FloatArray,
    sensor_ecef_m: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return unit vectors (n,) in ECEF of sensors at positions (n, 3), ECEF, m, that are rotated by
    small angles (n,).
    """
    axes = local_axes(sensor_ecef_m)
    # With nadir down, (north, -east) about the east and north axes.
    turn_x, turn_y, turn_z = (
        north_rad * axes[:, 0, axis] - east_rad * axes[:, 1, axis] for axis in range(3)
    )
    moved_x = x + turn_y * z - turn_z * y
    moved_y = y + turn_z * x - turn_x * z
    moved_z = z + turn_x * y - turn_y * x
    per_length = 1.0 / np.sqrt(moved_x * moved_x + moved_y * moved_y + moved_z * moved_z)
    return moved_x * per_length, moved_y * per_length, moved_z * per_length


@frozen(eq=False, repr=False)
class SensorStates:
    """Columns of the sensors, one row each; the position is nan for sensors that move in ECEF."""

    sensors: tuple[Sensor, ...]
    position_ecef_m: FloatArray
    sigma_rad: FloatArray
    moving: IntArray
    bias: PointingBias | None

    @classmethod
    def of(cls, sensors: tuple[Sensor, ...], bias: PointingBias | None = None) -> "SensorStates":
        """Return the columns of sensors with this bias, or without one."""
        position = np.full((len(sensors), 3), np.nan)
        for number, sensor in enumerate(sensors):
            if sensor.orbit.is_stationary:
                position[number] = sensor.orbit.position_ecef_m(np.zeros(1))[0]
        sigma_rad = np.array(
            [sensor.line_of_sight_sigma_rad for sensor in sensors], dtype=np.float64
        )
        moving = np.flatnonzero([not sensor.orbit.is_stationary for sensor in sensors])
        return cls(sensors, position, sigma_rad, moving, bias)

    def positions(self, sensor: IndexArray, time_s: FloatArray) -> FloatArray:
        """Return positions (n, 3), ECEF, m, of sensors (n,) at scene times (n,), s."""
        positions = np.take(self.position_ecef_m, sensor, axis=0)
        for number in self.moving:
            rows = np.flatnonzero(sensor == number)
            positions[rows] = self.sensors[number].orbit.position_ecef_m(time_s[rows])
        return positions


def scan_starts(seed: int, sensors: Sequence[Sensor]) -> list[float]:
    """Return the random numbers in [0, 1) of sensors' scan patterns with a random start."""
    streams = (Stream(stream_key(seed, sensor.id, "scan-phase")) for sensor in sensors)
    return [float(uniforms_of(stream.words(0, 1))[0]) for stream in streams]
