"""The pairs of a sensor and a target that have looks, compiled in blocks.

A block has many sensors or some targets of one, so that memory beyond the plan itself is that of a
block. Per sensor and block there is one call of the scan pattern and, for orbits that move in ECEF,
one per step of the light times. Pairs that the Earth surely hides have no lines of sight.
"""

from collections.abc import Iterator, Sequence
from itertools import pairwise

import numpy as np
from attrs import evolve

from opir_core.arrays import BoolArray, FloatArray, IndexArray, IntArray
from opir_core.constants import SPEED_OF_LIGHT_M_S
from opir_core.interfaces.sensors import Sensor
from opir_core.planning.hidden_pairs import CoarseGrid, surely_hidden
from opir_core.planning.sensor_states import SensorStates
from opir_core.planning.sightlines import (
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
from opir_core.planning.visibility import (
    Margins,
    SunMargins,
    cell_visibility,
    needs_look_test,
    without_dark_gaps,
)

#: Points of the grid in a block, about: their columns stay in the processor's cache.
BLOCK_POINTS = 32_768


#: More than the light time changes while a target is observed, s: by 3e-5 of the time at 10 km/s.
_LIGHT_TIME_CHANGE_S = 1.0


class PairCompiler:
    """Compiles blocks of pairs; the settings of the sensors are columns.

    `uniforms` are the sensors' random numbers in [0, 1) for scan patterns with a random start,
    `exclusions` their solar exclusions, or nothing if none of them has any.
    """

    def __init__(
        self,
        sensors: Sequence[Sensor],
        targets: Targets,
        uniforms: Sequence[float],
        light_time: bool,
        end_ns: int,
        exclusions: Sequence[SolarExclusion | None] = (),
    ) -> None:
        self._sensors = sensors
        self._targets = targets
        self._uniforms = uniforms
        self._light_time = light_time
        self._end_ns = end_ns
        self._exclusions = {
            number: exclusion
            for number, exclusion in enumerate(exclusions)
            if exclusion is not None
        }
        self._states = SensorStates.of(tuple(sensors))
        self._is_moving = np.array(
            [not sensor.orbit.is_stationary for sensor in sensors], dtype=np.bool_
        )
        self._follows = np.array([sensor.follows_bodies for sensor in sensors], dtype=np.bool_)
        self._half_angle_rad = np.array(
            [sensor.field_of_regard_half_angle_rad for sensor in sensors]
        )
        self._least_rad = np.array([sensor.minimum_elevation_rad for sensor in sensors])
        self._period_ns = np.array([sensor.scan.period_ns for sensor in sensors], dtype=np.int64)

    def compiled(self) -> tuple[Pairs, Sightlines]:
        """Return all pairs, including those without looks before the scene's end, and their lines
        of sight.
        """
        pairs = list[Pairs]()
        lines = list[Sightlines]()
        for block in self.blocks():
            of_block, lines_of_block = self.block(*block)
            pairs.append(of_block)
            lines.append(lines_of_block)
        return Pairs.concatenate(pairs), Sightlines.joined(lines)

    def most_looks(self) -> FloatArray:
        """Return upper bounds (sensors,) of the looks; scan patterns are asked for the phases of
        all pairs.
        """
        looks = np.zeros(len(self._sensors))
        for sensor, target in self.blocks():
            until_s = self._until_s(sensor, target)
            _, sensor_ecef_m, target_ecef_m = self._ends(sensor, target, until_s)
            self._phase_ns(sensor, sensor_ecef_m[::2], target_ecef_m[::2])
            observed_s = until_s - self._targets.ignition_s[target] + _LIGHT_TIME_CHANGE_S
            span_ns = np.minimum(observed_s * 1e9, self._end_ns)
            np.add.at(looks, sensor, span_ns / self._period_ns[sensor] + 1.0)
        return looks

    def pairs(self, is_chosen: BoolArray) -> Pairs:
        """Return pairs, sorted by sensor, then target, of those that are chosen (sensors, targets);
        no lines of sight are kept."""
        pair_blocks = []
        for sensor, target in self.blocks():
            rows = np.flatnonzero(is_chosen[sensor, target])
            pair_blocks.append(self.block(sensor[rows], target[rows])[0])
        return Pairs.concatenate(pair_blocks)

    def blocks(self) -> Iterator[tuple[IndexArray, IndexArray]]:
        """Yield the sensors and targets (n,) of each block: all pairs, sorted by sensor, then
        target.
        """
        count = len(self._targets.ids)
        rows = np.arange(len(self._sensors) * count)
        sensor = (rows // max(count, 1)).astype(np.int32)
        target = (rows % max(count, 1)).astype(np.int32)
        observed_s = self._until_s(sensor, target) - self._targets.ignition_s[target]
        # Three more: the grid encloses the observed time, which light times shift.
        points = np.cumsum(observed_s.astype(np.int64) + 3)
        number = (points - 1) // BLOCK_POINTS
        edges = [0, *(np.flatnonzero(np.diff(number)) + 1).tolist(), len(rows)]
        for block_rows in map(slice, edges[:-1], edges[1:]) if len(rows) else ():
            yield sensor[block_rows], target[block_rows]

    def block(self, sensor: IndexArray, target: IndexArray) -> tuple[Pairs, Sightlines]:
        """Return pairs of sensors and targets (n,), sorted by sensor, and their lines of sight."""
        until_s = self._until_s(sensor, target)
        emission_s, sensor_ecef_m, target_ecef_m = self._ends(sensor, target, until_s)
        pairs = self._hidden(
            sensor, target, self._phase_ns(sensor, sensor_ecef_m[::2], target_ecef_m[::2]), until_s
        )
        path = TargetPath.of(self._targets, target, until_s)
        rows = np.flatnonzero(~self._is_behind_earth(sensor, path))
        ends = np.stack([2 * rows, 2 * rows + 1], axis=1).ravel()
        look_s = self._look_s(
            np.repeat(sensor[rows], 2), emission_s[ends], sensor_ecef_m[ends], target_ecef_m[ends]
        )
        observed, lines = self._observed(
            pairs.take(rows), path.take(rows), look_s[::2], look_s[1::2]
        )
        pairs.overwrite(rows, observed)
        first_point = np.zeros(len(pairs), dtype=np.int64)
        first_point[rows] = lines.first_point
        sightlines = Sightlines(first_point, lines.travel_s, lines.elevation_sine, lines.sight)
        return pairs, sightlines.over_looks(pairs, np.arange(len(pairs)))

    def _hidden(
        self, sensor: IndexArray, target: IndexArray, phase_ns: IntArray, until_s: FloatArray
    ) -> Pairs:
        """Return pairs without looks: all are behind the Earth."""
        period_ns = self._period_ns[sensor]
        never = np.zeros(len(sensor), dtype=np.bool_)
        blocked = np.full(len(sensor), Blocked.BEHIND_EARTH, np.int64)
        start = np.zeros(len(sensor), dtype=np.int64)
        pairs = Pairs(
            sensor,
            target,
            period_ns,
            phase_ns,
            start,
            start,
            never,
            blocked,
            until_s,
            start,
            start - 1,
        )
        return self._with_scans(pairs)

    def _observed(
        self, pairs: Pairs, path: TargetPath, start_s: FloatArray, stop_s: FloatArray
    ) -> tuple[Pairs, Sightlines]:
        """Return pairs with their looks, from the arrival of first and last light (n,), and their
        lines of sight.
        """
        sensor = pairs.sensor
        target = pairs.target
        grid = Grid.over(start_s, stop_s)
        travel_s, sensor_ecef_m, target_ecef_m = self._sampled(sensor, path, grid)
        of_point = sensor[grid.pair]
        margins = Margins.of(
            self._half_angle_rad[of_point], self._least_rad[of_point], sensor_ecef_m, target_ecef_m
        )
        sun = self._sun(of_point, grid, sensor_ecef_m, target_ecef_m)
        sight, blocked = cell_visibility(
            grid, margins, distance_m(sensor_ecef_m, target_ecef_m), sun
        )
        if self._targets.dark_gaps_s.shape[1]:
            gaps_s = np.where(
                self._follows[sensor, None, None], np.nan, self._targets.dark_gaps_s[target]
            )
            sight = without_dark_gaps(sight, grid, grid.time_s - travel_s, gaps_s)
        first_s, last_s = grid.span(np.flatnonzero(sight != Visibility.NEVER), start_s, stop_s)
        # The first scan after `first_s` (at that instant the launch is not seen) and the last to
        # `last_s`.
        first_ns = np.rint(np.where(np.isfinite(first_s), first_s, 0.0) * 1e9).astype(np.int64)
        last_ns = np.rint(np.where(np.isfinite(last_s), last_s, -1.0) * 1e9).astype(np.int64)
        last_ns = np.where(blocked == Blocked.NOT, np.minimum(last_ns, self._end_ns - 1), -1)
        is_checked = needs_look_test(grid, sight, first_s, last_s)
        observed = evolve(
            pairs, is_checked=is_checked, blocked=blocked, from_ns=first_ns, to_ns=last_ns
        )
        return self._with_scans(observed), Sightlines(
            grid.first_point, travel_s, np.sin(margins.horizon_rad), sight
        )

    def _with_scans(self, pairs: Pairs) -> Pairs:
        """Return pairs with the scans of their phases: the first after `from_ns` to the last at
        `to_ns` at most.
        """
        phase_ns = pairs.phase_ns
        period_ns = pairs.period_ns
        first_scan = np.maximum((pairs.from_ns - phase_ns) // period_ns + 1, 0)
        is_seen = (pairs.blocked == Blocked.NOT) | (pairs.blocked == Blocked.NO_LOOK)
        last_scan = np.where(is_seen, (pairs.to_ns - phase_ns) // period_ns, first_scan - 1)
        no_look = np.where(last_scan < first_scan, Blocked.NO_LOOK, Blocked.NOT)
        blocked = np.where(is_seen, no_look, pairs.blocked)
        return evolve(pairs, first_scan=first_scan, last_scan=last_scan, blocked=blocked)

    def rephased(self, pairs: Pairs) -> Pairs:
        """Return all pairs of the plan with other phases: those of this compiler's random
        numbers.
        """
        ignition_s = self._targets.ignition_s[pairs.target]
        target_ecef_m = self._targets.position_ecef_m(pairs.target, ignition_s)
        phase_ns = self._phase_ns(
            pairs.sensor, self._positions(pairs.sensor, ignition_s), target_ecef_m
        )
        return self._with_scans(evolve(pairs, phase_ns=phase_ns))

    def _is_behind_earth(self, sensor: IndexArray, path: TargetPath) -> BoolArray:
        """Return which pairs (n,) the Earth surely hides all the time."""
        grid = CoarseGrid.over(self._targets.ignition_s[path.target], path.end_s)
        target_ecef_m = path.position_ecef_m(grid.pair, grid.time_s)
        of_point = sensor[grid.pair]
        is_moving = self._is_moving[sensor]
        sensor_ecef_m = self._positions(of_point, grid.time_s)
        if self._light_time and is_moving.any():
            travel_s = distance_m(sensor_ecef_m, target_ecef_m) / SPEED_OF_LIGHT_M_S
            sensor_ecef_m = self._positions(of_point, grid.time_s + travel_s)
        return surely_hidden(grid, sensor_ecef_m, target_ecef_m, is_moving)

    def _until_s(self, sensor: IndexArray, target: IndexArray) -> FloatArray:
        """Return the scene times (n,) up to which sensors observe targets."""
        targets = self._targets
        return np.where(self._follows[sensor], targets.end_s[target], targets.glow_end_s[target])

    def _ends(
        self, sensor: IndexArray, target: IndexArray, until_s: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return ignition and end of each pair in turn: times (2n,), positions of the sensor and of
        the target.
        """
        emission_s = np.stack([self._targets.ignition_s[target], until_s], axis=1).ravel()
        target_ecef_m = self._targets.position_ecef_m(np.repeat(target, 2), emission_s)
        return emission_s, self._positions(np.repeat(sensor, 2), emission_s), target_ecef_m

    def _look_s(
        self,
        sensor: IndexArray,
        emission_s: FloatArray,
        sensor_ecef_m: FloatArray,
        target_ecef_m: FloatArray,
    ) -> FloatArray:
        """Return when light that leaves targets (n, 3) at scene times (n,) arrives at sensors,
        given where they are.
        """
        if not self._light_time:
            return emission_s
        look_s = emission_s + distance_m(sensor_ecef_m, target_ecef_m) / SPEED_OF_LIGHT_M_S
        for _ in range(LIGHT_TIME_ITERATIONS - 1):
            look_s = (
                emission_s
                + distance_m(self._positions(sensor, look_s), target_ecef_m) / SPEED_OF_LIGHT_M_S
            )
        return look_s

    def _sampled(
        self, sensor: IndexArray, path: TargetPath, grid: Grid
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
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

    def _phase_ns(
        self, sensor: IndexArray, sensor_ecef_m: FloatArray, target_ecef_m: FloatArray
    ) -> IntArray:
        """Return the phases (n,) of targets in their sensors' scan periods, for their positions at
        ignition, ns.
        """
        phase_ns = np.empty(len(sensor), dtype=np.int64)
        for number, rows in _runs(sensor):
            scan = self._sensors[number].scan
            phase_ns[rows] = scan.phase_ns(
                sensor_ecef_m[rows], target_ecef_m[rows], self._uniforms[number]
            )
        return phase_ns

    def _sun(
        self, sensor: IndexArray, grid: Grid, sensor_ecef_m: FloatArray, target_ecef_m: FloatArray
    ) -> SunMargins | None:
        """Return the margins of lines of sight to the solar exclusions, or None if no sensor has
        one.
        """
        excluded = [
            (self._exclusions[number], rows)
            for number, rows in _runs(sensor)
            if number in self._exclusions
        ]
        if not excluded:
            return None
        margins = SunMargins(np.full(len(sensor), np.inf), np.zeros(len(sensor)))
        for exclusion, rows in excluded:
            sensor_margins = SunMargins.of(
                exclusion,
                grid.pair[rows],
                sensor_ecef_m[rows],
                target_ecef_m[rows],
                grid.time_s[rows],
            )
            margins.overwrite(rows, sensor_margins)
        return margins


def _runs(sensor: IndexArray) -> list[tuple[int, slice]]:
    """Return each of sorted sensors (n,) with its rows."""
    edges = [0, *(np.flatnonzero(np.diff(sensor)) + 1).tolist(), len(sensor)]
    return [(int(sensor[start]), slice(start, stop)) for start, stop in pairwise(edges) if stop]
