"""The truth of foreign detections, if it is known: for scores and summaries, never for a tracker."""

from typing import NamedTuple

import numpy as np

from opir_core import Detections, DetectionTruth, Plan
from opir_core.arrays import FloatArray, IndexArray, RowArray
from opir_core.constants import SPEED_OF_LIGHT_M_S
from opir_readers.detections.numbers import Rows
from opir_readers.frames import lengths

#: A line of sight is of the target that it is nearest to, within this number of standard deviations
#: of noise and bias.
_GATE = 6.0

#: Standard deviations below this, rad, are of rounding: events have angles to 1e-7 degrees or so.
_LEAST_SIGMA_RAD = 1e-8


class _Lines(NamedTuple):
    """Ranges (n,), m, times of emission, s, and angles between line of sight and target, rad; inf
    without a position.
    """

    range_m: FloatArray
    emission_s: FloatArray
    angle_rad: FloatArray


def truth_of(rows: Rows, detections: Detections, plan: Plan) -> DetectionTruth:
    """Return the truth of detections, -1 for those of no target of the plan.

    Of rows that name targets, these; else the targets that lines of sight are nearest to, within
    their errors.
    """
    if any("target_id" in row for row in rows):
        number = {name: place for place, name in enumerate(plan.targets.ids)}
        numbers = [number.get(str(row.get("target_id")), -1) for row in rows]
        target = np.array(numbers, dtype=np.int32)
    else:
        target = _nearest(detections, plan)
    unknown = np.full(len(rows), np.nan)
    emission_s = unknown.copy()
    range_m = unknown.copy()
    known = np.flatnonzero(target >= 0)
    if len(known):
        lines = _lines(detections, plan, known, target[known])
        range_m[known] = lines.range_m
        emission_s[known] = lines.emission_s
    return DetectionTruth(target, emission_s, range_m, unknown, unknown.copy())


def _nearest(detections: Detections, plan: Plan) -> IndexArray:
    """Return the targets (n,) that lines of sight are nearest to, in standard deviations; -1 beyond
    the gate.
    """
    biases = np.array([sensor.line_of_sight_bias_sigma_rad for sensor in plan.sensors])
    sigma = np.hypot(detections.line_of_sight_sigma_rad, biases[detections.sensor])
    sigma = np.maximum(sigma, _LEAST_SIGMA_RAD)
    time_s = detections.time_s
    target = np.full(len(detections), -1, dtype=np.int32)
    least = np.full(len(detections), _GATE)
    for number in range(len(plan.targets.ids)):
        # A second more for light times.
        start_s = plan.targets.ignition_s[number]
        rows = np.flatnonzero((time_s >= start_s) & (time_s <= plan.targets.end_s[number] + 1.0))
        lines = _lines(detections, plan, rows, np.full(len(rows), number, dtype=np.int32))
        distance = lines.angle_rad / sigma[rows]
        is_nearer = distance < least[rows]
        target[rows[is_nearer]] = number
        least[rows[is_nearer]] = distance[is_nearer]
    return target


def _lines(detections: Detections, plan: Plan, rows: RowArray, target: IndexArray) -> _Lines:
    """Return the lines from the sensors of rows (n,) to targets (n,)."""
    time_s = detections.time_s[rows]
    origin = detections.sensor_ecef_m[rows]
    ignition_s = plan.targets.ignition_s[target]
    end_s = plan.targets.end_s[target]
    emission_s = np.clip(time_s, ignition_s, end_s)
    speed_m_s = SPEED_OF_LIGHT_M_S if plan.scene.light_time else np.inf
    for _ in range(2 if plan.scene.light_time else 1):
        offset = plan.targets.position_ecef_m(target, emission_s) - origin
        range_m = lengths(offset)
        emission_s = np.clip(time_s - range_m / speed_m_s, ignition_s, end_s)
    miss = offset / range_m[:, None] - detections.line_of_sight_ecef[rows]
    angle = lengths(miss)
    return _Lines(range_m, emission_s, np.where(np.isfinite(angle), angle, np.inf))
