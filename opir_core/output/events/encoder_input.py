"""Windows for an encoder: in blocks, without detections that have no message, with valid values."""

from collections.abc import Callable, Iterator, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np
from attrs import evolve

from opir_core.arrays import BoolArray, FloatArray
from opir_core.errors import ModelError, SinkError
from opir_core.interfaces.contexts import detection_count as detection_count
from opir_core.interfaces.outputs import Encoder
from opir_core.interfaces.records import Detections, DetectionTruth, Tracks, Window
from opir_core.interfaces.sensors import Sensor
from opir_core.scene.scene import REPORTED_TYPES

if TYPE_CHECKING:
    from opir_core.interfaces.contexts import EncoderContext
    from opir_core.output.heartbeats import Heartbeats
    from opir_core.output.spool.columns import Origin

#: Tracks in a block: a track is a message of 10 kB, with its covariances and regions.
TRACK_BLOCK_ROWS = 512

#: Detections in a block: enough that numpy's cost per call is small, few enough for the processor's
#: cache.
BLOCK_ROWS = 8_192

# Largest error of the length of a unit vector.
_UNIT_ROUNDING = 1e-6

# Largest component of a position, m, with a square that a double holds: beyond it there is no
# horizontal.
_FARTHEST_M = 1e100


def window_blocks(window: Window, rows: int = BLOCK_ROWS) -> Iterator[Window]:
    """Yield a window as windows of at most `rows` detections; nothing for a window without
    detections.

    Each has the window's times and estimates; only the first has its `looks` and `tracks`.
    """
    for start in range(0, len(window.detections), rows):
        block = slice(start, start + rows)
        window_block = evolve(
            window, detections=window.detections.take(block), truth=window.truth.take(block)
        )
        yield window_block if start == 0 else evolve(window_block, looks=0, tracks=Tracks.empty())


def encoder_blocks(window: Window, encoder: Encoder) -> Iterator[Window]:
    """Yield a window as windows of a limited number of events for an encoder; nothing for a window
    without events.
    """
    if not encoder.encodes_tracks:
        yield from window_blocks(window)
        return
    for start in range(0, len(window.tracks), TRACK_BLOCK_ROWS):
        yield evolve(
            window,
            looks=window.looks if start == 0 else 0,
            detections=Detections.empty(),
            truth=DetectionTruth.empty(),
            tracks=window.tracks.take(slice(start, start + TRACK_BLOCK_ROWS)),
            estimates=Tracks.empty(),
        )


def track_count(window: Window) -> int:
    """Return the number of a window's tracks, one per track and tick."""
    return len(window.tracks)


def event_counter(encoder: Encoder) -> Callable[[Window], int]:
    """Return the function that counts the events of a window for an encoder: its detections or its
    tracks.
    """
    return track_count if encoder.encodes_tracks else detection_count


def configured_heartbeats(
    sink: str, config: Any, encoder: Encoder, origin: "EncoderContext | Origin"
) -> "Heartbeats | None":
    """Return the heartbeats of a sink with the setting `heartbeat_s`, None where it has none;
    `SinkError` for an encoder of no JSON.
    """
    every_s = getattr(config, "heartbeat_s", None)
    if every_s is None:
        return None
    if "json" not in encoder.content_type:
        raise SinkError(f"{sink}: heartbeat_s needs an encoder of JSON, for heartbeats are JSON")
    from opir_core.output.heartbeats import Heartbeats  # most runs have none

    return Heartbeats(origin.sensors, origin.epoch_us, every_s)


def only_encodable(window: Window, encoder: Encoder) -> Window:
    """Return the window without the detections that have no message in an encoder."""
    mask = encoder.encodable(window) if len(window.detections) else None
    if mask is None or mask.all():
        return window
    return evolve(window, detections=window.detections.take(mask), truth=DetectionTruth.empty())


def require_valid(
    window: Window, sensors: Sequence[Sensor], types: int = len(REPORTED_TYPES)
) -> None:
    """Raise `ModelError` if detections have values that no event may have: a nan confidence, an
    unknown sensor, …
    """
    detections = window.detections
    for rule, valid in _rules(window, sensors, types):
        if not valid.all():
            row = int(np.argmin(valid))
            invalid = len(valid) - int(np.count_nonzero(valid))
            raise ModelError(
                f"{invalid} of {len(valid)} detections cannot be encoded: {rule}"
                f" (the first is of sensor {_sensor_name(detections, row, sensors)} at"
                f" {detections.time_s[row]} s)"
            )


def _rules(
    window: Window, sensors: Sequence[Sensor], types: int
) -> Iterator[tuple[str, BoolArray]]:
    """Yield each rule and the rows (n,) that satisfy it; later rules assume the earlier ones."""
    d = window.detections
    yield (
        f"the sensor must be in 0 to {len(sensors) - 1}",
        (d.sensor >= 0) & (d.sensor < len(sensors)),
    )
    band_ends = np.array([1 << len(sensor.bands) for sensor in sensors])
    yield "the bands must be the sensor's", d.bands < band_ends[d.sensor]
    yield (
        f"the reported type must be a code below {types}, the number of types",
        d.reported_type < types,
    )
    yield "the confidence must be in [0, 1]", (d.confidence >= 0.0) & (d.confidence <= 1.0)
    yield "the line of sight must be a unit vector", _is_unit(d.line_of_sight_ecef)
    yield (
        "the standard deviation of the line of sight must be finite and not negative",
        _is_sigma(d),
    )
    x, y, z = (np.abs(d.sensor_ecef_m) <= _FARTHEST_M).T
    yield (
        f"the sensor's position must be finite, each component at most {_FARTHEST_M:g} m",
        x & y & z,
    )
    yield (
        "the estimate must be a row of the window's estimates",
        (d.estimate >= -1) & (d.estimate < len(window.estimates)),
    )


@np.errstate(over="ignore")
def _is_unit(vectors: FloatArray) -> BoolArray:
    x, y, z = vectors.T
    return np.abs(np.sqrt(x * x + y * y + z * z) - 1.0) <= _UNIT_ROUNDING


def _is_sigma(detections: Detections) -> BoolArray:
    sigma_rad = detections.line_of_sight_sigma_rad
    return (sigma_rad >= 0.0) & (sigma_rad < np.inf)


def _sensor_name(detections: Detections, row: int, sensors: Sequence[Sensor]) -> str:
    sensor = int(detections.sensor[row])
    return sensors[sensor].id if 0 <= sensor < len(sensors) else f"number {sensor}"
