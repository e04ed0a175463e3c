"""Blocks to components: the host looks up the name, the configuration class reads the settings."""

from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import suppress
from functools import cache, partial
from typing import Any, get_type_hints

from attrs import NOTHING, Factory, evolve, fields, frozen

from opir_core.errors import PluginError, install_command, nearest as nearest_words
from opir_core.host.boundary import is_interruption
from opir_core.host.components import CATALOGUE, TrackerPart
from opir_core.host.error_messages import described_error
from opir_core.host.host import Host
from opir_core.interfaces.file_contents import BadFileError
from opir_core.reading.nodes import (
    Complaint,
    ErrorCollector,
    InvalidNode,
    Node,
    complaints_inside,
    key_step,
    place_text,
    shown_text,
    under,
)
from opir_core.reading.plain_data import data_of_node, node_of_data
from opir_core.reading.structuring import (
    ClassReader,
    Home,
    UnreadableTypeError,
    block_of,
    class_reader,
    read_text,
    refusal,
    required,
)
from opir_core.scene.field_rows import field_rows, nested_config
from opir_core.scene.fields import (
    Alternatives,
    FieldInfo,
    alternatives,
    error_of_both,
    field_infos,
    info_of,
)
from opir_core.scene.scene import Choice

#: Keys reserved by scenes, besides those of the block.
_KEPT = {
    "opir_sensor_models": ("id", "model", "constellation", "members", "fleet"),
    "opir_sinks": ("spool",),
}


@frozen
class Settings:
    """The settings of one component in a scene.

    `written` are the settings in `block` (and `preset`). `given` are settings of the constellation
    `giver`; written ones take precedence. `other_keys` are allowed beside settings.
    """

    block: Node
    written: Mapping[str, Node] = Factory(dict)
    given: Mapping[str, Any] = Factory(dict)
    giver: Any = None
    other_keys: tuple[str, ...] = ("model", "preset")


