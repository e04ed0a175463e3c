"""Where the sensors of a plan are, as columns."""

from typing import TYPE_CHECKING

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray, IndexArray, IntArray
from opir_core.interfaces.protocols import Sensor

if TYPE_CHECKING:
    from opir_core.planning.pointing_bias import PointingBias


@frozen(eq=False)
class SensorStates:
    """What stays the same of the sensors, one row each; the position is nan for those that move."""

    sensors: tuple[Sensor, ...]
    position_ecef_m: FloatArray
    sigma_rad: FloatArray
    moving: IntArray
    bias: "PointingBias | None"

    @classmethod
    def of(cls, sensors: tuple[Sensor, ...], bias: "PointingBias | None" = None) -> "SensorStates":
        """Return the sites of sensors that have this bias, or none."""
        position = np.full((len(sensors), 3), np.nan)
        for number, sensor in enumerate(sensors):
            if sensor.orbit.is_stationary:
                position[number] = sensor.orbit.position_ecef_m(np.zeros(1))[0]
        sigma_rad = np.array([sensor.line_of_sight_sigma_rad for sensor in sensors], dtype=np.float64)
        moving = np.flatnonzero([not sensor.orbit.is_stationary for sensor in sensors])
        return cls(sensors, position, sigma_rad, moving, bias)

    def positions(self, sensor: IndexArray, time_s: FloatArray) -> FloatArray:
        """Return positions (n, 3) of sensors (n,) at scene times (n,), m."""
        positions = np.take(self.position_ecef_m, sensor, axis=0)
        for number in self.moving:
            rows = np.flatnonzero(sensor == number)
            positions[rows] = self.sensors[number].orbit.position_ecef_m(time_s[rows])
        return positions
