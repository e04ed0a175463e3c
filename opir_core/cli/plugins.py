"""`opir plugins`: what is installed, what it offers, and what is wrong with it."""

import argparse
import json
import sys
from collections.abc import Iterable
from typing import TYPE_CHECKING

from opir_core.cli.summary_text import table

if TYPE_CHECKING:
    from opir_core.plugin.components import PluginRow


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the form of the answer."""
    parser.add_argument("--json", action="store_true", help="print JSON")


def run(arguments: argparse.Namespace) -> int:
    """Print every plugin with its components."""
    from opir_core.plugin.host import Host

    rows = Host.discover().catalogue()
    sys.stdout.write((_as_json(rows) if arguments.json else _as_text(rows)) + "\n")
    return 0


def _as_json(rows: "list[PluginRow]") -> str:
    from attrs import asdict

    return json.dumps([asdict(row) for row in rows], indent=2)


def _as_text(rows: "list[PluginRow]") -> str:
    heads = [(row.plugin, row.distribution, row.version, row.api or "-", row.state) for row in rows]
    listed = [
        (part.kind, part.name, row.plugin, _warned(part.summary, part.contested_by))
        for row in rows
        for part in row.components
    ]
    failures = [f"{row.plugin}: {row.failure}" for row in rows if row.failure]
    return "\n\n".join(
        [
            table(("plugin", "distribution", "version", "api", "state"), heads),
            table(("kind", "name", "plugin", "summary"), sorted(listed)),
            *failures,
        ]
    )


def _warned(summary: str, contested_by: Iterable[object]) -> str:
    return f"{summary} (also claimed by {', '.join(map(str, contested_by))})" if contested_by else summary
