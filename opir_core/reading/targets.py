"""The targets and sources of a scene, and the forces in free flight: `kepler`, or zonal harmonics
and drag.
"""

import re
from collections.abc import Callable, Mapping, Sequence

from attrs import evolve

from opir_core.constants import ZONAL_FORCES
from opir_core.reading.component_reader import ComponentReader, Settings, component_name
from opir_core.reading.nodes import (
    MAXIMUM_ID_LENGTH,
    MAXIMUM_SOURCES,
    MAXIMUM_TARGETS,
    ErrorCollector,
    InvalidNode,
    Node,
    key_step,
    read_each,
    shown_text,
    under,
)
from opir_core.reading.scene_schema import DEFAULT_TARGET_MODEL
from opir_core.reading.structuring import (
    block_of,
    class_reader,
    items_of,
    nearest,
    read_text,
    refusal,
    required,
)
from opir_core.scene.scene import Choice, SceneDrag, SceneForces, SceneSource, SceneTarget
from opir_core.scene.target_classes import TargetClass

_ID = re.compile(rf"[A-Za-z0-9._:-]{{1,{MAXIMUM_ID_LENGTH}}}")


#: The rule for ids.
ID_RULE = f"ids have 1 to {MAXIMUM_ID_LENGTH} characters, of A to Z, a to z, 0 to 9 and ._:-"


class Identifier:
    """Reads blocks of `id`, `model` and settings of one kind; ids are unique."""

    def __init__(
        self,
        components: ComponentReader,
        hook: str,
        default_model: Callable[[Mapping[str, Node]], str] | None = None,
    ) -> None:
        self.components = components
        self.hook = hook
        #: Returns the model of a block without one.
        self._default_model = default_model
        self._homes: dict[str, str] = {}

    def identified(
        self, node: Node, path: str, other_keys: tuple[str, ...], choice_path: str
    ) -> tuple[str, Choice]:
        """Return a block's id and its model; `choice_path` is the path of the model in messages."""
        settings = dict(block_of(node, other_keys))
        collector = ErrorCollector()
        with collector.at(".id"):
            identifier = required(settings, "id", node)
            given_id = self.claimed(read_text(identifier), path, identifier)
        with collector.at():
            name = self._model(settings, node)
            choice = self.components.choice(
                self.hook, name, choice_path, Settings(node, settings, other_keys=other_keys)
            )
        collector.require_whole()
        return given_id, choice

    def claimed(self, text: str, path: str, node: Node) -> str:
        """Return and record the id of `path`; raises `InvalidNode` for an invalid id or a
        duplicate.
        """
        if not is_id(text):
            raise node.refused(f"{shown_text(text)} is not an id; {ID_RULE}")
        home = self._homes.setdefault(text, path)
        if home != path:
            raise node.refused(f"{text} is the id of {home} already")
        return text

    def _model(self, settings: dict[str, Node], node: Node) -> str:
        if "model" not in settings and self._default_model is not None:
            return self._default_model(settings)
        with under(".model"):
            return component_name(required(settings, "model", node))


def is_id(text: object) -> bool:
    """Return whether a value may be the id of a sensor or a target."""
    return isinstance(text, str) and _ID.fullmatch(text) is not None


KEPLER = "kepler"
_DRAG = "drag"
_KNOWN = (*ZONAL_FORCES, _DRAG)
_NEEDED = f"{KEPLER}, or a list of {', '.join(_KNOWN)}, is needed"
_ITEM_NEEDED = f"one of {', '.join(_KNOWN)}, or drag with its settings indented below it, is needed"


def read_forces(node: Node) -> SceneForces:
    """Return the forces of a node; raises `InvalidNode` with all that is wrong with it."""
    if node.value == KEPLER:
        return SceneForces()
    if not isinstance(node.value, list):
        hint = (
            f": write [{node.value}]"
            if isinstance(node.value, str) and node.value in _KNOWN
            else ""
        )
        raise refusal(node, f"{_NEEDED}{hint}")
    if not node.value:
        raise node.refused(f"this list is empty; for the point mass only, write {KEPLER}")
    forces = dict[str, SceneDrag | None]()

    def add(_index: int, item: Node) -> None:
        name, drag = _force(item)
        if name in forces:
            raise item.refused(f"{name} occurs twice")
        forces[name] = drag

    read_each(items_of(node), add)
    return SceneForces(tuple(name for name in ZONAL_FORCES if name in forces), forces.get(_DRAG))


