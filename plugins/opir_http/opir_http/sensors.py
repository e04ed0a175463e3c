"""The states of satellites at a time, as JSON documents."""

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from opir_core.output import timestamp_text
from opir_core.plugin import Sensor


def sensor_documents(
    sensors: Sequence[Sensor],
    time_s: float,
    counts: Sequence[int],
    last_s: Sequence[float | None],
    epoch_us: int,
    health: Sequence[Mapping[str, Any] | None],
) -> list[dict[str, Any]]:
    """Return place, state, counts and health of each sensor at a scene time, s; `last_s` are times
    of last detections.

    `health` is what the tracker has found of each sensor, or None.
    """
    at_s = np.array([time_s])
    rows = []
    for sensor, count, last, found in zip(sensors, counts, last_s, health, strict=True):
        position = sensor.orbit.position_ecef_m(at_s)[0]
        period_s = sensor.scan.period_ns * 1e-9
        is_detecting = last is not None and time_s - last <= 2.0 * period_s + 0.5
        rows.append(
            {
                "sensor_id": sensor.id,
                "sensor_type": sensor.type,
                "state": "detecting" if is_detecting else "searching",
                "scan_period_ms": sensor.scan.period_ns * 1e-6,
                "position_ecef_m": [round(axis, 1) for axis in position.tolist()],
                "field_of_regard_half_angle_deg": round(
                    float(np.degrees(sensor.field_of_regard_half_angle_rad)), 4
                ),
                "detections": count,
                "last_detection": None if last is None else _timestamp(epoch_us, last),
                "health": found,
            }
        )
    return rows


def _timestamp(epoch_us: int, time_s: float) -> str:
    return timestamp_text(np.array([epoch_us + round(time_s * 1e9) // 1000]))[0]
