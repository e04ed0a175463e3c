"""The sink `parquet`: the detections of a run as columns of one Parquet file."""

from pathlib import Path
from typing import Any

from opir_core.errors import SinkError
from opir_core.plugin import Delivery, Detections, EncoderContext, Sink, SinkContext, Window
from opir_export.formats.table_files import compression_of
from opir_export.row_groups import RowGroups
from opir_export.settings import ParquetSinkConfig
from opir_export.tabular.columns import table_of
from opir_export.tabular.detection_tables import columns_of_detections


class ParquetSink(Sink):
    """Writes detections to a file, in row groups; the file can be read once the sink is closed."""

    def __init__(self, config: ParquetSinkConfig, place: Path, origin: EncoderContext) -> None:
        self._origin = origin
        self._taken = 0
        self._file = RowGroups(
            "the Parquet file",
            Path(config.path),
            place,
            self._table(Detections.empty()).schema,
            compression=compression_of(config),
            group_rows=config.row_group_rows,
        )

    def write(self, window: Window) -> None:
        """Keep the window's detections, and write those of a whole row group."""
        if len(window.detections):
            self._file.add(self._table(window.detections))
            self._taken += len(window.detections)

    def close(self) -> Delivery:
        """Write the last row group and the footer, without which the file cannot be read."""
        self._file.close()
        return Delivery(delivered=self._taken)

    def _table(self, rows: Detections) -> Any:
        return table_of(columns_of_detections(rows, self._origin, in_file=True), {})


def parquet_sink(config: ParquetSinkConfig, context: SinkContext) -> ParquetSink:
    """Return the sink `parquet`, open; `SinkError` if it has a spool."""
    if context.resumes:
        words = (
            "parquet: a Parquet file cannot be continued by a later run, so it can have no spool;"
            " remove spool"
        )
        raise SinkError(f"{words}, or use jsonl")
    return ParquetSink(config, context.stage(config.path), context.origin)