class ComponentReader:
    """Looks up components with a host; collects the errors of plugins until the whole scene has
    been read.

    `preset` is the preset of the scene, from which each component that has it starts.
    """

    def __init__(self, host: Host) -> None:
        self._host = host
        self._found: dict[tuple[str, str], Any] = {}
        self._names: dict[str, list[str]] = {}
        self.failures: list[PluginError] = []
        self.preset: str | None = None
        #: The subjects that the scene's detection model reads.
        self.subjects: Sequence[str] = ()

    def component(self, hook: str, name: str, path: str) -> Any:
        """Return a component; if it is missing, record the failure and raise an empty
        `InvalidNode`.
        """
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

    def offered(self, hook: str, name: str) -> Any:
        """Return a component, None if it cannot be used; the failure is not recorded."""
        if (hook, name) in self._found:
            return self._found[hook, name]
        with suppress(PluginError):
            return self._host.component(hook, name)
        return None

    def names(self, hook: str) -> list[str]:
        """Return the names offered under a hook, sorted."""
        if hook not in self._names:
            self._names[hook] = self._host.names(hook)
        return self._names[hook]

    def readers_of(self, subject: str, hook: str) -> list[str]:
        """Return the names of the usable components of a hook that read a subject, sorted."""
        return [name for name in self.names(hook) if subject in self.subjects_of(hook, name)]

    def subjects_of(self, hook: str, name: str) -> Sequence[str]:
        """Return the subjects that a component reads; none of one that cannot be used."""
        component = self.offered(hook, name)
        return () if component is None else component.subjects_read(component.config()) or ()

    def satellites(self, node: Node, epoch_us: int | None) -> list[Node]:
        """Return the settings of each satellite of the file that a `fleet` block names; None is a
        refused epoch.
        """
        readers = self._host.readers()
        for kind in filter(None, (reader.fleet for reader in readers)):
            fleet: Any = class_reader(kind)(node)
            try:
                return [
                    node_of_data(satellite) for satellite in fleet.satellites(epoch_us, readers)
                ]
            except BadFileError as error:
                raise node.refused(str(error)) from error
        words = f"no installed plugin reads fleets from files; {install_command('opir-readers')}"
        raise node.refused(words, at_key=True)

    def named(self, hook: str, node: Node, path: str) -> Choice:
        """Return the choice of a node: a component's name, or a block of `model` and settings."""
        if isinstance(node.value, str):
            return self.choice(hook, component_name(node), path, Settings(node))
        if not isinstance(node.value, dict):
            raise refusal(node, "a component's name, or a block of model and settings, is needed")
        block = dict(block_of(node))
        with under(".model"):
            name = component_name(required(block, "model", node))
        return self.choice(hook, name, path, Settings(node, block))

    def choice(
        self, hook: str, name: str, path: str, settings: Settings, *, is_named: bool = True
    ) -> Choice:
        """Return a component's choice, its settings read; `is_named` is whether the scene names
        it.
        """
        component = self.component(hook, name, path)
        try:
            config = self._config(component, path, settings)
            return Choice(
                hook, name, config, path, written=_written(component, settings) if is_named else {}
            )
        except InvalidNode:
            raise
        except BaseException as error:  # whatever a configuration class of a plugin may raise
            if is_interruption(error):
                raise
            raise self.blamed(
                component, path, f"its configuration fails: {described_error(error)}"
            ) from error

    def blamed(self, component: Any, path: str, reason: str) -> InvalidNode:
        """Record an error of a plugin, and return an empty `InvalidNode`."""
        owner = self._host.provenance(component.hook, component.name)
        self.failures.append(
            PluginError(f"{path}: {component.kind} {component.name!r} of {owner}: {reason}")
        )
        return InvalidNode()

    def _config(self, component: Any, path: str, settings: Settings) -> Any:
        reader = self._reader(component, path, settings)
        pairs = alternatives(component.config)
        written = dict(settings.written)
        preset = (
            _preset(component, written.pop("preset"))
            if "preset" in written
            else self._preset_of_scene(component)
        )
        givers = {
            **dict.fromkeys(preset, component),
            **dict.fromkeys(settings.given, settings.giver),
        }
        supplied = node_of_data(
            _fitting(component.config, _laid_over(pairs, preset, settings.given), written)
        )
        for complaint in supplied.complaints:
            raise self.blamed(settings.giver or component, path, complaint.message)
        beside = [key for key in settings.other_keys if key != "preset" or component.presets]
        block = _laid_over(
            pairs, block_of(supplied), _completed(component.config, block_of(supplied), written)
        )
        try:
            result = _made(
                reader, block, settings.block, beside, partial(self._home, component, settings)
            )
            self._require_names(component.config, block, path)
            return self._with_parts(component, result, block, path)
        except InvalidNode as refused:
            fault = _fault_of_default(component.config, block)
            if fault:
                raise self.blamed(component, path, fault) from refused
            presets_of_key = {
                key_step(key): giver for key, giver in givers.items() if key not in written
            }
            complaints = [*complaints_inside(supplied), *refused.complaints]
            raise InvalidNode(
                self._own_complaints(complaints, presets_of_key, component, path)
            ) from refused

    def _preset_of_scene(self, component: Any) -> Mapping[str, Any]:
        """Return the preset of a component whose block names none: the scene's, or that for what is
        read.
        """
        if self.preset in component.presets:
            return component.presets[self.preset]
        names = (
            name for subject, name in component.presets_for.items() if subject in self.subjects
        )
        return component.presets.get(next(names, ""), {})

    def _require_names(self, config_class: type, block: Mapping[str, Node], path: str) -> None:
        """Raise the errors of fields that hold names of components, where no plugin offers one."""
        collector = ErrorCollector()
        for key, info in field_infos(config_class).items():
            if info.names_of and key in block:
                for steps, name, node in _names_in(
                    block[key], (key_step(key),), info.names_depth, info.inner_names
                ):
                    with collector.at(*steps):
                        self._require_name(info.names_of, name, node, path, steps)
        collector.require_whole()

    def _with_parts(self, component: Any, config: Any, block: Mapping[str, Node], path: str) -> Any:
        """Return a configuration with the choices of the parts that its fields name."""
        collector = ErrorCollector()
        choices = dict[str, Choice]()
        for key, info in field_infos(type(config)).items():
            if info.role:
                node = block.get(key) or Node(getattr(config, key))
                with collector.at(key_step(key)):
                    choices[key] = self._part(component, info, node, f"{path}.{key}")
        collector.require_whole()
        return evolve(config, **choices) if choices else config

    def _part(self, component: Any, info: FieldInfo, node: Node, path: str) -> Choice:
        """Return the choice of a tracker part; one that the tracker cannot use is refused, with
        those that it can.
        """
        name = node.value.get("model", node) if isinstance(node.value, dict) else node
        if isinstance(name.value, str):
            words = self._misfit(component, info, name.value)
            if words:
                usable = [
                    part
                    for part in self.names(TrackerPart.hook)
                    if not self._misfit(component, info, part)
                ]
                near = nearest_words(name.value, usable)
                raise name.refused(f"{words}{near}; there are {', '.join(usable) or 'none'}")
        return self.named(TrackerPart.hook, node, path)

    def _misfit(self, component: Any, info: FieldInfo, name: str) -> str:
        """Return why a tracker cannot have a part of a name for a role, "" if it can."""
        if name not in self.names(TrackerPart.hook):
            return f"no tracker part is named {shown_text(name)}"
        part = self.offered(TrackerPart.hook, name)
        if part is None:
            return ""
        if part.role != info.role:
            return f"{name} is a part for {part.role}, not for {info.role}"
        if part.trackers and component.name not in part.trackers:
            return f"{name} is a part of {', '.join(part.trackers)}, not of {component.name}"
        if info.state_size is not None and part.state_size != info.state_size:
            return (
                f"{name} has {part.state_size or 'no stated number of'} states,"
                f" {component.name} needs {info.state_size}"
            )
        return ""

    def _require_name(
        self, hook: str, name: str, node: Node, path: str, steps: Sequence[str]
    ) -> None:
        names = self.names(hook)
        if name not in names:
            kind = CATALOGUE[hook].kind
            message = (
                f"no {kind} is named {shown_text(name)}{nearest_words(name, names)}; there are"
                f" {', '.join(names)}"
            )
            raise node.refused(message, at_key=len(steps) > 1)
        self.component(hook, name, f"{path}{''.join(steps)}")

    def home_elsewhere(self, key: str, is_near: bool) -> str:
        """Return where in a scene a key belongs; not looked up if a known key is similar."""
        return self._home(None, None, key, is_near)

    def _home(self, component: Any, settings: Settings | None, key: str, is_near: bool) -> str:
        from opir_core.reading.misplaced_keys import home_elsewhere, home_of  # of wrong scenes

        is_chosen = settings is not None and "model" in settings.other_keys
        of_kind = (
            home_of(key, self._host, component, is_chosen=is_chosen) if settings is not None else ""
        )
        return of_kind or ("" if is_near else home_elsewhere(key, self._host))

    def _own_complaints(
        self, complaints: list[Complaint], givers: Mapping[str, Any], component: Any, path: str
    ) -> Iterator[Complaint]:
        """Yield the errors of settings in the scene; record the others as errors of the plugins
        that gave them.
        """
        for complaint in complaints:
            giver = givers.get(complaint.steps[0]) if complaint.steps else None
            if giver is None:
                yield complaint
            else:
                words = (
                    f"one of its settings does not fit {component.name}: {complaint.path}:"
                    f" {complaint.message}"
                )
                self.blamed(giver, path, words)

    def _reader(self, component: Any, path: str, settings: Settings) -> ClassReader:
        try:
            reader = class_reader(component.config)
        except UnreadableTypeError as error:
            raise self.blamed(component, path, str(error)) from error
        taken = sorted(
            reader.fields.keys() & {*settings.other_keys, *_KEPT.get(component.hook, ())}
        )
        if taken:
            raise self.blamed(
                component,
                path,
                f"its configuration has the field {taken[0]}, a key reserved by scenes",
            )
        return reader


