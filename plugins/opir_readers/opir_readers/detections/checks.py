"""The plausibility of foreign detections in their scene: times, places of sensors, and where lines
of sight lead.
"""

from collections.abc import Iterator

import numpy as np

from opir_core import Plan, Scene
from opir_core.arrays import BoolArray, IntArray
from opir_core.errors import number_of
from opir_core.geometry import dot
from opir_core.plugin import BadFileError
from opir_readers.detections.columns_of_run import RunColumns
from opir_readers.detections.line_doubts import odd_sigmas, rare_lines, unwatched_lines
from opir_readers.detections.meeting import slips_of_lines
from opir_readers.detections.numbers import Rows, place_of
from opir_readers.detections.times import NS_PER_S
from opir_readers.frames import lengths
from opir_readers.table_checks import SceneTimes, scale_text

#: Lines of sight that pass the Earth's centre farther away than this, m, meet no launch: 1 600 km
#: of height.
_FARTHEST_M = 8.0e6

#: Sensors farther from their orbits in the scene than this, m, are others, or of another time.
_ASTRAY_M = 20_000.0


def within_scene(rows: Rows, time_ns: IntArray, scene: Scene) -> Rows:
    """Return the rows whose times are those of a scene; raises `BadFileError` without any."""
    is_within = (time_ns >= 0) & (time_ns <= round(scene.duration_s * NS_PER_S))
    if not is_within.any():
        times = SceneTimes(scene.epoch_us, scene.duration_s)
        begin_s = float(time_ns.min()) / NS_PER_S
        end_s = float(time_ns.max()) / NS_PER_S
        scale = "; set the scene's epoch"
        if "time_s" in rows[0]:
            scale = scale_text(begin_s, times)
        raise BadFileError(
            f"{place_of(rows[0])}its times, {times.text(begin_s)} to {times.text(end_s)}, and the"
            f" scene, {times.text(0.0)} to {times.text(scene.duration_s)}, have nothing in"
            f" common{scale}"
        )
    return [rows[place] for place in np.flatnonzero(is_within).tolist()]


def warnings_of(columns: RunColumns, plan: Plan) -> Iterator[str]:
    """Yield the likely errors of detections, sensor by sensor."""
    detections = columns.detections
    origin_m = detections.sensor_ecef_m
    direction = detections.line_of_sight_ecef
    along_m = -dot(origin_m, direction)
    beside_m = origin_m + along_m[:, None] * direction
    misses = lengths(beside_m) > _FARTHEST_M
    yield from _many(
        columns,
        plan,
        misses | ~(along_m > 0.0),
        "leads past the Earth; are angles in other units, from other axes, or counted from"
        " elsewhere?",
    )
    nadir_rad = np.arccos(np.clip(along_m / lengths(origin_m), -1.0, 1.0))
    half_angles = np.array([sensor.field_of_regard_half_angle_rad for sensor in plan.sensors])
    is_outside = nadir_rad > half_angles[detections.sensor] + 1e-3
    yield from _many(columns, plan, is_outside, "is outside of the sensor's field of regard")
    yield from odd_sigmas(columns, plan)
    yield from rare_lines(detections, plan)
    yield from slips_of_lines(columns, plan)
    yield from unwatched_lines(columns, plan)
    for number, sensor in enumerate(plan.sensors):
        rows = np.flatnonzero(detections.sensor == number)
        offset = origin_m[rows] - sensor.orbit.position_ecef_m(detections.time_s[rows])
        astray_m = lengths(offset)
        if astray_m.max(initial=0.0) > _ASTRAY_M:
            worst = int(astray_m.argmax())
            yield (
                f"{place_of(columns.rows[rows[worst]])}sensor {sensor.id} is"
                f" {astray_m[worst] * 1e-3:.4g} km from its orbit in the scene; the tracker takes"
                " the file's places, and the scene's orbit for what it can see"
            )


def _many(columns: RunColumns, plan: Plan, is_wrong: BoolArray, words: str) -> Iterator[str]:
    """Yield, for each sensor with many wrong lines of sight, 5 % or more, how many and the first
    one.
    """
    for number, sensor in enumerate(plan.sensors):
        is_of_sensor = columns.detections.sensor == number
        count = int(np.count_nonzero(is_of_sensor))
        wrong = np.flatnonzero(is_wrong & is_of_sensor)
        if len(wrong) and len(wrong) >= 0.05 * count:
            line = place_of(columns.rows[int(wrong[0])])
            share = "alone"
            if len(wrong) > 1:
                share = f"as {len(wrong) - 1} others of {number_of('detection', count)}"
            yield f"{line}the line of sight of {sensor.id} {words} ({share})"
