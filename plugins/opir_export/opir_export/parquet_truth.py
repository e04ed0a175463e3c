"""The truth of a run as columns of a Parquet file: `opir run --truth events.truth.parquet`."""

import json
from collections.abc import Mapping, Sequence
from pathlib import Path
from types import TracebackType
from typing import Any, Self

from opir_core.interfaces.records import Detections, DetectionTruth, Window
from opir_export.row_groups import RowGroups
from opir_export.tabular.columns import table_of
from opir_export.tabular.detection_tables import columns_of_truth

#: The key of the records of sensors and targets, as JSON, in the metadata of the file.
RECORDS_KEY = "opir_truth"

_GROUP_ROWS = 65_536


class ParquetTruth:
    """Writes the truth of detections to a file, window by window; a context that closes it.

    The columns are those of the table `truth`. `records` of sensors and targets are in the file's metadata.
    """

    def __init__(
        self, path: Path, place: Path, target_ids: Sequence[str], records: Sequence[Mapping[str, Any]]
    ) -> None:
        self._ids = target_ids
        self._metadata = {RECORDS_KEY: json.dumps(records, separators=(",", ":"))}
        schema = self._table(Detections.empty(), DetectionTruth.empty()).schema
        self._file = RowGroups("the truth file", path, place, schema, compression="zstd", group_rows=_GROUP_ROWS)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, _kind: type[BaseException] | None, _error: object, _trace: TracebackType | None) -> None:
        self._file.close()

    def write(self, window: Window) -> None:
        """Write the truth of a window's detections."""
        if len(window.truth):
            self._file.add(self._table(window.detections, window.truth))

    def _table(self, detections: Detections, truth: DetectionTruth) -> Any:
        return table_of(columns_of_truth(detections, truth, self._ids), self._metadata)
