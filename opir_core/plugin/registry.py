"""The plugins of one host. Each is loaded at most once, on demand."""

from collections.abc import Iterable
from typing import Any

from opir_core.plugin.components import PluginFailure, Provenance
from opir_core.plugin.contributions import Contributions, InvalidPlugin, contributions_of
from opir_core.plugin.discovery import COMMAND_HOOK, Offer, Selection, Source
from opir_core.plugin.error_messages import described_error


class Registry:
    """The plugins, sorted by name, and the contributions or the failure of each that was loaded."""

    def __init__(self, selection: Selection) -> None:
        self.selection = selection
        self._sources = sorted(selection.allowed, key=lambda source: source.provenance)
        self._outcomes: dict[Source, Contributions | PluginFailure] = {}

    @property
    def sources(self) -> tuple[Source, ...]:
        """Return every plugin, sorted by name."""
        return tuple(self._sources)

    @property
    def failures(self) -> tuple[PluginFailure, ...]:
        """Return the failures of the loaded plugins, sorted."""
        return tuple(sorted(outcome for outcome in self._outcomes.values() if isinstance(outcome, PluginFailure)))

    def has_failed(self, source: Source) -> bool:
        """Return whether a plugin was loaded and failed."""
        return isinstance(self._outcomes.get(source), PluginFailure)

    @property
    def ready(self) -> tuple[Provenance, ...]:
        """Return the plugins that were loaded and did not fail, sorted."""
        ready = (source for source, outcome in self._outcomes.items() if isinstance(outcome, Contributions))
        return tuple(sorted(source.provenance for source in ready))

    def add(self, source: Source, contributions: Contributions) -> None:
        """Add a plugin with its contributions."""
        self._outcomes[source] = contributions
        self._sources = sorted([*self._sources, source], key=lambda item: item.provenance)

    def load(self, source: Source) -> Contributions | PluginFailure:
        """Return the contributions of a plugin, or its failure; a failure is logged once."""
        if source not in self._outcomes:
            outcome = outcome_of(source)
            self._outcomes[source] = outcome
            if isinstance(outcome, PluginFailure):
                warn(f"plugin left out: {outcome}")
        return self._outcomes[source]

    def fail(self, source: Source, reason: str) -> PluginFailure:
        """Record and return the failure of a plugin that was loaded before."""
        failure = PluginFailure.of(source.provenance, reason)
        self._outcomes[source] = failure
        warn(f"plugin left out: {failure}")
        return failure

    def load_all(self) -> None:
        """Load every plugin."""
        for source in self._sources:
            self.load(source)

    def claimants(self, offer: Offer) -> tuple[Source, ...]:
        """Return the plugins that advertise or offer a name; plugins that advertise nothing are loaded."""
        return tuple(source for source in self._sources if offer in self.claims_of(source))

    def claims_of(self, source: Source) -> Iterable[Offer]:
        """Return the names that a plugin advertises or, if it advertises none, those that it offers."""
        if source.advertised is not None:
            return source.advertised
        outcome = self.load(source)
        return outcome.components if isinstance(outcome, Contributions) else ()


def warn(message: str) -> None:
    """Log a warning for the user, through the logger `opir`."""
    _logger().warning("%s", message)


def outcome_of(source: Source) -> Contributions | PluginFailure:
    """Import a plugin and return its contributions or its failure."""
    if source.fault:
        return PluginFailure.of(source.provenance, source.fault)
    try:
        plugin = source.load()
    except (Exception, SystemExit) as error:
        return _failure(source, f"cannot be imported: {described_error(error)}", error)
    try:
        contributions = contributions_of(plugin)
        _require_advertised(source, contributions)
    except InvalidPlugin as invalid:
        return _failure(source, str(invalid), invalid)
    except Exception as error:
        return _failure(source, f"cannot be examined: {described_error(error)}", error)
    return contributions


def _logger() -> Any:
    from logging import getLogger

    return getLogger("opir")


def _failure(source: Source, reason: str, error: BaseException) -> PluginFailure:
    _logger().debug("%s", source.provenance, exc_info=error)
    return PluginFailure.of(source.provenance, reason)


def _require_advertised(source: Source, contributions: Contributions) -> None:
    if source.advertised is None:
        return
    advertised = {offer for offer in source.advertised if offer[0] != COMMAND_HOOK}
    offered = set(contributions.components)
    differences = [
        *(f"advertises {_entry(offer)} and does not offer it" for offer in sorted(advertised - offered)),
        *(f"offers {_entry(offer)} and does not advertise it" for offer in sorted(offered - advertised)),
    ]
    names_commands = len(advertised) < len(source.advertised)
    if names_commands and not contributions.add_commands:
        differences.append(f"advertises commands and has no {COMMAND_HOOK}")
    if contributions.add_commands and not names_commands:
        differences.append(f"has {COMMAND_HOOK} and advertises no command")
    if differences:
        raise InvalidPlugin(
            f"its entry points in group opir.components differ from what it offers: {'; '.join(differences)}"
        )


def _entry(offer: Offer) -> str:
    return f"{offer[0].removeprefix('opir_')}.{offer[1]}"