def _fault_of_default(config_class: type, block: Mapping[str, Any]) -> str:
    """Return which default of a configuration class, of those that a block leaves as they are, is
    out of range.
    """
    for attribute in fields(config_class):
        default: Any = attribute.default
        if (
            attribute.name in block
            or attribute.validator is None
            or default is NOTHING
            or hasattr(default, "takes_self")
        ):
            continue
        try:
            attribute.validator(None, attribute, default)
        except ValueError as error:
            return f"the default of its setting {attribute.name} is invalid: {error}"
    return ""


#: A block of at least so many fields that sets each of them was written by opir, as manifests are,
#: not by a person.
_FEW_FIELDS = 3


def is_written_out(config_class: type, block: Mapping[str, Any]) -> bool:
    """Return whether a block sets every field of a configuration class, or the alternative of
    it, but for those that opir leaves out.
    """
    pairs = alternatives(config_class)
    counterpart = {pair.plain: pair.other for pair in pairs} | {
        pair.other: pair.plain for pair in pairs
    }
    names = [attribute.name for attribute in fields(config_class) if attribute.init]
    unwritten = getattr(config_class, "unwritten", ())
    return len(names) >= _FEW_FIELDS and all(
        name in block or counterpart.get(name) in block or name in unwritten for name in names
    )


