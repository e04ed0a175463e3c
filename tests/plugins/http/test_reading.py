"""Numbers in a query, and bodies."""

import pytest
from opir_http.problems import ProblemError
from opir_http.queries import ReplayQuery, TracksQuery, read_query
from opir_http.reading import json_object

TIMES = "since=2026-04-01T12:00:00Z&until=2026-04-01T12:01:00Z"


def step_s(text: str) -> float:
    return read_query(f"{TIMES}&step_s={text}".encode(), ReplayQuery).step_s


def test_a_byte_order_mark_is_ignored() -> None:
    assert json_object(b'\xef\xbb\xbf{"type": "ICBM"}') == {"type": "ICBM"}


def test_an_absent_number_is_the_default() -> None:
    assert read_query(b"", TracksQuery).limit == 100
    assert read_query(TIMES.encode(), ReplayQuery).step_s == 1.0


@pytest.mark.parametrize(("text", "number"), [("0.1", 0.1), ("600", 600.0), ("1e1", 10.0)])
def test_a_number_is_read_up_to_its_limits(text: str, number: float) -> None:
    assert step_s(text) == number


@pytest.mark.parametrize(
    "text", ["", "-0.1", "600.1", "nan", "inf", "1e400", "0x1", "1_0", "+1", "1,5", "%D9%A1"]
)
def test_another_number_is_refused(text: str) -> None:
    with pytest.raises(ProblemError, match=r"step_s must be a number from 0\.1 to 600"):
        step_s(text)


@pytest.mark.parametrize("text", ["", "0", "1001", "1.0", "-1", "+1", "%D9%A1", "9" * 5000])
def test_another_integer_is_refused(text: str) -> None:
    with pytest.raises(ProblemError, match="limit must be an integer from 1 to 1000"):
        read_query(f"limit={text}".encode(), TracksQuery)
