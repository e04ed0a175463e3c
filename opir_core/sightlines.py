"""Who can see whom, and when: the pairs of a sensor and a target that have looks at all.

Along each pair's burn the geometry is sampled on a grid of scene time. Between two samples it cannot stray from the
straight line by more than acceleration · step² / 8, so most stretches are certain: seen throughout or not at all. The
looks of a pair with an uncertain stretch are judged one by one, in that stretch.
"""

from collections.abc import Sequence
from enum import IntEnum

import numpy as np
from attrs import frozen
from numpy.typing import NDArray

from opir_core.constants import SPEED_OF_LIGHT_M_S
from opir_core.geometry import elevation_rad, grazing_height_m, nadir_angle_rad
from opir_core.protocols import Sensor
from opir_core.records import BoolArray, Columns, FloatArray, IndexArray, IntArray
from opir_core.targets import Targets

#: Step of the grid on which geometry is sampled, s.
GRID_STEP_S = 1.0

#: No target or satellite here moves off a straight line faster than this relative acceleration, m/s² (about 10 g).
_ACCELERATION_BOUND_M_S2 = 100.0

#: So between samples a position strays from the chord by less than this, m.
_STRAY_M = _ACCELERATION_BOUND_M_S2 * GRID_STEP_S**2 / 8.0

#: Lines of sight that leave the target this far above its horizon are not asked where they graze the Earth.
_WELL_ABOVE_RAD = 0.05

#: Length of burn from which the velocity at its ends is taken, s.
_END_STEP_S = 0.05

_NS = 1_000_000_000


class Blocked(IntEnum):
    """Why a pair has no looks."""

    NOT = 0
    NO_LOOK = 1
    BEHIND_EARTH = 2
    OUTSIDE_FIELD_OF_REGARD = 3
    BELOW_MINIMUM_ELEVATION = 4


class Sight(IntEnum):
    """Whether looks in a cell of the grid see their target."""

    NEVER = 0
    ALWAYS = 1
    PERHAPS = 2


@frozen(eq=False)
class Sightlines:
    """What is known of pairs' lines of sight on the grid: light times at its points, visibility in its cells.

    Light times are linear between points and right to 5e-8 s, in which a target moves 0.4 mm; they are zero where the
    scene switches light time off. A pair's points are `first_point` + its grid step; a cell bears the number of the
    point it starts at.
    """

    first_point: IntArray
    travel_s: FloatArray
    sight: NDArray[np.uint8]

    def light_time_s(self, pair: IntArray, time_s: FloatArray) -> FloatArray:
        """Return the travel time of the light that pairs (n,) receive at times (n,)."""
        step = np.floor(time_s / GRID_STEP_S)
        point = self.first_point[pair] + step.astype(np.int64)
        early, late = self.travel_s[point], self.travel_s[point + 1]
        travel_s: FloatArray = early + (late - early) * (time_s / GRID_STEP_S - step)
        return travel_s

    def sight_at(self, pair: IntArray, time_s: FloatArray) -> NDArray[np.uint8]:
        """Return the `Sight` of looks of pairs (n,) at times (n,)."""
        return self.sight[self.first_point[pair] + np.floor(time_s / GRID_STEP_S).astype(np.int64)]


@frozen(eq=False)
class Pairs(Columns):
    """Sensor-target pairs, sorted by sensor, then target; one row a pair.

    Scans `first_scan` to `last_scan` (both included, none where first > last) look at the burning target at
    phase_ns + scan · period_ns; where `is_checked`, each look is still to be tested for visibility.
    """

    sensor: IndexArray
    target: IndexArray
    period_ns: IntArray
    phase_ns: IntArray
    first_scan: IntArray
    last_scan: IntArray
    is_checked: BoolArray
    blocked: IntArray

    @property
    def looks(self) -> IntArray:
        """Return how many looks each pair has."""
        count: IntArray = np.maximum(self.last_scan - self.first_scan + 1, 0)
        return count

    def is_over(self, time_ns: int) -> BoolArray:
        """Return which pairs have no look at or after a moment of scene time."""
        over: BoolArray = self.phase_ns + self.last_scan * self.period_ns < time_ns
        return over


