"""`opir plugins` lists the installed plugins, `opir describe` the settings of a component."""

import argparse
import json
import sys
from collections.abc import Iterable, Mapping, Sequence
from typing import Any

from attrs import asdict, frozen

from opir_core.cli.terminal import table
from opir_core.errors import PluginError, nearest_names
from opir_core.host.components import CATALOGUE, Constellation, Offered, Provenance
from opir_core.host.error_messages import PACKAGES, way_to_install
from opir_core.host.host import Host
from opir_core.host.registry import PluginRow
from opir_core.scene.field_rows import REQUIRED, field_rows, named_values, plain, shown
from opir_core.scene.target_classes import TargetClass

#: The hooks by the names of their kinds on the command line: `sensor-model`, `tracker`.
HOOK_BY_KIND = {kind.kind.replace(" ", "-"): hook for hook, kind in CATALOGUE.items()}


@frozen
class OwnedComponent:
    """A component and its owner."""

    component: Offered
    owner: Provenance


def plugins_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the output format."""
    parser.add_argument("--json", action="store_true", help="print JSON")


def plugins(arguments: argparse.Namespace) -> int:
    """Print every plugin with its components."""
    rows = Host.discover().catalogue()
    text = (
        json.dumps([asdict(row) for row in rows], indent=2)
        if arguments.json
        else _plugins_text(rows)
    )
    sys.stdout.write(text + "\n")
    return 0


def describe_arguments(parser: argparse.ArgumentParser) -> None:
    """Add the component and the output format."""
    add_component(parser)
    parser.add_argument("--json", action="store_true", help="print JSON")


def describe(arguments: argparse.Namespace) -> int:
    """Print the settings of the component, for each kind that has the name."""
    components = components_named(Host.discover(), arguments.name, arguments.kind)
    descriptions = [described(owned.component, owned.owner) for owned in components]
    text = (
        json.dumps(descriptions, indent=2)
        if arguments.json
        else "\n\n".join(map(_component_text, descriptions))
    )
    sys.stdout.write(text + "\n")
    return 0


def add_component(parser: argparse.ArgumentParser) -> None:
    """Add the arguments that name a component."""
    parser.add_argument("name", metavar="COMPONENT", help="the name of a component, as in scenes")
    parser.add_argument(
        "--kind", choices=sorted(HOOK_BY_KIND), help="only this kind, if several have the name"
    )


def components_named(host: Host, name: str, kind: str | None = None) -> Sequence[OwnedComponent]:
    """Return all components of a name, or that of one kind, sorted by kind.

    Raises `PluginError` if there is none or if the plugin of one cannot be used.
    """
    if kind is not None:
        return [_owned(host, HOOK_BY_KIND[kind], name)]
    components = [_owned(host, hook, name) for hook in CATALOGUE if name in host.names(hook)]
    if not components:
        raise PluginError(_unknown(host, name))
    return components


def described(component: Offered, owner: Provenance) -> Mapping[str, Any]:
    """Return the description of a component as plain values; the component is not built."""
    head = {
        "kind": component.kind,
        "name": component.name,
        "summary": component.summary,
        "plugin": owner.plugin,
        "distribution": owner.distribution,
        "version": owner.version,
    }
    if isinstance(component, Constellation):
        return {
            **head,
            "model": component.model,
            "satellites": [plain(row) for row in component.satellites],
        }
    if isinstance(component, TargetClass):
        phase = {"after_burnout": {component.after_burnout.model: asdict(component.after_burnout)}}
        return {
            **head,
            **{key: value for key, value in asdict(component).items() if key not in head},
            **phase,
        }
    rows = [asdict(row) for row in field_rows(component.config)]
    presets = {name: plain(values) for name, values in component.presets.items()}
    named = {"presets": presets, "presets_for": dict(component.presets_for)}
    return {**head, "fields": rows, **named, "named_values": named_values(component.config)}


def _plugins_text(rows: Sequence[PluginRow]) -> str:
    heads = [
        (row.plugin, row.distribution, row.version, row.requires_core or "-", row.state)
        for row in rows
    ]
    listed = [
        (
            component.kind,
            component.name,
            row.plugin,
            _with_owners(component.summary, component.contested_by),
        )
        for row in rows
        for component in row.components
    ]
    failures = [f"{row.plugin}: {row.failure}" for row in rows if row.failure]
    return "\n\n".join(
        [
            table(("plugin", "distribution", "version", "for opir-core", "state"), heads),
            table(("kind", "name", "plugin", "summary"), sorted(listed)),
            *failures,
        ]
    )


def _with_owners(summary: str, contested_by: Iterable[object]) -> str:
    return (
        f"{summary} (also offered by {', '.join(map(str, contested_by))})"
        if contested_by
        else summary
    )


def _owned(host: Host, hook: str, name: str) -> OwnedComponent:
    return OwnedComponent(host.component(hook, name), host.provenance(hook, name))


def _unknown(host: Host, name: str) -> str:
    close = nearest_names(name, {offered for hook in CATALOGUE for offered in host.names(hook)})
    packages = [
        package
        for package, entries in PACKAGES.items()
        if any(name == entry.partition(".")[2] for entry in entries)
    ]
    host.catalogue()
    lines = [
        f"no component is named {name!r}",
        *([f"nearest: {', '.join(close)}"] if close else []),
        *map(way_to_install, packages),
        *(f"failed: {failure}" for failure in host.failures),
        "opir plugins lists the installed components",
    ]
    return "\n  ".join(lines)


def _component_text(row: Mapping[str, Any]) -> str:
    head = (
        f"{row['kind']} {row['name']}, of {row['distribution']} {row['version']} (plugin"
        f" {row['plugin']})"
    )
    kinds = {"satellites": _satellites, "profiles": _profiles}
    described = next((text for key, text in kinds.items() if key in row), _settings)
    return "\n\n".join([f"{head}\n{row['summary']}", *described(row)])


def _profiles(row: Mapping[str, Any]) -> list[str]:
    """Return the reported type of a target class, its phase after burnout, and its profiles."""
    ((model, settings),) = row["after_burnout"].items()
    heads = ("profile", "burn time s", "burnout m/s", "range km", "peak W/sr", "stages")
    profiles = [
        (
            profile["name"],
            f"{profile['burn_time_s']:g}",
            f"{profile['burnout_speed_m_s']:g}",
            f"{profile['minimum_range_m'] / 1e3:g} to {profile['maximum_range_m'] / 1e3:g}",
            shown(row["plumes"][profile["name"]]["peak_w_sr"]),
            str(row["plumes"][profile["name"]]["stages"]),
        )
        for profile in row["profiles"]
    ]
    resembled = (
        "" if row["resembles"] == row["reported_type"] else f"; it resembles {row['resembles']}"
    )
    follows = f"after burnout: {model} {shown(settings) if settings else ''}".strip()
    return [f"reported type {row['reported_type']}{resembled}\n{follows}", table(heads, profiles)]


def _satellites(row: Mapping[str, Any]) -> list[str]:
    rows = [
        (satellite["id"], shown({key: value for key, value in satellite.items() if key != "id"}))
        for satellite in row["satellites"]
    ]
    return [table(("satellite", f"settings of the model {row['model']}"), rows)]


def _settings(row: Mapping[str, Any]) -> list[str]:
    if not row["fields"]:
        return ["It has no settings."]
    usual = {
        name: f" (default in scenes with {subject})" for subject, name in row["presets_for"].items()
    }
    presets = [
        f"preset {name}{usual.get(name, '')}: {shown(values)}"
        for name, values in row["presets"].items()
    ]
    named = [f"{text} is {shown(value)}" for text, value in row["named_values"].items()]
    return ["\n".join(map(_field, row["fields"])), *presets, *named]


def _field(row: Mapping[str, Any]) -> str:
    default = REQUIRED if row["is_required"] else f"default {shown(row['default'])}"
    allowed = (row["kind"], row["unit"], row["interval"], " | ".join(row["choices"]))
    lines = [
        f"{row['key']}: {', '.join(detail for detail in (*allowed, default) if detail)}",
        f"    {row['help']}",
        *([f"    {_origin(row['source'])}"] if row["source"] and not row["is_required"] else []),
    ]
    return "\n".join(lines)


def _origin(source: str) -> str:
    """Return the source of a default; a source that begins with "no default" is a sentence of its
    own.
    """
    return source if source.startswith("no default") else f"default: {source}"
