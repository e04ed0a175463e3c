"""Nodes to a scene: every part is read, so that all errors are reported at once.

Sensors stand alone, in constellations by name, or in constellations with their members.
"""

from collections.abc import Mapping, Sequence
from contextlib import suppress
from importlib import import_module
from typing import Any

from attrs import evolve, fields, frozen

from opir_core.host.components import Constellation
from opir_core.host.error_messages import way_to_read
from opir_core.host.host import Host
from opir_core.reading.component_reader import ComponentReader, Settings, component_name
from opir_core.reading.described_light import LightFinder
from opir_core.reading.nodes import (
    MAXIMUM_SENSORS,
    ErrorCollector,
    InvalidNode,
    Node,
    index_step,
    key_step,
    read_each,
    under,
)
from opir_core.reading.scene_schema import (
    AUTO,
    CHOICES,
    PAPER,
    WITHOUT_LIGHT,
    SceneFile,
    epoch_us_of_text,
)
from opir_core.reading.structuring import (
    block_of,
    class_reader,
    items_of,
    nearest,
    refusal,
    unknown_key,
)
from opir_core.reading.targets import (
    ID_RULE,
    Identifier,
    SourceReader,
    TargetReader,
    is_id,
    read_forces,
)
from opir_core.scene.fields import LIGHT
from opir_core.scene.scene import Choice, Scene, SceneSensor, SpoolConfig

_MODELS = "opir_sensor_models"
_CONSTELLATIONS = "opir_constellations"
_SENSOR_KEYS = ("model", "id", "preset")
#: Name of a scene's `director` that is none.
_NO_DIRECTOR = "none"
_NAMING_KEYS = ("constellation", "model")
_FLEET_KEYS = ("constellation", "preset")


class SensorReader:
    """Reads the list of sensors."""

    def __init__(self, components: ComponentReader, epoch: str | None) -> None:
        self._components = components
        self._identifier = Identifier(components, _MODELS)
        self._epoch_us = None if epoch is None else epoch_us_of_text(epoch)

    def sensors(self, node: Node) -> tuple[SceneSensor, ...]:
        """Return all sensors, constellations member by member."""
        items = items_of(node)
        if not items:
            raise node.refused("a scene needs a sensor: a constellation, or a model with an id")
        collector = ErrorCollector()
        sensors = list[SceneSensor]()
        for index, item in enumerate(items):
            with collector.at(index_step(index)):
                sensors += self._sensors_of(item, f"sensors[{index}]")
            if len(sensors) > MAXIMUM_SENSORS:
                raise node.refused(f"there are more than {MAXIMUM_SENSORS} sensors")
        collector.require_whole()
        return tuple(sensors)

    def _sensors_of(self, node: Node, path: str) -> list[SceneSensor]:
        if not isinstance(node.value, dict):
            raise refusal(node, "a block of constellation, or of model and id, is needed")
        block = dict(block_of(node))
        if "fleet" in block and "constellation" not in block:
            return self._of_file(node, block, path)
        if "constellation" not in block:
            if "model" not in block:
                for key, value in block.items():
                    if nearest(key, _NAMING_KEYS):
                        with under(key_step(key)):
                            raise unknown_key(key, value, _NAMING_KEYS)
                raise node.refused("names neither a model nor a constellation")
            return [self._sensor(node, path, path)]
        with under(".constellation"):
            name = component_name(block.pop("constellation"))
        if "members" in block:
            return self._members(block, name, path)
        return self._fleet(node, block, name, path)

    def _sensor(
        self, node: Node, path: str, choice_path: str, constellation: str | None = None
    ) -> SceneSensor:
        own_id, choice = self._identifier.identified(node, path, _SENSOR_KEYS, choice_path)
        return SceneSensor(own_id, choice, constellation)

    def _of_file(self, node: Node, block: dict[str, Node], path: str) -> list[SceneSensor]:
        """Return a sensor for each satellite of a file."""
        collector = ErrorCollector()
        sensors = list[SceneSensor]()
        with under(".fleet"):
            satellites = self._components.satellites(block.pop("fleet"), self._epoch_us)
        _refuse(block, ("id", "orbit"), "a fleet brings the {} of its sensors", collector)
        for satellite in satellites:
            with collector.at():
                satellite_node = evolve(node, value={**block, **block_of(satellite)})
                sensors.append(self._sensor(satellite_node, path, path))
        collector.require_whole()
        return sensors

    def _members(self, block: dict[str, Node], name: str, path: str) -> list[SceneSensor]:
        """Return a constellation with explicit members, as `scene_mapping` writes it."""
        collector = ErrorCollector()
        sensors = list[SceneSensor]()
        extra_keys = [key for key in block if key != "members"]
        _refuse(
            block, extra_keys, "is not allowed beside members; write it in each member", collector
        )
        with collector.at(".members"):
            if not items_of(block["members"]):
                raise block["members"].refused("a constellation has at least one member")
            sensors = read_each(
                items_of(block["members"]),
                lambda index, item: self._sensor(item, f"{path}.members[{index}]", path, name),
            )
        collector.require_whole()
        return sensors

    def _fleet(
        self, node: Node, written: dict[str, Node], name: str, path: str
    ) -> list[SceneSensor]:
        """Return a constellation's own members, with the scene's settings applied to each."""
        collector = ErrorCollector()
        sensors = list[SceneSensor]()
        _refuse(written, ("id", "model"), "a constellation brings the {} of its sensors", collector)
        with collector.at():
            constellation = self._components.component(_CONSTELLATIONS, name, path)
            for satellite in constellation.satellites:
                with collector.at():
                    sensors.append(
                        self._satellite(constellation, satellite, Settings(node, written), path)
                    )
        collector.require_whole()
        return sensors

    def _satellite(
        self,
        constellation: Constellation,
        satellite: Mapping[str, Any],
        settings: Settings,
        path: str,
    ) -> SceneSensor:
        block = dict(satellite)
        own_id = block.pop("id")
        if not is_id(own_id):
            raise self._components.blamed(
                constellation, path, f"{own_id!r} is not an id; {ID_RULE}"
            )
        self._identifier.claimed(own_id, path, settings.block)
        settings = evolve(settings, given=block, giver=constellation, other_keys=_FLEET_KEYS)
        choice = self._components.choice(_MODELS, constellation.model, path, settings)
        return SceneSensor(own_id, choice, constellation.name)


