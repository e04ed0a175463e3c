"""Records of arrays over n targets, and the same of some of the targets."""

from collections.abc import Sequence
from typing import Any, ClassVar, Self

import numpy as np

from opir_core.arrays import RowArray


class Rows:
    """A base of attrs records: arrays (n, ...), records of the same targets, and common values."""

    __slots__ = ()

    __attrs_attrs__: ClassVar[Any]

    #: The axis of the targets in each array.
    AXIS: ClassVar[int] = 0

    def take(self, rows: RowArray) -> Self:
        """Return the record of some of the targets."""
        names = [column.name for column in self.__attrs_attrs__]
        return type(self)(**{name: self._some(getattr(self, name), rows) for name in names})

    def overwrite(self, rows: RowArray, record: Self) -> None:
        """Overwrite some of the targets with those of another record."""
        place: Any = rows if self.AXIS == 0 else (..., rows)
        for column in self.__attrs_attrs__:
            getattr(self, column.name)[place] = getattr(record, column.name)

    @classmethod
    def concatenate(cls, records: Sequence[Self]) -> Self:
        """Return the record of the targets of all records, in order."""
        names = [column.name for column in cls.__attrs_attrs__]
        columns = ([getattr(record, name) for record in records] for name in names)
        return cls(*(np.concatenate(column, axis=cls.AXIS) for column in columns))

    def _some(self, column: Any, rows: RowArray) -> Any:
        if isinstance(column, np.ndarray):
            return column.take(rows, axis=self.AXIS)
        return column.take(rows) if hasattr(column, "take") else column


class TrailingRows(Rows):
    """As `Rows`, for arrays (..., n)."""

    __slots__ = ()
    AXIS = -1
