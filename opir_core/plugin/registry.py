"""The plugins of one host: each loaded at most once, and only when it has to be."""

from collections.abc import Iterable

from opir_core.plugin.components import PluginFailure, Provenance
from opir_core.plugin.contributions import Contributions, contributions_of
from opir_core.plugin.discovery import COMMAND_HOOK, Offer, Selection, Source
from opir_core.plugin.validation import InvalidPlugin, described_error


class Registry:
    """Plugins in the order of their names, and what became of those that were loaded."""

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
        """Return why plugins failed, of those that were loaded; sorted."""
        return tuple(sorted(outcome for outcome in self._outcomes.values() if isinstance(outcome, PluginFailure)))

    def has_failed(self, source: Source) -> bool:
        """Return whether a plugin was loaded and found unfit."""
        return isinstance(self._outcomes.get(source), PluginFailure)

    @property
    def ready(self) -> tuple[Provenance, ...]:
        """Return the plugins that were loaded and are fit, sorted."""
        fit = (source for source, outcome in self._outcomes.items() if isinstance(outcome, Contributions))
        return tuple(sorted(source.provenance for source in fit))

    def add(self, source: Source, offerings: Contributions) -> None:
        """Put a plugin on the shelf, with what it offers."""
        self._outcomes[source] = offerings
        self._sources = sorted([*self._sources, source], key=lambda item: item.provenance)

    def load(self, source: Source) -> Contributions | PluginFailure:
        """Return what a plugin offers, or why it cannot be used; a failure is logged when it is found."""
        if source not in self._outcomes:
            outcome = outcome_of(source)
            self._outcomes[source] = outcome
            if isinstance(outcome, PluginFailure):
                warn(f"plugin left out: {outcome}")
        return self._outcomes[source]

    def fail(self, source: Source, reason: str) -> PluginFailure:
        """Note that a plugin failed after it was loaded, and return the failure."""
        failure = PluginFailure.of(source.provenance, reason)
        self._outcomes[source] = failure
        warn(f"plugin left out: {failure}")
        return failure

    def load_all(self) -> None:
        """Load every plugin."""
        for source in self._sources:
            self.load(source)

    def claimants(self, offer: Offer) -> tuple[Source, ...]:
        """Return the plugins that advertise or offer a name; plugins that advertise nothing are loaded to find out."""
        return tuple(source for source in self._sources if offer in self.claims_of(source))

    def claims_of(self, source: Source) -> Iterable[Offer]:
        """Return what a plugin advertises or, where it advertises nothing, what it offers."""
        if source.advertised is not None:
            return source.advertised
        outcome = self.load(source)
        return outcome.components if isinstance(outcome, Contributions) else ()


def warn(message: str) -> None:
    """Log a warning for the user, through the logger `opir`."""
    from logging import getLogger

    getLogger("opir").warning("%s", message)


def outcome_of(source: Source) -> Contributions | PluginFailure:
    """Import a plugin and return what it offers, or why it cannot be used."""
    if source.fault:
        return PluginFailure.of(source.provenance, source.fault)
    try:
        plugin = source.load()
    except (Exception, SystemExit) as error:
        return _failure(source, f"cannot be imported: {described_error(error)}", error)
    try:
        offerings = contributions_of(plugin)
        _insist_on_advertised(source, offerings)
    except InvalidPlugin as verdict:
        return _failure(source, str(verdict), verdict)
    except Exception as error:
        return _failure(source, f"cannot be examined: {described_error(error)}", error)
    return offerings


def _failure(source: Source, reason: str, error: BaseException) -> PluginFailure:
    from logging import getLogger

    getLogger("opir").debug("%s", source.provenance, exc_info=error)
    return PluginFailure.of(source.provenance, reason)


def _insist_on_advertised(source: Source, offerings: Contributions) -> None:
    if source.advertised is None:
        return
    advertised = {offer for offer in source.advertised if offer[0] != COMMAND_HOOK}
    offered = set(offerings.components)
    complaints = [
        *(f"advertises {_entry(offer)} and does not offer it" for offer in sorted(advertised - offered)),
        *(f"offers {_entry(offer)} and does not advertise it" for offer in sorted(offered - advertised)),
    ]
    names_commands = len(advertised) < len(source.advertised)
    if names_commands and not offerings.add_commands:
        complaints.append(f"advertises commands and has no {COMMAND_HOOK}")
    if offerings.add_commands and not names_commands:
        complaints.append(f"has {COMMAND_HOOK} and advertises no command")
    if complaints:
        raise InvalidPlugin(
            f"its entry points in group opir.components are not what it offers: {'; '.join(complaints)}"
        )


def _entry(offer: Offer) -> str:
    return f"{offer[0].removeprefix('opir_')}.{offer[1]}"
