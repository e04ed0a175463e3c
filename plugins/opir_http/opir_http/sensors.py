"""The states of sensors at a time."""

import math
from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from opir_core.live import SensorStatus
from opir_core.output import timestamp_text
from opir_core.plugin import Sensor
from opir_http.answers import SensorPointing, SensorState


def sensor_states(
    sensors: Sequence[Sensor],
    time_s: float,
    counts: Sequence[int],
    last_s: Sequence[float | None],
    epoch_us: int,
    health: Sequence[Mapping[str, Any] | None],
) -> list[SensorState]:
    """Return place, state, counts and health of each sensor at a scene time, s.

    `last_s` are the times of the last detections. `health` is the calibration of each sensor as the
    tracker estimates it, or None.
    """
    return [
        _state(sensor, time_s, count, detection_s, epoch_us, calibration)
        for sensor, count, detection_s, calibration in zip(
            sensors, counts, last_s, health, strict=True
        )
    ]


def _state(
    sensor: Sensor,
    time_s: float,
    count: int,
    detection_s: float | None,
    epoch_us: int,
    health: Any,
) -> SensorState:
    position = sensor.orbit.position_ecef_m(np.array([time_s]))[0]
    period_s = sensor.scan.period_ns * 1e-9
    is_detecting = detection_s is not None and time_s - detection_s <= 2.0 * period_s + 0.5
    half_angle_deg = float(np.degrees(sensor.field_of_regard_half_angle_rad))
    return SensorState(
        sensor_id=sensor.id,
        sensor_type=sensor.type,
        state="detecting" if is_detecting else "searching",
        scan_period_ms=sensor.scan.period_ns * 1e-6,
        position_ecef_m=[round(axis, 1) for axis in position.tolist()],
        field_of_regard_half_angle_deg=round(half_angle_deg, 4),
        detections=count,
        last_detection=None
        if detection_s is None
        else timestamp(epoch_us + round(detection_s * 1e9) // 1000),
        health=health,
    )


def pointing_of(sensor: Sensor, status: SensorStatus, epoch_us: int) -> SensorPointing | None:
    """Return where the narrow field of a sensor is, None for a sensor without one."""
    field = status.field
    if field is None:
        return None
    aim = field.aim
    has_turned = math.isfinite(aim.from_s)
    return SensorPointing(
        half_angle_deg=round(math.degrees(field.half_angle_rad), 4),
        mode=aim.mode,
        modes=list(sensor.modes),
        position_ecef_m=[round(axis, 1) for axis in field.position_ecef_m.tolist()]
        if math.isfinite(field.position_ecef_m[0])
        else None,
        looks_from=timestamp(epoch_us + round(aim.from_s * 1e6)) if has_turned else None,
        track_id=None if aim.track < 0 else aim.track,
        reason=aim.reason,
        is_tasked=field.is_tasked,
        refusal=field.refusal,
    )


def timestamp(unix_us: int) -> str:
    """Return the text of a Unix time, microseconds."""
    return timestamp_text(np.array([unix_us]))[0]
