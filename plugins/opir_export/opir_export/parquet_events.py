"""The events of a file that the sink `parquet` wrote, row by row, for runs that are read back."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np
from pyarrow import parquet, types

from opir_core.plugin import REPORTED_TYPES
from opir_export.tabular.detection_tables import uuid_texts

_PLAIN = (
    *("detection_id", "sensor_id", "target_type", "confidence", "snr", "scan", "track_id"),
    *("azimuth_deg", "elevation_deg", "line_of_sight_sigma_urad"),
)
_POSITION = ("sensor_x_m", "sensor_y_m", "sensor_z_m")
_INSTANTS = {"timestamp": "time", "reported_at": "reported"}
_NEEDED = {*_PLAIN, *_POSITION, *_INSTANTS.values(), "bands"}
_IRRADIANCE = ("irradiance_", "_w_m2")
_PROBABILITIES = {f"probability_{name}": name for name in REPORTED_TYPES}


def parquet_events(path: Path) -> Iterator[Mapping[str, Any]]:
    """Yield the events with the keys of the encoder `forge`.

    Raises OSError, or ValueError if the sink `parquet` did not write the file.
    """
    with parquet.ParquetFile(path) as file:
        lacking = sorted(_NEEDED.difference(file.schema_arrow.names))
        if lacking:
            raise ValueError(
                f"is not what the sink parquet writes: it lacks the column {lacking[0]}"
            )
        for name in _INSTANTS.values():
            if not types.is_timestamp(file.schema_arrow.field(name).type):
                raise ValueError(f"is not what the sink parquet writes: {name} has no timestamps")
        for batch in file.iter_batches():
            yield from _rows(batch)


def _rows(batch: Any) -> Iterator[Mapping[str, Any]]:
    prefix, suffix = _IRRADIANCE
    bands = {
        name: name.removeprefix(prefix).removesuffix(suffix)
        for name in batch.schema.names
        if name.startswith(prefix)
    }
    columns = {
        **_plain_columns(batch),
        **_shares(batch, "band_irradiance_w_m2", bands),
        **_shares(batch, "type_probability", _PROBABILITIES),
    }
    return (dict(zip(columns, row, strict=True)) for row in zip(*columns.values(), strict=True))


def _plain_columns(batch: Any) -> dict[str, list[Any]]:
    """Return the columns that every file has, by the key of the event."""
    columns = {name: batch.column(name).to_pylist() for name in (*_PLAIN, *_POSITION)}
    positions = [columns.pop(name) for name in _POSITION]
    columns["detection_id"] = uuid_texts(batch.column("detection_id"))
    columns |= {key: _texts_of(batch.column(name)) for key, name in _INSTANTS.items()}
    columns["sensor_position_ecef_m"] = list(zip(*positions, strict=True))
    columns["bands"] = [
        text.split("+") if text else [] for text in batch.column("bands").to_pylist()
    ]
    if "path" in batch.schema.names:
        columns["path"] = [text and text.split(" > ") for text in batch.column("path").to_pylist()]
    return columns


def _texts_of(instants: Any) -> list[str]:
    """Return timestamps as texts, to a microsecond."""
    stamps = instants.to_numpy(zero_copy_only=False).astype("datetime64[ns]").astype(np.int64)
    return [
        f"{text}Z"
        for text in np.datetime_as_string(((stamps + 500) // 1000).astype("datetime64[us]"))
    ]


def _shares(
    batch: Any, key: str, columns: Mapping[str, str]
) -> dict[str, list[dict[str, float | None]]]:
    """Return the blocks that several columns make, by `key`; {} if all their values are null."""
    measured = {name: word for name, word in columns.items() if name in batch.schema.names}
    if all(batch.column(name).null_count == batch.num_rows for name in measured):
        return {}
    values = zip(*(batch.column(name).to_pylist() for name in measured), strict=True)
    return {key: [dict(zip(measured.values(), row, strict=True)) for row in values]}
