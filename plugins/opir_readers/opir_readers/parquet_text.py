"""Parquet as the text of a table: names of columns in its first line, then a line for each row."""

from collections import Counter
from collections.abc import Iterator
from io import BytesIO
from typing import Any
from uuid import UUID

from opir_core.errors import BAD_DATA, install_command
from opir_core.plugin import BadFileError

#: Parquet files begin so.
MAGIC = b"PAR1"

#: The most cells of the columns that are read: a small file may hold endless repetitions.
_MOST_CELLS = 5_000_000
#: The most bytes that are unpacked of these columns.
_MOST_BYTES = 256_000_000
#: A column with more bytes of text holds no names, types or times, and is left out.
_MOST_TEXT_BYTES = 64_000_000

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
        from pyarrow import parquet
    except ImportError as error:
        remedy = install_command("opir-readers", "parquet")
        raise BadFileError(f"is Parquet, which needs pyarrow; {remedy}") from error
    try:
        table = parquet.ParquetFile(BytesIO(content))
        names = [field.name for field in table.schema_arrow if _is_read(field)]
        if not names:
            raise BadFileError("has no columns of numbers, texts or times")
        times = Counter(table.schema_arrow.names)
        if repeated := next((name for name in names if times[name] > 1), None):
            raise BadFileError(f"has several columns {repeated!r}: rename or drop the others")
        _require_size(table.metadata, names)
        return _text_of(content, table.schema_arrow, names)
    except (pyarrow.ArrowException, OSError, *BAD_DATA) as error:
        if isinstance(error, BadFileError):
            raise
        raise BadFileError(
            f"is no whole Parquet file: {(str(error) or type(error).__name__).splitlines()[0][:200]}"
        ) from error


def _text_of(content: bytes, schema: Any, names: list[str]) -> str:
    """Return the columns of these names, but for those with long texts, a group of rows at a
    time.
    """
    import pyarrow
    from pyarrow import csv, parquet

    # Texts stay numbers into the list of the distinct ones until their size is known.
    texts = [name for name in names if _is_text(schema.field(name).type)]
    file = parquet.ParquetFile(BytesIO(content), read_dictionary=texts)
    long = {name for name in texts if _text_bytes(file, name) > _MOST_TEXT_BYTES}
    text = BytesIO()
    for group in range(file.num_row_groups):
        rows = file.read_row_group(group, [name for name in names if name not in long])
        options = csv.WriteOptions(include_header=not group)
        csv.write_csv(pyarrow.table(dict(_columns(rows))), text, options)
    return text.getvalue().decode("utf-8", "replace")


def _require_size(metadata: Any, names: list[str]) -> None:
    """Raise `BadFileError` if the columns of these names are too large."""
    if metadata.num_rows * len(names) > _MOST_CELLS:
        raise BadFileError(
            f"has {metadata.num_rows} rows of {len(names)} columns; at most {_MOST_CELLS} values"
            " are read: keep the burn, or fewer columns"
        )
    sizes = dict.fromkeys(names, 0)
    for number in range(metadata.num_row_groups):
        group = metadata.row_group(number)
        for column in map(group.column, range(group.num_columns)):
            name = column.path_in_schema.split(".")[0]
            if name in sizes:
                sizes[name] += column.total_uncompressed_size
    if sum(sizes.values()) > _MOST_BYTES:
        largest = max(sizes, key=lambda name: sizes[name])
        raise BadFileError(
            f"has {sum(sizes.values())} bytes in the columns of numbers, texts and times, most of"
            f" them in {largest!r}; at most {_MOST_BYTES} are read: leave that column out"
        )


def _is_read(field: Any) -> bool:
    """Return whether a column is one of numbers, texts, times or known vectors."""
    from pyarrow import types

    kind = field.type.value_type if types.is_dictionary(field.type) else field.type
    if types.is_list(kind) or types.is_fixed_size_list(kind):
        return field.name in _VECTORS
    if types.is_fixed_size_binary(kind):
        return bool(kind.byte_width == 16)
    kinds = types.is_floating, types.is_boolean, types.is_integer, types.is_timestamp, types.is_date
    return _is_text(kind) or any(is_kind(kind) for is_kind in kinds)


def _is_text(kind: Any) -> bool:
    from pyarrow import types

    kind = kind.value_type if types.is_dictionary(kind) else kind
    return bool(types.is_string(kind) or types.is_large_string(kind))


def _text_bytes(file: Any, name: str) -> int:
    """Return the bytes of a column of texts, row by row."""
    from pyarrow import compute

    total = 0
    for group in range(file.num_row_groups):
        for chunk in file.read_row_group(group, [name]).column(name).chunks:
            lengths = compute.binary_length(chunk.dictionary).cast("int64").take(chunk.indices)
            total += compute.sum(lengths).as_py() or 0
    return total


def _columns(table: Any) -> Iterator[tuple[str, Any]]:
    """Yield the columns that text can hold: NaN as a missing number, truth values as 1 and 0,
    vectors by components.
    """
    from pyarrow import compute, types

    for name, column in zip(table.column_names, table.columns, strict=True):
        if types.is_dictionary(column.type):
            column = column.cast(column.type.value_type)
        if types.is_list(column.type) or types.is_fixed_size_list(column.type):
            for axis, component in enumerate(_VECTORS[name]):
                yield component, compute.list_element(column, axis)
        else:
            yield name, _plain(column)


def _plain(column: Any) -> Any:
    """Return a column of numbers, texts, ids or times as text can hold it."""
    import pyarrow
    from pyarrow import types

    kind = column.type
    if types.is_floating(kind):
        return _without_nan(column.cast(pyarrow.float64()))
    if types.is_boolean(kind):
        return column.cast(pyarrow.int8())
    if types.is_fixed_size_binary(kind):
        return pyarrow.array(list(map(_uuid_text, column.to_pylist())), pyarrow.string())
    if types.is_timestamp(kind) or types.is_date(kind):
        return column.cast(pyarrow.timestamp("ns", tz="UTC"))
    return column


def _without_nan(column: Any) -> Any:
    from pyarrow import compute

    return compute.if_else(compute.is_nan(column), None, column)


def _uuid_text(content: bytes | None) -> str | None:
    return None if content is None else str(UUID(bytes=content))
