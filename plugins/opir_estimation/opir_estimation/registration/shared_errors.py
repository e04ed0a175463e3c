"""Errors that all lines of sight of a sensor share, and the shifts of directions and positions that
they cause.

Each sensor has three: the angles by which it is turned, so that a line of sight to nadir moves east
and north, rad, and the offset of its clock, s: stamped less true time. They are small:
all is linear in them.
"""

from typing import NamedTuple

import numpy as np
from attrs import evolve

from opir_core.arrays import BoolArray, FloatArray
from opir_core.constants import EARTH_ROTATION_RAD_S
from opir_core.geometry import local_axes
from opir_estimation.directions import cross, dot
from opir_estimation.law_files import law_parameters
from opir_estimation.lines_of_sight import LinesOfSight, earth_rotated

LAW = law_parameters("opir_estimation.registration", "registration")

#: Errors of a sensor: east, north, clock.
ERRORS = 3


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
    def of(cls, places_m: FloatArray, time_s: float, span_s: float) -> "Vantages":
        """Return those of sensors at a scene time, with equal weights.

        `places_m` (s, 3, 3) are ECEF positions at the beginning, the middle and the end of a span
        around that time.
        """
        sensors = len(places_m)
        axes = local_axes(places_m[:, 1])
        velocity = (places_m[:, 2] - places_m[:, 0]) / span_s
        origin, inertial_axes, inertial_velocity = (
            earth_rotated(vector.reshape(-1, 3), np.full(vector.size // 3, time_s))
            for vector in (places_m[:, 1], axes, velocity)
        )
        return cls(origin, inertial_axes.reshape(axes.shape), inertial_velocity, np.ones(sensors))

    def displacements(self, position_m: FloatArray, velocity_m_s: FloatArray) -> FloatArray:
        """Return the displacements (n, s, 3, 3), m, by each sensor's errors of 1 rad and 1 s of
        targets (n, 3) as it sees them.

        Positions and velocities are inertial; the last axis is the error.
        """
        line = position_m[:, None] - self.origin_m
        over_ground = velocity_m_s.copy()
        over_ground[:, 0] += EARTH_ROTATION_RAD_S * position_m[:, 1]
        over_ground[:, 1] -= EARTH_ROTATION_RAD_S * position_m[:, 0]
        east = np.broadcast_to(self.axes[:, 0], line.shape)
        north = np.broadcast_to(self.axes[:, 1], line.shape)
        clock = self.velocity_m_s - over_ground[:, None]
        return np.stack([cross(line, north), cross(east, line), clock], axis=3)

    def shifts(
        self, position_m: FloatArray, velocity_m_s: FloatArray, is_seen: BoolArray
    ) -> FloatArray:
        """Return the shifts (n, 3, 3 s), m, of triangulated positions (n, 3) by all errors of 1 rad
        and 1 s.

        `is_seen` (n, s) marks the sensors that see each target.
        """
        turn = shifts_of_positions(position_m, self.origin_m, is_seen, self.weight)
        moved = turn @ self.displacements(position_m, velocity_m_s)
        return moved.transpose(0, 2, 1, 3).reshape(*position_m.shape, ERRORS * is_seen.shape[1])


def corrected(lines: LinesOfSight, error: FloatArray) -> LinesOfSight:
    """Return lines of sight less the errors (s, 3) of their sensors."""
    error = error[lines.sensor]
    moved = turned_back(lines.direction_ecef, lines.origin_ecef_m, error)
    return evolve(lines, direction_ecef=moved, time_s=lines.time_s - error[:, 2])


def turned_back(direction: FloatArray, origin_m: FloatArray, error: FloatArray) -> FloatArray:
    """Return unit vectors (n, 3) from sensors at positions (n, 3), all in ECEF, less angles of
    errors (n, 3).
    """
    axes = local_axes(origin_m)
    turn = error[:, 1:2] * axes[:, 0] - error[:, :1] * axes[:, 1]
    moved = direction - cross(turn, direction)
    return moved / np.sqrt(dot(moved, moved))[:, None]


def shifts_of_positions(
    position_m: FloatArray, origin_m: FloatArray, visible: BoolArray, weight: FloatArray
) -> FloatArray:
    """Return the matrices (n, s, 3, 3) that turn shifts of what one sensor sees, m, into shifts of
    a position.

    Shifts along the line of sight have no effect. `origin_m` (s, 3) are the sensor positions,
    `visible` (n, s) marks which sensor sees which target, and `weight` (s,) is that of a sensor's
    angles, 1/rad² per second: look rate over error variance.
    """
    across, weight_m2, total = _least_squares(position_m, origin_m, visible, weight)
    return np.linalg.inv(total)[:, None] @ (weight_m2[:, :, None, None] * across)


def _least_squares(
    position_m: FloatArray, origin_m: FloatArray, visible: BoolArray, weight: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return projections across (n, s, 3, 3), weights (n, s), 1/m² per second, and information (n,
    3, 3).
    """
    offset = position_m[:, None] - origin_m
    range_square = np.sum(offset * offset, axis=2)
    across = (
        np.eye(3) - offset[:, :, :, None] * offset[:, :, None, :] / range_square[:, :, None, None]
    )
    weight_m2 = np.where(visible, weight / range_square, 0.0)
    # In observed directions the lines of one second outweigh the prior.
    total = np.sum(weight_m2[:, :, None, None] * across, axis=1) + np.eye(3) / LAW.prior_sigma_m**2
    return across, weight_m2, total
