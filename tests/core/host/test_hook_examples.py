"""Each hook and each base class of a contract shows an example in its docstring, which runs as it
is written.
"""

import doctest
import sys
from collections.abc import Iterator
from importlib import import_module
from typing import Any, Protocol

import numpy as np
import pytest

from opir_core.host import components, hookspecs
from opir_core.interfaces.contract import PluginPart
from opir_core.plugin import Component

MODULES = (
    "classification",
    "detection_models",
    "outputs",
    "radiometric_models",
    "results",
    "sensors",
    "trackers",
    "trajectories",
)

HOOKS = [
    hook
    for holder in (hookspecs.CatalogueHooks, hookspecs.ExtensionHooks)
    for name, hook in vars(holder).items()
    if name.startswith("opir_")
]


def bases() -> Iterator[Any]:
    """Yield the base classes and protocols of what components build."""
    for name in MODULES:
        module = import_module(f"opir_core.interfaces.{name}")
        members = [
            member
            for member in vars(module).values()
            if getattr(member, "__module__", "") == module.__name__
        ]
        yield from (
            member
            for member in members
            if isinstance(member, type) and {PluginPart, Protocol} & {*member.__bases__}
        )


def fault_of(shown: Any) -> str:
    """Return what is wrong with the example of a hook or a class, or ""."""
    names = {"np": np, **vars(sys.modules[shown.__module__])}
    (example,) = doctest.DocTestFinder(recurse=False).find(shown, shown.__name__, globs=names)
    if not example.examples:
        return "no example"
    reported: list[str] = []
    failed = doctest.DocTestRunner(verbose=False).run(example, out=reported.append).failed
    return "".join(reported) if failed else ""


def test_all_hooks_and_base_classes_are_looked_at() -> None:
    assert len(HOOKS) == len(components.CATALOGUE) + 1
    assert {"Sink", "Transport", "Encoder", "Orbit", "Sensor", "Tracker", "Metric"} - {
        base.__name__ for base in bases()
    } == {"Sensor"}, "a record needs no example"


@pytest.mark.parametrize("shown", [*HOOKS, *bases(), Component], ids=lambda shown: shown.__name__)
def test_examples_run(shown: Any) -> None:
    assert not fault_of(shown)


class Bare(PluginPart):
    """A contract without an example."""


class Wrong(PluginPart):
    """A contract with an example that does not hold.

    >>> 1 + 1
    3
    """


@pytest.mark.parametrize(("shown", "fault"), [(Bare, "no example"), (Wrong, "Expected:\n    3")])
def test_a_missing_or_wrong_example_is_found(shown: Any, fault: str) -> None:
    assert fault in fault_of(shown)
