"""Where a scene describes light, from its nodes as written: `detection: auto` goes by it."""

from collections.abc import Iterator, Mapping
from typing import Any

from attrs import evolve, frozen

from opir_core.host.components import (
    CATALOGUE,
    Constellation,
    DetectionModel,
    SensorModel,
    TargetModel,
)
from opir_core.reading.component_reader import ComponentReader, is_written_out
from opir_core.reading.nodes import Node, index_step, key_step
from opir_core.reading.scene_schema import CHOICES, WITHOUT_LIGHT
from opir_core.scene.fields import BANDS, LIGHT, SOURCES, field_infos

_SUBJECTS = (BANDS, LIGHT, SOURCES)


@frozen
class Description:
    """A setting that describes light: its steps from the scene, and its node."""

    steps: tuple[str, ...]
    node: Node

    def under(self, *steps: str) -> "Description":
        """Return the description relative to a node further up."""
        return evolve(self, steps=(*steps, *self.steps))

    @property
    def path(self) -> str:
        """Return the scene path, `sensors[0].threshold_sigma`."""
        return "".join(self.steps).removeprefix(".")


class LightFinder:
    """Finds the settings of a scene that only a model which reads light reads; `nodes` are those of
    the scene.
    """

    def __init__(self, components: ComponentReader, nodes: Mapping[str, Any]) -> None:
        self._components = components
        self._nodes = {key: node for key, node in nodes.items() if isinstance(node, Node)}

    def first(self) -> Description | None:
        """Return the first setting that describes light, None if there is none."""
        return next(self._descriptions(), None)

    def _descriptions(self) -> Iterator[Description]:
        for key in ("atmosphere", "background", "classification", "confidence"):
            if key in self._nodes:
                yield from self._in_choice(key, self._nodes[key])
        if _items(self._nodes.get("sources")):
            yield Description((".sources",), self._nodes["sources"])
        for key, described in (("sensors", self._in_sensor), ("targets", self._in_target)):
            for index, item in enumerate(_items(self._nodes.get(key))):
                steps = key_step(key), index_step(index)
                yield from (description.under(*steps) for description in described(item))
        if "detection" in self._nodes:
            yield from self._in_detection(self._nodes["detection"])
        models = [self._model_of(_block(item)) for item in _items(self._nodes.get("sensors"))]
        if any(_has_preset_for_light(model, self._nodes.get("preset")) for model in models):
            yield Description((".preset",), self._nodes["preset"])

    def _in_choice(self, key: str, node: Node) -> Iterator[Description]:
        """Yield the light that a chosen component describes; the default of a scene describes none."""
        hook, default = CHOICES[key]
        block = _block(node)
        name = block.get("model", node).value
        if node.value is None or (name == default and len(block) <= 1):
            return
        kind = CATALOGUE[hook]
        is_light = getattr(kind, "subject_of_kind", "") in _SUBJECTS
        if is_light or getattr(self._component(hook, name), "described", "") in _SUBJECTS:
            yield Description((key_step(key),), node)

    def _in_sensor(self, node: Node) -> Iterator[Description]:
        block = _block(node)
        model = self._model_of(block)
        if model is None:
            yield from ()
        elif model.described in _SUBJECTS:
            yield Description((), node)
        else:
            if _has_preset_for_light(model, block.get("preset")):
                yield Description((".preset",), block["preset"])
            yield from _in_settings(model, block)
        for index, member in enumerate(_items(block.get("members"))):
            inside = self._in_sensor(member)
            yield from (description.under(".members", index_step(index)) for description in inside)

    def _model_of(self, block: Mapping[str, Node]) -> SensorModel | None:
        """Return the sensor model of a block, that of its constellation where it names one; None if
        unknown.
        """
        name = block["model"].value if "model" in block else None
        if "constellation" in block:
            name = getattr(
                self._component(Constellation.hook, block["constellation"].value), "model", None
            )
        return self._component(SensorModel.hook, name)

    def _in_target(self, node: Node) -> Iterator[Description]:
        block = _block(node)
        if "signature" in block:
            yield Description((".signature",), block["signature"])
        model = (
            self._component(TargetModel.hook, block["model"].value) if "model" in block else None
        )
        if model is not None:
            yield from _in_settings(model, block)

    def _in_detection(self, node: Node) -> Iterator[Description]:
        """Yield the settings of `detection: {model: auto}` that the model without light does not
        have.
        """
        model = self._component(DetectionModel.hook, WITHOUT_LIGHT)
        keys = ("model", *(field_infos(model.config) if model is not None else ()))
        for key, setting in _block(node).items():
            if key not in keys:
                yield Description((".detection", key_step(key)), setting)

    def _component(self, hook: str, name: object) -> Any:
        """Return a component, None if it is not there."""
        return self._components.offered(hook, name) if isinstance(name, str) and name else None


def _has_preset_for_light(model: SensorModel | None, preset: Node | None) -> bool:
    """Return whether a preset is the one that a sensor model has for light."""
    name = None if preset is None else preset.value
    return model is not None and name is not None and name == model.presets_for.get(LIGHT)


def _in_settings(model: Any, block: Mapping[str, Node]) -> Iterator[Description]:
    """Yield the settings of light that a block sets; none of a block that opir has written out."""
    if is_written_out(model.config, block):
        return
    for key, info in field_infos(model.config).items():
        if key in block and info.subject in _SUBJECTS:
            yield Description((key_step(key),), block[key])


def _items(node: Node | None) -> list[Node]:
    return node.value if node is not None and isinstance(node.value, list) else []


def _block(node: Node) -> dict[str, Node]:
    return node.value if isinstance(node.value, dict) else {}
