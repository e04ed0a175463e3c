"""The targets of a scene, and the sources beside them that are no targets."""

from collections.abc import Sequence

from attrs import evolve

from opir_core.reading.choosing import Chooser
from opir_core.reading.heading import DEFAULT_TARGET_MODEL
from opir_core.reading.identifying import Identifier
from opir_core.reading.limits import MAXIMUM_SOURCES, MAXIMUM_TARGETS
from opir_core.reading.nodes import Gathering, Node, index_step, under
from opir_core.reading.readers import block_of, items_of
from opir_core.scene import Choice, SceneSource, SceneTarget

_TARGET_KEYS = ("id", "model", "preset", "signature")
_SOURCE_KEYS = ("id", "model", "preset")


class TargetReader:
    """Reads the list of targets; `duration_s` is the scene's, where it is known."""

    def __init__(self, chooser: Chooser, duration_s: float | None) -> None:
        self._chooser = chooser
        self._identifier = Identifier(chooser, "opir_target_models", DEFAULT_TARGET_MODEL)
        self._duration_s = duration_s

    def targets(self, node: Node) -> tuple[SceneTarget, ...]:
        """Return all targets; there may be none."""
        items = items_of(node)
        if len(items) > MAXIMUM_TARGETS:
            raise node.refused(f"there are {len(items)} targets; at most {MAXIMUM_TARGETS} are read")
        gathering, targets = Gathering(), list[SceneTarget]()
        for index, item in enumerate(items):
            with gathering.at(index_step(index)):
                path = f"targets[{index}]"
                targets.append(self._target(item, path))
        gathering.require_whole()
        return tuple(targets)

    def _target(self, node: Node, path: str) -> SceneTarget:
        block = dict(block_of(node, _TARGET_KEYS))
        gathering, signature = Gathering(), None
        if "signature" in block:
            with gathering.at(".signature"):
                named = block.pop("signature")
                signature = self._chooser.named("opir_signature_models", named, f"{path}.signature")
        with gathering.at():
            own_id, choice = self._identifier.identified(evolve(node, value=block), path, _TARGET_KEYS, path)
            self._refuse_late_launch(choice, node)
        gathering.require_whole()
        return SceneTarget(own_id, choice, signature)

    def _refuse_late_launch(self, choice: Choice, node: Node) -> None:
        """Refuse a launch that the scene does not reach; models say `launch.time_s` where they have one."""
        time_s = getattr(getattr(choice.config, "launch", None), "time_s", None)
        if not isinstance(time_s, float) or self._duration_s is None or time_s < self._duration_s:
            return
        launch = node.value.get("launch", node)
        time = launch.value.get("time_s", launch)
        with under(".launch", ".time_s"):
            raise time.refused(f"{time_s!r} s is not before the scene's end at {self._duration_s!r} s")


class SourceReader:
    """Reads the list of sources; `targets` are the scene's."""

    def __init__(self, chooser: Chooser, targets: Sequence[SceneTarget]) -> None:
        self._identifier = Identifier(chooser, "opir_source_models")
        self._target_ids = [target.id for target in targets]

    def sources(self, node: Node) -> tuple[SceneSource, ...]:
        """Return all blocks of sources."""
        items = items_of(node)
        if len(items) > MAXIMUM_SOURCES:
            raise node.refused(f"there are {len(items)} blocks of sources; at most {MAXIMUM_SOURCES} are read")
        gathering, sources = Gathering(), list[SceneSource]()
        for index, item in enumerate(items):
            with gathering.at(index_step(index)):
                path = f"sources[{index}]"
                own_id, choice = self._identifier.identified(item, path, _SOURCE_KEYS, path)
                self._refuse_taken(own_id, item)
                sources.append(SceneSource(own_id, choice))
        gathering.require_whole()
        return tuple(sources)

    def _refuse_taken(self, own_id: str, node: Node) -> None:
        """Refuse an id that an emitter of the block, `ID-7`, would share with a target."""
        for taken in self._target_ids:
            stem, dash, number = taken.rpartition("-")
            if taken == own_id or (stem == own_id and dash and number.isdecimal()):
                with under(".id"):
                    raise node.value["id"].refused(f"the target {taken} has an id of this source's emitters")
