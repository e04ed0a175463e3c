"""Records of columns: numpy arrays of one length that are indexed, concatenated and filled
together.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from functools import cache
from operator import is_
from typing import TYPE_CHECKING, Any, ClassVar, Generic, Self, TypeVar, get_type_hints

import numpy as np
from attrs import evolve, fields, frozen

from opir_core.arrays import NUMBER_TYPES
from opir_core.errors import number_of
from opir_core.notebook import ROWS_SHOWN, html_view

_Filled = TypeVar("_Filled", bound="Columns")


def _names(record: Any) -> tuple[str, ...]:
    """Return the names of a record's columns, in order."""
    return tuple(attribute.name for attribute in fields(record))


def _kinds(record: Any) -> tuple[Any, ...]:
    hints = get_type_hints(record)
    unknown = [name for name in names_of(record) if hints[name] not in NUMBER_TYPES]
    if unknown:
        columns = ", ".join(f"{record.__name__}.{name}" for name in unknown)
        raise TypeError(
            f"annotate {columns} with an array type of opir_core.arrays, for the number type of no"
            f" rows"
        )
    return tuple(NUMBER_TYPES[hints[name]] for name in names_of(record))


#: Returns the names of a record's columns, in order; needed for every block of rows.
names_of: Callable[[Any], tuple[str, ...]] = cache(_names)
#: Returns the number types of a record's columns, in order.
_kinds_of: Callable[[Any], tuple[Any, ...]] = cache(_kinds)


#: Letters of the columns' names in the text of a record.
LONGEST_REPR = 300


@frozen(eq=False)
class Deferred:
    """The columns `names` of a record, which `compute` returns of the rows of `inputs` when one of
    them is first read.

    `compute` treats each row by itself. It is compared: two records whose computations are equal
    are joined without computing.
    """

    names: frozenset[str]
    inputs: "Columns"
    compute: Callable[[Any], Mapping[str, Any]]

    def take(self, rows: Any) -> "Deferred":
        """Return the columns of some of the rows."""
        return evolve(self, inputs=self.inputs.take(rows))

    def is_like(self, other: "Deferred | None") -> bool:
        """Return whether two records may be joined without computing."""
        return (
            other is not None
            and self.names == other.names
            and type(self.inputs) is type(other.inputs)
            and self.compute == other.compute
        )

    @classmethod
    def joined(cls, parts: Sequence["Deferred | None"]) -> "Deferred | None":
        """Return the columns of several records, or None if one has none or they are not alike."""
        first = parts[0] if parts else None
        alike = [part for part in parts if part is not None and part.is_like(first)]
        if first is None or len(alike) < len(parts):
            return None
        inputs = type(first.inputs).concatenate(part.inputs for part in alike)
        return evolve(first, inputs=inputs)


