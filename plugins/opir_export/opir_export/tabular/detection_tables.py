"""The columns of the tables `detections` and `truth`."""

from collections.abc import Iterator, Sequence
from itertools import chain
from typing import Any, cast

import numpy as np
import pyarrow as pa

from opir_core import DetectionTruth
from opir_core.arrays import FloatArray, IndexArray
from opir_core.plugin import REPORTED_TYPES, Band, Detections, EncoderContext, Sensor
from opir_core.random_streams import uuid_characters, uuid_text
from opir_export.tabular.columns import TableColumn, instants, names, numbers_known

_ID_BYTES = 16


def detection_columns(run: Any) -> Iterator[TableColumn]:
    """Yield the columns of the table `detections` of a run; the truth is not in them."""
    origin = EncoderContext(
        sensors=tuple(run.sensors),
        epoch_us=run.plan.scene.epoch_us,
        reported_types=tuple(run.reported_types),
        paths=run.plan.link_paths,
    )
    yield from columns_of_detections(run.detections, origin)


def columns_of_detections(
    rows: Detections, origin: EncoderContext, *, in_file: bool = False
) -> Iterator[TableColumn]:
    """Yield the columns of detections of a run's sensors, epoch and reported types.

    Irradiances and type probabilities that the run does not have are left out. A file that is
    written window by window (`in_file`) has them as null columns, the same for all windows; its ids
    are 16 bytes instead of texts, and it has no times in seconds.
    """
    yield _ids(rows, in_file=in_file)
    yield from _reports(rows, origin, in_file=in_file)
    yield from _lines_of_sight(rows)
    irradiances = rows.band_irradiance_w_m2
    shares = rows.type_probability
    if in_file or irradiances.shape[1]:
        yield from _irradiances(rows.sensor, irradiances, origin.sensors)
    if in_file or shares.shape[1]:
        yield from _probabilities(shares)


def _lines_of_sight(rows: Detections) -> Iterator[TableColumn]:
    """Yield direction and error of the line of sight, and the position of the sensor."""
    angles = rows.angles()
    yield TableColumn(
        "azimuth_deg", np.degrees(angles.azimuth_rad), "clockwise from north, at the sensor"
    )
    yield TableColumn(
        "elevation_deg", np.degrees(angles.elevation_rad), "above the sensor's horizontal"
    )
    sigma_urad = rows.line_of_sight_sigma_rad * 1e6
    yield TableColumn("line_of_sight_sigma_urad", sigma_urad, "standard deviation per axis")
    for axis, letter in enumerate("xyz"):
        position_m = rows.sensor_ecef_m[:, axis]
        yield TableColumn(f"sensor_{letter}_m", position_m, "position of the sensor, ECEF")


def _reports(rows: Detections, origin: EncoderContext, *, in_file: bool) -> Iterator[TableColumn]:
    """Yield sensor, times, type, confidence, bands and track of the reports."""
    epoch_us = origin.epoch_us
    sensors = origin.sensors
    yield TableColumn(
        "sensor_id", names(rows.sensor, [sensor.id for sensor in sensors]), "the sensor"
    )
    if not in_file:
        yield TableColumn("time_s", rows.time_s, "scene time of the look")
    yield TableColumn("time", instants(rows.time_ns, epoch_us), "time of the look")
    if not in_file:
        yield TableColumn("reported_s", rows.reported_ns * 1e-9, "scene time of the report")
    yield TableColumn("reported", instants(rows.reported_ns, epoch_us), "time of the report")
    if origin.paths:
        ways = [" > ".join(path) for path in origin.paths]
        words = "way of the report to the ground, null without a link"
        yield TableColumn("path", names(np.ravel(rows.path), ways), words)
    yield TableColumn(
        "scan",
        numbers_known(rows.scan),
        "number of the sensor's scan, null for runs read from files",
    )
    yield TableColumn(
        "target_type", names(rows.reported_type, origin.reported_types), "reported type"
    )
    yield TableColumn("confidence", rows.confidence, "in [0, 1]")
    yield TableColumn("bands", _bands(rows, sensors), "bands that confirm, joined by +")
    yield TableColumn("snr", rows.snr, "signal-to-noise ratio")
    yield TableColumn(
        "detection_count", rows.detection_count, "detections of the object by the sensor so far"
    )
    yield TableColumn("track_id", numbers_known(rows.track), "the track, null for none")


def truth_columns(run: Any) -> Iterator[TableColumn]:
    """Yield the columns of the table `truth` of a run, one row per detection."""
    yield from columns_of_truth(run.detections, run.truth, run.target_ids)


