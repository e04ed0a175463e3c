"""Columns of tables: numpy arrays and texts to Arrow arrays, with unit and meaning."""

from collections.abc import Iterable, Sequence
from typing import Any

import numpy as np
import pyarrow as pa
from attrs import Factory, field, frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray

_NS_PER_US = 1_000
_NS_PER_S = 1_000_000_000


#: Units by the endings of names, the longer ones first.
_UNITS = {
    "_deg": "deg",
    "_m_s": "m/s",
    "_w_m2": "W/m2",
    "_km2": "km2",
    "_urad": "urad",
    "_m": "m",
    "_s": "s",
}


def _unit_of(column: "TableColumn") -> str:
    """Return the unit that a name ends in, UTC for times, "" for others."""
    if pa.types.is_timestamp(column.values.type):
        return "UTC"
    return next((unit for ending, unit in _UNITS.items() if column.name.endswith(ending)), "")


def _arrow(values: Any) -> Any:
    return numbers(values) if isinstance(values, np.ndarray) else values


@frozen(eq=False)
class TableColumn:
    """A column of a table: its name, numbers (n,) or an Arrow array, its meaning, and its unit, by
    default that of its name ("" for none).
    """

    name: str
    values: Any = field(converter=_arrow)
    meaning: str
    unit: str = Factory(_unit_of, takes_self=True)


def table_of(columns: Iterable[TableColumn], metadata: dict[str, str]) -> Any:
    """Return a `pyarrow.Table`; unit and meaning of a column are in the metadata of its field."""
    arrays = []
    fields = []
    for column in columns:
        words = {"unit": column.unit, "description": column.meaning}
        arrays.append(column.values)
        fields.append(pa.field(column.name, column.values.type, metadata=words))
    return pa.table(arrays, schema=pa.schema(fields, metadata=metadata))


def numbers(values: Any) -> Any:
    """Return numbers (n,) as an Arrow array, null where they are nan."""
    column = np.ascontiguousarray(values)
    return _array(column, np.isnan(column) if column.dtype.kind == "f" else None)


def _array(column: Any, unknown: BoolArray | None, kind: Any = None) -> Any:
    """Return an Arrow array over the memory of numbers (n,), null where they are `unknown` (n,).

    `pa.array` would import pandas, where it is installed, to look for its types.
    """
    nulls = 0 if unknown is None else int(np.count_nonzero(unknown))
    validity = (
        None
        if not nulls or unknown is None
        else pa.py_buffer(np.packbits(~unknown, bitorder="little"))
    )
    kind = pa.from_numpy_dtype(column.dtype) if kind is None else kind
    return pa.Array.from_buffers(kind, len(column), [validity, pa.py_buffer(column)], nulls)


def _words(words: Sequence[str]) -> Any:
    """Return words as an array of texts."""
    encoded = [word.encode() for word in words]
    ends = np.cumsum([0, *map(len, encoded)], dtype=np.int32)
    return pa.StringArray.from_buffers(
        len(encoded), pa.py_buffer(ends), pa.py_buffer(b"".join(encoded))
    )


def plain_numbers(values: Sequence[float | None]) -> Any:
    """Return numbers, None for unknown, as an array of doubles."""
    return pa.array(list(values), type=pa.float64(), from_pandas=True)


def counts(values: Sequence[int | None]) -> Any:
    """Return whole numbers, None for unknown, as an array."""
    return pa.array(list(values), type=pa.int64())


def numbers_known(values: IntArray) -> Any:
    """Return whole numbers (n,), null where they are negative."""
    column = np.ascontiguousarray(values, dtype=np.int64)
    return _array(column, column < 0)


def names(codes: Any, words: Sequence[str]) -> Any:
    """Return the words of codes (n,) as a dictionary array, null where a code is negative."""
    column = np.ascontiguousarray(codes, dtype=np.int32)
    return pa.DictionaryArray.from_arrays(_array(column, column < 0), _words(words))


def texts(values: Sequence[str | None]) -> Any:
    """Return texts, None for unknown, as a dictionary array."""
    return pa.array(list(values), type=pa.string()).dictionary_encode()


def lists(values: FloatArray) -> Any:
    """Return rows of numbers (n, k) as lists of k, null where the first number is nan."""
    rows, width = values.shape
    flat = pa.array(np.ascontiguousarray(values, dtype=np.float64).reshape(-1))
    unknown = np.isnan(values[:, 0]) if rows else np.zeros(0, dtype=np.bool_)
    return pa.FixedSizeListArray.from_arrays(flat, width, mask=pa.array(unknown))


def instants(time_ns: IntArray, epoch_us: int) -> Any:
    """Return scene times (n,), ns, as timestamps in UTC; the least integer is null."""
    column = np.asarray(time_ns, dtype=np.int64)
    unknown = column == np.iinfo(np.int64).min
    stamps = np.where(unknown, 0, column) + epoch_us * _NS_PER_US
    return _array(stamps, unknown, pa.timestamp("ns", tz="UTC"))


def nanoseconds(time_s: FloatArray) -> IntArray:
    """Return scene times (n,), s, rounded to ns; the least integer where they are nan."""
    column = np.asarray(time_s, dtype=np.float64)
    is_known = np.isfinite(column)
    rounded: IntArray = np.full(len(column), np.iinfo(np.int64).min)
    rounded[is_known] = np.rint(column[is_known] * _NS_PER_S).astype(np.int64)
    return rounded
