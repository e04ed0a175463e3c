"""Blocks to components: a name is looked up with the host, and its settings are read by its configuration class."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from functools import partial
from typing import Any

from attrs import Factory, frozen

from opir_core.errors import PluginError
from opir_core.plugin.host import Host
from opir_core.scene.fields import TwoWays, told_twice, two_ways
from opir_core.scene.reading.nodes import (
    Complaint,
    ErrorCollector,
    InvalidNode,
    Node,
    complaints_inside,
    key_step,
    shown_text,
    under,
)
from opir_core.scene.reading.plain_data import node_of_data
from opir_core.scene.reading.structuring import (
    ClassReader,
    Home,
    UnreadableTypeError,
    block_of,
    class_reader,
    read_text,
    refusal,
    required,
)
from opir_core.scene.scene import Choice

#: Keys that a scene keeps for itself, besides those that may stand in the block at hand.
_KEPT = {"opir_sensor_models": ("id", "model", "constellation", "members"), "opir_sinks": ("spool",)}


@frozen
class Settings:
    """What a scene writes of one component.

    `written` are the keys of its block that are settings (and `preset`), `block` is where they stand. `given` are
    settings that the constellation `giver` brings; those written come before them. `other_keys` may stand beside
    settings.
    """

    block: Node
    written: Mapping[str, Node] = Factory(dict)
    given: Mapping[str, Any] = Factory(dict)
    giver: Any = None
    other_keys: tuple[str, ...] = ("model", "preset")


class Chooser:
    """Looks up components with a host; keeps what plugins are to blame for until all of the scene has been read."""

    def __init__(self, host: Host) -> None:
        self._host = host
        self._found: dict[tuple[str, str], Any] = {}
        self.failures: list[PluginError] = []

    def component(self, hook: str, name: str, path: str) -> Any:
        """Return a component; where it cannot be had, keep why and refuse the node without another word."""
        if (hook, name) not in self._found:
            self._found[hook, name] = None
            try:
                self._found[hook, name] = self._host.component(hook, name, path)
            except PluginError as error:
                self.failures.append(error)
        component = self._found[hook, name]
        if component is None:
            raise InvalidNode
        return component

    def named(self, hook: str, node: Node, path: str) -> Choice:
        """Return the choice of a node that is a component's name, or a block of `model` and settings."""
        if isinstance(node.value, str):
            return self.choice(hook, component_name(node), path, Settings(node))
        if not isinstance(node.value, dict):
            raise refusal(node, "a component's name, or a block of model and settings, is needed")
        block = dict(block_of(node))
        with under(".model"):
            name = component_name(required(block, "model", node))
        return self.choice(hook, name, path, Settings(node, block))

    def choice(self, hook: str, name: str, path: str, settings: Settings) -> Choice:
        """Return a component's choice, its settings read."""
        component = self.component(hook, name, path)
        try:
            return Choice(hook, name, self._config(component, path, settings), path)
        except InvalidNode:
            raise
        except Exception as error:  # whatever a configuration class of a plugin may raise
            raise self.blamed(component, path, f"its configuration fails: {type(error).__name__}: {error}") from error

    def blamed(self, component: Any, path: str, reason: str) -> InvalidNode:
        """Keep that a plugin is at fault, and return the refusal of the node, without another word."""
        owner = self._host.provenance(component.hook, component.name)
        self.failures.append(PluginError(f"{path}: {component.kind} {component.name!r} of {owner}: {reason}"))
        return InvalidNode()

    def _config(self, component: Any, path: str, settings: Settings) -> Any:
        reader, pairs = self._reader(component, path, settings), two_ways(component.config)
        written = dict(settings.written)
        preset = _preset(component, written.pop("preset")) if "preset" in written else {}
        givers = {**dict.fromkeys(preset, component), **dict.fromkeys(settings.given, settings.giver)}
        supplied = node_of_data(_laid_over(pairs, preset, settings.given))
        for complaint in supplied.complaints:
            raise self.blamed(settings.giver or component, path, complaint.message)
        beside = [key for key in settings.other_keys if key != "preset" or component.presets]
        block = _laid_over(pairs, block_of(supplied), written)
        try:
            return _made(reader, block, settings.block, beside, partial(self._home, component, settings))
        except InvalidNode as refused:
            theirs = {key_step(key): giver for key, giver in givers.items() if key not in written}
            complaints = [*complaints_inside(supplied), *refused.complaints]
            raise InvalidNode(self._own_complaints(complaints, theirs, component, path)) from refused

    def home_elsewhere(self, key: str, is_near: bool) -> str:
        """Return where in a scene a key would mean something; it is not looked for where a known one is like it."""
        from opir_core.scene.reading.misplaced_keys import home_elsewhere

        return "" if is_near else home_elsewhere(key, self._host)

    def _home(self, component: Any, settings: Settings, key: str, is_near: bool) -> str:
        from opir_core.scene.reading.misplaced_keys import home_of

        of_kind = home_of(key, self._host, component, is_chosen="model" in settings.other_keys)
        return of_kind or self.home_elsewhere(key, is_near)

    def _own_complaints(
        self, complaints: list[Complaint], givers: Mapping[str, Any], component: Any, path: str
    ) -> Iterator[Complaint]:
        """Yield the complaints about what the scene wrote; for the others, blame who gave the setting."""
        for complaint in complaints:
            giver = givers.get(complaint.steps[0]) if complaint.steps else None
            if giver is None:
                yield complaint
            else:
                words = f"a setting of it does not fit {component.name}: {complaint.path}: {complaint.message}"
                self.blamed(giver, path, words)

    def _reader(self, component: Any, path: str, settings: Settings) -> ClassReader:
        try:
            reader = class_reader(component.config)
        except UnreadableTypeError as error:
            raise self.blamed(component, path, str(error)) from error
        taken = sorted(reader.fields.keys() & {*settings.other_keys, *_KEPT.get(component.hook, ())})
        if taken:
            raise self.blamed(component, path, f"its configuration has the field {taken[0]}, a key that scenes keep")
        return reader


