"""`opir check`: does a component keep the promises of its kind? What is broken is told with what to change."""

import argparse
import json
import sys
from collections.abc import Mapping, Sequence
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from opir_core.cli.lookup import Owned
    from opir_core.testing.contract_runner import Verdict

#: A component that breaks a promise: the exit code of models that return what their contract forbids.
_BROKEN_EXIT_CODE = 4


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the component, its settings, what is expected to fail, and the form of the answer."""
    from opir_core.cli.lookup import HOOK_BY_KIND

    parser.add_argument("name", metavar="COMPONENT", help="a component's name, as scenes write it")
    parser.add_argument("--kind", choices=sorted(HOOK_BY_KIND), help="of this kind alone, where several share the name")
    parser.add_argument(
        "--set", metavar="KEY=VALUE", action="append", default=[], dest="settings", help="a setting to check it with"
    )
    parser.add_argument(
        "--expect", metavar="TEST=REASON", action="append", default=[], help="a test that fails, and why; it must fail"
    )
    parser.add_argument("--json", action="store_true", help="print JSON")


def run(arguments: argparse.Namespace) -> int:
    """Run the contract of each kind that has the name, and tell what it came to."""
    from opir_core.cli.lookup import components_named
    from opir_core.plugin.host import Host
    from opir_core.testing.contract_runner import BAD, contract_for, verdicts

    found = components_named(Host.discover(), arguments.name, arguments.kind)
    settings, expected = _settings(arguments.settings), _expected(arguments.expect)
    contracts = [(owned, contract_for(owned.component.hook, arguments.name, settings, expected)) for owned in found]
    told = [(owned, list(verdicts(contract))) for owned, contract in contracts]
    sys.stdout.write((_as_json(told) if arguments.json else "\n\n".join(_as_text(*one) for one in told)) + "\n")
    return _BROKEN_EXIT_CODE if any(verdict.state in BAD for _, one in told for verdict in one) else 0


def _settings(written: Sequence[str]) -> Mapping[str, Any]:
    """Return the settings that `key=value` words mean, read as overrides of scenes are."""
    from opir_core.errors import Problem, SceneError
    from opir_core.scene.reading.nodes import Node
    from opir_core.scene.reading.overrides import overridden
    from opir_core.scene.reading.plain_data import data_of_node

    root = Node({})
    complaints = overridden(root, written, {})
    if complaints:
        raise SceneError([Problem("", complaint.message) for complaint in complaints], source="--set")
    settings: Mapping[str, Any] = data_of_node(root)
    return settings


def _expected(written: Sequence[str]) -> Mapping[str, str]:
    from opir_core.errors import Problem, SceneError

    for word in written:
        if not word.partition("=")[2].strip():
            raise SceneError([Problem(word, "write TEST=REASON, with a reason")], source="--expect")
    return {word.partition("=")[0]: word.partition("=")[2] for word in written}


def _as_text(owned: "Owned", verdicts: "Sequence[Verdict]") -> str:
    from opir_core.testing.contract_runner import BAD, KEPT

    component = owned.component
    bad = [verdict for verdict in verdicts if verdict.state in BAD]
    lines = [f"{component.kind} {component.name} of {owned.owner}"]
    for verdict in verdicts:
        lines.append(f"  {verdict.state:10}  {verdict.promise}")
        if verdict.state != KEPT:
            lines += [f"              {verdict.test}: {verdict.seen}", f"              {verdict.change}"]
    kept = len(verdicts) - len(bad)
    lines.append(f"{kept} of {len(verdicts)} promises are kept{', as expected' if not bad else ''}")
    return "\n".join(line.rstrip() for line in lines)


def _as_json(told: "Sequence[tuple[Owned, Sequence[Verdict]]]") -> str:
    from attrs import asdict

    rows = [
        {
            "kind": owned.component.kind,
            "name": owned.component.name,
            **asdict(owned.owner),
            "tests": [asdict(verdict) for verdict in verdicts],
        }
        for owned, verdicts in told
    ]
    return json.dumps(rows, indent=2)