def columns_of_truth(
    detections: Detections,
    rows: DetectionTruth,
    target_ids: Sequence[str],
    *,
    in_file: bool = False,
) -> Iterator[TableColumn]:
    """Yield the columns of the truth of detections; `in_file` as in `columns_of_detections`."""
    yield _ids(detections, in_file=in_file)
    yield TableColumn(
        "target_id", names(rows.target, target_ids), "the target, null for a false alarm"
    )
    yield TableColumn(
        "emission_s", rows.emission_time_s, "scene time at which the light was emitted"
    )
    yield TableColumn("range_m", rows.range_m, "true distance from sensor to target")
    elevation_deg = np.degrees(rows.target_elevation_rad)
    yield TableColumn(
        "target_elevation_deg", elevation_deg, "of the sensor above the target's horizon"
    )
    yield TableColumn("probability", rows.probability, "probability of detection of the look")


def _ids(rows: Detections, *, in_file: bool) -> TableColumn:
    """Return the ids of detections as texts, or `in_file` as 16 bytes, which are faster."""
    if in_file:
        octets = pa.py_buffer(rows.detection_id.astype(">u8"))
        values = pa.Array.from_buffers(pa.binary(_ID_BYTES), len(rows), [None, octets])
        return TableColumn("detection_id", values, "UUID of the event, 16 bytes")
    return TableColumn("detection_id", _texts_of_ids(rows), "UUID of the event")


def uuid_texts(column: Any) -> list[str]:
    """Return a column of ids, bytes or texts, as texts."""
    if not pa.types.is_fixed_size_binary(column.type):
        return cast("list[str]", column.to_pylist())
    octets = np.frombuffer(b"".join(column.to_pylist()), dtype=">u8")
    return uuid_text(octets.astype(np.uint64).reshape(-1, 2))


def _texts_of_ids(rows: Detections) -> Any:
    """Return the ids of detections as an array of texts."""
    characters = uuid_characters(rows.detection_id)
    if characters.size > np.iinfo(np.int32).max:  # too long for the offsets of one array of texts
        return pa.array(uuid_text(rows.detection_id), type=pa.string())
    offsets = np.arange(len(characters) + 1, dtype=np.int32) * characters.shape[1]
    return pa.StringArray.from_buffers(
        len(characters), pa.py_buffer(offsets), pa.py_buffer(characters)
    )


def _bands(rows: Detections, sensors: Sequence[Sensor]) -> Any:
    """Return the names of each detection's bands; a pair of sensor and mask is spelt once."""
    pairs = rows.sensor.astype(np.int64) << 8 | rows.bands
    pairs_used = np.flatnonzero(np.bincount(pairs))
    # All combinations, also those without a row: files do not depend on how rows are cut into
    # tables.
    bands = {sensor.bands for sensor in sensors}
    words = sorted(
        {
            _spelt(combination, mask)
            for combination in bands
            for mask in range(1 << len(combination))
        }
    )
    number = {word: code for code, word in enumerate(words)}
    codes = np.zeros(pairs_used.max(initial=-1) + 1, dtype=np.int32)
    codes[pairs_used] = [
        number[_spelt(sensors[pair >> 8].bands, pair & 0xFF)] for pair in pairs_used.tolist()
    ]
    return names(codes.take(pairs), words)


def _spelt(bands: Sequence[Band], mask: int) -> str:
    return "+".join(band.name for place, band in enumerate(bands) if mask >> place & 1)


def _irradiances(
    sensor: IndexArray, measured: FloatArray, sensors: Sequence[Sensor]
) -> Iterator[TableColumn]:
    """Yield the measured irradiance by band name, null for sensors without the band."""
    names_of_sensors = [[band.name for band in each.bands] for each in sensors]
    for name in dict.fromkeys(chain.from_iterable(names_of_sensors)):
        column = np.full(len(measured), np.nan)
        for number, band_names in enumerate(names_of_sensors):
            if name in band_names and band_names.index(name) < measured.shape[1]:
                is_of_sensor = sensor == number
                column[is_of_sensor] = measured[is_of_sensor, band_names.index(name)]
        yield TableColumn(f"irradiance_{name}_w_m2", column, "measured at the aperture")


def _probabilities(shares: FloatArray) -> Iterator[TableColumn]:
    for place, name in enumerate(REPORTED_TYPES):
        column = shares[:, place] if shares.shape[1] else np.full(len(shares), np.nan)
        yield TableColumn(f"probability_{name}", column, "probability of the type")
