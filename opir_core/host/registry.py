"""The plugins of one host. Each is loaded at most once, on demand."""

from collections.abc import Iterable
from typing import Any

from attrs import evolve, frozen

from opir_core.host.components import CATALOGUE, PluginFailure, Provenance
from opir_core.host.contributions import Contributions, InvalidPlugin, contributions_of
from opir_core.host.discovery import COMMAND_HOOK, Offer, Selection, Source
from opir_core.host.error_messages import (
    NOT_LISTED,
    NOT_OFFERED,
    described_error,
    stale_plugin,
    unknown_plugin,
)


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

    `state` is "ready", "failed" (`failure` is the reason), "hidden" (excluded by the allow-list,
    not imported) or "unknown" (on the allow-list, but not installed). The `failure` of a ready
    plugin names the components that its installed entry points do not match, and the remedy.
    `requires_core` is the specifier of the versions of opir-core that the plugin requires, "" for
    none. `commands` are those advertised.
    """

    distribution: str
    version: str
    plugin: str
    state: str
    requires_core: str = ""
    components: tuple[ComponentRow, ...] = ()
    commands: tuple[str, ...] = ()
    failure: str = ""


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
        return tuple(
            sorted(
                outcome for outcome in self._outcomes.values() if isinstance(outcome, PluginFailure)
            )
        )

    @property
    def ready(self) -> tuple[Provenance, ...]:
        """Return the plugins that were loaded and did not fail, sorted."""
        outcomes = self._outcomes.items()
        return tuple(
            sorted(
                source.provenance
                for source, outcome in outcomes
                if isinstance(outcome, Contributions)
            )
        )

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
            elif outcome.stale:
                warn(f"{source.provenance}: {stale_plugin(source, outcome.stale)}")
        return self._outcomes[source]

    def fail(self, source: Source, reason: str) -> None:
        """Record the failure of a plugin that was loaded before."""
        failure = PluginFailure(source.provenance, reason)
        self._outcomes[source] = failure
        warn(f"plugin left out: {failure}")

    def load_all(self) -> None:
        """Load every plugin."""
        for source in self._sources:
            self.load(source)

    def claimants(self, offer: Offer) -> tuple[Source, ...]:
        """Return the plugins that advertise or offer a name; plugins that advertise nothing are
        loaded.
        """
        return tuple(source for source in self._sources if offer in self.claims_of(source))

    def claims_of(self, source: Source) -> Iterable[Offer]:
        """Return the names that a plugin advertises or, if it advertises none, those that it
        offers.
        """
        if source.advertised is not None:
            return source.advertised
        outcome = self.load(source)
        return outcome.components if isinstance(outcome, Contributions) else ()

    def stale(self, offer: Offer) -> tuple[Source, str] | None:
        """Return the loaded plugin whose installed entry points differ in a component, and how."""
        return next(
            (
                (source, outcome.stale[offer])
                for source, outcome in self._outcomes.items()
                if isinstance(outcome, Contributions) and offer in outcome.stale
            ),
            None,
        )

    def claims(self) -> dict[Offer, list[Provenance]]:
        """Return every name that a plugin that has not failed advertises or offers, with its
        owners.
        """
        owners: dict[Offer, list[Provenance]] = {}
        for source in self._sources:
            offers = self.claims_of(source)
            if not isinstance(self._outcomes.get(source), PluginFailure):
                for offer in offers:
                    owners.setdefault(offer, []).append(source.provenance)
        return owners

    def rows(self) -> list[PluginRow]:
        """Load every plugin and return a row for each, sorted by name, then the hidden and the
        unknown ones.
        """
        self.load_all()
        owners = self.claims()
        selection = self.selection
        return [
            *(self._row_of(source, owners) for source in self._sources),
            *(
                _row(source.provenance, "hidden", source.requires_core)
                for source in selection.hidden
            ),
            *(
                _row(Provenance(name, "", ""), "unknown", failure=unknown_plugin(name, selection))
                for name in selection.unknown
            ),
        ]

    def _row_of(self, source: Source, owners: dict[Offer, list[Provenance]]) -> PluginRow:
        owner = source.provenance
        outcome = self.load(source)
        if isinstance(outcome, PluginFailure):
            return _row(owner, "failed", source.requires_core, failure=outcome.reason)
        components = tuple(
            ComponentRow(
                hook=hook,
                kind=CATALOGUE[hook].kind,
                name=name,
                summary=component.summary,
                contested_by=tuple(
                    claimant for claimant in owners[hook, name] if claimant != owner
                ),
            )
            for (hook, name), component in sorted(outcome.components.items())
        )
        commands = tuple(
            sorted(name for hook, name in source.advertised or () if hook == COMMAND_HOOK)
        )
        return _row(
            owner,
            "ready",
            source.requires_core,
            components=components,
            commands=commands,
            failure=stale_plugin(source, outcome.stale) if outcome.stale else "",
        )


def warn(message: str) -> None:
    """Log a warning for the user, through the logger `opir`."""
    _logger().warning("%s", message)


def outcome_of(source: Source) -> Contributions | PluginFailure:
    """Import a plugin and return its contributions or its failure."""
    if source.fault:
        return PluginFailure(source.provenance, source.fault)
    try:
        plugin = source.load()
    except (Exception, SystemExit) as error:
        return _failure(source, f"cannot be imported: {described_error(error)}", error)
    try:
        return _as_advertised(source, contributions_of(plugin))
    except InvalidPlugin as invalid:
        return _failure(source, str(invalid), invalid)
    except Exception as error:
        return _failure(source, f"cannot be examined: {described_error(error)}", error)


def _logger() -> Any:
    from logging import getLogger

    return getLogger("opir")


def _failure(source: Source, reason: str, error: BaseException) -> PluginFailure:
    _logger().debug("%s", source.provenance, exc_info=error)
    return PluginFailure(source.provenance, reason)


def _as_advertised(source: Source, contributions: Contributions) -> Contributions:
    """Return the contributions with the components that the plugin's installed entry points list.

    The others, and those that are listed and not offered, are stale; so are all commands of a
    plugin that adds some and lists none.
    """
    if source.advertised is None:
        return contributions
    listed = {offer for offer in source.advertised if offer[0] != COMMAND_HOOK}
    offered = set(contributions.components)
    lists_commands = len(listed) < len(source.advertised)
    commands = {(COMMAND_HOOK, "*")} if contributions.add_commands and not lists_commands else set()
    stale = {
        **dict.fromkeys(sorted(offered - listed), NOT_LISTED),
        **dict.fromkeys(sorted(listed - offered), NOT_OFFERED),
        **dict.fromkeys(commands, NOT_LISTED),
    }
    components = {
        offer: component for offer, component in contributions.components.items() if offer in listed
    }
    return evolve(contributions, components=components, stale=stale)


def _row(owner: Provenance, state: str, requires_core: str = "", **more: Any) -> PluginRow:
    return PluginRow(
        distribution=owner.distribution,
        version=owner.version,
        plugin=owner.plugin,
        state=state,
        requires_core=requires_core,
        **more,
    )
