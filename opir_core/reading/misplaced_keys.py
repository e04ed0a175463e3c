"""Where a key that is unknown in its block belongs; looked up only for error messages."""

from collections.abc import Iterator, Mapping, Sequence
from functools import cache

from attrs import fields, frozen

from opir_core.errors import PluginError
from opir_core.host.components import CATALOGUE, Component
from opir_core.host.host import Host
from opir_core.reading.scene_schema import CHOICES, SceneFile
from opir_core.scene.field_rows import field_rows

#: Maximum number of models that one message names.
_MOST_NAMED = 5

#: The block of a scene that components of each kind are set in.
_BLOCKS: Mapping[str, str] = {
    **{hook: key for key, (hook, _) in CHOICES.items()},
    "opir_sensor_models": "sensors",
    "opir_target_models": "targets",
    "opir_signature_models": "a target's signature",
    "opir_source_models": "sources",
    "opir_sinks": "outputs",
}


@frozen
class Owners:
    """The models of one kind that have a key: their names, and the inner block of the key, or
    "".
    """

    hook: str
    names: Sequence[str]
    block: str

    def __str__(self) -> str:
        kind = CATALOGUE[self.hook].kind
        shown = self.names[:_MOST_NAMED]
        more = [f"{len(self.names) - len(shown)} more"] if len(self.names) > len(shown) else []
        inside = f"{self.block} of " if self.block else ""
        return (
            f"{inside}the {kind}{'s' if len(self.names) > 1 else ''}"
            f" {listed([*shown, *more], 'and')}"
        )


def home_of(key: str, host: Host, component: Component, *, is_chosen: bool) -> str:
    """Return where in a component's block, or in another model of its kind, a key belongs, as text;
    "" if nowhere.

    `is_chosen` says whether it is the block's `model` that chooses the component.
    """
    blocks = list(dict.fromkeys(_blocks_with(key, component)))
    if blocks:
        return f"it belongs in {listed(blocks, 'or')}"
    owners = _owners(key, host, component.hook)
    if owners is None:
        return ""
    choosing = (
        f"; write model: {listed(owners.names[:_MOST_NAMED], 'or')} to set it" if is_chosen else ""
    )
    return f"it belongs to {owners}, and this is {component.name}{choosing}"


def home_elsewhere(key: str, host: Host) -> str:
    """Return where in a scene a key belongs, as text; "" if nowhere."""
    if any(key == attribute.name for attribute in fields(SceneFile)):
        return "it belongs to the top level of the scene"
    homes = [
        f"{owners} (in {_BLOCKS[hook]})"
        for hook in _BLOCKS
        if (owners := _owners(key, host, hook)) is not None
    ]
    return f"it belongs to {listed(homes, 'or')}" if homes else ""


def listed(words: Sequence[str], conjunction: str) -> str:
    """Return words as a list in a sentence: `a`, `a or b`, `a, b or c`."""
    return f" {conjunction} ".join([", ".join(words[:-1]), words[-1]] if len(words) > 1 else words)


def _owners(key: str, host: Host, hook: str) -> Owners | None:
    """Return the models of a kind that have a key; those that have it in the outermost block, if
    any.
    """
    owners = {
        component.name: list(_blocks_with(key, component)) for component in _usable(host, hook)
    }
    outermost = [name for name, blocks in owners.items() if "" in blocks]
    if outermost:
        return Owners(hook, outermost, "")
    inside = {name: blocks[0] for name, blocks in owners.items() if blocks}
    block = next(iter(inside.values()), "")
    return (
        Owners(hook, [name for name in inside if inside[name] == block], block) if inside else None
    )


def _usable(host: Host, hook: str) -> Iterator[Component]:
    for name in host.names(hook):
        try:
            component = host.component(hook, name)
        except PluginError:
            continue
        if isinstance(component, Component):
            yield component


def _blocks_with(key: str, component: Component) -> Iterator[str]:
    """Yield the blocks of a component's settings that have a key: "" for the outermost, then those
    inside.
    """
    for block, name in _settings(component.config):
        if name == key:
            yield block


@cache
def _settings(config: type) -> Sequence[tuple[str, str]]:
    """Return the settings of a configuration class, each with the block that it stands in."""
    try:
        keys = [row.key for row in field_rows(config)]
    except Exception:  # a class of another package that cannot be read has no settings to point to
        return ()
    return [(block, name) for block, _, name in (key.rpartition(".") for key in keys)]
