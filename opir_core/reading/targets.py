"""The targets of a scene."""

from opir_core.reading.choosing import Chooser
from opir_core.reading.heading import DEFAULT_TARGET_MODEL
from opir_core.reading.identifying import Identifier
from opir_core.reading.limits import MAXIMUM_TARGETS
from opir_core.reading.nodes import Gathering, Node, index_step, under
from opir_core.reading.readers import items_of
from opir_core.scene import Choice, SceneTarget

_TARGET_KEYS = ("id", "model", "preset")


class TargetReader:
    """Reads the list of targets; `duration_s` is the scene's, where it is known."""

    def __init__(self, chooser: Chooser, duration_s: float | None) -> None:
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
                own_id, choice = self._identifier.identified(item, path, _TARGET_KEYS, path)
                self._refuse_late_launch(choice, item)
                targets.append(SceneTarget(own_id, choice))
        gathering.require_whole()
        return tuple(targets)

    def _refuse_late_launch(self, choice: Choice, node: Node) -> None:
        """Refuse a launch that the scene does not reach; models say `launch.time_s` where they have one."""
        time_s = getattr(getattr(choice.config, "launch", None), "time_s", None)
        if not isinstance(time_s, float) or self._duration_s is None or time_s < self._duration_s:
            return
        launch = node.value.get("launch", node)
        time = launch.value.get("time_s", launch)
        with under(".launch", ".time_s"):
            raise time.refused(f"{time_s!r} s is not before the scene's end at {self._duration_s!r} s")