def _force(node: Node) -> tuple[str, SceneDrag | None]:
    """Return an item's name, and its settings if it is drag."""
    if not isinstance(node.value, dict):
        return _named(node.value, node), SceneDrag() if node.value == _DRAG else None
    block = block_of(node)
    if len(block) != 1:
        raise refusal(node, _ITEM_NEEDED)
    ((key, settings),) = block.items()
    if _named(key, node) != _DRAG:
        raise node.refused(f"{key} has no settings: write {key} alone")
    with under(key_step(key)):
        return _DRAG, SceneDrag() if settings.value is None else class_reader(SceneDrag)(settings)


def _named(name: object, node: Node) -> str:
    if not isinstance(name, str):
        raise refusal(node, _ITEM_NEEDED)
    if name not in _KNOWN:
        raise _unknown(name, node)
    return name


def _unknown(name: str, node: Node) -> InvalidNode:
    if name == KEPLER:
        return node.refused(
            f"{KEPLER} is the point mass only: write it instead of the list, or leave it out"
        )
    similar = nearest(name, _KNOWN)
    return node.refused(
        f"there is no force {shown_text(name)}; {f'did you mean {similar}?' if similar else _ITEM_NEEDED}"
    )


_TARGET_KEYS = ("id", "model", "preset", "signature")
_SOURCE_KEYS = ("id", "model", "preset")


class TargetReader:
    """Reads the list of targets; `duration_s` is the scene's, None if unknown."""

    def __init__(self, components: ComponentReader, duration_s: float | None) -> None:
        self._components = components
        self._identifier = Identifier(components, "opir_target_models", self._default_model)
        self._duration_s = duration_s

    def targets(self, node: Node) -> tuple[SceneTarget, ...]:
        """Return all targets; there may be none."""
        items = items_of(node)
        if len(items) > MAXIMUM_TARGETS:
            raise node.refused(
                f"there are {len(items)} targets; at most {MAXIMUM_TARGETS} are read"
            )
        return tuple(read_each(items, lambda index, item: self._target(item, f"targets[{index}]")))

    def _target(self, node: Node, path: str) -> SceneTarget:
        block = dict(block_of(node, _TARGET_KEYS))
        collector = ErrorCollector()
        signature = None
        if "signature" in block:
            with collector.at(".signature"):
                named = block.pop("signature")
                signature = self._components.named(
                    "opir_signature_models", named, f"{path}.signature"
                )
        with collector.at():
            own_id, choice = self._identifier.identified(
                evolve(node, value=block), path, _TARGET_KEYS, path
            )
            self._refuse_late_launch(choice, node)
        collector.require_whole()
        return SceneTarget(own_id, choice, signature)

    def _default_model(self, settings: Mapping[str, Node]) -> str:
        """Return the model of a block without one: that of its target class, `ballistic` if the
        class is unknown.
        """
        kind = settings.get("type")
        if kind is None or kind.value not in self._components.names(TargetClass.hook):
            return DEFAULT_TARGET_MODEL
        try:
            target_class: TargetClass = self._components.component(
                TargetClass.hook, kind.value, "type"
            )
        except InvalidNode:
            return DEFAULT_TARGET_MODEL
        return target_class.after_burnout.model

    def _refuse_late_launch(self, choice: Choice, node: Node) -> None:
        """Reject a launch after the end of the scene, for models with `launch.time_s`."""
        time_s = getattr(getattr(choice.config, "launch", None), "time_s", None)
        if not isinstance(time_s, float) or self._duration_s is None or time_s < self._duration_s:
            return
        launch = node.value.get("launch", node)
        time = launch.value.get("time_s", launch)
        with under(".launch", ".time_s"):
            raise time.refused(
                f"{time_s!r} s is not before the scene's end at {self._duration_s!r} s"
            )


class SourceReader:
    """Reads the list of sources; `targets` are the scene's."""

    def __init__(self, components: ComponentReader, targets: Sequence[SceneTarget]) -> None:
        self._identifier = Identifier(components, "opir_source_models")
        self._target_ids = [target.id for target in targets]

    def sources(self, node: Node) -> tuple[SceneSource, ...]:
        """Return all blocks of sources."""
        items = items_of(node)
        if len(items) > MAXIMUM_SOURCES:
            raise node.refused(
                f"there are {len(items)} blocks of sources; at most {MAXIMUM_SOURCES} are read"
            )
        return tuple(read_each(items, lambda index, item: self._source(item, f"sources[{index}]")))

    def _source(self, node: Node, path: str) -> SceneSource:
        own_id, choice = self._identifier.identified(node, path, _SOURCE_KEYS, path)
        # An emitter of the block, `ID-7`, must not share the id of a target.
        for taken in self._target_ids:
            stem, dash, number = taken.rpartition("-")
            if taken == own_id or (stem == own_id and dash and number.isdecimal()):
                with under(".id"):
                    raise node.value["id"].refused(
                        f"the target {taken} has an id of this source's emitters"
                    )
        return SceneSource(own_id, choice)
