"""Records of columns: numpy arrays of one length that are indexed, concatenated and filled together."""

from collections.abc import Iterable, Mapping
from typing import Any, Generic, Self, TypeVar

import numpy as np
from attrs import fields

_Filled = TypeVar("_Filled", bound="Columns")

#: The column names of each record: needed for every block of rows.
_KNOWN_NAMES: dict[Any, tuple[str, ...]] = {}


class _FirstNames(dict[Any, str]):
    """The name of each record's first column, which gives its length."""

    def __missing__(self, record: Any) -> str:
        self[record] = names_of(record)[0]
        return self[record]


_FIRST_NAMES = _FirstNames()


class Columns:
    """A record of columns; the first attribute gives its length, and any may be None."""

    def __len__(self) -> int:
        return len(getattr(self, _FIRST_NAMES[type(self)]))

    def take(self, rows: Any) -> Self:
        """Return some of the rows, by an index array, a mask or a slice."""
        columns = [getattr(self, name) for name in names_of(type(self))]
        if isinstance(rows, np.ndarray) and rows.dtype != np.bool_:
            # For columns of vectors `take` is several times as fast as an index.
            return type(self)(*[None if column is None else column.take(rows, axis=0) for column in columns])
        return type(self)(*[None if column is None else column[rows] for column in columns])

    def part(self, rows: Any) -> Self:
        """Return some of the rows, by distinct sorted indices; the record itself if these are all rows."""
        return self if len(rows) == len(self) else self.take(rows)

    def freeze(self) -> Self:
        """Make every buffer read-only and return the record."""
        for name in names_of(type(self)):
            getattr(self, name).flags.writeable = False
        return self

    def overwrite(self, rows: Any, other: Self) -> None:
        """Overwrite some rows with the rows of another record."""
        for name in names_of(type(self)):
            getattr(self, name)[rows] = getattr(other, name)

    @classmethod
    def concatenate(cls, parts: Iterable[Self]) -> Self:
        """Return one record of all rows, in order; the empty record without parts."""
        pieces = list(parts)
        if not pieces:
            return cls.empty()
        # Empty pieces may have columns of another width.
        pieces = [piece for piece in pieces if len(piece)] or pieces[:1]
        return cls(*(np.concatenate([getattr(piece, name) for piece in pieces]) for name in names_of(cls)))

    @classmethod
    def empty(cls) -> Self:
        """Return the record without rows."""
        raise TypeError(f"{cls.__name__} has no empty form")


class Filling(Generic[_Filled]):
    """A record of a known number of rows, filled part by part, each copied while it is in the processor's cache.

    Columns that are complete already are `given`; they are not copied.
    """

    def __init__(self, record: type[_Filled], rows: int, given: Mapping[str, Any] | None = None) -> None:
        self._record = record
        self._rows = rows
        self._given = {} if given is None else given
        self._names = [name for name in names_of(record) if name not in self._given]
        self._columns: dict[str, Any] = {}
        self._at = 0

    def put(self, part: _Filled) -> None:
        """Append rows."""
        if not self._columns:
            self._columns = {name: self._blank(getattr(part, name)) for name in self._names}
        for name, whole in self._columns.items():
            if whole is not None:
                whole[self._at : self._at + len(part)] = getattr(part, name)
        self._at += len(part)

    def record(self) -> _Filled:
        """Return the filled record."""
        return self._record(**self._columns, **self._given) if self._columns else self._record.empty()

    def _blank(self, column: Any) -> Any:
        return None if column is None else np.empty((self._rows, *column.shape[1:]), column.dtype)


def names_of(record: Any) -> tuple[str, ...]:
    """Return the names of a record's columns, in order."""
    names = _KNOWN_NAMES.get(record)
    if names is None:
        names = _KNOWN_NAMES[record] = tuple(attribute.name for attribute in fields(record))
    return names
