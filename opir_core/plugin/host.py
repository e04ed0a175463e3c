"""The host: which plugins there are, what they offer, and whose each component is.

A host forgives at discovery (a broken plugin is one warning and one row in the catalogue) and insists at resolution: a
component that is asked for and cannot be had is a `PluginError` that says whose it is and what to do. Nothing depends
on the order in which plugins were installed, and there is no host but the ones that are made.
"""

import os
from collections.abc import Container, Iterable
from itertools import count
from types import EllipsisType
from typing import Any, Self, TypeVar, overload

from opir_core.errors import PluginError
from opir_core.plugin import catalogue, error_messages
from opir_core.plugin.components import CATALOGUE, Component, Constellation, PluginFailure, PluginRow, Provenance
from opir_core.plugin.contributions import Contributions
from opir_core.plugin.discovery import Selection, Source, core_sources, installed_sources, selected
from opir_core.plugin.error_messages import Search
from opir_core.plugin.registry import Registry, outcome_of, warn

#: The environment variable that lists the plugins allowed.
ALLOW_VARIABLE = "OPIR_PLUGINS"

Kind = TypeVar("Kind", bound=Component | Constellation)
#: A catalogue hook, by its name or by the class of what it yields.
Hook = str | type[Component] | type[Constellation]


class Host:
    """Plugins and what they offer; make one with `Host.discover()` or `Host.of(...)`."""

    def __init__(self, selection: Selection) -> None:
        self._shelf = Registry(selection)
        self._used: set[Provenance] = set()

    @classmethod
    def discover(cls, allowed: Iterable[str] | EllipsisType | None = ...) -> Self:
        """Return a host of core's own plugins and the installed ones; none of them is imported yet.

        `allowed` are short names of plugins (`["dsp", "kafka"]`; an empty list allows none, None allows all). Left out,
        the environment's `OPIR_PLUGINS=dsp,kafka` says it: set to nothing it allows none, unset it allows all. A name
        that no installed distribution has is logged as a warning and listed in the catalogue.
        """
        rule = "the allow-list"
        if isinstance(allowed, EllipsisType):
            rule, allowed = ALLOW_VARIABLE, os.environ.get(ALLOW_VARIABLE)
        names = allowed.split(",") if isinstance(allowed, str) else allowed
        selection = selected([*core_sources(), *installed_sources()], names, rule)
        for name in selection.unknown:
            warn(error_messages.unknown_plugin(name, selection))
        return cls(selection)

    @classmethod
    def of(cls, *plugins: object) -> Self:
        """Return a host of core's own plugins and the given plugin objects (modules or instances), and no others."""
        host = cls(Selection(core_sources()))
        for plugin in plugins:
            host.register(plugin)
        return host

    def register(self, plugin: object, name: str | None = None) -> None:
        """Take in a plugin object of this program; raise `PluginError` at once if it is not fit.

        Its name, where none is given, is that of the module or class, with a number if that is taken.
        """
        taken = {source.provenance.plugin for source in self._shelf.sources}
        if name in taken:
            raise PluginError(f"a plugin named {name!r} is registered already")
        owner = Provenance(name or _free_name(plugin, taken), "", "")
        source = Source(provenance=owner, load=lambda: plugin)
        outcome = outcome_of(source)
        if isinstance(outcome, PluginFailure):
            raise PluginError(str(outcome))
        self._shelf.add(source, outcome)

    @overload
    def component(self, hook: type[Kind], name: str, path: str = "") -> Kind: ...

    @overload
    def component(self, hook: str, name: str, path: str = "") -> Any: ...

    def component(self, hook: Any, name: str, path: str = "") -> Any:
        """Return the one component of that name; `path` is the place in the scene that names it.

        `hook` is a catalogue hook's name or the class of its components. Raises `PluginError` where no plugin offers
        the name, where several do, and where the one that does failed.
        """
        search = Search(_hook_name(hook), name, path)
        source, offerings = self._resolved(search)
        self._used.add(source.provenance)
        return offerings.components[search.offer]

    def provenance(self, hook: Hook, name: str, path: str = "") -> Provenance:
        """Return whose a component is; raises as `component` does."""
        source, _ = self._resolved(Search(_hook_name(hook), name, path))
        return source.provenance

    def names(self, hook: Hook) -> list[str]:
        """Return the names offered under a hook, sorted; plugins that advertise their names are not imported for it."""
        wanted = _hook_name(hook)
        return sorted({name for offered, name in catalogue.claims(self._shelf) if offered == wanted})

    def catalogue(self) -> list[PluginRow]:
        """Return every plugin with what it offers or why it failed, sorted by name; loads all that are allowed."""
        return catalogue.rows(self._shelf)

    @property
    def failures(self) -> tuple[PluginFailure, ...]:
        """Return why plugins failed, of those loaded so far; sorted."""
        return self._shelf.failures

    def loaded(self) -> tuple[Provenance, ...]:
        """Return the plugins whose code was imported and is fit, sorted: what could have had an effect."""
        return self._shelf.ready

    def used(self) -> tuple[Provenance, ...]:
        """Return the plugins that `component` took something from, sorted: what was chosen."""
        return tuple(sorted(self._used))

    def add_commands(self, commands: Any, name: str | None = None) -> tuple[str, ...]:
        """Let plugins add commands to argparse's object of subparsers; return the names they added, sorted.

        With a name, only plugins that advertise it are loaded, and those that advertise nothing; `PluginError` says
        where two plugins have the command, or where the one that advertises it failed. Without (for help) all plugins
        with commands are loaded, and what fails is a warning.
        """
        from opir_core.plugin.commands import added_commands

        return added_commands(self._shelf, commands, name)

    def _resolved(self, search: Search) -> tuple[Source, Contributions]:
        claimants = self._shelf.claimants(search.offer)
        if len(claimants) > 1:
            raise PluginError(error_messages.contested(search, [source.provenance for source in claimants]))
        if not claimants:
            self._shelf.load_all()
            known = catalogue.claims(self._shelf)
            raise PluginError(error_messages.missing(search, known, self.failures, self._shelf.selection))
        outcome = self._shelf.load(claimants[0])
        if isinstance(outcome, PluginFailure):
            raise PluginError(error_messages.unusable(search, outcome))
        return claimants[0], outcome


def _hook_name(hook: Hook) -> str:
    name = hook if isinstance(hook, str) else hook.hook
    if name not in CATALOGUE:
        raise ValueError(f"{name!r} is not a catalogue hook; those are {', '.join(CATALOGUE)}")
    return name


def _free_name(plugin: object, taken: Container[str]) -> str:
    name = getattr(plugin, "__name__", type(plugin).__name__)
    numbered = (f"{name}-{number}" for number in count(2))
    return name if name not in taken else next(candidate for candidate in numbered if candidate not in taken)
