"""`opir describe`: what a component is, what a scene may set of it, and where its defaults come from."""

import argparse
import json
import sys
from collections.abc import Mapping
from typing import Any

from opir_core.cli.summary_text import table


def add_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the component and the form of the answer."""
    from opir_core.cli.lookup import HOOK_BY_KIND

    parser.add_argument("name", metavar="COMPONENT", help="a component's name, as scenes write it")
    parser.add_argument("--kind", choices=sorted(HOOK_BY_KIND), help="of this kind alone, where several share the name")
    parser.add_argument("--json", action="store_true", help="print JSON")


def run(arguments: argparse.Namespace) -> int:
    """Print what is known of the component, of each kind that has the name."""
    from opir_core.cli.lookup import components_named
    from opir_core.plugin.description import described
    from opir_core.plugin.host import Host

    found = components_named(Host.discover(), arguments.name, arguments.kind)
    told = [described(owned.component, owned.owner) for owned in found]
    text = json.dumps(told, indent=2) if arguments.json else "\n\n".join(map(_as_text, told))
    sys.stdout.write(text + "\n")
    return 0


def _as_text(told: Mapping[str, Any]) -> str:
    head = f"{told['kind']} {told['name']}, of {told['distribution']} {told['version']} (plugin {told['plugin']})"
    return "\n\n".join([f"{head}\n{told['summary']}", *(_fleet(told) if "satellites" in told else _settings(told))])


def _fleet(told: Mapping[str, Any]) -> list[str]:
    from opir_core.plugin.description import shown

    rows = [(row["id"], shown({key: value for key, value in row.items() if key != "id"})) for row in told["satellites"]]
    return [table(("satellite", f"settings of the model {told['model']}"), rows)]


def _settings(told: Mapping[str, Any]) -> list[str]:
    from opir_core.plugin.description import shown

    if not told["fields"]:
        return ["It has nothing to set."]
    presets = [f"preset {name}: {shown(values)}" for name, values in told["presets"].items()]
    return ["\n".join(map(_field, told["fields"])), *presets]


def _field(row: Mapping[str, Any]) -> str:
    from opir_core.plugin.description import REQUIRED, shown

    default = REQUIRED if row["is_required"] else f"default {shown(row['default'])}"
    allowed = (row["kind"], row["unit"], row["interval"], " | ".join(row["choices"]))
    lines = [
        f"{row['key']}: {', '.join(part for part in (*allowed, default) if part)}",
        f"    {row['help']}",
        *([f"    {_origin(row['source'])}"] if row["source"] and not row["is_required"] else []),
    ]
    return "\n".join(lines)


def _origin(source: str) -> str:
    """Return where a default comes from; a source that says there is none says so itself."""
    return source if source.startswith("no default") else f"default: {source}"