class Columns:
    """A record of columns; the first attribute gives its length, and any may be None. Records have
    `repr=False`.

    A column that is the array of the first one stays so: `take` and `concatenate` copy it once.
    Columns may be deferred: the first read of one computes them.
    """

    #: The shape of a row in the columns that have more than one number a row.
    row_shapes: ClassVar[Mapping[str, tuple[int, ...]]] = {}

    @classmethod
    def deferring(cls, columns: Mapping[str, Any], deferred: Deferred | None) -> Self:
        """Return the record with these columns, the others deferred."""
        if deferred is None or not deferred.names:
            return cls(**columns)
        record = cls.__new__(cls)
        record.__dict__["_deferred"] = deferred
        for name, column in columns.items():
            object.__setattr__(record, name, column)
        return record

    @property
    def deferred(self) -> Deferred | None:
        """The columns that are not computed yet."""
        deferred: Deferred | None = self.__dict__.get("_deferred")
        return deferred

    if not TYPE_CHECKING:  # names stay checked

        def __getattr__(self, name: str) -> Any:
            """Compute the deferred columns, read-only; called for an attribute without a value."""
            deferred = self.__dict__.get("_deferred")
            if deferred is None or name not in deferred.names:
                # Unknown, or computed by another thread meanwhile.
                return object.__getattribute__(self, name)
            columns = deferred.compute(deferred.inputs)
            for column_name in deferred.names:
                columns[column_name].flags.writeable = False
                object.__setattr__(self, column_name, columns[column_name])
            self.__dict__.pop("_deferred", None)
            return columns[name]

    def computed(self) -> Self:
        """Compute the deferred columns and return the record."""
        if self.deferred is not None:
            getattr(self, min(self.deferred.names))
        return self

    def _present(self, deferred: Deferred | None) -> Mapping[str, Any]:
        """Return the columns that are not among the deferred ones, by name."""
        absent = frozenset() if deferred is None else deferred.names
        return {name: getattr(self, name) for name in names_of(type(self)) if name not in absent}

    def replaced(self, **columns: Any) -> Self:
        """Return the record with other columns; those deferred stay so."""
        deferred = self.deferred
        present = self._present(deferred)
        if deferred is not None:
            deferred = evolve(deferred, names=deferred.names - columns.keys())
        return self.deferring({**present, **columns}, deferred)

    def __len__(self) -> int:
        return len(getattr(self, names_of(type(self))[0]))

    def __repr__(self) -> str:
        """Return the number of rows and the columns, with the shape of a row where it is not one
        number; deferred columns stay so.
        """
        blank = self.take(slice(0, 0))
        columns = {name: getattr(blank, name) for name in names_of(type(self))}
        names = [
            f"{name}{list(column.shape[1:]) if np.ndim(column) > 1 else ''}"
            for name, column in columns.items()
            if column is not None
        ]
        present = self._present(self.deferred).values()
        rows = next((len(column) for column in present if column is not None), 0)
        text = ", ".join(names)
        if len(text) > LONGEST_REPR:
            shown = text[:LONGEST_REPR].rpartition(", ")[0]
            text = f"{shown} and {len(names) - shown.count(', ') - 1} more"
        return f"<{type(self).__name__}: {number_of('row', rows)} of {text}>"

    def _repr_html_(self) -> str:
        """Return the first rows of the columns of one number a row, for a notebook."""
        shown = self.take(slice(ROWS_SHOWN))
        columns = {
            name: column.tolist()
            for name in names_of(type(self))
            if isinstance(column := getattr(shown, name), np.ndarray) and column.ndim == 1
        }
        return html_view(self, list(columns), list(zip(*columns.values(), strict=True)), len(self))

    def take(self, rows: Any) -> Self:
        """Return some of the rows, by an index array, a mask or a slice."""
        deferred = self.deferred
        columns = self._present(deferred)
        first_column = columns[names_of(type(self))[0]]
        if isinstance(rows, np.ndarray) and rows.dtype != np.bool_:
            # For columns of vectors `take` is several times as fast as an index.
            of_first = None if first_column is None else first_column.take(rows, axis=0)
            taken = {
                name: of_first
                if column is first_column
                else None
                if column is None
                else column.take(rows, axis=0)
                for name, column in columns.items()
            }
        else:
            of_first = None if first_column is None else first_column[rows]
            taken = {
                name: of_first
                if column is first_column
                else None
                if column is None
                else column[rows]
                for name, column in columns.items()
            }
        if deferred is None:
            return type(self)(*taken.values())
        return self.deferring(taken, deferred.take(rows))

    def part(self, rows: Any) -> Self:
        """Return some of the rows, by distinct sorted indices; the record itself if these are all
        rows.
        """
        return self if len(rows) == len(self) else self.take(rows)

    def freeze(self) -> Self:
        """Make every buffer read-only and return the record."""
        for column in self._present(self.deferred).values():
            column.flags.writeable = False
        return self

    def overwrite(self, rows: Any, replacement: Self) -> None:
        """Overwrite some rows with the rows of another record."""
        deferred = self.deferred
        others = replacement.deferred
        if deferred is not None and others is not None and deferred.is_like(others):
            deferred.inputs.overwrite(rows, others.inputs)
        elif deferred is not None:
            for name in deferred.names:
                object.__setattr__(self.computed(), name, getattr(self, name).copy())
            deferred = None
        for name, column in self._present(deferred).items():
            column[rows] = getattr(replacement, name)

    @classmethod
    def concatenate(cls, records: Iterable[Self]) -> Self:
        """Return one record of all rows, in order; the empty record without parts."""
        pieces = list(records)
        if not pieces:
            return cls.empty()
        # Empty pieces may have columns of another width.
        pieces = [piece for piece in pieces if len(piece)] or pieces[:1]
        deferred = Deferred.joined([piece.deferred for piece in pieces])
        names = pieces[0]._present(deferred)
        columns = {name: [getattr(piece, name) for piece in pieces] for name in names}
        first_columns = columns[names_of(cls)[0]]
        of_first = np.concatenate(first_columns)
        joined = {
            name: of_first
            if column[0] is first_columns[0] and all(map(is_, column, first_columns))
            else np.concatenate(column)
            for name, column in columns.items()
        }
        return cls.deferring(joined, deferred)

    @classmethod
    def empty(cls) -> Self:
        """Return the record without rows."""
        columns = zip(names_of(cls), _kinds_of(cls), strict=True)
        return cls(
            *(np.empty((0, *cls.row_shapes.get(name, ())), dtype=kind) for name, kind in columns)
        )


class Filling(Generic[_Filled]):
    """A record of a known number of rows, filled part by part, each copied while it is in the
    processor's cache.

    Columns that are complete already are `given`; they are not copied.
    """

    def __init__(
        self, record: type[_Filled], rows: int, complete: Mapping[str, Any] | None = None
    ) -> None:
        self._record = record
        self._rows = rows
        self._given = {} if complete is None else complete
        self._names = [name for name in names_of(record) if name not in self._given]
        self._columns: dict[str, Any] = {}
        self._deferred: list[Deferred | None] = []
        self._at = 0

    def put(self, rows: _Filled) -> None:
        """Append rows; all parts have the same columns deferred."""
        deferred = rows.deferred
        self._deferred.append(deferred)
        if not self._columns:
            absent = frozenset() if deferred is None else deferred.names
            names = [name for name in self._names if name not in absent]
            self._columns = {name: self._blank(getattr(rows, name)) for name in names}
        for name, column in self._columns.items():
            if column is not None:
                column[self._at : self._at + len(rows)] = getattr(rows, name)
        self._at += len(rows)

    def record(self) -> _Filled:
        """Return the filled record."""
        if not self._columns:
            return self._record.empty()
        columns = {**self._columns, **self._given}
        return self._record.deferring(columns, Deferred.joined(self._deferred))

    def _blank(self, column: Any) -> Any:
        return None if column is None else np.empty((self._rows, *column.shape[1:]), column.dtype)
