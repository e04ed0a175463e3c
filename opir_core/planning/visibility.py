"""The pairs of a sensor and a target that have looks, and when the target is visible.

Along each pair's burn or flight the geometry is sampled on a grid of scene time. Between two samples it deviates from
the chord by at most acceleration · step² / 8, so most cells are certain: visible throughout, or not at all. In the
other cells the looks are tested one by one.

Pairs are compiled in blocks, of many sensors or of some targets of one, so that memory beyond the plan itself is that
of a block. Per sensor and block there is one call of the scan pattern and, for orbits that move in ECEF, one per step
of the light times.
"""

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from attrs import frozen
from numpy.typing import NDArray

from opir_core.arrays import BoolArray, FloatArray, IndexArray, IntArray
from opir_core.constants import EARTH_ROTATION_RAD_S, SPEED_OF_LIGHT_M_S
from opir_core.geometry import elevation_rad, grazing_height_m, nadir_angle_rad
from opir_core.interfaces.columns import Columns
from opir_core.interfaces.protocols import Sensor
from opir_core.planning.sensor_states import SensorStates
from opir_core.planning.sightlines import (
    GRID_STEP_S,
    LIGHT_TIME_ITERATIONS,
    Blocked,
    Grid,
    Pairs,
    Sightlines,
    TargetPath,
    Visibility,
    distance_m,
)
from opir_core.planning.solar_exclusion import SolarExclusion
from opir_core.planning.targets import Targets

#: Upper bound of the relative acceleration of target and satellite, m/s² (about 10 g).
_ACCELERATION_BOUND_M_S2 = 100.0

#: Largest distance of a position from the chord between two samples, m.
CHORD_ERROR_M = _ACCELERATION_BOUND_M_S2 * GRID_STEP_S**2 / 8.0

#: Heights of lines of sight this far below the ground need not be exact: all between two samples is hidden.
_HIDDEN_M = -2.0 * CHORD_ERROR_M

#: Lines of sight at least this far above the target's horizon need no grazing height.
_WELL_ABOVE_RAD = 0.05


def visible_now(sensor: Sensor, sensor_ecef_m: FloatArray, target_ecef_m: FloatArray) -> BoolArray:
    """Return whether targets (n, 3) are in the field of regard, above the minimum elevation, not behind the Earth."""
    half_angle_rad, least_rad = sensor.field_of_regard_half_angle_rad, sensor.minimum_elevation_rad
    margins = Margins.of(half_angle_rad, least_rad, sensor_ecef_m, target_ecef_m)
    clear = (margins.horizon_rad > 0.0) | (margins.grazing_m > 0.0)
    seen: BoolArray = clear & (margins.inside_rad > 0.0) & (margins.above_rad > 0.0)
    return seen


@frozen(eq=False)
class Margins(Columns):
    """Margins of lines of sight for each condition; all positive means visible.

    A target is visible to a sensor above its horizon, and to one below if the line of sight passes above the ellipsoid.
    """

    horizon_rad: FloatArray
    grazing_m: FloatArray
    inside_rad: FloatArray
    above_rad: FloatArray

    @classmethod
    def of(
        cls,
        half_angle_rad: FloatArray | float,
        minimum_elevation_rad: FloatArray | float,
        sensor_ecef_m: FloatArray,
        target_ecef_m: FloatArray,
    ) -> "Margins":
        """Return the margins of lines of sight from sensor positions to targets (n, 3), with the half angles of the
        fields of regard and the minimum elevations (n,), or one for all."""
        horizon_rad = elevation_rad(target_ecef_m, sensor_ecef_m)
        inside_rad = half_angle_rad - nadir_angle_rad(sensor_ecef_m, target_ecef_m)
        above_rad = horizon_rad - minimum_elevation_rad
        grazing_m = np.full(len(horizon_rad), np.inf)
        low = np.flatnonzero(~(horizon_rad > _WELL_ABOVE_RAD))
        grazing_m[low] = grazing_height_m(sensor_ecef_m[low], target_ecef_m[low], exact_above_m=_HIDDEN_M)
        return cls(horizon_rad, grazing_m, inside_rad, above_rad)


@frozen(eq=False)
class SunMargins(Columns):
    """Margins of lines of sight at the grid's points to the solar exclusion, rad, and how far they turn in a step."""

    clear_rad: FloatArray
    turn_rad: FloatArray

    @classmethod
    def of(
        cls, exclusion: SolarExclusion, sensor_ecef_m: FloatArray, target_ecef_m: FloatArray, time_s: FloatArray
    ) -> "SunMargins":
        """Return the margins of lines of sight from sensor positions to targets (n, 3) at scene times (n,)."""
        way = target_ecef_m - sensor_ecef_m
        unit = way / distance_m(sensor_ecef_m, target_ecef_m)[:, None]
        # An arc is at most pi/2 times its chord; the Sun turns about the Earth in ECEF.
        turn_rad = np.append(0.5 * np.pi * distance_m(unit[1:], unit[:-1]), 0.0) + EARTH_ROTATION_RAD_S * GRID_STEP_S
        return cls(exclusion.margin_rad(sensor_ecef_m, target_ecef_m, time_s), turn_rad)


