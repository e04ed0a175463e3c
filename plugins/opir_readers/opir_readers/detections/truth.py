"""What foreign detections were of, where that is known: for scores and summaries, never for a
tracker.
"""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from opir_core import Detections, DetectionTruth, Plan
from opir_core.arrays import BoolArray, FloatArray, IndexArray, RowArray
from opir_core.constants import SPEED_OF_LIGHT_M_S

#: A line of sight is of the target that it is nearest to, within this number of standard deviations
#: of noise and bias.
_GATE = 6.0

#: Standard deviations below this, rad, are of rounding: events have angles to 1e-7 degrees or so.
_LEAST_SIGMA_RAD = 1e-8


def truth_of(
    rows: Sequence[Mapping[str, Any]], detections: Detections, plan: Plan
) -> DetectionTruth:
    """Return the truth of detections, -1 for those of no target of the plan.

    Of rows that name targets, these; else the targets that lines of sight are nearest to, within
    their errors.
    """
    if any("target_id" in row for row in rows):
        number = {name: place for place, name in enumerate(plan.targets.ids)}
        target = np.array(
            [number.get(str(row.get("target_id")), -1) for row in rows], dtype=np.int32
        )
    else:
        target = _nearest(detections, plan)
    emission_s, range_m = (np.full(len(rows), np.nan) for _ in range(2))
    seen = np.flatnonzero(target >= 0)
    if len(seen):
        range_m[seen], emission_s[seen], _ = _looks(detections, plan, seen, target[seen])
    unknown = np.full(len(rows), np.nan)
    return DetectionTruth(target, emission_s, range_m, unknown, unknown.copy())


def _nearest(detections: Detections, plan: Plan) -> IndexArray:
    """Return the targets (n,) that lines of sight are nearest to, in standard deviations; -1 beyond
    the gate.
    """
    bias = np.array([sensor.line_of_sight_bias_sigma_rad for sensor in plan.sensors])[
        detections.sensor
    ]
    sigma = np.maximum(np.hypot(detections.line_of_sight_sigma_rad, bias), _LEAST_SIGMA_RAD)
    target = np.full(len(detections), -1, dtype=np.int32)
    least = np.full(len(detections), _GATE)
    for number in range(len(plan.targets.ids)):
        rows = np.flatnonzero(_is_there(detections, plan, number))
        _, _, angle = _looks(detections, plan, rows, np.full(len(rows), number, dtype=np.int32))
        off = angle / sigma[rows]
        nearer = rows[off < least[rows]]
        target[nearer] = number
        least[nearer] = off[off < least[rows]]
    return target


def _is_there(detections: Detections, plan: Plan, number: int) -> BoolArray:
    """Return which detections were made while a target's position is known, with light times."""
    time_s = detections.time_s
    return np.asarray(
        (time_s >= plan.targets.ignition_s[number]) & (time_s <= plan.targets.end_s[number] + 1.0)
    )


def _looks(
    detections: Detections, plan: Plan, rows: RowArray, target: IndexArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return ranges, m, times of emission, s, and angles between line of sight and target, rad; inf
    where there is no target."""
    time_s = detections.time_s[rows]
    origin = detections.sensor_ecef_m[rows]
    first = plan.targets.ignition_s[target]
    last = plan.targets.end_s[target]
    emission_s = np.clip(time_s, first, last)
    for _ in range(2 if plan.scene.light_time else 1):
        offset = plan.targets.position_ecef_m(target, emission_s) - origin
        range_m = np.sqrt((offset * offset).sum(axis=1))
        if plan.scene.light_time:
            emission_s = np.clip(time_s - range_m / SPEED_OF_LIGHT_M_S, first, last)
    direction = offset / range_m[:, None]
    apart = direction - detections.line_of_sight_ecef[rows]
    angle = np.sqrt((apart * apart).sum(axis=1))
    return range_m, emission_s, np.where(np.isfinite(angle), angle, np.inf)
