"""The commands that plugins add to the command line, each with its owner."""

from argparse import ArgumentParser
from collections.abc import Collection
from typing import Any

from opir_core.errors import PluginError
from opir_core.host import error_messages
from opir_core.host.components import Provenance
from opir_core.host.contributions import Contributions, InvalidPlugin
from opir_core.host.discovery import COMMAND_HOOK, Source
from opir_core.host.error_messages import NOT_LISTED, NOT_OFFERED, Search, described_error
from opir_core.host.host import Host
from opir_core.host.registry import Registry, warn

#: The owners of every command that plugins have added.
Owners = dict[str, list[Provenance]]


class OwnedSubparsers:
    """argparse's subparsers object for one plugin; records the owner of each command that is added.

    The plugin gets an unused parser for a command that another plugin has added, and for one that
    its installed entry points do not list; a request for the command is an error with the owners.
    """

    def __init__(
        self, commands: Any, core: Collection[str], owners: Owners, source: Source
    ) -> None:
        self._commands = commands
        self._core = core
        self._owners = owners
        self._owner = source.provenance
        self._listed = _advertised_commands(source)
        self.added = set[str]()

    def add_parser(self, name: str, **keywords: Any) -> ArgumentParser:
        """Add a command, as argparse's `add_parser` does; `help` is its description too, unless it
        has one.
        """
        names = [name, *keywords.get("aliases", ())]
        for spelling in names:
            if spelling in self._core:
                raise InvalidPlugin(
                    f"{COMMAND_HOOK} adds the command {spelling!r}, which is a command of opir"
                    f" itself"
                )
            if spelling in self.added:
                raise InvalidPlugin(f"{COMMAND_HOOK} adds the command {spelling!r} twice")
        self.added.update(names)
        if self._listed is not None and name not in self._listed:
            return ArgumentParser(prog=name)
        if summary := keywords.get("help"):
            keywords.setdefault("description", f"{summary[0].upper()}{summary[1:]}.")
        contested = any(spelling in self._owners for spelling in names)
        for spelling in names:
            self._owners.setdefault(spelling, []).append(self._owner)
        return (
            ArgumentParser(prog=name) if contested else self._commands.add_parser(name, **keywords)
        )

    def stale(self) -> dict[str, str]:
        """Return the commands in which the plugin and its installed entry points differ, and how.

        Aliases need not be listed.
        """
        if self._listed is None:
            return {}
        listed_aliases = {name for name in self.added if self._owner in self._owners.get(name, ())}
        return {
            **dict.fromkeys(sorted(self.added - self._listed - listed_aliases), NOT_LISTED),
            **dict.fromkeys(sorted(self._listed - self.added), NOT_OFFERED),
        }

    def __getattr__(self, name: str) -> Any:
        return getattr(self._commands, name)


def added_commands(host: Host, commands: Any, name: str | None = None) -> tuple[str, ...]:
    """Let plugins add commands to argparse's subparsers object; return the names of those added,
    sorted.

    With a name, only the plugins that advertise it and those that advertise nothing are loaded;
    raises `PluginError` if the command has two owners or cannot be used. Without (for help) all
    plugins with commands are loaded, and failures are warnings.
    """
    registry = host.registry
    core = frozenset(commands.choices)
    owners: Owners = {}
    if name is not None:
        _require_one_owner(registry, name, owners)
    for source in registry.sources:
        if _may_have(source, name):
            parsers = OwnedSubparsers(commands, core, owners, source)
            _report_stale(source, _let_add(registry, source, parsers), name)
    if name is not None:
        _require_one_owner(registry, name, owners)
    else:
        _warn_of_contested(owners)
    return tuple(sorted(owners))


def add_commands(commands: Any, name: str | None) -> None:
    """Add the command of a name, or all commands of plugins without one or if nobody has it:
    argparse lists them.
    """
    added = added_commands(Host.discover(), commands, name)
    if name is not None and not added:
        require_installed(name)
        added_commands(Host.discover(), commands)


def require_installed(name: str) -> None:
    """Raise `PluginError` if a package of this project that is not installed provides the
    command.
    """
    remedy = list(error_messages.installable(Search(COMMAND_HOOK, name)))
    if remedy:
        raise PluginError("\n  ".join([f"no command is named {name!r}", *remedy]))


def _advertised_commands(source: Source) -> set[str] | None:
    """Return the commands that a plugin advertises; None if it advertises nothing."""
    if source.advertised is None:
        return None
    return {command for hook, command in source.advertised if hook == COMMAND_HOOK}


def _may_have(source: Source, name: str | None) -> bool:
    advertised = _advertised_commands(source)
    if advertised is None:
        return True
    return bool(advertised) if name is None else name in advertised


def _let_add(registry: Registry, source: Source, commands: OwnedSubparsers) -> dict[str, str]:
    """Let a plugin add its commands; return those that are stale, none if the plugin fails."""
    contributions = registry.load(source)
    if not isinstance(contributions, Contributions):
        return {}
    try:
        for add in contributions.add_commands:
            add(commands)
    except InvalidPlugin as invalid:
        registry.fail(source, str(invalid))
    except (Exception, SystemExit) as error:
        registry.fail(source, f"{COMMAND_HOOK} raised {described_error(error)}")
    else:
        return commands.stale()
    return {}


def _report_stale(source: Source, differences: dict[str, str], name: str | None) -> None:
    """Raise `PluginError` if a requested command is stale; without a request, warn of each."""
    for command, difference in differences.items():
        message = error_messages.stale(Search(COMMAND_HOOK, command), source, difference)
        if command == name:
            raise PluginError(message)
        if name is None:
            warn(message)


def _require_one_owner(registry: Registry, name: str, owners: Owners) -> None:
    search = Search(COMMAND_HOOK, name)
    advertisers = {
        source.provenance
        for source in registry.sources
        if search.offer in (source.advertised or ())
    }
    claimants = advertisers.union(owners.get(name, ()))
    if len(claimants) > 1:
        raise PluginError(error_messages.contested(search, claimants))
    for failure in registry.failures:
        if failure.provenance in claimants:
            raise PluginError(error_messages.unusable(search, failure))


def _warn_of_contested(owners: Owners) -> None:
    for name in sorted(owners):
        if len(set(owners[name])) > 1:
            warn(error_messages.contested(Search(COMMAND_HOOK, name), set(owners[name])))
