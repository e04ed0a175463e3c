"""Whose a component is, and whose fault a failure is."""

from attrs import frozen


@frozen(order=True)
class Provenance:
    """The owner of a component: a plugin's short name and the distribution that brought it.

    `distribution` and `version` are "" for a plugin object that was registered by the running program.
    """

    plugin: str
    distribution: str
    version: str

    def __str__(self) -> str:
        """Return the owner as messages call it, `opir-dsp 0.1.0 (plugin dsp)`."""
        if not self.distribution:
            return f"plugin {self.plugin} (registered by this program)"
        owner = f"{self.distribution} {self.version or '(version unknown)'}"
        return f"{owner} (plugin {self.plugin})" if self.plugin else owner


@frozen(order=True)
class PluginFailure:
    """A plugin that cannot be used, and why; none of its components is offered."""

    plugin: str
    distribution: str
    version: str
    reason: str

    @classmethod
    def of(cls, owner: Provenance, reason: str) -> "PluginFailure":
        """Return the failure of an owner."""
        return cls(owner.plugin, owner.distribution, owner.version, reason)

    @property
    def provenance(self) -> Provenance:
        """Return whose failure it is."""
        return Provenance(self.plugin, self.distribution, self.version)

    def __str__(self) -> str:
        """Return the failure as one line."""
        return f"{self.provenance}: {self.reason}"


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

    `state` is "ready", "failed" (`failure` says why), "hidden" (the allow-list leaves it out, so it was not imported)
    or "unknown" (the allow-list names it and no installed distribution offers it). `api` is the range of plugin
    interfaces that it declares, "" for none. `commands` are those advertised.
    """

    distribution: str
    version: str
    plugin: str
    state: str
    api: str = ""
    components: tuple[ComponentRow, ...] = ()
    commands: tuple[str, ...] = ()
    failure: str = ""
