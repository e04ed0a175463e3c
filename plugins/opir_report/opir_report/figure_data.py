"""The data of a figure: columns of equal length, by name, and their file."""

from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any

import numpy as np
from attrs import frozen


@frozen(eq=False)
class FigureData:
    """Columns (n,) by name; units are in the names."""

    columns: Mapping[str, np.ndarray[Any, Any]]

    @classmethod
    def of_rows(cls, names: Sequence[str], rows: Iterable[Sequence[Any]]) -> "FigureData":
        """Return the columns of rows of plain values."""
        columns = list(zip(*rows, strict=True)) or [()] * len(names)
        return cls({name: np.asarray(values) for name, values in zip(names, columns, strict=True)})

    @classmethod
    def joined(cls, tables: "Sequence[FigureData]") -> "FigureData":
        """Return the rows of tables of the same columns."""
        return cls(
            {name: np.concatenate([table[name] for table in tables]) for name in tables[0].columns}
        )

    def __len__(self) -> int:
        return len(next(iter(self.columns.values()), ()))

    def __getitem__(self, name: str) -> np.ndarray[Any, Any]:
        """Return a column."""
        return self.columns[name]

    def where(self, rows: Any) -> "FigureData":
        """Return some of the rows."""
        return FigureData({name: column[rows] for name, column in self.columns.items()})

    def levels(self, name: str) -> list[Any]:
        """Return the distinct values of a column, in order."""
        return list(dict.fromkeys(self.columns[name].tolist()))

    def at(self, name: str, value: Any) -> "FigureData":
        """Return the rows with a value in a column."""
        return self.where(self.columns[name] == value)

    def write(self, path: Path) -> None:
        """Write the columns to a Parquet file."""
        import pyarrow
        from pyarrow import parquet

        arrays = {name: _arrow(pyarrow, column) for name, column in self.columns.items()}
        parquet.write_table(pyarrow.table(arrays), path)


def _arrow(pyarrow: Any, column: np.ndarray[Any, Any]) -> Any:
    """Return a column as an Arrow array, None as null; `pyarrow.array` would import pandas, to look
    for its types.
    """
    kind = column.dtype.kind
    if kind in "iuf":
        wide = np.ascontiguousarray(column, dtype=np.float64 if kind == "f" else np.int64)
        buffers = [None, pyarrow.py_buffer(wide)]
        return pyarrow.Array.from_buffers(pyarrow.from_numpy_dtype(wide.dtype), len(wide), buffers)
    if kind == "b":
        buffers = [None, _bits(pyarrow, column)]
        return pyarrow.Array.from_buffers(pyarrow.bool_(), len(column), buffers)
    values = column.tolist()
    if not all(value is None or isinstance(value, str) for value in values) or not any(values):
        return pyarrow.array(values)
    known = np.array([value is not None for value in values])
    encoded = [(value or "").encode() for value in values]
    ends = pyarrow.py_buffer(np.cumsum([0, *map(len, encoded)], dtype=np.int32))
    buffers = [
        None if known.all() else _bits(pyarrow, known),
        ends,
        pyarrow.py_buffer(b"".join(encoded)),
    ]
    return pyarrow.Array.from_buffers(pyarrow.string(), len(encoded), buffers)


def _bits(pyarrow: Any, column: Any) -> Any:
    return pyarrow.py_buffer(np.packbits(column, bitorder="little"))
