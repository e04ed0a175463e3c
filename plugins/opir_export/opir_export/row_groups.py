"""A Parquet file that is written table by table, in row groups."""

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from pyarrow import parquet

from opir_core.errors import unwritable
from opir_export.formats.table_files import encodings


class RowGroups:
    """An open Parquet file at `place`; it can be read once it is closed.

    Errors name `subject` and `path`. Row groups have `group_rows` rows, the last one fewer: the
    bytes do not depend on the tables that the rows came in, and memory does not grow with the run.
    """

    def __init__(
        self,
        subject: str,
        path: Path,
        place: Path,
        schema: Any,
        *,
        compression: str | None,
        group_rows: int,
    ) -> None:
        self._subject = subject
        self._path = path
        self._group_rows = group_rows
        self._pending: list[Any] = []
        self._rows = 0
        try:
            # Random ids cannot be compressed.
            by_name = {
                name: "none" if name == "detection_id" else compression or "none"
                for name in schema.names
            }
            self._file = parquet.ParquetWriter(
                place, schema, compression=by_name, **encodings(schema)
            )
        except OSError as error:
            raise unwritable(subject, path, error) from error

    def add(self, table: Any) -> None:
        """Keep the rows of a table, and write those of whole row groups."""
        self._pending.append(table)
        self._rows += table.num_rows
        if self._rows < self._group_rows:
            return
        pending = pa.concat_tables(self._pending)
        end = self._rows - self._rows % self._group_rows
        for start in range(0, end, self._group_rows):
            self._write(pending.slice(start, self._group_rows))
        # A copy: a slice would keep all rows of its table.
        remaining = pending.slice(end)
        self._pending = (
            [remaining.take(np.arange(remaining.num_rows))] if remaining.num_rows else []
        )
        self._rows = remaining.num_rows

    def close(self) -> None:
        """Write the last row group and the footer, without which no row can be read."""
        try:
            if self._rows:
                self._write(pa.concat_tables(self._pending))
        finally:
            self._pending = []
            self._rows = 0
            self._end()

    def _write(self, group: Any) -> None:
        try:
            self._file.write_table(group.combine_chunks(), row_group_size=group.num_rows)
        except OSError as error:
            raise unwritable(self._subject, self._path, error) from error

    def _end(self) -> None:
        try:
            self._file.close()
        except OSError as error:
            raise unwritable(self._subject, self._path, error) from error
