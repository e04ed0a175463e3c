"""The sensors of a scene: single sensors, constellations by name, and constellations with their members."""

from collections.abc import Mapping
from typing import Any

from attrs import evolve

from opir_core.plugin.components import Constellation
from opir_core.scene.reading.component_reader import ComponentReader, Settings, component_name
from opir_core.scene.reading.nodes import MAXIMUM_SENSORS, ErrorCollector, Node, index_step, key_step, under
from opir_core.scene.reading.structuring import block_of, items_of, nearest, refusal, unknown_key
from opir_core.scene.reading.targets import ID_RULE, Identifier, is_id
from opir_core.scene.scene import SceneSensor

_MODELS = "opir_sensor_models"
_CONSTELLATIONS = "opir_constellations"
_SENSOR_KEYS = ("model", "id", "preset")
_NAMING_KEYS = ("constellation", "model")
_FLEET_KEYS = ("constellation", "preset")


class SensorReader:
    """Reads the list of sensors."""

    def __init__(self, components: ComponentReader) -> None:
        self._components = components
        self._identifier = Identifier(components, _MODELS)

    def sensors(self, node: Node) -> tuple[SceneSensor, ...]:
        """Return all sensors, constellations member by member."""
        items = items_of(node)
        if not items:
            raise node.refused("a scene needs a sensor: a constellation, or a model with an id")
        collector, sensors = ErrorCollector(), list[SceneSensor]()
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
        if "constellation" not in block:
            if "model" not in block:
                _refuse_nameless(block, node)
            return [SceneSensor(*self._identifier.identified(node, path, _SENSOR_KEYS, path))]
        with under(".constellation"):
            name = component_name(block.pop("constellation"))
        if "members" in block:
            return self._members(block, name, path)
        return self._fleet(node, block, name, path)

    def _members(self, block: dict[str, Node], name: str, path: str) -> list[SceneSensor]:
        """Return a constellation with explicit members, as `scene_mapping` writes it."""
        collector, sensors = ErrorCollector(), list[SceneSensor]()
        for key, node in block.items():
            if key != "members":
                with collector.at(key_step(key)):
                    raise node.refused("is not allowed beside members; write it in each member", at_key=True)
        with collector.at(".members"):
            if not items_of(block["members"]):
                raise block["members"].refused("a constellation has at least one member")
            for index, item in enumerate(items_of(block["members"])):
                with collector.at(".members", index_step(index)):
                    own_path = f"{path}.members[{index}]"
                    sensors.append(SceneSensor(*self._identifier.identified(item, own_path, _SENSOR_KEYS, path), name))
        collector.require_whole()
        return sensors

    def _fleet(self, node: Node, written: dict[str, Node], name: str, path: str) -> list[SceneSensor]:
        """Return a constellation's own members, with the scene's settings applied to each."""
        collector, sensors = ErrorCollector(), list[SceneSensor]()
        for key in [key for key in ("id", "model") if key in written]:
            with collector.at(key_step(key)):
                raise written.pop(key).refused(f"a constellation brings the {key} of its sensors", at_key=True)
        with collector.at():
            constellation = self._components.component(_CONSTELLATIONS, name, path)
            for satellite in constellation.satellites:
                with collector.at():
                    sensors.append(self._satellite(constellation, satellite, Settings(node, written), path))
        collector.require_whole()
        return sensors

    def _satellite(
        self, constellation: Constellation, satellite: Mapping[str, Any], settings: Settings, path: str
    ) -> SceneSensor:
        given = dict(satellite)
        own_id = given.pop("id")
        if not is_id(own_id):
            raise self._components.blamed(constellation, path, f"{own_id!r} is not an id; {ID_RULE}")
        self._identifier.claimed(own_id, path, settings.block)
        settings = evolve(settings, given=given, giver=constellation, other_keys=_FLEET_KEYS)
        choice = self._components.choice(_MODELS, constellation.model, path, settings)
        return SceneSensor(own_id, choice, constellation.name)


def _refuse_nameless(block: Mapping[str, Node], node: Node) -> None:
    """Reject a block without a model and a constellation."""
    for key, value in block.items():
        if nearest(key, _NAMING_KEYS):
            with under(key_step(key)):
                raise unknown_key(key, value, _NAMING_KEYS)
    raise node.refused("names neither a model nor a constellation")
