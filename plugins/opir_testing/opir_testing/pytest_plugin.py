"""The pytest plugin: expected failures of conformance tests, and a fixture that runs scenes.

pytest loads it wherever opir-core is installed, so it imports the core only when a conformance test
is collected.
"""

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

import pytest

if TYPE_CHECKING:
    from opir_testing.bench import BenchRun


#: The module of the base class of conformance tests, compared by name so that it need not be
#: imported.
_CONTRACT = "opir_testing.contracts.contract"


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Mark expected failures of conformance tests as strict xfail, with their reasons."""
    for item in items:
        expected: Mapping[str, str] = _expected(item)
        if item.name in expected:
            item.add_marker(pytest.mark.xfail(reason=expected[item.name], strict=True))


def _expected(item: pytest.Item) -> Mapping[str, str]:
    """Return the expected failures of an item's class; raises if one is an unknown test or has no
    reason.
    """
    contract: Any = getattr(item, "cls", None)
    if not any(parent.__module__ == _CONTRACT for parent in getattr(contract, "__mro__", ())):
        return {}
    expected: Mapping[str, str] = contract.expected_failures
    for test, reason in expected.items():
        if not hasattr(contract, test) or not reason.strip():
            raise pytest.UsageError(
                f"{contract.__name__} expects {test} to fail: no such test, or no reason"
            )
    return expected


@pytest.fixture
def opir_bench() -> "Callable[..., BenchRun]":
    """Return a function that runs the test scene with changes:
    `opir_bench(tracker="my-tracker")`.
    """
    from opir_testing.bench import bench_host, bench_run, bench_scene

    def run(**changes: Any) -> "BenchRun":
        return bench_run(bench_scene(**changes), bench_host(()))

    return run
