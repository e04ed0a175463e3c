"""The host: the plugins, their components and the owner of each.

Discovery is tolerant: a broken plugin is one warning and one row in the catalogue. Resolution is
strict: a requested component that cannot be used is a `PluginError` with the owner and the remedy.
The order of installation has no effect, and there is no global host.
"""

import os
from collections.abc import Container, Iterable
from contextlib import suppress
from itertools import count
from types import EllipsisType
from typing import Any, Self, TypeVar, overload

from opir_core.errors import PluginError, number_of
from opir_core.host import error_messages
from opir_core.host.components import CATALOGUE, FileReader, Offered, PluginFailure, Provenance
from opir_core.host.contributions import Contributions
from opir_core.host.discovery import Selection, Source, core_sources, installed_sources, selected
from opir_core.host.error_messages import Search
from opir_core.host.registry import PluginRow, Registry, outcome_of, warn
from opir_core.notebook import html_view

#: The environment variable that lists the plugins allowed.
ALLOW_VARIABLE = "OPIR_PLUGINS"

Kind = TypeVar("Kind", bound=Offered)
#: A catalogue hook, by its name or by the class of what it yields.
Hook = str | type[Offered]


class Host:
    """The plugins and their components; made by `Host.discover()` or `Host.of(...)`."""

    def __init__(self, selection: Selection) -> None:
        self.registry = Registry(selection)
        self._used: set[Provenance] = set()

    @classmethod
    def discover(cls, allowed: Iterable[str] | EllipsisType | None = ...) -> Self:
        """Return a host of the core's own plugins and the installed ones; none is imported yet.

        `allowed` are short names of plugins (`["dsp", "kafka"]`; an empty list allows none, None
        allows all). By default the environment variable `OPIR_PLUGINS=dsp,kafka` gives them: empty
        allows none, unset allows all. A name that is not installed is logged as a warning and
        listed in the catalogue.
        """
        rule = "the allow-list"
        if isinstance(allowed, EllipsisType):
            rule = ALLOW_VARIABLE
            allowed = os.environ.get(ALLOW_VARIABLE)
        names = allowed.split(",") if isinstance(allowed, str) else allowed
        selection = selected([*core_sources(), *installed_sources()], names, rule)
        for name in selection.unknown:
            warn(error_messages.unknown_plugin(name, selection))
        return cls(selection)

    def __repr__(self) -> str:
        """Return the number of plugins, in one line."""
        return f"<Host: {number_of('plugin', len(self.registry.sources))}>"

    def _repr_html_(self) -> str:
        """Return the plugins for a notebook."""
        plugins = [source.provenance for source in self.registry.sources]
        rows = [(plugin.plugin, plugin.distribution, plugin.version) for plugin in plugins]
        return html_view(self, ("plugin", "distribution", "version"), rows, len(rows))

    @classmethod
    def of(cls, *plugins: object) -> Self:
        """Return a host of the core's own plugins and the given plugin objects (modules or
        instances) only.
        """
        host = cls(Selection(core_sources()))
        for plugin in plugins:
            host.register(plugin)
        return host

    def register(self, plugin: object, name: str | None = None) -> None:
        """Add a plugin object of this program; raises `PluginError` if it is invalid.

        The default name is that of the module or class, with a number if that is taken.
        """
        taken = {source.provenance.plugin for source in self.registry.sources}
        if name in taken:
            raise PluginError(f"a plugin named {name!r} is registered already")
        owner = Provenance(name or _free_name(plugin, taken), "", "")
        source = Source(provenance=owner, load=lambda: plugin)
        outcome = outcome_of(source)
        if isinstance(outcome, PluginFailure):
            raise PluginError(str(outcome))
        self.registry.add(source, outcome)

    @overload
    def component(self, hook: type[Kind], name: str, path: str = "") -> Kind: ...

    @overload
    def component(self, hook: str, name: str, path: str = "") -> Any: ...

    def component(self, hook: Any, name: str, path: str = "") -> Any:
        """Return the component of a name; `path` is the path in the scene that names it.

        `hook` is a catalogue hook's name or the class of its components. Raises `PluginError` if no
        plugin offers the name, if several do, or if its plugin failed.
        """
        search = Search(_hook_name(hook), name, path)
        source, contributions = self._resolved(search)
        self._used.add(source.provenance)
        return contributions.components[search.offer]

    def provenance(self, hook: Hook, name: str, path: str = "") -> Provenance:
        """Return the owner of a component; raises as `component` does."""
        source, _ = self._resolved(Search(_hook_name(hook), name, path))
        return source.provenance

    def names(self, hook: Hook) -> list[str]:
        """Return the names offered under a hook, sorted; plugins that advertise their names are not
        imported.
        """
        hook_name = _hook_name(hook)
        return sorted({name for offered, name in self.registry.claims() if offered == hook_name})

    def readers(self) -> list[FileReader]:
        """Return the readers of files that can be used, sorted by name; one whose plugin fails
        costs itself.
        """
        readers = []
        for name in self.names(FileReader.hook):
            with suppress(PluginError):
                readers.append(self.component(FileReader, name))
        return readers

    def catalogue(self) -> list[PluginRow]:
        """Return a row for every plugin, sorted by name; loads all that are allowed."""
        return self.registry.rows()

    @property
    def failures(self) -> tuple[PluginFailure, ...]:
        """Return the failures of the plugins loaded so far, sorted."""
        return self.registry.failures

    def loaded(self) -> tuple[Provenance, ...]:
        """Return the plugins that were imported and did not fail, sorted."""
        return self.registry.ready

    def used(self) -> tuple[Provenance, ...]:
        """Return the plugins whose components were requested, sorted."""
        return tuple(sorted(self._used))

    def _resolved(self, search: Search) -> tuple[Source, Contributions]:
        claimants = self.registry.claimants(search.offer)
        if len(claimants) > 1:
            raise PluginError(
                error_messages.contested(search, [source.provenance for source in claimants])
            )
        if not claimants:
            self.registry.load_all()
            self._require_installed(search)
            claims = self.registry.claims()
            raise PluginError(
                error_messages.missing(search, claims, self.failures, self.registry.selection)
            )
        outcome = self.registry.load(claimants[0])
        if isinstance(outcome, PluginFailure):
            raise PluginError(error_messages.unusable(search, outcome))
        self._require_installed(search)
        return claimants[0], outcome

    def _require_installed(self, search: Search) -> None:
        if difference := self.registry.stale(search.offer):
            raise PluginError(error_messages.stale(search, *difference))


def _hook_name(hook: Hook) -> str:
    name = hook if isinstance(hook, str) else hook.hook
    if name not in CATALOGUE:
        raise ValueError(f"{name!r} is not a catalogue hook; those are {', '.join(CATALOGUE)}")
    return name


def _free_name(plugin: object, taken: Container[str]) -> str:
    name = getattr(plugin, "__name__", type(plugin).__name__)
    numbered = (f"{name}-{number}" for number in count(2))
    return (
        name
        if name not in taken
        else next(candidate for candidate in numbered if candidate not in taken)
    )