def cell_visibility(
    grid: Grid, margins: Margins, range_m: FloatArray, sun: SunMargins | None = None
) -> tuple[NDArray[np.uint8], IntArray]:
    """Return the `Visibility` of each cell, by its first point, and why pairs are `Blocked`."""
    guard_rad = 2.0 * CHORD_ERROR_M / range_m
    cells = grid.cells()
    horizon, hidden = _certain(margins.horizon_rad, guard_rad, cells)
    grazing, behind = _certain(margins.grazing_m, np.full(len(guard_rad), 2.0 * CHORD_ERROR_M), cells)
    inside, outside = _certain(margins.inside_rad, guard_rad, cells)
    above, below = _certain(margins.above_rad, guard_rad, cells)
    nobody = np.zeros(len(cells), dtype=np.bool_)
    clear, blinded = (~nobody, nobody) if sun is None else _certain(sun.clear_rad, guard_rad + sun.turn_rad, cells)
    impossible = np.zeros(len(cells), dtype=np.bool_)
    blocked = np.full(len(grid.points), Blocked.NOT, dtype=np.int64)
    for reason, never in (
        (Blocked.BEHIND_EARTH, hidden & behind),
        (Blocked.OUTSIDE_FIELD_OF_REGARD, outside),
        (Blocked.BELOW_MINIMUM_ELEVATION, below),
        (Blocked.NEAR_THE_SUN, blinded),
    ):
        impossible |= never
        newly = ~grid.any_of_pair(cells[~impossible]) & (blocked == Blocked.NOT)
        blocked = np.where(newly, reason, blocked)
    sight = np.zeros(len(grid.pair), dtype=np.uint8)
    certain = (horizon | grazing) & inside & above & clear
    sight[cells] = np.where(impossible, Visibility.NEVER, np.where(certain, Visibility.ALWAYS, Visibility.UNCERTAIN))
    return sight, blocked


def _certain(margin: FloatArray, guard: FloatArray, cells: IntArray) -> tuple[BoolArray, BoolArray]:
    """Return in which cells a margin is positive throughout, and in which it is negative throughout."""
    early, late = margin[cells], margin[cells + 1]
    bound = np.maximum(guard[cells], guard[cells + 1])
    always: BoolArray = np.minimum(early, late) > bound
    never: BoolArray = np.maximum(early, late) < -bound
    return always, never


#: Allowance at the ends of dark gaps, s: more than the error of interpolated light times.
_GAP_ALLOWANCE_S = 1e-6


def without_dark_gaps(
    sight: NDArray[np.uint8], grid: Grid, emission_s: FloatArray, gaps_s: FloatArray
) -> NDArray[np.uint8]:
    """Return the visibility of cells for sensors that see burns only: never in dark gaps, uncertain at their ends.

    `emission_s` are the times at which the light seen at the grid's points leaves; `gaps_s` (n, k, 2) are by pair.
    """
    if not gaps_s.shape[1]:
        return sight
    cells = grid.cells()
    early_s, late_s = emission_s[cells, None], emission_s[cells + 1, None]
    out_s, relit_s = gaps_s[grid.pair[cells]].transpose(2, 0, 1)
    meets = (late_s > out_s - _GAP_ALLOWANCE_S) & (early_s < relit_s + _GAP_ALLOWANCE_S)
    within = (early_s > out_s + _GAP_ALLOWANCE_S) & (late_s < relit_s - _GAP_ALLOWANCE_S)
    dark, edge = within.any(axis=1), meets.any(axis=1)
    result = sight.copy()
    result[cells[edge & (sight[cells] == Visibility.ALWAYS)]] = Visibility.UNCERTAIN
    result[cells[dark]] = Visibility.NEVER
    return result


def needs_look_test(grid: Grid, sight: NDArray[np.uint8], first_s: FloatArray, last_s: FloatArray) -> BoolArray:
    """Return which pairs have a cell without certain visibility between their first and last visible times."""
    cells = grid.cells()
    time_s, pair = grid.time_s[cells], grid.pair[cells]
    between = (time_s + GRID_STEP_S > first_s[pair]) & (time_s < last_s[pair])
    return grid.any_of_pair(cells[between & (sight[cells] != Visibility.ALWAYS)])


#: Points of the grid in a block, about: their columns stay in the processor's cache.
BLOCK_POINTS = 32_768

