"""The grid of scene time along each pair's burn or flight, and what is sampled on it."""

import numpy as np
from attrs import frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.constants import SPEED_OF_LIGHT_M_S
from opir_core.interfaces.protocols import Sensor
from opir_core.planning.targets import Targets
from opir_core.planning.visibility.records import GRID_STEP_S

#: Length of burn from which the velocity at its ends is taken, s.
_END_STEP_S = 0.05

#: Each iteration shrinks the error by speed / c, below 3e-5: three leave less than a nanosecond's rounding.
_LIGHT_TIME_ITERATIONS = 3


@frozen(eq=False)
class Grid:
    """Whole steps of scene time that enclose what is watched of each target, laid end to end.

    A pair has one more point than cells.
    """

    first_step: IntArray
    points: IntArray
    first_point: IntArray
    pair: IntArray
    time_s: FloatArray

    @classmethod
    def over(cls, start_s: FloatArray, stop_s: FloatArray) -> "Grid":
        """Return the grid that encloses start to stop (n,) of each of n pairs."""
        first_step = np.floor(start_s / GRID_STEP_S).astype(np.int64)
        points = np.floor(stop_s / GRID_STEP_S).astype(np.int64) - first_step + 2
        offset = np.cumsum(points) - points
        pair = np.repeat(np.arange(len(points)), points)
        step = np.arange(len(pair)) - offset[pair] + first_step[pair]
        return cls(first_step, points, offset - first_step, pair, step * GRID_STEP_S)

    def cells(self) -> IntArray:
        """Return the points that start a cell: all but the last of each pair."""
        return np.flatnonzero(self.pair[1:] == self.pair[:-1])

    def any_of_pair(self, cells: IntArray) -> BoolArray:
        """Return which pairs own at least one of the cells."""
        return np.bincount(self.pair[cells], minlength=len(self.points)) > 0

    def span(self, cells: IntArray, start_s: FloatArray, stop_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return each pair's start and stop, drawn in to the first and last of the given cells."""
        first, last = np.full(len(self.points), np.inf), np.full(len(self.points), -np.inf)
        np.minimum.at(first, self.pair[cells], self.time_s[cells])
        np.maximum.at(last, self.pair[cells], self.time_s[cells] + GRID_STEP_S)
        return np.maximum(start_s, first), np.minimum(stop_s, last)


@frozen(eq=False)
class TargetPath:
    """Targets' ways, drawn out straight before and after what is watched: the grid's outer cells stay smooth."""

    targets: Targets
    end_s: FloatArray
    velocity_in_m_s: FloatArray
    velocity_out_m_s: FloatArray

    @classmethod
    def of(cls, targets: Targets, end_s: FloatArray) -> "TargetPath":
        """Return the ways of all targets, each to its end (n,)."""
        everyone = np.arange(len(targets.ids), dtype=np.int32)
        start_s = targets.ignition_s
        short_s = np.minimum(_END_STEP_S, end_s - start_s)
        after, before = np.minimum(start_s + short_s, end_s), np.maximum(end_s - short_s, start_s)
        moved_in = targets.position_ecef_m(everyone, after) - targets.position_ecef_m(everyone, start_s)
        moved_out = targets.position_ecef_m(everyone, end_s) - targets.position_ecef_m(everyone, before)
        return cls(targets, end_s, moved_in / _step_s(start_s, after), moved_out / _step_s(before, end_s))

    def position_ecef_m(self, pair: IntArray, time_s: FloatArray) -> FloatArray:
        """Return positions (n, 3) of targets (n,) at any times (n,)."""
        target = pair.astype(np.int32)
        start_s, end_s = self.targets.ignition_s[target], self.end_s[target]
        position = self.targets.position_ecef_m(target, np.clip(time_s, start_s, end_s))
        early_s, late_s = np.minimum(time_s - start_s, 0.0), np.maximum(time_s - end_s, 0.0)
        drawn_out: FloatArray = (
            position + self.velocity_in_m_s[target] * early_s[:, None] + self.velocity_out_m_s[target] * late_s[:, None]
        )
        return drawn_out


def _step_s(start_s: FloatArray, stop_s: FloatArray) -> FloatArray:
    """Return steps (n, 1); endless where there is none, as of what begins when the scene is over: it stands still."""
    step_s = stop_s - start_s
    return np.where(step_s > 0.0, step_s, np.inf)[:, None]


def sampled(
    sensor: Sensor, targets: Targets, grid: Grid, light_time: bool
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return light times, sensor and target positions at the grid's points."""
    path = TargetPath.of(targets, targets.watched_until_s(sensor))
    sensor_ecef_m = sensor.orbit.position_ecef_m(grid.time_s)
    travel_s = np.zeros(len(grid.time_s))
    target_ecef_m = path.position_ecef_m(grid.pair, grid.time_s)
    for _ in range(_LIGHT_TIME_ITERATIONS if light_time else 0):
        travel_s = distance_m(sensor_ecef_m, target_ecef_m) / SPEED_OF_LIGHT_M_S
        target_ecef_m = path.position_ecef_m(grid.pair, grid.time_s - travel_s)
    return travel_s, sensor_ecef_m, target_ecef_m


def look_time_s(sensor: Sensor, targets: Targets, emission_s: FloatArray, light_time: bool) -> FloatArray:
    """Return when the light that targets emit at a moment of their flight reaches the sensor, s."""
    if not light_time:
        return emission_s
    everyone = np.arange(len(emission_s), dtype=np.int32)
    target_ecef_m = targets.position_ecef_m(everyone, emission_s)
    look_s = emission_s
    for _ in range(_LIGHT_TIME_ITERATIONS):
        look_s = emission_s + distance_m(sensor.orbit.position_ecef_m(look_s), target_ecef_m) / SPEED_OF_LIGHT_M_S
    return look_s


def distance_m(one_m: FloatArray, other_m: FloatArray) -> FloatArray:
    """Return the distances (n,) between positions (n, 3)."""
    x, y, z = (one_m[:, axis] - other_m[:, axis] for axis in range(3))
    distance: FloatArray = np.sqrt(x * x + y * y + z * z)
    return distance
