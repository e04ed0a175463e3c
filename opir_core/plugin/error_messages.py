"""The words for a component that is missing, claimed twice, or whose plugin failed: whose it is and the way out."""

from collections.abc import Collection, Iterable, Mapping, Sequence

from attrs import frozen

from opir_core.plugin.components import CATALOGUE, PluginFailure, Provenance
from opir_core.plugin.discovery import COMMAND_HOOK, CORE_PLUGINS, Offer, Selection
from opir_core.plugin.validation import nearest, nearest_names

#: Every name that is claimed under a hook, with its owners.
Claims = Mapping[Offer, Sequence[Provenance]]


@frozen
class Search:
    """What was asked for: the hook, the name and where in the scene it stands ("" outside a scene)."""

    hook: str
    name: str
    path: str = ""

    @property
    def kind(self) -> str:
        """Return how messages call what was asked for."""
        return "command" if self.hook == COMMAND_HOOK else CATALOGUE[self.hook].kind

    @property
    def offer(self) -> Offer:
        """Return the hook and the name."""
        return (self.hook, self.name)

    @property
    def prefix(self) -> str:
        """Return the place, as messages begin with it."""
        return f"{self.path}: " if self.path else ""


def missing(search: Search, claims: Claims, failures: Iterable[PluginFailure], selection: Selection) -> str:
    """Return the complete answer to a name that no usable plugin offers."""
    kind, name = search.kind, search.name
    installed = {offered: owners for (hook, offered), owners in sorted(claims.items()) if hook == search.hook}
    close = nearest_names(name, installed)
    lines = [
        f"{search.prefix}no {kind} is named {name!r}",
        *([f"nearest: {_listed({offered: installed[offered] for offered in close})}"] if close else []),
        f"{kind}s installed: {_listed(installed) or 'none'}",
        *_of_other_kinds(search, claims),
        *(f"failed: {failure}" for failure in sorted(failures)),
        *_left_out(search, selection),
    ]
    return "\n  ".join(lines)


def contested(search: Search, owners: Collection[Provenance]) -> str:
    """Return the complaint about a name with several owners."""
    ranked = sorted(owners)
    count = "two" if len(ranked) == 2 else str(len(ranked))
    return (
        f"{search.prefix}{count} plugins offer the {search.kind} {search.name!r}: "
        f"{' and '.join(map(str, ranked))}\n  {_way_out(ranked)}"
    )


def unusable(search: Search, failure: PluginFailure) -> str:
    """Return the complaint about a name whose only owner failed."""
    return (
        f"{search.prefix}the {search.kind} {search.name!r} cannot be used, because its plugin failed\n"
        f"  failed: {failure}"
    )


def unknown_plugin(name: str, selection: Selection) -> str:
    """Return the complaint about a name on the allow-list that no distribution offers."""
    known = {source.provenance.plugin for source in (*selection.allowed, *selection.hidden)}
    return f"{selection.rule} names {name!r}, but no installed distribution has such a plugin{nearest(name, known)}"


def _left_out(search: Search, selection: Selection) -> Iterable[str]:
    for source in selection.hidden:
        if source.advertised and (search.hook, search.name) in source.advertised:
            owner = source.provenance
            yield f"{owner} offers it, but {selection.rule} does not allow {owner.plugin}"
    if selection.hidden:
        owners = ", ".join(str(source.provenance) for source in selection.hidden)
        yield f"hidden, because {selection.rule} does not allow them: {owners}"
    yield from (unknown_plugin(name, selection) for name in selection.unknown)


def _of_other_kinds(search: Search, claims: Claims) -> Iterable[str]:
    for (hook, name), owners in sorted(claims.items()):
        if name == search.name and hook not in (search.hook, COMMAND_HOOK):
            yield f"{name!r} is {_one(CATALOGUE[hook].kind)} of {owners[0]}, not {_one(search.kind)}"


def _one(kind: str) -> str:
    return f"{'an' if kind[0] in 'aeiou' else 'a'} {kind}"


def _listed(owners_by_name: Mapping[str, Sequence[Provenance]]) -> str:
    return ", ".join(f"{name} of {' and '.join(map(str, owners))}" for name, owners in owners_by_name.items())


def _way_out(owners: Sequence[Provenance]) -> str:
    registered = [owner.plugin for owner in owners if not owner.distribution]
    if registered:
        return f"leave out {' or '.join(registered)}, which this program registered"
    plugins = sorted({owner.plugin for owner in owners} - set(CORE_PLUGINS))
    if len({owner.plugin for owner in owners}) < len(owners):
        return "uninstall all of them but one"
    without = " or ".join(plugins)
    return f"uninstall all of them but one, or set OPIR_PLUGINS to the plugins to use, without {without}"
