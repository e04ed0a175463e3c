"""Records of columns: columns that are the array of the first one stay so, and others stay
apart.
"""

from typing import ClassVar

import numpy as np
import pytest
from attrs import frozen
from opir_testing import stub_window

from opir_core import arrays
from opir_core.interfaces import Columns


@frozen(eq=False)
class Row(Columns):
    """Three columns, of which any may be None."""

    one: np.ndarray | None
    other: np.ndarray | None
    third: np.ndarray | None


SHARED = np.arange(5)
APART = np.arange(5) + 10


@pytest.mark.parametrize(
    "rows", [slice(1, 4), np.array([3, 1, 1]), np.array([True, False, True, True, False])]
)
def test_take_copies_one_array_once(rows: object) -> None:
    taken = Row(SHARED, SHARED, APART).take(rows)
    assert taken.one is taken.other
    assert np.array_equal(taken.one, SHARED[rows])
    assert np.array_equal(taken.third, APART[rows])
    equal = Row(SHARED, SHARED.copy(), None).take(rows)
    assert equal.one is not equal.other
    assert np.array_equal(equal.one, equal.other)
    assert equal.third is None


def test_concatenate_copies_a_shared_array_once() -> None:
    shared = Row.concatenate([Row(SHARED, SHARED, APART), Row(APART, APART, SHARED)])
    assert shared.one is shared.other
    assert shared.one.tolist() == [*range(5), *range(10, 15)]
    assert shared.third.tolist() == [*range(10, 15), *range(5)]
    mixed = Row.concatenate([Row(SHARED, SHARED, APART), Row(SHARED, APART, APART)])
    assert mixed.one is not mixed.other
    assert mixed.other.tolist() == [*range(5), *range(10, 15)]


def test_reports_are_at_the_times_of_looks_unless_given() -> None:
    detections = stub_window(4).detections
    assert detections.reported_ns is detections.time_ns
    assert not detections.is_delayed
    delayed = stub_window(4, reported_ns=np.arange(4) + 7).detections
    assert delayed.is_delayed
    assert delayed.take(slice(0, 0)).is_delayed is False
    assert delayed.take([2]).reported_ns.tolist() == [9]


@frozen(eq=False)
class Numbers(Columns):
    """A record as in a module with postponed annotations."""

    row_shapes: ClassVar = {"state": (6,)}

    state: "arrays.FloatArray"
    codes: "arrays.ByteArray"
    anything: "arrays.ObjectArray"


def test_empty_records_have_the_annotated_number_types() -> None:
    empty = Numbers.empty()
    assert (empty.state.shape, empty.state.dtype) == ((0, 6), np.float64)
    assert (empty.codes.shape, empty.codes.dtype) == ((0,), np.uint8)
    assert (empty.anything.shape, empty.anything.dtype) == ((0,), np.object_)


def test_every_array_type_has_its_number_type() -> None:
    named = {
        name: alias
        for name, alias in vars(arrays).items()
        if name.endswith("Array") and name != "NDArray"
    }
    assert set(arrays.NUMBER_TYPES) == set(named.values())


def test_a_column_of_no_known_number_type_is_named() -> None:
    with pytest.raises(
        TypeError, match=r"annotate Row\.one, Row\.other, Row\.third with an array type"
    ):
        Row.empty()
