"""The catalogue of a host: one row for each plugin, for text and JSON."""

from attrs import frozen

from opir_core.plugin.components import CATALOGUE, PluginFailure, Provenance
from opir_core.plugin.discovery import COMMAND_HOOK, Offer, Source
from opir_core.plugin.error_messages import unknown_plugin
from opir_core.plugin.registry import Registry


@frozen(kw_only=True)
class ComponentRow:
    """One component in a catalogue; `contested_by` are the other plugins that claim its name."""

    hook: str
    kind: str
    name: str
    summary: str
    contested_by: tuple[Provenance, ...] = ()


@frozen(kw_only=True)
class PluginRow:
    """One plugin in a catalogue.

    `state` is "ready", "failed" (`failure` is the reason), "hidden" (excluded by the allow-list, not imported) or
    "unknown" (on the allow-list, but not installed). `requires_core` is the specifier of the versions of opir-core that
    the plugin requires, "" for none. `commands` are those advertised.
    """

    distribution: str
    version: str
    plugin: str
    state: str
    requires_core: str = ""
    components: tuple[ComponentRow, ...] = ()
    commands: tuple[str, ...] = ()
    failure: str = ""


def claims(registry: Registry) -> dict[Offer, list[Provenance]]:
    """Return every name that a plugin that has not failed advertises or offers, with its owners."""
    owners: dict[Offer, list[Provenance]] = {}
    for source in registry.sources:
        offers = registry.claims_of(source)
        if not registry.has_failed(source):
            for offer in offers:
                owners.setdefault(offer, []).append(source.provenance)
    return owners


def rows(registry: Registry) -> list[PluginRow]:
    """Load every plugin and return a row for each, sorted by name, then the hidden and the unknown ones."""
    registry.load_all()
    owners = claims(registry)
    selection = registry.selection
    return [
        *(_row(registry, source, owners) for source in registry.sources),
        *(_bare_row(source.provenance, "hidden", requires_core=source.requires_core) for source in selection.hidden),
        *(
            _bare_row(Provenance(name, "", ""), "unknown", unknown_plugin(name, selection))
            for name in selection.unknown
        ),
    ]


def _row(registry: Registry, source: Source, owners: dict[Offer, list[Provenance]]) -> PluginRow:
    owner = source.provenance
    outcome = registry.load(source)
    if isinstance(outcome, PluginFailure):
        return _bare_row(owner, "failed", outcome.reason, requires_core=source.requires_core)
    components = tuple(
        ComponentRow(
            hook=hook,
            kind=CATALOGUE[hook].kind,
            name=name,
            summary=component.summary,
            contested_by=tuple(other for other in owners[hook, name] if other != owner),
        )
        for (hook, name), component in sorted(outcome.components.items())
    )
    return PluginRow(
        distribution=owner.distribution,
        version=owner.version,
        plugin=owner.plugin,
        state="ready",
        requires_core=source.requires_core,
        components=components,
        commands=tuple(sorted(name for hook, name in source.advertised or () if hook == COMMAND_HOOK)),
    )


def _bare_row(owner: Provenance, state: str, failure: str = "", *, requires_core: str = "") -> PluginRow:
    return PluginRow(
        distribution=owner.distribution,
        version=owner.version,
        plugin=owner.plugin,
        state=state,
        requires_core=requires_core,
        failure=failure,
    )