def _refuse(
    block: dict[str, Node], keys: Sequence[str], message: str, collector: ErrorCollector
) -> None:
    for key in [key for key in keys if key in block]:
        with collector.at(key_step(key)):
            raise block.pop(key).refused(message.format(key), at_key=True)


_SINKS = "opir_sinks"
_ENCODERS = "opir_event_encoders"
_FEW_KEYS = 8
_OUTPUT_NEEDED = "a sink's name, or one name with its settings indented below it, is needed"


@frozen
class ChosenDetection:
    """The detection model of a scene: its name, and why `auto` chose it, "" if the scene names it.

    `problem` is why `auto` cannot choose, at `steps` from the scene.
    """

    name: str
    reason: str = ""
    steps: tuple[str, ...] = ()
    problem: InvalidNode | None = None


_DEFAULTS = {attribute.name: attribute.default for attribute in fields(SceneFile)}


def _no_sensor(node: Node, name: str, ids: Sequence[str], *, at_key: bool = False) -> InvalidNode:
    """Return the refusal of a name that is none of the sensors' ids."""
    similar = nearest(name, ids)
    hint = f"did you mean {similar}?" if similar else f"there are {', '.join(ids[:_FEW_KEYS])}"
    return node.refused(f"there is no sensor {name!r}; {hint}", at_key=at_key)


