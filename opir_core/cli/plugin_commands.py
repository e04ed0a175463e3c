"""The commands that plugins add to the command line, each with its owner."""

from argparse import ArgumentParser
from collections.abc import Collection
from typing import Any

from opir_core.errors import PluginError
from opir_core.host import error_messages
from opir_core.host.components import Provenance
from opir_core.host.contributions import Contributions, InvalidPlugin
from opir_core.host.discovery import COMMAND_HOOK, Source
from opir_core.host.error_messages import Search, described_error
from opir_core.host.host import Host
from opir_core.host.registry import Registry, warn

#: The owners of every command that plugins have added.
Owners = dict[str, list[Provenance]]


class OwnedSubparsers:
    """argparse's subparsers object for one plugin; records the owner of each command that is added.

    A command that another plugin has added is not added again: the plugin gets an unused parser,
    and a request for the command is an error that names both owners.
    """

    def __init__(
        self, commands: Any, core: Collection[str], owner: Provenance, owners: Owners
    ) -> None:
        self._commands = commands
        self._core = core
        self._owner = owner
        self._owners = owners
        self.added: list[str] = []

    def add_parser(self, name: str, **keywords: Any) -> ArgumentParser:
        """Add a command, as argparse's `add_parser` does; `help` is its description too, unless it
        has one.
        """
        names = [name, *keywords.get("aliases", ())]
        for known in names:
            if known in self._core:
                raise InvalidPlugin(
                    f"{COMMAND_HOOK} adds the command {known!r}, which is a command of opir itself"
                )
            if self._owner in self._owners.get(known, ()):
                raise InvalidPlugin(f"{COMMAND_HOOK} adds the command {known!r} twice")
        if summary := keywords.get("help"):
            keywords.setdefault("description", f"{summary[0].upper()}{summary[1:]}.")
        contested = any(known in self._owners for known in names)
        parser = (
            ArgumentParser(prog=name) if contested else self._commands.add_parser(name, **keywords)
        )
        for known in names:
            self._owners.setdefault(known, []).append(self._owner)
        self.added.append(name)
        return parser

    def __getattr__(self, name: str) -> Any:
        return getattr(self._commands, name)


def added_commands(host: Host, commands: Any, name: str | None = None) -> tuple[str, ...]:
    """Let plugins add commands to argparse's subparsers object; return the names of those added,
    sorted.

    With a name, only the plugins that advertise it and those that advertise nothing are loaded;
    raises `PluginError` if the command has two owners or its owner failed. Without (for help) all
    plugins with commands are loaded, and failures are warnings.
    """
    registry = host.registry
    core = frozenset(commands.choices)
    owners: Owners = {}
    if name is not None:
        _require_one_owner(registry, name, owners)
    for source in registry.sources:
        if _may_have(source, name):
            _let_add(registry, source, OwnedSubparsers(commands, core, source.provenance, owners))
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


def _may_have(source: Source, name: str | None) -> bool:
    if source.advertised is None:
        return True
    return any(
        hook == COMMAND_HOOK and name in (None, command) for hook, command in source.advertised
    )


def _let_add(registry: Registry, source: Source, commands: OwnedSubparsers) -> None:
    contributions = registry.load(source)
    if not isinstance(contributions, Contributions):
        return
    try:
        for add in contributions.add_commands:
            add(commands)
        _require_advertised(source, commands.added)
    except InvalidPlugin as invalid:
        registry.fail(source, str(invalid))
    except (Exception, SystemExit) as error:
        registry.fail(source, f"{COMMAND_HOOK} raised {described_error(error)}")


def _require_advertised(source: Source, added: Collection[str]) -> None:
    if source.advertised is None:
        return
    advertised = {command for hook, command in source.advertised if hook == COMMAND_HOOK}
    if advertised != set(added):
        listed = ", ".join(sorted(advertised))
        made = ", ".join(sorted(added)) or "none"
        raise InvalidPlugin(
            f"its entry points in group opir.components advertise the commands {listed}; it adds"
            f" {made}"
        )


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
