"""What the service takes for a number in a query, and what it takes where there is none."""

import pytest
from opir_http.problems import ProblemError
from opir_http.reading import json_object, number_within, unit_number, whole_number


def test_a_byte_order_mark_before_a_body_is_passed_over() -> None:
    assert json_object(b'\xef\xbb\xbf{"type": "ICBM"}') == {"type": "ICBM"}


def test_an_absent_number_is_the_default() -> None:
    assert number_within({}, "speed", 2.5, 0.0, 10.0) == 2.5
    assert whole_number({}, "limit", 7, 10) == 7
    assert unit_number({}, "confidence") is None


@pytest.mark.parametrize(
    ("text", "number"), [("0", 0.0), ("10", 10.0), ("2.5", 2.5), ("1e1", 10.0)]
)
def test_a_number_is_taken_up_to_its_limits(text: str, number: float) -> None:
    assert number_within({"speed": text}, "speed", 1.0, 0.0, 10.0) == number


@pytest.mark.parametrize(
    "text", ["", "-0.1", "10.1", "nan", "inf", "1e400", "0x1", "1_0", " 1", "1,5", "\u0661"]
)
def test_another_number_is_refused_with_the_limits(text: str) -> None:
    with pytest.raises(ProblemError, match="speed must be a number from 0 to 10"):
        number_within({"speed": text}, "speed", 1.0, 0.0, 10.0)


@pytest.mark.parametrize("text", ["", "0", "11", "1.0", "-1", "+1", "\u0661", "9" * 5000])
def test_another_integer_is_refused_with_the_limits(text: str) -> None:
    with pytest.raises(ProblemError, match="limit must be an integer from 1 to 10"):
        whole_number({"limit": text}, "limit", 7, 10)