def compile_pairs(
    sensors: Sequence[Sensor], targets: Targets, uniforms: Sequence[float], *, light_time: bool, end_ns: int
) -> tuple[Pairs, Sightlines]:
    """Return all pairs, those without looks before the scene's end included, and their lines of sight."""
    parts = [
        _sensor_pairs(number, sensor, targets, uniform, light_time, end_ns)
        for number, (sensor, uniform) in enumerate(zip(sensors, uniforms, strict=True))
    ]
    lines = [part[1] for part in parts]
    starts = np.cumsum([0, *(len(line.travel_s) for line in lines[:-1])])
    first_point = np.concatenate([line.first_point + start for line, start in zip(lines, starts, strict=True)])
    travel_s, sight = np.concatenate([line.travel_s for line in lines]), np.concatenate([line.sight for line in lines])
    return Pairs.concatenate([part[0] for part in parts]), Sightlines(first_point, travel_s, sight)


def visible_now(sensor: Sensor, sensor_ecef_m: FloatArray, target_ecef_m: FloatArray) -> BoolArray:
    """Return whether targets (n, 3) are in a sensor's field of regard, high enough, and not behind the Earth."""
    margins = _Margins.of(sensor, sensor_ecef_m, target_ecef_m)
    clear = (margins.horizon_rad > 0.0) | (margins.grazing_m > 0.0)
    seen: BoolArray = clear & (margins.inside_rad > 0.0) & (margins.above_rad > 0.0)
    return seen


@frozen(eq=False)
class _Margins(Columns):
    """By how much lines of sight clear each condition; positive is good.

    A sensor above the target's horizon sees it; one below still does where the line of sight grazes above the
    ellipsoid.
    """

    horizon_rad: FloatArray
    grazing_m: FloatArray
    inside_rad: FloatArray
    above_rad: FloatArray

    @classmethod
    def of(cls, sensor: Sensor, sensor_ecef_m: FloatArray, target_ecef_m: FloatArray) -> "_Margins":
        horizon_rad = elevation_rad(target_ecef_m, sensor_ecef_m)
        inside_rad = sensor.field_of_regard_half_angle_rad - nadir_angle_rad(sensor_ecef_m, target_ecef_m)
        above_rad = horizon_rad - sensor.minimum_elevation_rad
        grazing_m = np.full(len(horizon_rad), np.inf)
        low = np.flatnonzero(~(horizon_rad > _WELL_ABOVE_RAD))
        grazing_m[low] = grazing_height_m(sensor_ecef_m[low], target_ecef_m[low])
        return cls(horizon_rad, grazing_m, inside_rad, above_rad)


@frozen(eq=False)
class _Grid:
    """Whole steps of scene time that enclose each pair's burn, laid end to end; one more point than cells a pair."""

    first_step: IntArray
    points: IntArray
    first_point: IntArray
    pair: IntArray
    time_s: FloatArray

    @classmethod
    def over(cls, start_s: FloatArray, stop_s: FloatArray) -> "_Grid":
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


def _sensor_pairs(
    number: int, sensor: Sensor, targets: Targets, uniform: float, light_time: bool, end_ns: int
) -> tuple[Pairs, Sightlines]:
    """Return one sensor's pairs with all targets, and their lines of sight."""
    everyone = np.arange(len(targets.ids), dtype=np.int32)
    start_s = _look_time_s(sensor, targets, targets.ignition_s, light_time)
    stop_s = _look_time_s(sensor, targets, targets.burnout_s, light_time)
    grid = _Grid.over(start_s, stop_s)
    travel_s, sensor_ecef_m, target_ecef_m = _sample(sensor, targets, grid, light_time)
    sight, blocked = _judge(sensor, grid, sensor_ecef_m, target_ecef_m)
    first_s, last_s = grid.span(np.flatnonzero(sight != Sight.NEVER), start_s, stop_s)
    phase_ns = _phase_ns(sensor, targets, uniform)
    first_scan, last_scan = _scans(first_s, last_s, phase_ns, sensor.scan.period_ns, end_ns)
    last_scan = np.where(blocked == Blocked.NOT, last_scan, first_scan - 1)
    blocked = np.where((blocked == Blocked.NOT) & (last_scan < first_scan), Blocked.NO_LOOK, blocked)
    sensors, periods = np.full_like(everyone, number), np.full_like(phase_ns, sensor.scan.period_ns)
    is_checked = _has_doubt(grid, sight, first_s, last_s)
    pairs = Pairs(sensors, everyone, periods, phase_ns, first_scan, last_scan, is_checked, blocked)
    return pairs, Sightlines(grid.first_point, travel_s, sight)


