"""Failed conformance tests of one cause are one group, whose first test tells it best."""

from typing import Any

import pytest
from opir_testing import ConformanceError
from opir_testing.contracts.causes import cause_of, grouped_by_cause, seen_of
from opir_testing.contracts.contract import DIFFERENCE, EVENTS, OUTSIDE_INPUTS, REPEAT, ROWS

from opir_core.errors import ModelError


def shown(evidence: str, seen: str = "a") -> str:
    return cause_of(ConformanceError(seen, "", evidence))


def raised_by(code: str, **names: object) -> Exception:
    """Return the error of a module of an author, which the core has called."""
    module = compile(code, "mine/sensor.py", "exec")
    with pytest.raises(ZeroDivisionError) as raised:
        exec(module, {"__name__": "mine", **names})
    return raised.value.with_traceback(raised.tb.tb_next)


def test_an_exception_is_one_cause_by_its_type_and_line() -> None:
    errors = [raised_by(f"x = {number}\n1 / 0") for number in (1, 2)]
    assert len({cause_of(error) for error in errors}) == 1
    assert cause_of(raised_by("\n\n1 / 0")) != cause_of(errors[0])
    assert seen_of(errors[0]) == "ZeroDivisionError: division by zero (mine/sensor.py, line 2)"


def test_the_line_is_the_authors_not_that_of_a_library_which_it_calls() -> None:
    library: dict[str, Any] = {"__name__": "library"}
    exec(compile("def ratio(x):\n    return 1 / x", "library/ratios.py", "exec"), library)
    error = raised_by("\n\nratio(0)", ratio=library["ratio"])
    assert seen_of(error) == "ZeroDivisionError: division by zero (mine/sensor.py, line 3)"


def test_an_exception_is_the_same_cause_behind_the_core_and_in_another_process() -> None:
    error = raised_by("1 / 0")
    wrapped = ModelError("'mine': build raised ZeroDivisionError (mine/sensor.py, line 1)")
    wrapped.__cause__ = error
    text = (
        "the sensor model 'mine': build raised ZeroDivisionError: x (y) (mine/sensor.py, line 1);"
        " `opir check mine` shows what is required"
    )
    assert cause_of(error) == cause_of(wrapped) == cause_of(ModelError(text))


def test_messages_that_differ_in_numbers_are_one_cause() -> None:
    assert shown("", "-1.5 of 3 rows are nan") == shown("", "2e-7 of 40 rows are inf")
    assert shown("", "a row is long") != shown("", "a row is short")


@pytest.mark.parametrize(
    ("evidence", "groups"),
    [
        (
            {"bytes": REPEAT, "windows": EVENTS, "clock": OUTSIDE_INPUTS, "copy": DIFFERENCE},
            [["clock", "bytes", "windows", "copy"]],
        ),
        ({"windows": EVENTS, "rows": ROWS, "copy": DIFFERENCE}, [["rows", "windows"], ["copy"]]),
        ({"bytes": REPEAT, "help": ""}, [["bytes"], ["help"]]),
    ],
)
def test_the_test_that_explains_others_comes_first(
    evidence: dict[str, str], groups: list[list[str]]
) -> None:
    causes = [(test, shown(kind, test)) for test, kind in evidence.items()]
    assert sorted(map(list, grouped_by_cause(causes))) == sorted(groups)


def test_what_the_engine_refuses_follows_from_the_wrong_value() -> None:
    refused = cause_of(ModelError("confidence returned 80 in row 0; [0, 1] is required"))
    value = shown("", "confidences are from 0 to 80")
    documented = shown("", "a field has no help")
    named = [("test_every_setting_is_documented", documented), ("run", refused), ("value", value)]
    assert grouped_by_cause(named) == [
        ["test_every_setting_is_documented"],
        ["value", "run"],
    ]
    assert grouped_by_cause(named[:2]) == [["test_every_setting_is_documented"], ["run"]]
