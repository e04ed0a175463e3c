"""A Parquet file that is written table by table, in row groups."""

from pathlib import Path
from typing import Any

import numpy as np
import pyarrow as pa
from pyarrow import parquet

from opir_core.errors import unwritable
from opir_export.formats.table_files import encodings


class RowGroups:
    """An open Parquet file at `place`, which errors name `what` and `path`; it can be read once it
    is closed.

    Row groups have `group_rows` rows, the last one the rest: the bytes do not depend on the tables
    that the rows came in, and memory use does not grow with the run.
    """

    def __init__(
        self,
        what: str,
        path: Path,
        place: Path,
        schema: Any,
        *,
        compression: str | None,
        group_rows: int,
    ) -> None:
        self._what = what
        self._path = path
        self._group_rows = group_rows
        self._kept: list[Any] = []
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
            raise unwritable(what, path, error) from error

    def add(self, table: Any) -> None:
        """Keep the rows of a table, and write those of whole row groups."""
        self._kept.append(table)
        self._rows += table.num_rows
        if self._rows < self._group_rows:
            return
        together = pa.concat_tables(self._kept)
        whole = self._rows - self._rows % self._group_rows
        for start in range(0, whole, self._group_rows):
            self._write(together.slice(start, self._group_rows))
        # A copy: a slice would keep all rows of its table.
        rest = together.slice(whole)
        self._kept = [rest.take(np.arange(rest.num_rows))] if rest.num_rows else []
        self._rows = rest.num_rows

    def close(self) -> None:
        """Write the rest and end the file, without which no row can be read."""
        try:
            if self._rows:
                self._write(pa.concat_tables(self._kept))
        finally:
            self._kept = []
            self._rows = 0
            self._end()

    def _write(self, group: Any) -> None:
        try:
            self._file.write_table(group.combine_chunks(), row_group_size=group.num_rows)
        except OSError as error:
            raise unwritable(self._what, self._path, error) from error

    def _end(self) -> None:
        try:
            self._file.close()
        except OSError as error:
            raise unwritable(self._what, self._path, error) from error