def _look_time_s(sensor: Sensor, targets: Targets, emission_s: FloatArray, light_time: bool) -> FloatArray:
    """Return when the light that targets emit at a moment of their burn reaches the sensor, s."""
    if not light_time:
        return emission_s
    everyone = np.arange(len(emission_s), dtype=np.int32)
    target_ecef_m = targets.position_ecef_m(everyone, emission_s)
    look_s = emission_s
    for _ in range(_LIGHT_TIME_ITERATIONS):
        look_s = emission_s + _distance_m(sensor.orbit.position_ecef_m(look_s), target_ecef_m) / SPEED_OF_LIGHT_M_S
    return look_s


def _sample(
    sensor: Sensor, targets: Targets, grid: _Grid, light_time: bool
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return light times, sensor and target positions at the grid's points."""
    path = _Path.of(targets)
    sensor_ecef_m = sensor.orbit.position_ecef_m(grid.time_s)
    travel_s = np.zeros(len(grid.time_s))
    target_ecef_m = path.position_ecef_m(grid.pair, grid.time_s)
    for _ in range(_LIGHT_TIME_ITERATIONS if light_time else 0):
        travel_s = _distance_m(sensor_ecef_m, target_ecef_m) / SPEED_OF_LIGHT_M_S
        target_ecef_m = path.position_ecef_m(grid.pair, grid.time_s - travel_s)
    return travel_s, sensor_ecef_m, target_ecef_m


@frozen(eq=False)
class _Path:
    """Targets' ways, drawn out straight before ignition and after burnout: the grid's outer cells stay smooth."""

    targets: Targets
    velocity_in_m_s: FloatArray
    velocity_out_m_s: FloatArray

    @classmethod
    def of(cls, targets: Targets) -> "_Path":
        everyone = np.arange(len(targets.ids), dtype=np.int32)
        start_s, end_s = targets.ignition_s, targets.burnout_s
        short_s = np.minimum(_END_STEP_S, end_s - start_s)
        after, before = np.minimum(start_s + short_s, end_s), np.maximum(end_s - short_s, start_s)
        moved_in = targets.position_ecef_m(everyone, after) - targets.position_ecef_m(everyone, start_s)
        moved_out = targets.position_ecef_m(everyone, end_s) - targets.position_ecef_m(everyone, before)
        return cls(targets, moved_in / (after - start_s)[:, None], moved_out / (end_s - before)[:, None])

    def position_ecef_m(self, pair: IntArray, time_s: FloatArray) -> FloatArray:
        """Return positions (n, 3) of targets (n,) at any times (n,)."""
        target = pair.astype(np.int32)
        start_s, end_s = self.targets.ignition_s[target], self.targets.burnout_s[target]
        position = self.targets.position_ecef_m(target, np.clip(time_s, start_s, end_s))
        early_s, late_s = np.minimum(time_s - start_s, 0.0), np.maximum(time_s - end_s, 0.0)
        drawn_out: FloatArray = (
            position + self.velocity_in_m_s[target] * early_s[:, None] + self.velocity_out_m_s[target] * late_s[:, None]
        )
        return drawn_out


def _judge(
    sensor: Sensor, grid: _Grid, sensor_ecef_m: FloatArray, target_ecef_m: FloatArray
) -> tuple[NDArray[np.uint8], IntArray]:
    """Return the `Sight` of each cell, by the point it starts at, and why pairs are blocked."""
    margins = _Margins.of(sensor, sensor_ecef_m, target_ecef_m)
    guard_rad = 2.0 * _STRAY_M / _distance_m(sensor_ecef_m, target_ecef_m)
    cells = grid.cells()
    horizon, hidden = _certain(margins.horizon_rad, guard_rad, cells)
    grazing, behind = _certain(margins.grazing_m, np.full(len(guard_rad), 2.0 * _STRAY_M), cells)
    inside, outside = _certain(margins.inside_rad, guard_rad, cells)
    above, below = _certain(margins.above_rad, guard_rad, cells)
    impossible = np.zeros(len(cells), dtype=np.bool_)
    blocked = np.full(len(grid.points), Blocked.NOT, dtype=np.int64)
    for reason, never in (
        (Blocked.BEHIND_EARTH, hidden & behind),
        (Blocked.OUTSIDE_FIELD_OF_REGARD, outside),
        (Blocked.BELOW_MINIMUM_ELEVATION, below),
    ):
        impossible |= never
        newly = ~grid.any_of_pair(cells[~impossible]) & (blocked == Blocked.NOT)
        blocked = np.where(newly, reason, blocked)
    sight = np.zeros(len(grid.pair), dtype=np.uint8)
    sure = (horizon | grazing) & inside & above
    sight[cells] = np.where(impossible, Sight.NEVER, np.where(sure, Sight.ALWAYS, Sight.PERHAPS))
    return sight, blocked


def _certain(margin: FloatArray, guard: FloatArray, cells: IntArray) -> tuple[BoolArray, BoolArray]:
    """Return in which cells a margin is positive throughout, and in which negative throughout."""
    early, late = margin[cells], margin[cells + 1]
    stray = np.maximum(guard[cells], guard[cells + 1])
    always: BoolArray = np.minimum(early, late) > stray
    never: BoolArray = np.maximum(early, late) < -stray
    return always, never


def _has_doubt(grid: _Grid, sight: NDArray[np.uint8], first_s: FloatArray, last_s: FloatArray) -> BoolArray:
    """Return which pairs have, between their first and last moment in view, a cell that is not seen throughout."""
    cells = grid.cells()
    time_s, pair = grid.time_s[cells], grid.pair[cells]
    between = (time_s + GRID_STEP_S > first_s[pair]) & (time_s < last_s[pair])
    return grid.any_of_pair(cells[between & (sight[cells] != Sight.ALWAYS)])


def _phase_ns(sensor: Sensor, targets: Targets, uniform: float) -> IntArray:
    """Return each target's place in the sensor's scan period, judged at its ignition."""
    everyone = np.arange(len(targets.ids), dtype=np.int32)
    target_ecef_m = targets.position_ecef_m(everyone, targets.ignition_s)
    return sensor.scan.phase_ns(sensor.orbit.position_ecef_m(targets.ignition_s), target_ecef_m, uniform)


def _scans(
    first_s: FloatArray, last_s: FloatArray, phase_ns: IntArray, period_ns: int, end_ns: int
) -> tuple[IntArray, IntArray]:
    """Return the first scan after `first_s` (one at that instant does not see the launch) and the last to `last_s`."""
    first_ns = np.rint(np.where(np.isfinite(first_s), first_s, 0.0) * _NS).astype(np.int64)
    last_ns = np.rint(np.where(np.isfinite(last_s), last_s, -1.0) * _NS).astype(np.int64)
    first_scan = np.maximum((first_ns - phase_ns) // period_ns + 1, 0)
    return first_scan, (np.minimum(last_ns, end_ns - 1) - phase_ns) // period_ns


def _distance_m(one_m: FloatArray, other_m: FloatArray) -> FloatArray:
    x, y, z = (one_m[:, axis] - other_m[:, axis] for axis in range(3))
    distance_m: FloatArray = np.sqrt(x * x + y * y + z * z)
    return distance_m


#: Each iteration shrinks the error by speed / c, below 3e-5: three leave less than a nanosecond's rounding.
_LIGHT_TIME_ITERATIONS = 3