class SceneBuilder:
    """Reads one scene; `collector` has what is wrong with it, `components.failures` what is wrong
    with plugins.
    """

    def __init__(self, host: Host) -> None:
        self.collector = ErrorCollector()
        self.components = ComponentReader(host)

    def scene(self, root: Node) -> Scene | None:
        """Return the scene, or None if there are errors."""
        values: dict[str, Any] = {}
        with self.collector.at():
            values = class_reader(SceneFile).values(
                root, self.collector, home=self.components.home_elsewhere
            )
        self.components.preset = values.get("preset")
        detection = self._chosen_detection(block_of(root))
        fields = self._parts(values, detection)
        if "sensors" in fields:
            ids = [sensor.id for sensor in fields["sensors"]]
            self._require_known(ids, values, block_of(root))
        if detection.problem is not None and not self.components.failures:
            with self.collector.at(*detection.steps):
                raise detection.problem
        if not self.collector.is_whole or self.components.failures:
            return None
        file = SceneFile(**values)
        return Scene(
            name=file.scene,
            epoch_us=epoch_us_of_text(file.epoch),
            duration_s=file.duration_s,
            seed=file.seed,
            # The paper's latencies are those of the looks.
            light_time=values.get("light_time", file.preset != PAPER),
            tracking_order=file.tracking_order,
            tracking_lag_s=file.tracking_lag_s,
            reported_types=file.reported_types,
            limits=file.limits,
            allow_implausible=file.allow_implausible,
            watched_s=file.watched_s,
            faults=file.faults,
            written={name: value for name, value in values.items() if value != _DEFAULTS[name]},
            **fields,
        )

    def _require_known(
        self, ids: Sequence[str], values: Mapping[str, Any], nodes: Mapping[str, Node]
    ) -> None:
        """Collect the errors of spans and faults of sensors that the scene does not have."""
        if "watched_s" in values:
            with self.collector.at(key_step("watched_s")):
                for name, spans in block_of(nodes["watched_s"]).items():
                    if name not in ids:
                        raise _no_sensor(spans, name, ids, at_key=True)
        for number, fault in enumerate(values.get("faults", ())):
            if fault.sensor not in ids:
                with self.collector.at(key_step("faults"), index_step(number), key_step("sensor")):
                    written = block_of(items_of(nodes["faults"])[number])["sensor"]
                    raise _no_sensor(written, fault.sensor, ids)

    def _chosen_detection(self, nodes: Mapping[str, Any]) -> ChosenDetection:
        """Return the detection model of a scene: the one it names, or what `auto` comes to."""
        if "detection" in nodes:
            written = nodes["detection"]
            named = written.value.get("model") if isinstance(written.value, dict) else written
            name = named.value if isinstance(named, Node) else None
            if name != AUTO:
                # What names no model is refused when it is read.
                return ChosenDetection(name if isinstance(name, str) and name else WITHOUT_LIGHT)
        description = LightFinder(self.components, nodes).first()
        if description is None:
            return ChosenDetection(WITHOUT_LIGHT, "the scene describes no light")
        models = self.components.readers_of(LIGHT, CHOICES["detection"][0])
        if len(models) == 1:
            return ChosenDetection(models[0], f"the scene describes light: {description.path}")
        remedy = (
            f"choose one of {', '.join(models)}"
            if models
            else f"none is installed; {way_to_read(LIGHT)}"
        )
        words = f"describes light, which needs a detection model that reads it: {remedy}"
        return ChosenDetection(
            WITHOUT_LIGHT, "", description.steps, description.node.refused(words, at_key=True)
        )

    def _parts(self, values: dict[str, Any], detection: ChosenDetection) -> dict[str, Any]:
        """Return the parts of the scene, read from its blocks."""
        fields: dict[str, Any] = {"targets": (), "sources": (), "outputs": ()}
        if detection.reason or detection.problem is not None:
            values["detection"] = _renamed(values.get("detection"), detection.name)
        self.components.subjects = self.components.subjects_of(
            CHOICES["detection"][0], detection.name
        )
        if values.get("forces") is not None:
            with self.collector.at(key_step("forces")):
                fields["forces"] = read_forces(values["forces"])
        lists = {
            "sensors": SensorReader(self.components, values.get("epoch")).sensors,
            "targets": TargetReader(self.components, values.get("duration_s")).targets,
            "sources": lambda node: SourceReader(self.components, fields["targets"]).sources(node),
            "outputs": self._outputs,
        }
        for key, read in lists.items():
            if key in values:
                with self.collector.at(key_step(key)):
                    fields[key] = read(values[key])
        for key, (hook, _) in CHOICES.items():
            with self.collector.at(key_step(key)):
                fields[key] = self._model(
                    hook, values.get(key), key, self.default_name(key, values)
                )
        director = values.get("director")
        if director is not None and director.value != _NO_DIRECTOR:
            with self.collector.at(key_step("director")):
                fields["director"] = self.components.named("opir_directors", director, "director")
        if values.get("links") is not None:
            fields["links"] = self._links(values["links"], fields.get("sensors", ()))
        if detection.reason and "detection" in fields:
            fields["detection"] = evolve(fields["detection"], reason=detection.reason, written={})
        return fields

    def _links(self, node: Node, sensors: Sequence[SceneSensor]) -> Any:
        """Return the links of a node; their reader is imported for scenes that have links."""
        with self.collector.at(key_step("links")):
            if sensors:  # else their errors are collected already
                reader = import_module("opir_core.reading.links")
                return reader.read_links(node, [sensor.id for sensor in sensors])
        return None

    def default_name(self, key: str, nodes: Mapping[str, Any]) -> str:
        """Return the name that a key has if the scene names none; a detection model may bring its
        classifier.
        """
        default = CHOICES[key][1]
        if key != "classification":
            return default
        with suppress(InvalidNode):
            name = self._chosen_detection(nodes).name
            return (
                self.components.component(CHOICES["detection"][0], name, "detection").classifier
                or default
            )
        return default

    def _model(self, hook: str, node: Node | None, key: str, default: str) -> Choice:
        if node is None:
            return self.components.choice(hook, default, key, Settings(Node({})), is_named=False)
        choice = self.components.named(hook, node, key)
        # A default that is named, as manifests do, is what the scene has anyway.
        is_usual = choice.name == CHOICES[key][1] and len(choice.written) <= 1
        return evolve(choice, written={}) if is_usual else choice

    def _outputs(self, node: Node) -> tuple[Choice, ...]:
        taken = dict[tuple[str, str], str]()

        def read(index: int, item: Node) -> Choice:
            choice = self._output(item, f"outputs[{index}]")
            # Looked up here, so that a missing encoder is reported with the other errors.
            name = getattr(choice.config, "encoder", None)
            if isinstance(name, str):
                self.components.component(_ENCODERS, name, f"{choice.path}.encoder")
            path = getattr(choice.config, "path", None)
            if path is not None:
                owner = taken.setdefault((choice.name, repr(path)), choice.path)
                if owner != choice.path:
                    raise item.refused(f"{owner} writes to {path!r} already")
            return choice

        return tuple(read_each(items_of(node), read))

    def _output(self, node: Node, path: str) -> Choice:
        if isinstance(node.value, str):
            return self.components.named(_SINKS, node, path)
        if not isinstance(node.value, dict):
            raise refusal(node, _OUTPUT_NEEDED)
        block = block_of(node)
        if len(block) != 1:
            keys = (
                f" has the keys {', '.join(block)}"
                if 0 < len(block) <= _FEW_KEYS
                else f" has {len(block)} keys"
            )
            raise node.refused(f"this block{keys}; {_OUTPUT_NEEDED}")
        ((name, node),) = block.items()
        with under(key_step(name)):
            settings = {} if node.value is None else dict(block_of(node))
            spooled = {"spool": settings.pop("spool")} if "spool" in settings else {}
            collector = ErrorCollector()
            with collector.at():
                sink_settings = Settings(node, settings, other_keys=("preset", "spool"))
                choice = self.components.choice(_SINKS, name, path, sink_settings)
            with collector.at():
                spool = {key: _spool_settings(block) for key, block in spooled.items()}
            collector.require_whole()
            return evolve(choice, **spool)


def _renamed(node: Node | None, model: str) -> Node:
    """Return the node of a component, a name or a block of settings, with another model."""
    if node is None or not isinstance(node.value, dict):
        return Node(model, None if node is None else node.place)
    return evolve(node, value={**node.value, "model": Node(model, node.place)})


def _spool_settings(node: Node) -> Any:
    with under(key_step("spool")):
        return class_reader(SpoolConfig)(node)
