"""The sink `parquet`: the detections of a run as columns of one Parquet file."""

from pathlib import Path
from typing import Any

import pyarrow as pa
from pyarrow import parquet

from opir_core.errors import SinkError, unwritable
from opir_core.interfaces.contexts import EncoderContext, SinkContext
from opir_core.interfaces.protocols import Delivery
from opir_core.interfaces.records import Detections, Window
from opir_export.formats.table_files import encodings
from opir_export.settings import ParquetSinkConfig
from opir_export.tabular.columns import table_of
from opir_export.tabular.detection_tables import columns_of_detections

_WHAT = "the Parquet file"


class ParquetSink:
    """Writes detections to a file, in row groups; the file can be read once the sink is closed.

    Detections are kept until there are enough for a row group, so that memory use does not grow with the run.
    """

    def __init__(self, config: ParquetSinkConfig, place: Path, origin: EncoderContext) -> None:
        self._path = config.path
        self._group_rows = config.row_group_rows
        self._origin = origin
        self._kept: list[Any] = []
        self._taken = 0
        schema = self._table(Detections.empty()).schema
        compression = None if config.compression == "none" else config.compression
        try:
            self._file = parquet.ParquetWriter(place, schema, compression=compression, **encodings(schema))
        except OSError as error:
            raise unwritable(_WHAT, Path(self._path), error) from error

    def write(self, window: Window) -> None:
        """Keep the window's detections, and write those of a whole row group."""
        if len(window.detections):
            self._kept.append(self._table(window.detections))
            self._taken += len(window.detections)
            if sum(table.num_rows for table in self._kept) >= self._group_rows:
                self._write_kept()

    def close(self) -> Delivery:
        """Write the rest and end the file, without which none of its detections can be read."""
        try:
            self._write_kept()
        finally:
            self._end()
        return Delivery(delivered=self._taken)

    def _write_kept(self) -> None:
        if not self._kept:
            return
        together = pa.concat_tables(self._kept).unify_dictionaries()
        self._kept = []
        try:
            self._file.write_table(together, row_group_size=max(together.num_rows, 1))
        except OSError as error:
            raise unwritable(_WHAT, Path(self._path), error) from error

    def _end(self) -> None:
        try:
            self._file.close()
        except OSError as error:
            raise unwritable(_WHAT, Path(self._path), error) from error

    def _table(self, rows: Detections) -> Any:
        return table_of(columns_of_detections(rows, self._origin, with_unmeasured=True), {})


def parquet_sink(config: ParquetSinkConfig, context: SinkContext) -> ParquetSink:
    """Return the sink `parquet`, open; `SinkError` if it has a spool, for a Parquet file cannot be continued."""
    if context.resumes:
        words = "parquet: a Parquet file cannot be continued by a later run, so it can have no spool; remove spool"
        raise SinkError(f"{words}, or use jsonl")
    return ParquetSink(config, context.stage(config.path), context.origin)
