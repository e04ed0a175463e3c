"""Timestamps against the standard library's datetime."""

from datetime import UTC, datetime, timedelta

import numpy as np
import pytest
from hypothesis import given, strategies as st

from opir_core.errors import SinkError
from opir_core.output import timestamp_text, unix_microseconds, writable_unix_microseconds
from opir_core.output.events.text import END_UNIX_US, FIRST_UNIX_US, timestamp_characters

UNIX_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
WRITABLE = st.integers(FIRST_UNIX_US, END_UNIX_US - 1)
EPOCH_US = 1_775_044_800_000_000


def standard(unix_us: int) -> str:
    return (
        (UNIX_EPOCH + timedelta(microseconds=unix_us))
        .isoformat(timespec="microseconds")
        .replace("+00:00", "Z")
    )


@given(st.lists(WRITABLE | st.integers(0, 4_102_444_800_000_000)))
def test_text_is_datetime_s(unix_us: list[int]) -> None:
    assert timestamp_text(np.array(unix_us, dtype=np.int64)) == [
        standard(unix_u) for unix_u in unix_us
    ]


@pytest.mark.parametrize("year", range(1970, 2100))
def test_every_year_s_ends_are_datetime_s(year: int) -> None:
    first_us = int((datetime(year, 1, 1, tzinfo=UTC) - UNIX_EPOCH).total_seconds()) * 1_000_000
    leap_day = first_us + 59 * 86_400_000_000
    times = [first_us - 1, first_us, first_us + 1, leap_day - 1, leap_day]
    assert timestamp_text(np.array(times)) == [standard(time) for time in times]


def test_equal_neighbours_and_unsorted_times_are_written_alike() -> None:
    times = np.array([5_000_000, 5_000_001, 3, 5_999_999, 5_000_000, 5_000_000])
    assert timestamp_text(times) == [standard(time_us) for time_us in times.tolist()]
    assert timestamp_text(times[2:3]) == timestamp_text(times)[2:3]


@given(st.integers(-(2**63), 2**63 - 1), WRITABLE)
def test_nanoseconds_round_to_microseconds_half_up(time_ns: int, epoch_us: int) -> None:
    (unix_us,) = unix_microseconds(np.array([time_ns]), epoch_us).tolist()
    assert unix_us == epoch_us + (2 * time_ns + 1000) // 2000


def test_a_half_microsecond_rounds_up() -> None:
    halves = np.array([-1500, -500, 500, 1500, 499, -501])
    assert unix_microseconds(halves, 10).tolist() == [9, 10, 11, 12, 10, 9]


def test_the_first_and_last_writable_times() -> None:
    assert timestamp_text(np.array([FIRST_UNIX_US, END_UNIX_US - 1])) == [
        "0001-01-01T00:00:00.000000Z",
        "9999-12-31T23:59:59.999999Z",
    ]


@pytest.mark.parametrize("unix_us", [FIRST_UNIX_US - 1, END_UNIX_US, 2**63 - 1, -(2**63)])
def test_a_year_of_more_or_fewer_than_four_digits_is_refused(unix_us: int) -> None:
    with pytest.raises(SinkError, match="1 of 2 times lie outside the years 1 to 9999"):
        timestamp_text(np.array([0, unix_us]))


def test_no_times_make_no_text() -> None:
    assert timestamp_text(np.empty(0, dtype=np.int64)) == []
    assert timestamp_characters(np.empty(0, dtype=np.int64)).shape == (0, 27)


@given(st.floats(), st.sampled_from([EPOCH_US, FIRST_UNIX_US, END_UNIX_US - 1]))
def test_seconds_that_a_timestamp_cannot_say_are_distinguished(
    time_s: float, epoch_us: int
) -> None:
    unix_us, writable = writable_unix_microseconds(np.array([time_s]), epoch_us)
    if writable[0]:
        assert abs(int(unix_us[0]) - epoch_us - time_s * 1e6) <= 1 + abs(time_s) * 1e-9
        assert len(timestamp_text(unix_us)) == 1
    else:
        inside = (
            np.isfinite(time_s) and FIRST_UNIX_US + 1 < epoch_us + time_s * 1e6 < END_UNIX_US - 1
        )
        assert not inside
