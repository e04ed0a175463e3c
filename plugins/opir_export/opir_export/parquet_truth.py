"""The truth of a run as a Parquet file (`opir run --truth events.truth.parquet`): write, read."""

import json
from collections.abc import Iterator, Mapping, Sequence
from math import radians
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from opir_core import DetectionTruth
from opir_core.plugin import Detections, Window
from opir_export.row_groups import RowGroups
from opir_export.tabular.columns import table_of
from opir_export.tabular.detection_tables import columns_of_truth, uuid_texts

#: The key of the records of sensors and targets, as JSON, in the metadata of the file.
RECORDS_KEY = "opir_truth"

_GROUP_ROWS = 65_536


def read_truth(path: Path) -> Iterator[dict[str, Any]]:
    """Yield the records of sensors, targets and detections, in the layout of `*.truth.jsonl`.

    Raises OSError, or ValueError for a file without these records.
    """
    from pyarrow.parquet import ParquetFile

    with ParquetFile(path) as file:
        metadata = file.schema_arrow.metadata or {}
        if RECORDS_KEY.encode() not in metadata:
            raise ValueError(
                "has no records of sensors and targets: it is no truth that opir wrote"
            )
        yield from json.loads(metadata[RECORDS_KEY.encode()])
        for batch in file.iter_batches(_GROUP_ROWS):
            for identity, row in zip(
                uuid_texts(batch.column("detection_id")), batch.to_pylist(), strict=True
            ):
                elevation_deg = row.pop("target_elevation_deg")
                elevation_rad = None if elevation_deg is None else radians(elevation_deg)
                yield {
                    "record": "detection",
                    **row,
                    "detection_id": identity,
                    "target_elevation_rad": elevation_rad,
                }


class ParquetTruth:
    """Writes the truth of detections to a file, window by window; a context that closes it.

    The columns are those of the table `truth`. `records` of sensors and targets are in the file's
    metadata.
    """

    def __init__(
        self,
        path: Path,
        place: Path,
        target_ids: Sequence[str],
        records: Sequence[Mapping[str, Any]],
    ) -> None:
        self._ids = target_ids
        self._metadata = {RECORDS_KEY: json.dumps(records, separators=(",", ":"))}
        schema = self._table(Detections.empty(), DetectionTruth.empty()).schema
        self._file = RowGroups(
            "the truth file", path, place, schema, compression="zstd", group_rows=_GROUP_ROWS
        )

    def __enter__(self) -> Self:
        return self

    def __exit__(
        self, _kind: type[BaseException] | None, _error: object, _trace: TracebackType | None
    ) -> None:
        self._file.close()

    def write(self, window: Window) -> None:
        """Write the truth of a window's detections."""
        if len(window.truth):
            self._file.add(self._table(window.detections, window.truth))

    def _table(self, detections: Detections, truth: DetectionTruth) -> Any:
        return table_of(
            columns_of_truth(detections, truth, self._ids, in_file=True), self._metadata
        )
