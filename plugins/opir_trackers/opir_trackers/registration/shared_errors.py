"""Errors that all lines of sight of a sensor share, and what they do to directions and to
positions.

Each sensor has three: the angles by which it is turned, so that a line of sight to nadir moves east
and north, rad, and the offset of its clock, s: what it stamps less what is right. They are small:
all is linear in them.
"""

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from attrs import evolve

from opir_core.arrays import BoolArray, FloatArray
from opir_core.constants import EARTH_ROTATION_RAD_S
from opir_core.estimation import dot
from opir_core.geometry import local_axes
from opir_core.plugin import Sensor
from opir_trackers.lines_of_sight import LinesOfSight, earth_rotated
from opir_trackers.sensors import shifts_of_positions

#: Errors of a sensor: east, north, clock.
ERRORS = 3

#: Half of the time, s, over which sensors' velocities are differenced.
_HALF_S = 0.5


class Vantages(NamedTuple):
    """Sensors (s,) at a time: inertial positions (s, 3), axes (s, 3, 3) east, north, up, and
    velocities over the Earth.

    `weight` (s,) is that of their angles, 1/rad² per second.
    """

    origin_m: FloatArray
    axes: FloatArray
    velocity_m_s: FloatArray
    weight: FloatArray

    @classmethod
    def of(cls, sensors: Sequence[Sensor], time_s: float) -> "Vantages":
        """Return those of sensors at a scene time, with equal weights."""
        when = np.array([time_s - _HALF_S, time_s, time_s + _HALF_S])
        places = np.array([sensor.orbit.position_ecef_m(when) for sensor in sensors])
        count = len(sensors)
        now = np.full(len(sensors), time_s)
        axes = local_axes(places[:, 1])
        return cls(
            earth_rotated(places[:, 1], now),
            earth_rotated(axes.reshape(-1, 3), np.full(3 * count, time_s)).reshape(count, 3, 3),
            earth_rotated((places[:, 2] - places[:, 0]) / (2.0 * _HALF_S), now),
            np.ones(count),
        )

    def displacements(self, position_m: FloatArray, velocity_m_s: FloatArray) -> FloatArray:
        """Return how far (n, s, 3, 3), m, each sensor's errors of 1 rad and 1 s move what it sees
        of targets (n, 3).

        Positions and velocities are inertial; the last axis is the error.
        """
        apart = position_m[:, None] - self.origin_m
        over_ground = velocity_m_s.copy()
        over_ground[:, 0] += EARTH_ROTATION_RAD_S * position_m[:, 1]
        over_ground[:, 1] -= EARTH_ROTATION_RAD_S * position_m[:, 0]
        east = np.broadcast_to(self.axes[:, 0], apart.shape)
        north = np.broadcast_to(self.axes[:, 1], apart.shape)
        clock = self.velocity_m_s - over_ground[:, None]
        return np.stack([np.cross(apart, north), np.cross(east, apart), clock], axis=3)

    def shifts(
        self, position_m: FloatArray, velocity_m_s: FloatArray, seen: BoolArray
    ) -> FloatArray:
        """Return the shifts (n, 3, 3 s), m, of triangulated positions (n, 3) by all errors of 1 rad
        and 1 s.

        `seen` (n, s) marks the sensors that see each target.
        """
        turn = shifts_of_positions(position_m, self.origin_m, seen, self.weight)
        moved = turn @ self.displacements(position_m, velocity_m_s)
        return np.asarray(
            moved.transpose(0, 2, 1, 3).reshape(*position_m.shape, ERRORS * seen.shape[1])
        )


def corrected(lines: LinesOfSight, error: FloatArray) -> LinesOfSight:
    """Return lines of sight less the errors (s, 3) of their sensors."""
    mine = error[lines.sensor]
    moved = turned_back(lines.direction_ecef, lines.origin_ecef_m, mine)
    return evolve(lines, direction_ecef=moved, time_s=lines.time_s - mine[:, 2])


def turned_back(direction: FloatArray, origin_m: FloatArray, error: FloatArray) -> FloatArray:
    """Return unit vectors (n, 3) from sensors at positions (n, 3), all in ECEF, less angles of
    errors (n, 3).
    """
    axes = local_axes(origin_m)
    turn = error[:, 1:2] * axes[:, 0] - error[:, :1] * axes[:, 1]
    moved = direction - np.cross(turn, direction)
    return np.asarray(moved / np.sqrt(dot(moved, moved))[:, None])