_NS = 1_000_000_000


def compile_pairs(
    sensors: Sequence[Sensor],
    targets: Targets,
    uniforms: Sequence[float],
    *,
    light_time: bool,
    end_ns: int,
    exclusions: Sequence[SolarExclusion | None] = (),
) -> tuple[Pairs, Sightlines]:
    """Return all pairs, including those without looks before the scene's end, and their lines of sight.

    `uniforms` are the sensors' random numbers in [0, 1) for scan patterns with a random start, `exclusions` their solar
    exclusions, or nothing if none of them has any.
    """
    compiler = _Compiler(sensors, targets, uniforms, light_time, end_ns, exclusions)
    parts = [compiler.block(*block) for block in compiler.blocks()]
    return Pairs.concatenate([part[0] for part in parts]), Sightlines.joined([part[1] for part in parts])


class _Compiler:
    """Compiles blocks of pairs; the settings of the sensors are columns."""

    def __init__(
        self,
        sensors: Sequence[Sensor],
        targets: Targets,
        uniforms: Sequence[float],
        light_time: bool,
        end_ns: int,
        exclusions: Sequence[SolarExclusion | None],
    ) -> None:
        self._sensors, self._targets, self._uniforms = sensors, targets, uniforms
        self._light_time, self._end_ns = light_time, end_ns
        self._exclusions = {number: each for number, each in enumerate(exclusions) if each is not None}
        self._states = SensorStates.of(tuple(sensors))
        self._follows = np.array([sensor.follows_bodies for sensor in sensors], dtype=np.bool_)
        self._half_angle_rad = np.array([sensor.field_of_regard_half_angle_rad for sensor in sensors])
        self._least_rad = np.array([sensor.minimum_elevation_rad for sensor in sensors])
        self._period_ns = np.array([sensor.scan.period_ns for sensor in sensors], dtype=np.int64)

    def blocks(self) -> Iterator[tuple[IndexArray, IndexArray]]:
        """Yield the sensors and targets (n,) of each block: all pairs, sorted by sensor, then target."""
        count = len(self._targets.ids)
        rows = np.arange(len(self._sensors) * count)
        sensor, target = (rows // max(count, 1)).astype(np.int32), (rows % max(count, 1)).astype(np.int32)
        observed_s = self._until_s(sensor, target) - self._targets.ignition_s[target]
        # Three more: the grid encloses the observed time, which light times shift.
        points = np.cumsum(observed_s.astype(np.int64) + 3)
        number = (points - 1) // BLOCK_POINTS
        edges = [0, *(np.flatnonzero(np.diff(number)) + 1).tolist(), len(rows)]
        for part in map(slice, edges[:-1], edges[1:]) if len(rows) else ():
            yield sensor[part], target[part]

    def block(self, sensor: IndexArray, target: IndexArray) -> tuple[Pairs, Sightlines]:
        """Return pairs of sensors and targets (n,), sorted by sensor, and their lines of sight."""
        until_s, phase_ns, start_s, stop_s = self._observed(sensor, target)
        grid = Grid.over(start_s, stop_s)
        travel_s, sensor_ecef_m, target_ecef_m = self._sampled(
            sensor, TargetPath.of(self._targets, target, until_s), grid
        )
        of_point = sensor[grid.pair]
        margins = Margins.of(self._half_angle_rad[of_point], self._least_rad[of_point], sensor_ecef_m, target_ecef_m)
        sun = self._sun(of_point, sensor_ecef_m, target_ecef_m, grid.time_s)
        sight, blocked = cell_visibility(grid, margins, distance_m(sensor_ecef_m, target_ecef_m), sun)
        if self._targets.dark_gaps_s.shape[1]:
            gaps_s = np.where(self._follows[sensor, None, None], np.nan, self._targets.dark_gaps_s[target])
            sight = without_dark_gaps(sight, grid, grid.time_s - travel_s, gaps_s)
        first_s, last_s = grid.span(np.flatnonzero(sight != Visibility.NEVER), start_s, stop_s)
        period_ns = self._period_ns[sensor]
        # The first scan after `first_s` (at that instant the launch is not seen) and the last to `last_s`.
        first_ns = np.rint(np.where(np.isfinite(first_s), first_s, 0.0) * _NS).astype(np.int64)
        last_ns = np.rint(np.where(np.isfinite(last_s), last_s, -1.0) * _NS).astype(np.int64)
        first_scan = np.maximum((first_ns - phase_ns) // period_ns + 1, 0)
        last_scan = (np.minimum(last_ns, self._end_ns - 1) - phase_ns) // period_ns
        last_scan = np.where(blocked == Blocked.NOT, last_scan, first_scan - 1)
        blocked = np.where((blocked == Blocked.NOT) & (last_scan < first_scan), Blocked.NO_LOOK, blocked)
        is_checked = needs_look_test(grid, sight, first_s, last_s)
        pairs = Pairs(sensor, target, period_ns, phase_ns, first_scan, last_scan, is_checked, blocked, until_s)
        lines = Sightlines(grid.first_point, travel_s, np.sin(margins.horizon_rad), sight)
        return pairs, lines.over_looks(pairs, np.arange(len(pairs)))

    def _until_s(self, sensor: IndexArray, target: IndexArray) -> FloatArray:
        """Return the scene times (n,) up to which sensors observe targets."""
        targets = self._targets
        return np.where(self._follows[sensor], targets.end_s[target], targets.burnout_s[target])

    def _observed(self, sensor: IndexArray, target: IndexArray) -> tuple[FloatArray, IntArray, FloatArray, FloatArray]:
        """Return the ends of the observed times, scan phases, and the times at which first and last light arrives."""
        targets = self._targets
        until_s = self._until_s(sensor, target)
        # Ignition and end of each pair in turn: rows of a sensor stay together.
        emission_s = np.stack([targets.ignition_s[target], until_s], axis=1).ravel()
        both = np.repeat(sensor, 2)
        target_ecef_m = targets.position_ecef_m(np.repeat(target, 2), emission_s)
        sensor_ecef_m = self._positions(both, emission_s)
        phase_ns = self._phase_ns(sensor, sensor_ecef_m[::2], target_ecef_m[::2])
        if not self._light_time:
            return until_s, phase_ns, emission_s[::2], emission_s[1::2]
        look_s = emission_s + distance_m(sensor_ecef_m, target_ecef_m) / SPEED_OF_LIGHT_M_S
        for _ in range(LIGHT_TIME_ITERATIONS - 1):
            look_s = emission_s + distance_m(self._positions(both, look_s), target_ecef_m) / SPEED_OF_LIGHT_M_S
        return until_s, phase_ns, look_s[::2], look_s[1::2]

    def _sampled(self, sensor: IndexArray, path: TargetPath, grid: Grid) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return light times, sensor and target positions at the grid's points."""
        sensor_ecef_m = self._positions(sensor[grid.pair], grid.time_s)
        travel_s = np.zeros(len(grid.time_s))
        target_ecef_m = path.position_ecef_m(grid.pair, grid.time_s)
        for _ in range(LIGHT_TIME_ITERATIONS if self._light_time else 0):
            travel_s = distance_m(sensor_ecef_m, target_ecef_m) / SPEED_OF_LIGHT_M_S
            target_ecef_m = path.position_ecef_m(grid.pair, grid.time_s - travel_s)
        return travel_s, sensor_ecef_m, target_ecef_m

    def _positions(self, sensor: IndexArray, time_s: FloatArray) -> FloatArray:
        """Return positions (n, 3), ECEF, m, of sorted sensors (n,) at times (n,)."""
        positions = self._states.position_ecef_m.take(sensor, axis=0)
        for number, rows in _runs(sensor):
            orbit = self._sensors[number].orbit
            if not orbit.is_stationary:
                positions[rows] = orbit.position_ecef_m(time_s[rows])
        return positions

    def _phase_ns(self, sensor: IndexArray, sensor_ecef_m: FloatArray, target_ecef_m: FloatArray) -> IntArray:
        """Return the phases (n,) of targets in their sensors' scan periods, for their positions at ignition, ns."""
        phase_ns = np.empty(len(sensor), dtype=np.int64)
        for number, rows in _runs(sensor):
            scan = self._sensors[number].scan
            phase_ns[rows] = scan.phase_ns(sensor_ecef_m[rows], target_ecef_m[rows], self._uniforms[number])
        return phase_ns

    def _sun(
        self, sensor: IndexArray, sensor_ecef_m: FloatArray, target_ecef_m: FloatArray, time_s: FloatArray
    ) -> SunMargins | None:
        """Return the margins of lines of sight to the solar exclusions, or None if no sensor has one."""
        excluded = [(self._exclusions[number], rows) for number, rows in _runs(sensor) if number in self._exclusions]
        if not excluded:
            return None
        margins = SunMargins(np.full(len(sensor), np.inf), np.zeros(len(sensor)))
        for exclusion, rows in excluded:
            own = SunMargins.of(exclusion, sensor_ecef_m[rows], target_ecef_m[rows], time_s[rows])
            margins.overwrite(rows, own)
        return margins


def _runs(sensor: IndexArray) -> list[tuple[int, slice]]:
    """Return each of sorted sensors (n,) with its rows."""
    edges = [0, *(np.flatnonzero(np.diff(sensor)) + 1).tolist(), len(sensor)]
    return [(int(sensor[start]), slice(start, stop)) for start, stop in pairwise(edges) if stop]
