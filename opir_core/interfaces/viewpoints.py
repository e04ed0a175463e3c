"""Sensor positions of detections, and azimuth and elevation from them."""

from typing import NamedTuple

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray, IndexArray, IntArray
from opir_core.geometry import azimuth_elevation_range_in_axes, local_axes


class AzimuthElevation(NamedTuple):
    """Azimuth in [0, 2 pi) clockwise from true north, and elevation in [-pi/2, pi/2], (n,), rad.

    Both are in the geodetic horizon at the sensor's position (docs/reference/angles.md).
    """

    azimuth_rad: FloatArray
    elevation_rad: FloatArray


@frozen(eq=False)
class Viewpoints:
    """The distinct sensor positions (m, 3) of detections, ECEF, m, and each row's index (n,) into
    them.
    """

    position_ecef_m: FloatArray
    of_row: IntArray

    @classmethod
    def of(cls, sensor: IndexArray, sensor_ecef_m: FloatArray) -> "Viewpoints":
        """Return the viewpoints of sensors (n,), indices from 0 on, at positions (n, 3), ECEF, m.

        A sensor has one position for all rows equal to its last one, and one for each other row.
        """
        row_of_sensor = np.zeros(int(sensor.max(initial=-1)) + 1, dtype=np.int64)
        row_of_sensor[sensor] = np.arange(len(sensor))
        homes = sensor_ecef_m.take(row_of_sensor, axis=0)
        of_row = sensor.astype(np.int64)
        has_moved = sensor_ecef_m != homes.take(of_row, axis=0)
        moved = np.flatnonzero(has_moved[:, 0] | has_moved[:, 1] | has_moved[:, 2])
        of_row[moved] = len(homes) + np.arange(len(moved))
        return cls(np.concatenate([homes, sensor_ecef_m[moved]]), of_row)

    def angles(self, line_of_sight_ecef: FloatArray) -> AzimuthElevation:
        """Return azimuth and elevation of directions (n, 3), ECEF, seen from the rows' viewpoints.

        The axes are computed once per viewpoint. Without a direction or a position the angles are
        nan.
        """
        of_viewpoint = local_axes(self.position_ecef_m).reshape(-1, 9)
        columns = np.ascontiguousarray(of_viewpoint.T).take(self.of_row, axis=1)
        axes = np.moveaxis(columns.reshape(3, 3, -1), -1, 0)
        look = azimuth_elevation_range_in_axes(line_of_sight_ecef, axes)
        return AzimuthElevation(look.azimuth_rad, look.elevation_rad)
