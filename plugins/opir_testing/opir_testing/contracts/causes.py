"""The causes of bad results of conformance tests: one cause has many, and is reported once."""

import re
import sys
import traceback
from collections.abc import Iterable, Sequence
from pathlib import PurePath

from opir_core.host import described_error
from opir_testing.contracts.contract import (
    DIFFERENCE,
    EVENTS,
    OUTSIDE_INPUTS,
    REPEAT,
    ROWS,
    ConformanceError,
    Contract,
)

#: Any other error, mostly of the engine, which refuses in a run what a test of values finds too.
REFUSED = "refused"

#: Evidence of one kind explains that of the later kinds; that of the first two, any difference.
_EXPLAINING = (OUTSIDE_INPUTS, REPEAT, ROWS, EVENTS)
_EXPLAINS_DIFFERENCES = (OUTSIDE_INPUTS, REPEAT)
#: How the cause of a value that is wrong by itself begins.
_OF_A_VALUE = ": "

_NOT_THE_AUTHORS = {
    "opir_core",
    "opir_testing",
    "numpy",
    "scipy",
    *("attr", "attrs", "cattrs", "msgspec", "pluggy"),
    *sys.stdlib_module_names,
}
_LINE_OF_THE_TESTS = re.compile(r" \((opir_testing|contracts)/[^()]*, line \d+\)$")
_ANY_LINE = re.compile(r" \([^()]*, line \d+\)$")
_RAISED = re.compile(r"raised (\w+)\b.*\(([^()]+, line \d+)\)")
_NUMBER = re.compile(r"-?\d[\d.e+-]*|\bnan\b|\binf\b")


def authors_line(error: BaseException) -> str:
    """Return the innermost line of the component's package in which an error was raised, "" if it
    was raised elsewhere. That package is the first one outside the core: it may use libraries.
    """
    lines: dict[str, str] = {}
    for frame, number in traceback.walk_tb(_root_cause(error).__traceback__):
        package = frame.f_globals.get("__name__", "").partition(".")[0]
        place = "/".join(PurePath(frame.f_code.co_filename).parts[-2:])
        lines[package] = f"{place}, line {number}"
    return next((line for name, line in lines.items() if name not in _NOT_THE_AUTHORS), "")


def seen_of(error: BaseException) -> str:
    """Return an error in one line, with the line of the component's code that raised it."""
    if isinstance(error, ConformanceError):
        return error.seen
    line = authors_line(error)
    text = (_ANY_LINE if line else _LINE_OF_THE_TESTS).sub("", described_error(error))
    return f"{text} ({line})" if line and line not in text else text


def cause_of(error: BaseException) -> str:
    """Return the cause that an error shows, the same text for errors of one cause: what a failed
    test shows, the type and the line of an exception, or a message without its numbers.
    """
    if isinstance(error, ConformanceError):
        message = _NUMBER.sub("#", error.seen)
        is_message = error.evidence in ("", DIFFERENCE)
        return f"{error.evidence}: {message}" if is_message else error.evidence
    text = seen_of(error)
    raised = _RAISED.search(text)
    if raised:
        return " ".join(raised.groups())
    line = authors_line(error)
    if line:
        return f"{type(_root_cause(error)).__name__} {line}"
    return f"{REFUSED}: {_NUMBER.sub('#', text.partition(': ')[2])}"


def grouped_by_cause(causes: Iterable[tuple[str, str]]) -> Sequence[Sequence[str]]:
    """Return the tests with bad results, given with the cause that each shows, in a row for each
    cause; the first of a row tells it best.
    """
    groups: dict[str, list[str]] = {}
    for test, cause in causes:
        groups.setdefault(cause, []).append(test)
    present = [cause for cause in _EXPLAINING if cause in groups]
    for cause in present[1:]:
        groups[present[0]] += groups.pop(cause)
    _move(groups, DIFFERENCE, next((c for c in _EXPLAINS_DIFFERENCES if c in groups), None))
    values = (cause for cause, tests in groups.items() if _is_of_values(cause, tests[0]))
    _move(groups, REFUSED, next(values, None))
    return list(groups.values())


def _is_of_values(cause: str, test: str) -> bool:
    """Return whether a test of the kind has found a wrong value."""
    return cause.startswith(_OF_A_VALUE) and not hasattr(Contract, test)


def _move(groups: dict[str, list[str]], evidence: str, cause: str | None) -> None:
    """Add the tests that show evidence of any message to those of a cause, if there is one."""
    for key in [key for key in groups if cause is not None and key.startswith(f"{evidence}: ")]:
        groups[str(cause)] += groups.pop(key)


def _root_cause(error: BaseException) -> BaseException:
    """Return the exception at the beginning of the chain of causes of an error."""
    while error.__cause__ is not None:
        error = error.__cause__
    return error
