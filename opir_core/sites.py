"""The sensors as columns: position, local axes and line-of-sight error of each, and of any row of looks."""

import numpy as np
from attrs import frozen

from opir_core.geometry import east_north_up_axes, ecef_to_geodetic
from opir_core.protocols import Sensor
from opir_core.records import FloatArray, IndexArray, IntArray


@frozen(eq=False)
class Sites:
    """What stays the same of the sensors, one row each; position and axes are nan for those that move.

    `axes` (sensors, 3, 3) are east, north and up of the geodetic frame at the sensor, in ECEF.
    """

    sensors: tuple[Sensor, ...]
    position_ecef_m: FloatArray
    axes: FloatArray
    sigma_rad: FloatArray
    moving: IntArray

    @classmethod
    def of(cls, sensors: tuple[Sensor, ...]) -> "Sites":
        """Return the sites of sensors."""
        position = np.full((len(sensors), 3), np.nan)
        for number, sensor in enumerate(sensors):
            if sensor.orbit.is_stationary:
                position[number] = sensor.orbit.position_ecef_m(np.zeros(1))[0]
        sigma_rad = np.array([sensor.line_of_sight_sigma_rad for sensor in sensors], dtype=np.float64)
        moving = np.flatnonzero([not sensor.orbit.is_stationary for sensor in sensors])
        return cls(sensors, position, _axes(position), sigma_rad, moving)

    def positions(self, sensor: IndexArray, time_s: FloatArray) -> FloatArray:
        """Return positions (n, 3) of sensors (n,) at scene times (n,), m."""
        positions = np.take(self.position_ecef_m, sensor, axis=0)
        for number in self.moving:
            rows = np.flatnonzero(sensor == number)
            positions[rows] = self.sensors[number].orbit.position_ecef_m(time_s[rows])
        return positions

    def local(
        self, sensor: IndexArray, positions_m: FloatArray, x: FloatArray, y: FloatArray, z: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return east, north and up (n,) of ECEF vectors (n,) at sensors (n,) that are at positions (n, 3)."""
        columns = [np.take(self.axes[:, row, axis], sensor) for row in range(3) for axis in range(3)]
        rows = np.flatnonzero(np.isin(sensor, self.moving)) if len(self.moving) else self.moving
        if len(rows):
            axes = _axes(positions_m[rows])
            for number, column in enumerate(columns):
                column[rows] = axes[:, number // 3, number % 3]
        east, north, up = (columns[row] * x + columns[row + 1] * y + columns[row + 2] * z for row in range(0, 9, 3))
        return east, north, up


def _axes(position_ecef_m: FloatArray) -> FloatArray:
    where = ecef_to_geodetic(position_ecef_m)
    return east_north_up_axes(where.latitude_rad, where.longitude_rad)