def _written(component: Any, settings: Settings) -> dict[str, str]:
    """Return the places of a component's block and of its settings that are read under a condition,
    by their keys.

    Of a block that opir has written out, only those that are neither a default nor a preset's
    count.
    """
    config_class = component.config
    conditional = {
        key: node
        for key, node in settings.written.items()
        if key in conditional_fields(config_class)
    }
    if is_written_out(config_class, settings.written):
        usual = [_defaults(config_class), *component.presets.values()]
        conditional = {
            key: node
            for key, node in conditional.items()
            if data_of_node(node) not in [block.get(key) for block in usual]
        }
    return {"": _place_text(settings.block)} | {
        path: place for key, node in conditional.items() for path, place in _places(key, node)
    }


@cache
def conditional_fields(config_class: type) -> frozenset[str]:
    """Return the fields of a configuration class that are not always read, or hold settings that
    are not.
    """
    hints = get_type_hints(config_class)
    names = set[str]()
    for attribute in fields(config_class):
        info = info_of(attribute)
        inner = nested_config(hints[attribute.name])
        if info.subject or info.read_if or (inner is not None and conditional_fields(inner)):
            names.add(attribute.name)
    return frozenset(names)


@cache
def _defaults(config_class: type) -> Mapping[str, Any]:
    """Return the defaults of a configuration class, as plain values."""
    return {row.key: row.default for row in field_rows(config_class) if not row.is_required}


def _places(path: str, node: Node) -> Iterator[tuple[str, str]]:
    """Yield the dotted paths of the values in a node that are no blocks, with their places."""
    if isinstance(node.value, dict) and node.value:
        for key, inner in node.value.items():
            yield from _places(f"{path}.{key}", inner)
    else:
        yield path, _place_text(node)


def _place_text(node: Node) -> str:
    place = node.key_place or node.place
    return "" if place is None else place_text(place)


def component_name(node: Node) -> str:
    """Return the name of a component; raises `InvalidNode` if the node is empty or not text."""
    name = read_text(node)
    if not name:
        raise node.refused("a component's name is needed")
    return name


