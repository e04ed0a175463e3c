"""Every component of this house keeps the contract of its kind, in a test that names it; what
cannot be says why.
"""

import ast
from collections.abc import Iterator

import pytest
from opir_testing.contracts import HOMES
from repository import ROOT

from opir_core import Host

TESTS = ROOT / "tests"

#: Components that are not held to their contract by a test of this kind, and why.
WITHOUT = {
    ("opir_sinks", "kafka"): "it needs a broker: tests/journeys and its own tests bring one",
    (
        "opir_trackers",
        "stonesoup",
    ): "it takes minutes: `opir check stonesoup` runs it, test_stonesoup_tracker.py the core",
    **{
        ("opir_tracker_parts", name): "`imm` has it by default, and is held to the same tests"
        for name in ("gnn", "jpda", "m-of-n", "regions", "thrust", "unlikely")
    },
}


def contracts_named() -> Iterator[tuple[str, str]]:
    """Yield the contract and the component of each contract test below `tests` and in the
    plugins.
    """
    for path in (*TESTS.rglob("test_*.py"), *(TESTS.parent / "plugins").rglob("test_*.py")):
        for node in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if isinstance(node, ast.ClassDef):
                yield from (
                    (ast.unparse(parent), name) for parent in node.bases for name in names_in(node)
                )


def names_in(node: ast.ClassDef) -> Iterator[str]:
    """Yield the names that a contract test holds; "*" for parameters: all that are installed."""
    if "type(self).name = request.param" in ast.unparse(node):
        yield "*"
    for statement in node.body:
        if isinstance(statement, ast.Assign) and ast.unparse(statement.targets[0]) == "name":
            yield str(ast.literal_eval(statement.value))


@pytest.mark.slow
def test_every_component_of_this_house_is_held_to_its_contract() -> None:
    held = set(contracts_named())
    fleets = {name for contract, name in held if contract == "ConstellationContract"}
    missing = [
        (component.hook, component.name)
        for row in Host.discover().catalogue()
        if row.distribution.startswith("opir-")
        for component in row.components
        if not held & {(HOMES[component.hook][1], name) for name in (component.name, "*")}
        and (component.hook, component.name) not in WITHOUT
        and not (
            component.hook == "opir_sensor_models"
            and any(name.startswith(component.name) for name in fleets)
        )
    ]
    assert not missing, "write a contract test, as in tests/contracts/test_core_contracts.py"
