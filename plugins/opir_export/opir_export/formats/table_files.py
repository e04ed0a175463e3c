"""The exporters `parquet`, `arrow` and `csv`: a folder with one file for each table of a run."""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
from attrs import frozen
from pyarrow import csv, feather, parquet

from opir_core.output import OutputFiles
from opir_export.settings import DELIMITERS, ArrowConfig, CsvConfig, ParquetConfig, named_tables
from opir_export.tabular.run_tables import table
from opir_export.tabular.well_known_binary import text_of_binary


@frozen
class TableFolder(ABC):
    """Writes a run to a folder, one file for each table."""

    tables: Sequence[str]
    compression: str | None = None

    #: A folder has no ending.
    suffix = ""
    ending = ""

    def write(self, run: Any, path: Path) -> Sequence[Path]:
        """Write the tables of a run into a folder, and return the files."""
        files = [path / f"{name}{self.ending}" for name in self.tables]
        with OutputFiles(folder=path) as output:
            for name, file in zip(self.tables, files, strict=True):
                with output.writing(file, "table", is_made_up=True) as part:
                    self.write_table(table(run, name), part)
        return files

    @abstractmethod
    def write_table(self, made: Any, path: Path) -> None:
        """Write one table to a file."""


class ParquetFolder(TableFolder):
    """Writes Parquet files, which have the manifest among their metadata."""

    ending = ".parquet"

    def write_table(self, made: Any, path: Path) -> None:
        """Write a table as Parquet."""
        parquet.write_table(made, path, compression=self.compression, **encodings(made.schema))


class ArrowFolder(TableFolder):
    """Writes files of the Arrow IPC format, which have the manifest among their metadata."""

    ending = ".arrow"

    def write_table(self, made: Any, path: Path) -> None:
        """Write a table as an Arrow IPC file."""
        feather.write_feather(made, str(path), compression=self.compression or "uncompressed")


@frozen
class CsvFolder(TableFolder):
    """Writes CSV files: lists as a column for each number, regions as WKT."""

    delimiter: str = ","

    ending = ".csv"

    def write_table(self, made: Any, path: Path) -> None:
        """Write a table as CSV."""
        options = csv.WriteOptions(delimiter=self.delimiter, quoting_style="needed")
        columns = dict(_flat(made))
        csv.write_csv(pa.table(columns), path, options)


def encodings(schema: Any) -> dict[str, Any]:
    """Return the encodings of Parquet columns: dictionaries for words, split bytes for numbers,
    differences for dates.

    A dictionary of measured numbers, of ids or of dates is as large as these; the bytes of numbers
    compress if equal places are together. The least and the greatest of the random ids of a row
    group, which would exclude no group, are not sought.
    """
    own = [each.name for each in schema if each.name != "detection_id"]
    by_column = {each.name: "BYTE_STREAM_SPLIT" for each in schema if _is_measured(each)}
    by_column |= {
        each.name: "DELTA_BINARY_PACKED" for each in schema if pa.types.is_timestamp(each.type)
    }
    repeated = [name for name in own if name not in by_column]
    return {"use_dictionary": repeated, "column_encoding": by_column, "write_statistics": own}


def _is_measured(column: Any) -> bool:
    return pa.types.is_float64(column.type) and not column.name.startswith("sensor_")


def _flat(made: Any) -> Iterator[tuple[str, Any]]:
    """Yield the columns that CSV can hold."""
    for name, column in zip(made.column_names, made.columns, strict=True):
        if pa.types.is_fixed_size_list(column.type):
            for place in range(column.type.list_size):
                yield (
                    f"{name}_{place}",
                    pa.array([None if row is None else row[place] for row in column.to_pylist()]),
                )
        elif pa.types.is_binary(column.type):
            yield (
                name,
                pa.array([text_of_binary(value) for value in column.to_pylist()], type=pa.string()),
            )
        elif pa.types.is_dictionary(column.type):
            yield name, column.cast(pa.string())
        else:
            yield name, column


def parquet_folder(config: ParquetConfig, _context: Any) -> ParquetFolder:
    """Return the exporter `parquet`."""
    return ParquetFolder(
        named_tables(config.tables), None if config.compression == "none" else config.compression
    )


def arrow_folder(config: ArrowConfig, _context: Any) -> ArrowFolder:
    """Return the exporter `arrow`."""
    return ArrowFolder(
        named_tables(config.tables), None if config.compression == "none" else config.compression
    )


def csv_folder(config: CsvConfig, _context: Any) -> CsvFolder:
    """Return the exporter `csv`."""
    return CsvFolder(named_tables(config.tables), delimiter=DELIMITERS[config.delimiter])
