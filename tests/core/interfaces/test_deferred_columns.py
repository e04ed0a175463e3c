"""Deferred columns are computed once, when they are read, and are those of an eager computation."""

from collections.abc import Callable
from typing import Any

import numpy as np
import pytest
from attrs import field, frozen

from opir_core.arrays import FloatArray, IntArray
from opir_core.interfaces.columns import Columns, Deferred, Filling


@frozen(eq=False, repr=False)
class Inputs(Columns):
    number: IntArray


@frozen(eq=False, repr=False)
class Squares(Columns):
    row: IntArray
    square: FloatArray
    root: FloatArray


@frozen
class Powers:
    calls: list[int] = field(factory=list, eq=False)

    def __call__(self, inputs: Inputs) -> dict[str, Any]:
        self.calls.append(len(inputs))
        number = inputs.number.astype(np.float64)
        return {"square": number * number, "root": np.sqrt(number)}


def squares(numbers: Any, powers: Powers) -> Squares:
    inputs = Inputs(np.array(numbers))
    deferred = Deferred(frozenset({"square", "root"}), inputs, powers)
    return Squares.deferring({"row": np.arange(len(inputs))}, deferred)


def filled(record: Squares) -> Squares:
    filling = Filling(Squares, len(record))
    filling.put(record.take(slice(0, 2)))
    filling.put(record.take(slice(2, None)))
    return filling.record()


def overwritten(record: Squares) -> Squares:
    whole = record.take(np.arange(len(record)))
    powers: Any = None if record.deferred is None else record.deferred.compute
    whole.overwrite(np.array([1]), squares([25], powers).replaced(row=np.array([1])))
    return whole


@pytest.mark.parametrize(
    ("change", "expected"),
    [
        (lambda record: record, [1, 4, 9, 16]),
        (lambda record: record.take(slice(1, 3)), [4, 9]),
        (lambda record: record.take(np.array([3, 0])), [16, 1]),
        (lambda record: record.take(np.array([True, False, False, True])), [1, 16]),
        (lambda record: Squares.concatenate([record, record]), [1, 4, 9, 16] * 2),
        (lambda record: record.replaced(row=np.zeros(4, dtype=np.int64)), [1, 4, 9, 16]),
        (lambda record: record.freeze(), [1, 4, 9, 16]),
        (filled, [1, 4, 9, 16]),
        (overwritten, [1, 625, 9, 16]),
    ],
)
def test_columns_wait_until_one_is_read(
    change: Callable[[Squares], Squares], expected: list[int]
) -> None:
    powers = Powers()
    changed = change(squares([1, 2, 3, 4], powers))
    assert len(changed) == len(expected)
    assert powers.calls == []
    assert changed.square.tolist() == expected
    assert changed.root.tolist() == np.sqrt(np.sqrt(expected)).tolist()
    assert powers.calls == [len(expected)]
    assert not changed.square.flags.writeable


def test_unlike_records_are_joined_by_computing() -> None:
    powers = Powers()
    eager = Squares(np.array([7]), np.array([49.0]), np.array([2.0]))
    joined = Squares.concatenate([squares([1, 2], powers), eager])
    assert joined.square.tolist() == [1.0, 4.0, 49.0]
    assert joined.deferred is None


def test_a_replaced_column_is_not_computed_over() -> None:
    powers = Powers()
    record = squares([4], powers).replaced(square=np.array([-1.0]))
    assert record.root.tolist() == [2.0]
    assert record.square.tolist() == [-1.0]


def test_a_column_that_another_thread_computes_is_read() -> None:
    record: Any = squares([1, 2], Powers())
    computed = record.square
    # Python calls it if the column was missing before that thread was through.
    assert record.__getattr__("square") is computed


def test_a_name_that_is_none_is_an_attribute_error() -> None:
    with pytest.raises(AttributeError, match="'Squares' object has no attribute 'cube'"):
        getattr(squares([1], Powers()), "cube")  # noqa: B009 - mypy knows that it is none
