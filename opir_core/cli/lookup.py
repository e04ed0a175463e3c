"""Components by name alone, of whatever kind: what `opir describe NAME` and `opir check NAME` mean."""

from collections.abc import Sequence

from attrs import frozen

from opir_core.errors import PluginError
from opir_core.plugin.components import CATALOGUE, Component, Constellation, Provenance
from opir_core.plugin.host import Host
from opir_core.plugin.validation import nearest_names

#: The hooks by what the command line calls their kinds: `sensor-model`, `tracker`.
HOOK_BY_KIND = {kind.kind.replace(" ", "-"): hook for hook, kind in CATALOGUE.items()}


@frozen
class Owned:
    """A component and whose it is."""

    component: Component | Constellation
    owner: Provenance


def components_named(host: Host, name: str, kind: str | None = None) -> Sequence[Owned]:
    """Return all components of a name, of one kind if it is given, by kind.

    Raises `PluginError` where there is none, or where the plugin of one cannot be used.
    """
    hooks = list(CATALOGUE) if kind is None else [HOOK_BY_KIND[kind]]
    if kind is not None:
        return [_owned(host, hooks[0], name)]
    found = [_owned(host, hook, name) for hook in hooks if name in host.names(hook)]
    if not found:
        raise PluginError(_unknown(host, name))
    return found


def _owned(host: Host, hook: str, name: str) -> Owned:
    return Owned(host.component(hook, name), host.provenance(hook, name))


def _unknown(host: Host, name: str) -> str:
    known = {offered for hook in CATALOGUE for offered in host.names(hook)}
    close = nearest_names(name, known)
    host.catalogue()
    lines = [
        f"no component is named {name!r}",
        *([f"nearest: {', '.join(close)}"] if close else []),
        *(f"failed: {failure}" for failure in host.failures),
        "opir plugins lists what is installed",
    ]
    return "\n  ".join(lines)