def component_name(node: Node) -> str:
    """Return the name of a component; raises `InvalidNode` where the node is no text or empty."""
    name = read_text(node)
    if not name:
        raise node.refused("a component's name is needed")
    return name


def _made(reader: ClassReader, block: Mapping[str, Node], place: Node, other_keys: Sequence[str], home: Home) -> Any:
    """Return a configuration, or raise all that is wrong with its block, what it tells twice included.

    What the block tells plainly its class's default does not tell otherwise.
    """
    gathering, silent = ErrorCollector(), {}
    for pair in two_ways(reader.config_class):
        told = _told(pair, block)
        if told == [pair.plain] and pair.is_other_default:
            silent[pair.other] = Node(None, place.place)
        with gathering.at(key_step(pair.other)):
            if len(told) > 1:
                raise block[pair.other].refused(told_twice(pair.plain), at_key=True)
    node = Node({**block, **silent}, place.place)
    if gathering.is_whole:
        return reader.made(node, other_keys, home)
    with gathering.at():
        reader.values(node, gathering, other_keys, home)
    raise InvalidNode(gathering.complaints)


def _laid_over(pairs: Iterable[TwoWays], lower: Mapping[str, Any], upper: Mapping[str, Any]) -> dict[str, Any]:
    """Return settings with nearer ones over them: what these tell, in either way, those no longer tell."""
    gone = {name for pair in pairs if _told(pair, upper) for name in (pair.plain, pair.other)}
    return {**{key: value for key, value in lower.items() if key not in gone}, **upper}


def _told(pair: TwoWays, block: Mapping[str, Any]) -> list[str]:
    """Return by which of two names settings, nodes or plain values, tell what both tell."""
    values = {name: block.get(name) for name in (pair.plain, pair.other)}
    return [name for name, one in values.items() if (one.value if isinstance(one, Node) else one) is not None]


def _preset(component: Any, node: Node) -> Mapping[str, Any]:
    name = read_text(node)
    if name not in component.presets:
        known = f"it has {', '.join(sorted(component.presets))}" if component.presets else "it has none"
        message = f"the {component.kind} {component.name} has no preset {shown_text(name)}; {known}"
        raise InvalidNode([Complaint(message, node.place, (".preset",))])
    preset: Mapping[str, Any] = component.presets[name]
    return preset
