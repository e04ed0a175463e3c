"""The columns of the tables `detections` and `truth`."""

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np
import pyarrow as pa

from opir_core.arrays import FloatArray
from opir_core.interfaces.protocols import Sensor
from opir_core.interfaces.records import Detections
from opir_core.random_streams.detection_ids import uuid_text
from opir_export.tabular.columns import TableColumn, instants, names, numbers, numbers_known, texts

_UTC = "UTC"


def detection_columns(run: Any) -> Iterator[TableColumn]:
    """Yield the columns of the table `detections` of a run; the truth is not in them."""
    rows: Detections = run.detections
    yield from _reports(run, rows)
    angles = rows.angles()
    yield TableColumn(
        "azimuth_deg", numbers(np.degrees(angles.azimuth_rad)), "deg", "clockwise from north, at the sensor"
    )
    yield TableColumn(
        "elevation_deg", numbers(np.degrees(angles.elevation_rad)), "deg", "above the sensor's horizontal"
    )
    sigma_urad = rows.line_of_sight_sigma_rad * 1e6
    yield TableColumn("line_of_sight_sigma_urad", numbers(sigma_urad), "urad", "standard deviation per axis")
    for axis, letter in enumerate("xyz"):
        position_m = rows.sensor_ecef_m[:, axis]
        yield TableColumn(f"sensor_{letter}_m", numbers(position_m), "m", "position of the sensor, ECEF")
    yield from _irradiances(rows, run.sensors)
    yield from _probabilities(rows.type_probability, run.reported_types)


def _reports(run: Any, rows: Detections) -> Iterator[TableColumn]:
    """Yield what a report says: ids, times, type, confidence, bands, track."""
    epoch_us = run.plan.scene.epoch_us
    yield TableColumn("detection_id", texts_of_ids(rows), "", "UUID of the event")
    yield TableColumn("sensor_id", names(rows.sensor, [each.id for each in run.sensors]), "", "the sensor")
    yield TableColumn("time_s", numbers(rows.time_s), "s", "scene time of the look")
    yield TableColumn("time", instants(rows.time_ns, epoch_us), _UTC, "time of the look")
    yield TableColumn("reported_s", numbers(rows.reported_ns * 1e-9), "s", "scene time of the report")
    yield TableColumn("reported", instants(rows.reported_ns, epoch_us), _UTC, "time of the report")
    yield TableColumn(
        "scan", numbers_known(rows.scan), "", "number of the sensor's scan, null for runs read from files"
    )
    yield TableColumn("target_type", names(rows.reported_type, run.reported_types), "", "reported type")
    yield TableColumn("confidence", numbers(rows.confidence), "", "in [0, 1]")
    yield TableColumn("bands", texts(_bands(rows, run.sensors)), "", "bands that confirm, joined by +")
    yield TableColumn("snr", numbers(rows.snr), "", "signal-to-noise ratio")
    yield TableColumn(
        "detection_count", numbers(rows.detection_count), "", "detections of the object by the sensor so far"
    )
    yield TableColumn("track_id", numbers_known(rows.track), "", "the track, null for none")


def truth_columns(run: Any) -> Iterator[TableColumn]:
    """Yield the columns of the table `truth` of a run, row by row that of the detections."""
    rows = run.truth
    yield TableColumn("detection_id", texts_of_ids(run.detections), "", "UUID of the event")
    yield TableColumn("target_id", names(rows.target, run.target_ids), "", "the target, null for a false alarm")
    yield TableColumn("emission_s", numbers(rows.emission_time_s), "s", "scene time at which the light was emitted")
    yield TableColumn("range_m", numbers(rows.range_m), "m", "true distance from sensor to target")
    elevation_deg = np.degrees(rows.target_elevation_rad)
    yield TableColumn("target_elevation_deg", numbers(elevation_deg), "deg", "of the sensor above the target's horizon")
    yield TableColumn("probability", numbers(rows.probability), "", "probability of detection of the look")


def texts_of_ids(rows: Detections) -> Any:
    """Return the ids of detections as an array of texts."""
    return pa.array(uuid_text(rows.detection_id), type=pa.string())


def _bands(rows: Detections, sensors: Sequence[Sensor]) -> list[str]:
    """Return the names of each detection's bands; each pair of sensor and mask is spelt once."""
    pairs = rows.sensor.astype(np.int64) << 8 | rows.bands
    distinct, place = np.unique(pairs, return_inverse=True)
    words = [_spelt(sensors[pair >> 8], pair & 0xFF) for pair in distinct.tolist()]
    return [words[index] for index in place.tolist()]


def _spelt(sensor: Sensor, mask: int) -> str:
    return "+".join(band.name for place, band in enumerate(sensor.bands) if mask >> place & 1)


def _irradiances(rows: Detections, sensors: Sequence[Sensor]) -> Iterator[TableColumn]:
    """Yield the measured irradiance by band name, null for detections by sensors without the band."""
    measured = rows.band_irradiance_w_m2
    if not measured.shape[1]:
        return
    for name in dict.fromkeys(band.name for sensor in sensors for band in sensor.bands):
        column = np.full(len(measured), np.nan)
        for number, sensor in enumerate(sensors):
            own = [band.name for band in sensor.bands]
            if name in own:
                mine = rows.sensor == number
                column[mine] = measured[mine, own.index(name)]
        yield TableColumn(f"irradiance_{name}_w_m2", numbers(column), "W/m2", "measured at the aperture")


def _probabilities(shares: FloatArray, types: Sequence[str]) -> Iterator[TableColumn]:
    for place, name in enumerate(types[: shares.shape[1]]):
        yield TableColumn(f"probability_{name}", numbers(shares[:, place]), "", "probability of the type")
