"""Zero crossings against functions whose zeros are known: sines, parabolas that dip between
samples, corners.
"""

import numpy as np
import pytest
from hypothesis import assume, example, given, strategies as st

from opir_core.geometry import zero_crossings
from opir_core.geometry.crossings import intervals_below


def test_every_zero_of_a_sine_is_found():
    crossings = zero_crossings(
        lambda _, time_s: np.sin(time_s), np.array([0.5]), np.array([20.0]), step_s=0.9
    )
    assert crossings.time_s == pytest.approx(np.pi * np.arange(1, 7), abs=1e-3)
    assert crossings.rises.tolist() == [False, True] * 3


def test_rows_have_functions_and_ends_of_their_own():
    shift = np.array([0.0, 1.0, 2.0])
    crossings = zero_crossings(
        lambda row, time_s: time_s - 3.0 - shift[row],
        np.array([0.0, 0.0, 4.5]),
        np.array([10.0, 3.5, 6.0]),
        step_s=1.0,
        tolerance_s=1e-6,
    )
    assert crossings.row.tolist() == [0, 2]
    assert crossings.time_s == pytest.approx([3.0, 5.0], abs=1e-6)


@example(25.0, 1.0, "parabola", False)
@example(5.0, 1.0, "parabola", False)
@example(95.0, 1.0, "parabola", True)
@given(
    st.floats(0.05, 99.95),
    st.floats(3e-3, 3.0),
    st.sampled_from(["parabola", "corner"]),
    st.booleans(),
)
def test_a_dip_between_two_samples_is_found(centre_s, half_s, shape, is_negated):
    """A dip of any width, below zero within half_s of its centre, and samples 10 s apart."""
    edges = np.array([centre_s - half_s, centre_s + half_s])
    assume(np.all(np.abs(edges - np.rint(edges / 10.0) * 10.0) > 1e-2))
    sign = -1.0 if is_negated else 1.0

    def function(time_s):
        off = np.abs(time_s - centre_s) / half_s
        return sign * (off**2 - 1.0 if shape == "parabola" else off - 1.0)

    crossings = zero_crossings(
        lambda _, time_s: function(time_s), np.zeros(1), np.full(1, 100.0), step_s=10.0
    )
    assert crossings.time_s == pytest.approx(edges[(edges > 0.0) & (edges < 100.0)], abs=1.5e-3)


def test_intervals_are_cut_at_the_ends():
    assert intervals_below(np.sin, 4.0, 12.0, step_s=0.5) == pytest.approx(
        np.array([[4.0, 2.0 * np.pi], [3.0 * np.pi, 12.0]]), abs=1e-3
    )
    assert intervals_below(np.cos, 2.0, 4.0, step_s=0.5).tolist() == [[2.0, 4.0]]
    assert intervals_below(np.sin, 1.0, 2.0, step_s=0.5).shape == (0, 2)
    assert intervals_below(np.sin, 4.0, 4.0, step_s=0.5).shape == (0, 2)


def test_nan_has_no_sign():
    crossings = zero_crossings(
        lambda _, time_s: np.where((time_s > 2.0) & (time_s < 4.5), np.nan, np.sin(time_s)),
        np.array([1.0]),
        np.array([9.0]),
        step_s=0.5,
    )
    assert crossings.time_s == pytest.approx([2.0 * np.pi], abs=1e-3)


def test_no_rows_have_no_crossings():
    crossings = zero_crossings(lambda _, time_s: time_s, np.empty(0), np.empty(0), step_s=1.0)
    assert [len(column) for column in crossings] == [0, 0, 0]


def test_a_function_far_from_zero_is_sampled_and_no_more():
    calls = []

    def counted(_, time_s):
        calls.append(len(time_s))
        return 5.0 + np.sin(time_s)

    zero_crossings(counted, np.zeros(1), np.full(1, 10.0), step_s=1.0)
    assert sum(calls) <= 11 + 2
