"""Line-of-sight bias: the one error that all lines of sight of a sensor share, drawn once a run.

It is a turn of the whole sensor by two small angles about axes in its local horizon, so that a line of sight to nadir
moves by `east_rad` towards east and by `north_rad` towards north.
"""

from collections.abc import Sequence

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray, IndexArray
from opir_core.geometry import local_axes
from opir_core.interfaces.protocols import Sensor
from opir_core.random_streams.philox import Stream, normal_pairs, stream_key

#: The purpose that names a sensor's stream.
STREAM = "line-of-sight-bias"


@frozen(eq=False)
class PointingBias:
    """The bias of each sensor, (sensors,) rad along east and north."""

    east_rad: FloatArray
    north_rad: FloatArray

    @classmethod
    def drawn(cls, seed: int, sensors: Sequence[Sensor]) -> "PointingBias":
        """Return normal biases with the sensors' own standard deviations, each from the sensor's own stream."""
        bias = np.zeros((2, len(sensors)))
        for number, sensor in enumerate(sensors):
            east, north = normal_pairs(Stream(stream_key(seed, sensor.id, STREAM)).words(0, 1))
            bias[:, number] = np.array([east[0], north[0]]) * sensor.line_of_sight_bias_sigma_rad
        return cls(bias[0], bias[1])

    def applied(
        self, x: FloatArray, y: FloatArray, z: FloatArray, sensor: IndexArray, sensor_ecef_m: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return unit vectors (n,) in ECEF as sensors (n,) at positions (n, 3), ECEF, m, that are turned see them."""
        turn_x, turn_y, turn_z = self._turns(sensor, sensor_ecef_m)
        moved_x = x + turn_y * z - turn_z * y
        moved_y = y + turn_z * x - turn_x * z
        moved_z = z + turn_x * y - turn_y * x
        per_length = 1.0 / np.sqrt(moved_x * moved_x + moved_y * moved_y + moved_z * moved_z)
        return moved_x * per_length, moved_y * per_length, moved_z * per_length

    def _turns(self, sensor: IndexArray, sensor_ecef_m: FloatArray) -> tuple[FloatArray, ...]:
        """Return the components of the turns, rad: with nadir down, (north, -east) about the east and north axes."""
        axes = local_axes(sensor_ecef_m)
        about_east, about_north = self.north_rad[sensor], -self.east_rad[sensor]
        return tuple(about_east * axes[:, 0, axis] + about_north * axes[:, 1, axis] for axis in range(3))

    def told(self, sensors: Sequence[Sensor]) -> list[dict[str, str | float]]:
        """Return one mapping a sensor, for the truth file and the manifest."""
        both = zip(sensors, self.east_rad.tolist(), self.north_rad.tolist(), strict=True)
        return [
            {"sensor_id": sensor.id, "line_of_sight_bias_east_rad": east, "line_of_sight_bias_north_rad": north}
            for sensor, east, north in both
        ]
