"""`opir check`: run the conformance tests of a component."""

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from contextlib import redirect_stdout
from io import StringIO
from typing import Any

from attrs import asdict

from opir_core.cli import OwnedComponent, add_component, components_named
from opir_core.errors import Problem, SceneError, number_of
from opir_core.host import warn
from opir_core.plugin import Host
from opir_core.reading import Node, data_of_node, overridden
from opir_core.scene import implausible_defaults
from opir_testing.contracts import (
    BAD,
    PASSED,
    ConformanceResult,
    by_cause,
    conformance_results,
    contract_for,
)

#: The exit code of a failed conformance test, as of models that return invalid values.
_FAILED_EXIT_CODE = 4


def check_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the component, its settings, the expected failures and the output format."""
    add_component(parser)
    parser.add_argument(
        "--set",
        metavar="KEY=VALUE",
        action="append",
        default=[],
        dest="settings",
        help="a setting for the tests",
    )
    parser.add_argument(
        "--expect",
        metavar="TEST=REASON",
        action="append",
        default=[],
        help="a test that must fail, with the reason",
    )
    parser.add_argument("--json", action="store_true", help="print JSON")


def check(arguments: argparse.Namespace) -> int:
    """Run the conformance tests for each kind that has the name, and print the results."""
    components = components_named(Host.discover(), arguments.name, arguments.kind)
    settings = _settings(arguments.settings)
    expected = _expected(arguments.expect)
    contracts = [
        (component, contract_for(component.component.hook, arguments.name, settings, expected))
        for component in components
    ]
    # What a component prints is no result; a conformance test reports it.
    with redirect_stdout(StringIO()):
        results = [
            (component, list(conformance_results(contract))) for component, contract in contracts
        ]
    text = (
        _as_json(results)
        if arguments.json
        else "\n\n".join(_as_text(*result) for result in results)
    )
    sys.stdout.write(text + "\n")
    for component in components:
        for problem in implausible_defaults(component.component, settings):
            warn(f"{component.component.kind} {component.component.name}: {problem}")
    return (
        _FAILED_EXIT_CODE
        if any(result.state in BAD for _, rows in results for result in rows)
        else 0
    )


def _settings(written: Sequence[str]) -> Mapping[str, Any]:
    """Return the settings of `key=value` words, read like the overrides of a scene."""
    root = Node({})
    errors = overridden(root, written)
    if errors:
        raise SceneError([Problem("", error.message) for error in errors], source="--set")
    return data_of_node(root)


def _expected(written: Sequence[str]) -> Mapping[str, str]:
    for word in written:
        if not word.partition("=")[2].strip():
            raise SceneError([Problem(word, "write TEST=REASON, with a reason")], source="--expect")
    return {word.partition("=")[0]: word.partition("=")[2] for word in written}


def _as_text(owned: OwnedComponent, results: Sequence[ConformanceResult]) -> str:
    component = owned.component
    lines = [f"{component.kind} {component.name} of {owned.owner}"]
    causes = by_cause(results)
    consequences = {first.test: others for first, *others in causes}
    for result in results:
        if result.state in BAD and result.test not in consequences:
            continue
        lines.append(f"  {result.state:7}  {result.requirement}")
        if result.state != PASSED:
            lines += [f"           {result.test}: {result.seen}", f"           {result.change}"]
        if names := [other.test for other in consequences.get(result.test, ())]:
            lines.append(f"           for this cause {len(names)} more fail: {', '.join(names)}")
    passing = sum(result.state not in BAD for result in results)
    verdict = f"{passing} of {len(results)} conformance tests pass"
    if causes:
        verdict += f"; {number_of('cause', len(causes))} to correct"
    return "\n".join(line.rstrip() for line in [*lines, verdict])


def _test_rows(results: Sequence[ConformanceResult]) -> Sequence[Mapping[str, Any]]:
    """Return the results as plain values; the `cause` of a bad one is the test that tells it."""
    first = {result.test: group[0].test for group in by_cause(results) for result in group}
    return [{**asdict(result), "cause": first.get(result.test, "")} for result in results]


def _as_json(reports: Sequence[tuple[OwnedComponent, Sequence[ConformanceResult]]]) -> str:
    rows = [
        {
            "kind": owned.component.kind,
            "name": owned.component.name,
            **asdict(owned.owner),
            "tests": _test_rows(results),
        }
        for owned, results in reports
    ]
    return json.dumps(rows, indent=2)
