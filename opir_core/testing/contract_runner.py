"""Contracts without pytest: every test of a contract run, and its verdict in words."""

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from attrs import frozen

from opir_core.errors import Problem, SceneError, nearest
from opir_core.plugin.error_messages import described_error
from opir_core.testing.contracts import contract_of
from opir_core.testing.contracts.contract import Broken, Contract, promise, test_names

KEPT, BROKEN, EXPECTED, UNEXPECTED = "kept", "broken", "expected", "unexpected"

_SETTINGS = "The settings that it is checked with can be read."

#: What makes a component unfit: a promise broken, or one kept that was said to be broken.
BAD = (BROKEN, UNEXPECTED)


@frozen(kw_only=True)
class Verdict:
    """What came of a test.

    `state` is "kept", "broken", "expected" (broken, as was said, `change` being the reason) or "unexpected" (kept,
    though it was said to be broken).
    """

    test: str
    promise: str
    state: str
    seen: str = ""
    change: str = ""


def contract_for(
    hook: str, name: str, settings: Mapping[str, Any], expected: Mapping[str, str], plugins: Sequence[str] = ()
) -> type[Contract]:
    """Return the contract of a component; raises `SceneError` where `expected` names a test that is not in it."""
    parent = contract_of(hook)
    known = test_names(parent)
    for test in expected:
        if test not in known:
            raise SceneError(
                [Problem(test, f"{parent.__name__} has no such test{nearest(test, known)}")], source="--expect"
            )
    given = {"name": name, "settings": settings, "expected_failures": expected, "plugins": tuple(plugins)}
    return type(parent.__name__, (parent,), given)


def verdicts(contract: type[Contract]) -> Iterator[Verdict]:
    """Yield the verdict of each test of a contract, one after the other; one alone where its settings do not fit."""
    try:
        contract.config()
    except Broken as error:
        yield Verdict(test="settings", promise=_SETTINGS, state=BROKEN, seen=error.seen, change=error.change)
        return
    for test in test_names(contract):
        yield _verdict(contract, test)


def _verdict(contract: type[Contract], test: str) -> Verdict:
    reason = contract.expected_failures.get(test)
    told = {"test": test, "promise": promise(contract, test)}
    try:
        getattr(contract(), test)()
    except Exception as error:
        if reason is not None:
            return Verdict(**told, state=EXPECTED, seen=_seen(error), change=reason)
        return Verdict(**told, state=BROKEN, seen=_seen(error), change=_change(error))
    if reason is None:
        return Verdict(**told, state=KEPT)
    return Verdict(**told, state=UNEXPECTED, seen="it is kept", change=f"Expect it no longer to fail ({reason}).")


def _seen(error: Exception) -> str:
    return error.seen if isinstance(error, Broken) else described_error(error)


def _change(error: Exception) -> str:
    if isinstance(error, Broken):
        return error.change
    if "read-only" in str(error):
        return "Columns that are handed in belong to the engine: copy a column before changing it."
    return "Mend what raises this."
