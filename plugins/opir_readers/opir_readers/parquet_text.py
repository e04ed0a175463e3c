"""Parquet as the text of a table: names of columns in its first line, then a line for each row."""

from collections.abc import Iterator
from io import BytesIO
from typing import Any
from uuid import UUID

from opir_core.errors import install_command
from opir_core.plugin import BadFileError

#: Parquet files begin so.
MAGIC = b"PAR1"

#: The most cells of a table: a small file may hold endless repetitions.
_MOST_CELLS = 20_000_000

#: Columns of vectors, and those of their components.
_VECTORS = {
    "sensor_position_ecef_m": [f"sensor_{axis}_ecef_m" for axis in "xyz"],
    "line_of_sight_ecef": [f"los_{axis}_ecef" for axis in "xyz"],
    "line_of_sight_eme2000": [f"los_{axis}_eme2000" for axis in "xyz"],
}


def text_of_parquet(content: bytes) -> str:
    """Return the columns of numbers, texts and times of a Parquet file, parted by commas; raises
    `BadFileError`.
    """
    try:
        import pyarrow
        from pyarrow import csv, parquet
    except ImportError as error:
        remedy = install_command("opir-readers", "parquet")
        raise BadFileError(f"is Parquet, which needs pyarrow; {remedy}") from error
    text = BytesIO()
    try:
        file = parquet.ParquetFile(BytesIO(content))
        _require_size(file.metadata.num_rows, file.metadata.num_columns)
        columns = dict(_columns(file.read()))
        if not columns:
            raise BadFileError("has no columns of numbers, texts or times")
        csv.write_csv(pyarrow.table(columns), text)
    except (pyarrow.ArrowException, OSError, ValueError) as error:
        if isinstance(error, BadFileError):
            raise
        raise BadFileError(
            f"is no whole Parquet file: {str(error).splitlines()[0][:200]}"
        ) from error
    return text.getvalue().decode("utf-8", "replace")


def _require_size(rows: int, columns: int) -> None:
    if rows * columns > _MOST_CELLS:
        raise BadFileError(
            f"has {rows} rows of {columns} columns; at most {_MOST_CELLS} values are read: keep the"
            " burn, or fewer columns"
        )


def _columns(table: Any) -> Iterator[tuple[str, Any]]:
    """Yield the columns that text can hold: NaN as a missing number, truth values as 1 and 0,
    vectors by components.
    """
    from pyarrow import compute, types

    for name, column in zip(table.column_names, table.columns, strict=True):
        if types.is_dictionary(column.type):
            column = column.cast(column.type.value_type)
        if name in _VECTORS and (
            types.is_list(column.type) or types.is_fixed_size_list(column.type)
        ):
            for axis, component in enumerate(_VECTORS[name]):
                yield component, compute.list_element(column, axis)
        else:
            plain = _plain(column)
            if plain is not None:
                yield name, plain


def _plain(column: Any) -> Any:
    """Return a column of numbers, texts or times as text can hold it, None for others."""
    import pyarrow
    from pyarrow import types

    kind = column.type
    if types.is_floating(kind):
        return _without_nan(column.cast(pyarrow.float64()))
    if types.is_boolean(kind):
        return column.cast(pyarrow.int8())
    if any(is_kind(kind) for is_kind in (types.is_integer, types.is_string, types.is_large_string)):
        return column
    if types.is_fixed_size_binary(kind) and kind.byte_width == 16:
        return pyarrow.array(list(map(_uuid_text, column.to_pylist())), pyarrow.string())
    if types.is_timestamp(kind) or types.is_date(kind):
        return column.cast(pyarrow.timestamp("ns", tz="UTC"))
    return None


def _without_nan(column: Any) -> Any:
    from pyarrow import compute

    return compute.if_else(compute.is_nan(column), None, column)


def _uuid_text(content: bytes | None) -> str | None:
    return None if content is None else str(UUID(bytes=content))
