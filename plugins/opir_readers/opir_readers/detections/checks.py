"""The plausibility of foreign detections in their scene: times, places of sensors, and where lines
of sight lead.
"""

from collections.abc import Iterator, Sequence

import numpy as np

from opir_core import Plan, Scene
from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.errors import number_of
from opir_core.plugin import BadFileError
from opir_readers.detections.columns_of_run import Row, RunColumns
from opir_readers.detections.meeting import slips_of_lines
from opir_readers.detections.numbers import place_of
from opir_readers.table_checks import SceneTimes, moment_text, scale_text

_NS = 1_000_000_000

#: Lines of sight that pass the Earth's centre farther away than this, m, meet no launch: 1 600 km
#: of height.
_FARTHEST_M = 8.0e6

#: Sensors farther from their orbits in the scene than this, m, are others, or of another time.
_ASTRAY_M = 20_000.0

#: Lines this many scan periods apart in the median, of at least so many gaps, were thinned out.
_RARE = 4
_FEWEST_GAPS = 8

#: Standard deviations of lines of sight that a sensor may plausibly have, as the setting of that
#: name, µrad.
_LEAST_SIGMA_URAD = 0.1
_MOST_SIGMA_URAD = 10_000.0

#: The share of a sensor's detections from which a warning is worth reading.
_MANY = 0.05


def within_scene(rows: Sequence[Row], when_ns: IntArray, scene: Scene) -> Sequence[Row]:
    """Return the rows whose times are those of a scene; raises `BadFileError` where none is."""
    is_in = (when_ns >= 0) & (when_ns <= round(scene.duration_s * _NS))
    if not is_in.any():
        times = SceneTimes(scene.epoch_us, scene.duration_s)
        first = float(when_ns.min()) / _NS
        last = float(when_ns.max()) / _NS
        begin, end, own, late = (
            moment_text(scene.epoch_us * 1e-6 + at) for at in (0.0, scene.duration_s, first, last)
        )
        scale = scale_text(first, times) if "time_s" in rows[0] else "; set the scene's epoch"
        raise BadFileError(
            f"{place_of(rows[0])}its times, {own} to {late}, and the scene, {begin} to {end}, have"
            f" nothing in common"
            f"{scale}"
        )
    return [row for row, is_due in zip(rows, is_in.tolist(), strict=True) if is_due]


def warnings_of(columns: RunColumns, plan: Plan) -> Iterator[str]:
    """Yield what of the detections may be an error, sensor by sensor."""
    found = columns.detections
    astray_m = np.zeros(len(found))
    for number in range(len(plan.sensors)):
        own = np.flatnonzero(found.sensor == number)
        orbit_m = plan.sensors[number].orbit.position_ecef_m(found.time_s[own])
        astray_m[own] = _length(found.sensor_ecef_m[own] - orbit_m)
    nearest_m, is_ahead = _passes(found.sensor_ecef_m, found.line_of_sight_ecef)
    yield from _many(columns, plan, ~is_ahead | (nearest_m > _FARTHEST_M), _MISSES)
    outside = _nadir_rad(found.sensor_ecef_m, found.line_of_sight_ecef)
    limit = np.array([sensor.field_of_regard_half_angle_rad for sensor in plan.sensors])[
        found.sensor
    ]
    yield from _many(
        columns, plan, outside > limit + 1e-3, "is outside of the sensor's field of regard"
    )
    yield from _odd_sigmas(columns, plan)
    yield from _rare_lines(columns, plan)
    yield from slips_of_lines(found, plan)
    for number in np.unique(found.sensor[astray_m > _ASTRAY_M]).tolist():
        own = np.flatnonzero(found.sensor == number)
        row = own[int(astray_m[own].argmax())]
        yield (
            f"{place_of(columns.rows[row])}sensor {plan.sensors[number].id} is"
            f" {astray_m[row] * 1e-3:.4g} km from its"
            " orbit in the scene; the tracker takes the file's places, and the scene's orbit for"
            " what it can see"
        )


_MISSES = (
    "leads past the Earth; are angles in other units, from other axes, or counted from elsewhere?"
)


def _rare_lines(columns: RunColumns, plan: Plan) -> Iterator[str]:
    """Yield, for each sensor, that its lines come more rarely than its scans in the scene."""
    found = columns.detections
    for number in np.unique(found.sensor).tolist():
        gaps_ns = np.diff(np.unique(found.time_ns[found.sensor == number]))
        sensor = plan.sensors[number]
        if len(gaps_ns) < _FEWEST_GAPS or np.median(gaps_ns) < _RARE * sensor.scan.period_ns:
            continue
        period_ms = float(np.median(gaps_ns)) * 1e-6
        yield (
            f"lines of {sensor.id} are {period_ms * 1e-3:.3g} s apart in the median, and its scans"
            f" in the scene {sensor.scan.period_ns / _NS:g} s: looks between count as darkness; if"
            f" the file is thinned, set scan_period_ms: {period_ms:.0f}"
        )


def _odd_sigmas(columns: RunColumns, plan: Plan) -> Iterator[str]:
    """Yield, for each sensor, standard deviations that no sensor has."""
    sigma_urad = columns.detections.line_of_sight_sigma_rad * 1e6
    is_odd = (sigma_urad < _LEAST_SIGMA_URAD) | (sigma_urad > _MOST_SIGMA_URAD)
    for number in np.unique(columns.detections.sensor[is_odd]).tolist():
        row = int(np.flatnonzero(is_odd & (columns.detections.sensor == number))[0])
        yield (
            f"{place_of(columns.rows[row])}the standard deviation of {plan.sensors[number].id},"
            f" {sigma_urad[row]:.3g} µrad, is outside of {_LEAST_SIGMA_URAD:g} to"
            f" {_MOST_SIGMA_URAD:g} µrad; is it in another unit (line_of_sight_sigma_rad)?"
        )


def _many(columns: RunColumns, plan: Plan, is_odd: BoolArray, words: str) -> Iterator[str]:
    """Yield, for each sensor with many odd lines of sight, how many and the first."""
    sensor = columns.detections.sensor
    for number in np.unique(sensor[is_odd]).tolist():
        own = int(np.count_nonzero(sensor == number))
        odd = np.flatnonzero(is_odd & (sensor == number))
        if len(odd) >= _MANY * own:
            where = place_of(columns.rows[int(odd[0])])
            count = (
                f"as {len(odd) - 1} others of {number_of('detection', own)}"
                if len(odd) > 1
                else "alone"
            )
            yield f"{where}the line of sight of {plan.sensors[number].id} {words} ({count})"


def _passes(origin_m: FloatArray, direction: FloatArray) -> tuple[FloatArray, BoolArray]:
    """Return how near the Earth's centre rays pass, m, and whether that is ahead of their
    sensor.
    """
    along = -(origin_m * direction).sum(axis=1)
    nearest = _length(origin_m + along[:, None] * direction)
    return nearest, along > 0.0


def _nadir_rad(origin_m: FloatArray, direction: FloatArray) -> FloatArray:
    cosine = -(origin_m * direction).sum(axis=1) / _length(origin_m)
    return np.arccos(np.clip(cosine, -1.0, 1.0))


def _length(vectors: FloatArray) -> FloatArray:
    return np.sqrt((vectors * vectors).sum(axis=1))
