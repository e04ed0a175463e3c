"""`opir check`: run the conformance tests of a component."""

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from typing import Any

from attrs import asdict

from opir_core.cli.components import OwnedComponent, add_component, components_named
from opir_core.errors import Problem, SceneError
from opir_core.plugin.host import Host
from opir_core.scene.reading.loading import overridden
from opir_core.scene.reading.nodes import Node
from opir_core.scene.reading.plain_data import data_of_node
from opir_core.testing.contract_runner import BAD, KEPT, Verdict, contract_for, verdicts

#: The exit code of a failed conformance test, as of models that return invalid values.
_FAILED_EXIT_CODE = 4


def check_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the component, its settings, the expected failures and the output format."""
    add_component(parser)
    parser.add_argument(
        "--set", metavar="KEY=VALUE", action="append", default=[], dest="settings", help="a setting for the tests"
    )
    parser.add_argument(
        "--expect", metavar="TEST=REASON", action="append", default=[], help="a test that must fail, with the reason"
    )
    parser.add_argument("--json", action="store_true", help="print JSON")


def check(arguments: argparse.Namespace) -> int:
    """Run the conformance tests for each kind that has the name, and print the results."""
    components = components_named(Host.discover(), arguments.name, arguments.kind)
    settings, expected = _settings(arguments.settings), _expected(arguments.expect)
    contracts = [(one, contract_for(one.component.hook, arguments.name, settings, expected)) for one in components]
    results = [(one, list(verdicts(contract))) for one, contract in contracts]
    text = _as_json(results) if arguments.json else "\n\n".join(_as_text(*result) for result in results)
    sys.stdout.write(text + "\n")
    return _FAILED_EXIT_CODE if any(verdict.state in BAD for _, one in results for verdict in one) else 0


def _settings(written: Sequence[str]) -> Mapping[str, Any]:
    """Return the settings of `key=value` words, read like the overrides of a scene."""
    root = Node({})
    errors = overridden(root, written, {})
    if errors:
        raise SceneError([Problem("", error.message) for error in errors], source="--set")
    settings: Mapping[str, Any] = data_of_node(root)
    return settings


def _expected(written: Sequence[str]) -> Mapping[str, str]:
    for word in written:
        if not word.partition("=")[2].strip():
            raise SceneError([Problem(word, "write TEST=REASON, with a reason")], source="--expect")
    return {word.partition("=")[0]: word.partition("=")[2] for word in written}


def _as_text(owned: OwnedComponent, verdicts: Sequence[Verdict]) -> str:
    component = owned.component
    bad = [verdict for verdict in verdicts if verdict.state in BAD]
    lines = [f"{component.kind} {component.name} of {owned.owner}"]
    for verdict in verdicts:
        lines.append(f"  {verdict.state:10}  {verdict.promise}")
        if verdict.state != KEPT:
            lines += [f"              {verdict.test}: {verdict.seen}", f"              {verdict.change}"]
    passed = len(verdicts) - len(bad)
    lines.append(f"{passed} of {len(verdicts)} conformance tests pass{', as expected' if not bad else ''}")
    return "\n".join(line.rstrip() for line in lines)


def _as_json(results: Sequence[tuple[OwnedComponent, Sequence[Verdict]]]) -> str:
    rows = [
        {
            "kind": owned.component.kind,
            "name": owned.component.name,
            **asdict(owned.owner),
            "tests": [asdict(verdict) for verdict in verdicts],
        }
        for owned, verdicts in results
    ]
    return json.dumps(rows, indent=2)
