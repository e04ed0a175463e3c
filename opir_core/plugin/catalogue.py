"""What the plugins of a host offer, as rows for people and for JSON."""

from opir_core.plugin.components import CATALOGUE, ComponentRow, PluginFailure, PluginRow, Provenance
from opir_core.plugin.discovery import COMMAND_HOOK, Offer, Source
from opir_core.plugin.error_messages import unknown_plugin
from opir_core.plugin.registry import Registry


def claims(shelf: Registry) -> dict[Offer, list[Provenance]]:
    """Return every name that is advertised or offered by a plugin that has not failed, with its owners."""
    found: dict[Offer, list[Provenance]] = {}
    for source in shelf.sources:
        offers = shelf.claims_of(source)
        if not shelf.has_failed(source):
            for offer in offers:
                found.setdefault(offer, []).append(source.provenance)
    return found


def rows(shelf: Registry) -> list[PluginRow]:
    """Load every plugin and return a row for each, sorted by name; then the hidden and the unknown."""
    shelf.load_all()
    owners = claims(shelf)
    selection = shelf.selection
    return [
        *(_row(shelf, source, owners) for source in shelf.sources),
        *(_bare_row(source.provenance, "hidden", api=source.api) for source in selection.hidden),
        *(
            _bare_row(Provenance(name, "", ""), "unknown", unknown_plugin(name, selection))
            for name in selection.unknown
        ),
    ]


def _row(shelf: Registry, source: Source, owners: dict[Offer, list[Provenance]]) -> PluginRow:
    owner = source.provenance
    outcome = shelf.load(source)
    if isinstance(outcome, PluginFailure):
        return _bare_row(owner, "failed", outcome.reason, api=source.api)
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
        api=source.api,
        components=components,
        commands=tuple(sorted(name for hook, name in source.advertised or () if hook == COMMAND_HOOK)),
    )


def _bare_row(owner: Provenance, state: str, failure: str = "", *, api: str = "") -> PluginRow:
    return PluginRow(
        distribution=owner.distribution,
        version=owner.version,
        plugin=owner.plugin,
        state=state,
        api=api,
        failure=failure,
    )
