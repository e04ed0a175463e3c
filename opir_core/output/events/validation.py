"""What detections owe an encoder: values that an event can carry."""

from collections.abc import Iterator, Sequence

import numpy as np

from opir_core.arrays import BoolArray, FloatArray
from opir_core.errors import ModelError
from opir_core.interfaces.protocols import Sensor
from opir_core.interfaces.records import Detections, Window
from opir_core.scene.scene import REPORTED_TYPES

# By how much the length of a unit vector may miss 1.
_UNIT_ROUNDING = 1e-6

# Components of positions, m, whose squares a double still holds: with any other there would be no horizontal.
_FARTHEST_M = 1e100


def refuse_unlawful(window: Window, sensors: Sequence[Sensor]) -> None:
    """Raise `ModelError` where detections hold what no event may: a nan confidence, a sensor that does not exist, …"""
    detections = window.detections
    for law, lawful in _laws(window, sensors):
        if not lawful.all():
            row = int(np.argmin(lawful))
            broken = len(lawful) - int(np.count_nonzero(lawful))
            raise ModelError(
                f"{broken} of {len(lawful)} detections cannot be encoded: {law}"
                f" (the first is of sensor {_sensor_name(detections, row, sensors)} at {detections.time_s[row]} s)"
            )


def _laws(window: Window, sensors: Sequence[Sensor]) -> Iterator[tuple[str, BoolArray]]:
    """Yield what must hold and for which rows it does; later laws rest on earlier ones."""
    d = window.detections
    yield f"the sensor must be in 0 to {len(sensors) - 1}", (d.sensor >= 0) & (d.sensor < len(sensors))
    band_ends = np.array([1 << len(sensor.bands) for sensor in sensors])
    yield "the bands must be the sensor's", d.bands < band_ends[d.sensor]
    yield "the reported type must be a code into REPORTED_TYPES", d.reported_type < len(REPORTED_TYPES)
    yield "the confidence must be in [0, 1]", (d.confidence >= 0.0) & (d.confidence <= 1.0)
    yield "the line of sight must be a unit vector", _is_unit(d.line_of_sight_ecef)
    yield "the standard deviation of the line of sight must be finite and not negative", _is_sigma(d)
    x, y, z = (np.abs(d.sensor_ecef_m) <= _FARTHEST_M).T
    yield f"the sensor's position must be finite, each component at most {_FARTHEST_M:g} m", x & y & z
    yield (
        "the estimate must be a row of the window's estimates",
        (d.estimate >= -1) & (d.estimate < len(window.estimates)),
    )


@np.errstate(over="ignore")
def _is_unit(vectors: FloatArray) -> BoolArray:
    x, y, z = vectors.T
    result: BoolArray = np.abs(np.sqrt(x * x + y * y + z * z) - 1.0) <= _UNIT_ROUNDING
    return result


def _is_sigma(detections: Detections) -> BoolArray:
    sigma_rad = detections.line_of_sight_sigma_rad
    result: BoolArray = (sigma_rad >= 0.0) & (sigma_rad < np.inf)
    return result


def _sensor_name(detections: Detections, row: int, sensors: Sequence[Sensor]) -> str:
    sensor = int(detections.sensor[row])
    return sensors[sensor].id if 0 <= sensor < len(sensors) else f"number {sensor}"