def _names_in(
    node: Node, steps: tuple[str, ...], depth: int, inner: tuple[str, ...]
) -> Iterator[tuple[tuple[str, ...], str, Node]]:
    """Yield the names of components that a node holds: its text, or its keys, or those `depth`
    mappings below.

    With `inner` also the keys one mapping deeper, unless they are one of these.
    """
    if isinstance(node.value, str):
        yield steps, node.value, node
    for key, child in node.value.items() if isinstance(node.value, dict) else ():
        inside = (*steps, key_step(key))
        if depth:
            yield from _names_in(child, inside, depth - 1, inner)
        else:
            yield inside, key, child
            deeper = child.value.items() if inner and isinstance(child.value, dict) else ()
            yield from (
                ((*inside, key_step(name)), name, leaf)
                for name, leaf in deeper
                if name not in inner
            )


def _made(
    reader: ClassReader,
    block: Mapping[str, Node],
    place: Node,
    other_keys: Sequence[str],
    home: Home,
) -> Any:
    """Return a configuration, or raise all errors of its block, both of two alternatives being one.

    A block that sets the plain field turns off the default of its alternative.
    """
    collector = ErrorCollector()
    silent = {}
    for pair in alternatives(reader.config_class):
        names = _set_names(pair, block)
        if names == [pair.plain] and pair.is_other_default:
            silent[pair.other] = Node(None, place.place)
        with collector.at(key_step(pair.other)):
            if len(names) > 1:
                raise block[pair.other].refused(error_of_both(pair.plain), at_key=True)
    node = Node({**block, **silent}, place.place)
    if collector.is_whole:
        return reader.made(node, other_keys, home)
    with collector.at():
        reader.values(node, collector, other_keys, home)
    raise InvalidNode(collector.complaints)


def _laid_over(
    pairs: Iterable[Alternatives], lower: Mapping[str, Any], upper: Mapping[str, Any]
) -> dict[str, Any]:
    """Return settings with overriding ones laid over them; an overriding setting replaces both
    alternatives.
    """
    gone = {name for pair in pairs if _set_names(pair, upper) for name in (pair.plain, pair.other)}
    return {**{key: value for key, value in lower.items() if key not in gone}, **upper}


def _completed(
    config_class: type, lower: Mapping[str, Node], upper: Mapping[str, Node]
) -> dict[str, Node]:
    """Return settings whose nested blocks have what they leave unset from the lower settings.

    A block that opir has written out is whole.
    """
    completed = dict(upper)
    if is_written_out(config_class, upper):
        return completed
    hints = get_type_hints(config_class)
    for key, node in upper.items():
        lower_value = lower[key].value if key in lower else None
        inner = nested_config(hints[key]) if key in hints else None
        if inner is not None and isinstance(lower_value, dict) and isinstance(node.value, dict):
            settings = _completed(inner, lower_value, node.value)
            completed[key] = evolve(
                node, value=_laid_over(alternatives(inner), lower_value, settings)
            )
    return completed


def _fitting(
    config_class: type, supplied: Mapping[str, Any], written: Mapping[str, Node]
) -> dict[str, Any]:
    """Return supplied settings without keys that name nothing in the field that they refer to, as a
    block writes it.
    """
    fitting = dict(supplied)
    for name, info in field_infos(config_class).items():
        keyed_values = written[info.keys_of].value if info.keys_of in written else None
        if isinstance(keyed_values, dict) and name in supplied:
            fitting[name] = {
                key: value for key, value in supplied[name].items() if key in keyed_values
            }
    return fitting


def _set_names(pair: Alternatives, block: Mapping[str, Any]) -> list[str]:
    """Return which of two alternatives are set, in nodes or plain values."""
    values = {name: block.get(name) for name in (pair.plain, pair.other)}
    return [
        name
        for name, setting in values.items()
        if (setting.value if isinstance(setting, Node) else setting) is not None
    ]


def _preset(component: Any, node: Node) -> Mapping[str, Any]:
    name = read_text(node)
    if name not in component.presets:
        presets = (
            f"it has {', '.join(sorted(component.presets))}" if component.presets else "it has none"
        )
        message = (
            f"the {component.kind} {component.name} has no preset {shown_text(name)}; {presets}"
        )
        raise InvalidNode([Complaint(message, node.place, (".preset",))])
    return component.presets[name]
