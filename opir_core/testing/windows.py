"""Windows made to order, for the tests of encoders and sinks."""

from typing import Any

import numpy as np
from attrs import evolve, fields

from opir_core.arrays import FloatArray
from opir_core.events.identifiers import stream_key, uuid8_words
from opir_core.records import Detections, DetectionTruth, Tracks, Window
from opir_core.scene import UNKNOWN_TYPE

_NS_PER_S = 1_000_000_000
_GEOSTATIONARY_RADIUS_M = 42_164_172.0
_SIGMA_RAD = 2e-5


def stub_window(count: int, *, first_scan: int = 0, estimates: Tracks | None = None, **columns: Any) -> Window:
    """Return a window of detections of sensor 0, one a second from `first_scan` on; `columns` replace any of theirs.

    A replacing value is broadcast to its column; without `estimates` there are none.
    """
    scan = np.arange(first_scan, first_scan + count)
    detections = evolve(_detections(scan), **{name: _like(name, value, count) for name, value in columns.items()})
    return Window(
        start_s=float(first_scan),
        end_s=float(first_scan + count),
        looks=2 * count,
        detections=detections.freeze(),
        truth=_truth(count).freeze(),
        tracks=Tracks.empty(),
        estimates=Tracks.empty() if estimates is None else estimates,
    )


def stub_estimates(count: int, **columns: Any) -> Tracks:
    """Return estimates of which only tick (0, 1, … s) and track (0) are known; `columns` replace any of theirs."""
    unknown = {
        name: np.full((count, *column.shape[1:]), np.nan)
        for name, column in _columns(Tracks.empty()).items()
        if column.dtype == np.float64
    }
    unknown |= {"tick_s": np.arange(count, dtype=np.float64), "track": np.zeros(count, dtype=np.int64)}
    given = {name: np.array(np.broadcast_to(value, unknown[name].shape)) for name, value in columns.items()}
    return Tracks(**(unknown | given))


def _detections(scan: Any) -> Detections:
    count = len(scan)
    none = np.full(count, -1, dtype=np.int64)
    keys = np.tile(np.array([stream_key("stub")], dtype=np.uint64), (count, 1))
    down, place = _rows([-1.0, 0.0, 0.0], count), _rows([_GEOSTATIONARY_RADIUS_M, 0.0, 0.0], count)
    return Detections(
        time_ns=scan * _NS_PER_S,
        sensor=np.zeros(count, dtype=np.int32),
        scan=scan,
        detection_id=uuid8_words(keys, scan),
        reported_type=np.full(count, UNKNOWN_TYPE, dtype=np.uint8),
        bands=np.ones(count, dtype=np.uint8),
        detection_count=np.arange(1, count + 1, dtype=np.int32),
        confidence=np.full(count, 0.5),
        line_of_sight_ecef=down,
        sensor_ecef_m=place,
        snr=np.full(count, np.nan),
        track=none,
        estimate=none.copy(),
        line_of_sight_sigma_rad=np.full(count, _SIGMA_RAD),
        band_irradiance_w_m2=np.empty((count, 0)),
    )


def _truth(count: int) -> DetectionTruth:
    return DetectionTruth(
        target=np.zeros(count, dtype=np.int32),
        emission_time_s=np.zeros(count),
        range_m=np.full(count, 3.6e7),
        target_elevation_sine=np.full(count, 0.9),
        probability=np.full(count, 0.5),
    )


def _rows(vector: list[float], count: int) -> FloatArray:
    return np.tile(np.array(vector), (count, 1))


def _like(name: str, value: Any, count: int) -> Any:
    empty = _columns(Detections.empty())[name]
    return np.array(np.broadcast_to(value, (count, *empty.shape[1:])), dtype=empty.dtype)


def _columns(record: Detections | Tracks) -> dict[str, Any]:
    return {attribute.name: getattr(record, attribute.name) for attribute in fields(type(record))}
