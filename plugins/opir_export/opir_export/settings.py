"""The settings of the exporters; no heavy imports."""

from attrs import frozen

from opir_core.plugin import nested, text

#: The names of the tables of a run.
TABLES = ("detections", "truth", "tracks", "regions", "targets", "sensors")
ALL = "all"

#: What separates the columns of CSV, by name.
DELIMITERS = {"comma": ",", "semicolon": ";", "tab": "\t"}


def _tables_complaint(value: str) -> str | None:
    unknown = [name for name in named_tables(value) if name not in TABLES]
    return f"no table is named {unknown[0]!r}; there are {', '.join(TABLES)}" if unknown else None


def named_tables(value: str) -> tuple[str, ...]:
    """Return the tables of a setting `tables`, in the order of `TABLES` where all are meant."""
    return TABLES if value.strip() == ALL else tuple(name.strip() for name in value.split(","))


@frozen(kw_only=True)
class ParquetConfig:
    """One Parquet file for each table."""

    tables: str = nested(default=ALL, check=_tables_complaint, help="tables to write, with commas between, or all")
    compression: str = text(
        default="zstd", choices=("zstd", "snappy", "gzip", "none"), help="compression of the column chunks"
    )


@frozen(kw_only=True)
class ArrowConfig:
    """One Arrow IPC file (Feather version 2) for each table."""

    tables: str = nested(default=ALL, check=_tables_complaint, help="tables to write, with commas between, or all")
    compression: str = text(default="zstd", choices=("zstd", "lz4", "none"), help="compression of the record batches")


@frozen(kw_only=True)
class CsvConfig:
    """One CSV file for each table, with a line of names."""

    tables: str = nested(default=ALL, check=_tables_complaint, help="tables to write, with commas between, or all")
    delimiter: str = text(default="comma", choices=tuple(DELIMITERS), help="what separates the columns")
