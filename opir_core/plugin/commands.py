"""Commands that plugins add to the command line, each with its owner."""

from argparse import ArgumentParser
from collections.abc import Collection
from typing import Any

from opir_core.errors import PluginError
from opir_core.plugin import error_messages
from opir_core.plugin.components import Provenance
from opir_core.plugin.contributions import Contributions
from opir_core.plugin.discovery import COMMAND_HOOK, Source
from opir_core.plugin.error_messages import Search
from opir_core.plugin.registry import Registry, warn
from opir_core.plugin.validation import InvalidPlugin, described_error

#: The owners of every command that plugins have added.
Owners = dict[str, list[Provenance]]


class CommandDesk:
    """argparse's object of subparsers as one plugin sees it: what is added is noted in `owners`.

    A command that another plugin has added is not added again: the plugin gets a parser that nothing leads to, and
    whoever asks for the command hears of both.
    """

    def __init__(self, commands: Any, core: Collection[str], owner: Provenance, owners: Owners) -> None:
        self._commands = commands
        self._core = core
        self._owner = owner
        self._owners = owners
        self.added: list[str] = []

    def add_parser(self, name: str, **keywords: Any) -> ArgumentParser:
        """Add a command, as argparse's `add_parser` does."""
        names = [name, *keywords.get("aliases", ())]
        for known in names:
            if known in self._core:
                raise InvalidPlugin(f"{COMMAND_HOOK} adds the command {known!r}, which opir has itself")
            if self._owner in self._owners.get(known, ()):
                raise InvalidPlugin(f"{COMMAND_HOOK} adds the command {known!r} twice")
        contested = any(known in self._owners for known in names)
        parser = ArgumentParser(prog=name) if contested else self._commands.add_parser(name, **keywords)
        for known in names:
            self._owners.setdefault(known, []).append(self._owner)
        self.added.append(name)
        return parser

    def __getattr__(self, name: str) -> Any:
        return getattr(self._commands, name)


def added_commands(shelf: Registry, commands: Any, name: str | None = None) -> tuple[str, ...]:
    """Let the plugins that may have the command `name` (None: any command) add to `commands`; return what they added.

    Raises `PluginError` where `name` has two owners or its owner failed; without a name these are warnings.
    """
    core = frozenset(commands.choices)
    owners: Owners = {}
    if name is not None:
        _insist_on(shelf, name, owners)
    for source in shelf.sources:
        if _may_have(source, name):
            _let_add(shelf, source, CommandDesk(commands, core, source.provenance, owners))
    if name is not None:
        _insist_on(shelf, name, owners)
    else:
        _warn_of_contested(owners)
    return tuple(sorted(owners))


def _may_have(source: Source, name: str | None) -> bool:
    if source.advertised is None:
        return True
    return any(hook == COMMAND_HOOK and name in (None, command) for hook, command in source.advertised)


def _let_add(shelf: Registry, source: Source, desk: CommandDesk) -> None:
    offerings = shelf.load(source)
    if not isinstance(offerings, Contributions):
        return
    try:
        for add in offerings.add_commands:
            add(desk)
        _insist_on_advertised(source, desk.added)
    except InvalidPlugin as verdict:
        shelf.fail(source, str(verdict))
    except (Exception, SystemExit) as error:
        shelf.fail(source, f"{COMMAND_HOOK} raised {described_error(error)}")


def _insist_on_advertised(source: Source, added: Collection[str]) -> None:
    if source.advertised is None:
        return
    advertised = {command for hook, command in source.advertised if hook == COMMAND_HOOK}
    if advertised != set(added):
        listed, made = ", ".join(sorted(advertised)), ", ".join(sorted(added)) or "none"
        raise InvalidPlugin(
            f"its entry points in group opir.components advertise the commands {listed}; it adds {made}"
        )


def _insist_on(shelf: Registry, name: str, owners: Owners) -> None:
    search = Search(COMMAND_HOOK, name)
    advertisers = {source.provenance for source in shelf.sources if search.offer in (source.advertised or ())}
    claimants = advertisers.union(owners.get(name, ()))
    if len(claimants) > 1:
        raise PluginError(error_messages.contested(search, claimants))
    for failure in shelf.failures:
        if failure.provenance in claimants:
            raise PluginError(error_messages.unusable(search, failure))


def _warn_of_contested(owners: Owners) -> None:
    for name in sorted(owners):
        if len(set(owners[name])) > 1:
            warn(error_messages.contested(Search(COMMAND_HOOK, name), set(owners[name])))
