"""The exporters `parquet`, `arrow` and `csv`: a folder with one file for each table of a run."""

from abc import ABC, abstractmethod
from collections.abc import Iterator, Sequence
from pathlib import Path
from typing import Any

import pyarrow as pa
from attrs import frozen
from pyarrow import csv, feather, parquet

from opir_core.output import OutputFiles
from opir_export.settings import (
    DELIMITERS,
    ArrowConfig,
    CsvConfig,
    ParquetConfig,
    ParquetSinkConfig,
    named_tables,
)
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
                with output.writing(file, "table", is_made_up=True) as file_part:
                    self.write_table(table(run, name), file_part)
        return files

    @abstractmethod
    def write_table(self, content: Any, path: Path) -> None:
        """Write one table to a file."""


class ParquetFolder(TableFolder):
    """Writes Parquet files, which have the manifest among their metadata."""

    ending = ".parquet"

    def write_table(self, content: Any, path: Path) -> None:
        """Write a table as Parquet."""
        parquet.write_table(
            content, path, compression=self.compression, **encodings(content.schema)
        )


class ArrowFolder(TableFolder):
    """Writes files of the Arrow IPC format, which have the manifest among their metadata."""

    ending = ".arrow"

    def write_table(self, content: Any, path: Path) -> None:
        """Write a table as an Arrow IPC file."""
        feather.write_feather(content, str(path), compression=self.compression or "uncompressed")


@frozen
class CsvFolder(TableFolder):
    """Writes CSV files: lists as a column for each number, regions as WKT."""

    delimiter: str = ","

    ending = ".csv"

    def write_table(self, content: Any, path: Path) -> None:
        """Write a table as CSV."""
        options = csv.WriteOptions(delimiter=self.delimiter, quoting_style="needed")
        columns = dict(_flat(content))
        csv.write_csv(pa.table(columns), path, options)


def encodings(schema: Any) -> dict[str, Any]:
    """Return the encodings of Parquet columns as arguments of `ParquetWriter`.

    Words are in dictionaries, times are differences. Measured numbers have their bytes split by
    place, which compresses better; a dictionary of them would be as large as they are. Ids are
    random: their least and greatest, which would exclude no row group, are not written.
    """
    encoded = [column.name for column in schema if column.name != "detection_id"]
    by_column = {column.name: "BYTE_STREAM_SPLIT" for column in schema if _is_measured(column)}
    by_column |= {
        column.name: "DELTA_BINARY_PACKED"
        for column in schema
        if pa.types.is_timestamp(column.type)
    }
    repeated = [name for name in encoded if name not in by_column]
    return {"use_dictionary": repeated, "column_encoding": by_column, "write_statistics": encoded}


def compression_of(config: ParquetConfig | ArrowConfig | ParquetSinkConfig) -> str | None:
    """Return the compression of the settings as pyarrow takes it."""
    return None if config.compression == "none" else config.compression


def _is_measured(column: Any) -> bool:
    return pa.types.is_float64(column.type) and not column.name.startswith("sensor_")


def _flat(content: Any) -> Iterator[tuple[str, Any]]:
    """Yield the columns that CSV can hold."""
    for name, column in zip(content.column_names, content.columns, strict=True):
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


def parquet_folder(config: ParquetConfig) -> ParquetFolder:
    """Return the exporter `parquet`."""
    return ParquetFolder(named_tables(config.tables), compression_of(config))


def arrow_folder(config: ArrowConfig) -> ArrowFolder:
    """Return the exporter `arrow`."""
    return ArrowFolder(named_tables(config.tables), compression_of(config))


def csv_folder(config: CsvConfig) -> CsvFolder:
    """Return the exporter `csv`."""
    return CsvFolder(named_tables(config.tables), delimiter=DELIMITERS[config.delimiter])
