"""All pairs of a scene: when each sensor looks at each target while it burns, or flies, and is in view."""

from collections.abc import Sequence

import numpy as np

from opir_core.arrays import FloatArray, IntArray
from opir_core.interfaces.protocols import Sensor
from opir_core.planning.targets import Targets
from opir_core.planning.visibility.grid import Grid, distance_m, look_time_s, sampled
from opir_core.planning.visibility.margins import Margins, judged, needs_look_test
from opir_core.planning.visibility.records import Blocked, Pairs, Sightlines, Visibility

_NS = 1_000_000_000


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
    return Pairs.concatenate([part[0] for part in parts]), Sightlines(
        first_point=np.concatenate([line.first_point + start for line, start in zip(lines, starts, strict=True)]),
        travel_s=np.concatenate([line.travel_s for line in lines]),
        elevation_sine=np.concatenate([line.elevation_sine for line in lines]),
        sight=np.concatenate([line.sight for line in lines]),
    )


def _sensor_pairs(
    number: int, sensor: Sensor, targets: Targets, uniform: float, light_time: bool, end_ns: int
) -> tuple[Pairs, Sightlines]:
    """Return one sensor's pairs with all targets, and their lines of sight."""
    everyone = np.arange(len(targets.ids), dtype=np.int32)
    start_s = look_time_s(sensor, targets, targets.ignition_s, light_time)
    until_s = targets.watched_until_s(sensor)
    stop_s = look_time_s(sensor, targets, until_s, light_time)
    grid = Grid.over(start_s, stop_s)
    travel_s, sensor_ecef_m, target_ecef_m = sampled(sensor, targets, grid, light_time)
    margins = Margins.of(sensor, sensor_ecef_m, target_ecef_m)
    sight, blocked = judged(grid, margins, distance_m(sensor_ecef_m, target_ecef_m))
    first_s, last_s = grid.span(np.flatnonzero(sight != Visibility.NEVER), start_s, stop_s)
    phase_ns = _phase_ns(sensor, targets, uniform)
    first_scan, last_scan = _scans(first_s, last_s, phase_ns, sensor.scan.period_ns, end_ns)
    last_scan = np.where(blocked == Blocked.NOT, last_scan, first_scan - 1)
    blocked = np.where((blocked == Blocked.NOT) & (last_scan < first_scan), Blocked.NO_LOOK, blocked)
    sensors, periods = np.full_like(everyone, number), np.full_like(phase_ns, sensor.scan.period_ns)
    is_checked = needs_look_test(grid, sight, first_s, last_s)
    pairs = Pairs(sensors, everyone, periods, phase_ns, first_scan, last_scan, is_checked, blocked, until_s)
    return pairs, Sightlines(grid.first_point, travel_s, np.sin(margins.horizon_rad), sight)


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
