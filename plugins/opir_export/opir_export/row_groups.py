"""A Parquet file that is written table by table, in row groups."""

from pathlib import Path
from typing import Any

import pyarrow as pa
from pyarrow import parquet

from opir_core.errors import unwritable
from opir_export.formats.table_files import encodings


class RowGroups:
    """An open Parquet file at `place`, which errors name `what` and `path`; it can be read once it is closed.

    Rows are kept until there are enough for a row group, so that memory use does not grow with the run.
    """

    def __init__(
        self, what: str, path: Path, place: Path, schema: Any, *, compression: str | None, group_rows: int
    ) -> None:
        self._what, self._path, self._group_rows = what, path, group_rows
        self._kept: list[Any] = []
        try:
            self._file = parquet.ParquetWriter(place, schema, compression=compression, **encodings(schema))
        except OSError as error:
            raise unwritable(what, path, error) from error

    def add(self, table: Any) -> None:
        """Keep the rows of a table, and write those of a whole row group."""
        self._kept.append(table)
        if sum(each.num_rows for each in self._kept) >= self._group_rows:
            self._write_kept()

    def close(self) -> None:
        """Write the rest and end the file, without which no row can be read."""
        try:
            self._write_kept()
        finally:
            self._end()

    def _write_kept(self) -> None:
        if not self._kept:
            return
        together = pa.concat_tables(self._kept).unify_dictionaries()
        self._kept = []
        try:
            self._file.write_table(together, row_group_size=max(together.num_rows, 1))
        except OSError as error:
            raise unwritable(self._what, self._path, error) from error

    def _end(self) -> None:
        try:
            self._file.close()
        except OSError as error:
            raise unwritable(self._what, self._path, error) from error
