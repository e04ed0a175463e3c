"""Nodes to a scene: each part is read to its end, so that all that is wrong is told at once."""

from typing import Any

from attrs import evolve

from opir_core.plugin.host import Host
from opir_core.scene.reading.component_reader import Chooser, Settings
from opir_core.scene.reading.nodes import ErrorCollector, Node, index_step, key_step, under
from opir_core.scene.reading.scene_schema import CHOICES, SceneFile, epoch_us_of_text
from opir_core.scene.reading.sensors import SensorReader
from opir_core.scene.reading.structuring import block_of, class_reader, items_of, refusal
from opir_core.scene.reading.targets import SourceReader, TargetReader, read_forces
from opir_core.scene.scene import Choice, Scene, SpoolConfig

_SINKS = "opir_sinks"
_ENCODERS = "opir_event_encoders"
_FEW_KEYS = 8
_OUTPUT_NEEDED = "a sink's name, or one name with its settings indented below it, is needed"


class Assembler:
    """Reads one scene; `gathering` has what is wrong with it, `chooser.failures` what is wrong with plugins."""

    def __init__(self, host: Host) -> None:
        self.gathering = ErrorCollector()
        self.chooser = Chooser(host)

    def scene(self, root: Node) -> Scene | None:
        """Return the scene, or None where something is wrong."""
        values: dict[str, Any] = {}
        with self.gathering.at():
            values = class_reader(SceneFile).values(root, self.gathering, home=self.chooser.home_elsewhere)
        parts = self._parts(values)
        if not self.gathering.is_whole or self.chooser.failures:
            return None
        file = SceneFile(**values)
        return Scene(
            name=file.scene,
            epoch_us=epoch_us_of_text(file.epoch),
            duration_s=file.duration_s,
            seed=file.seed,
            light_time=file.light_time,
            **parts,
        )

    def _parts(self, values: dict[str, Any]) -> dict[str, Any]:
        """Return the parts of the scene that its blocks come to."""
        parts: dict[str, Any] = {"targets": (), "sources": (), "outputs": ()}
        if values.get("forces") is not None:
            with self.gathering.at(key_step("forces")):
                parts["forces"] = read_forces(values["forces"])
        lists = {
            "sensors": SensorReader(self.chooser).sensors,
            "targets": TargetReader(self.chooser, values.get("duration_s")).targets,
            "sources": lambda node: SourceReader(self.chooser, parts["targets"]).sources(node),
            "outputs": self._outputs,
        }
        for key, read in lists.items():
            if key in values:
                with self.gathering.at(key_step(key)):
                    parts[key] = read(values[key])
        for key, (hook, default) in CHOICES.items():
            with self.gathering.at(key_step(key)):
                parts[key] = self._model(hook, values.get(key), key, default)
        return parts

    def _model(self, hook: str, node: Node | None, key: str, default: str) -> Choice:
        if node is None:
            return self.chooser.choice(hook, default, key, Settings(Node({})))
        return self.chooser.named(hook, node, key)

    def _outputs(self, node: Node) -> tuple[Choice, ...]:
        gathering, outputs = ErrorCollector(), list[Choice]()
        for index, item in enumerate(items_of(node)):
            with gathering.at(index_step(index)):
                choice = self._output(item, f"outputs[{index}]")
                self._require_encoder(choice)
                _require_own_place(item, choice, outputs)
                outputs.append(choice)
        gathering.require_whole()
        return tuple(outputs)

    def _output(self, node: Node, path: str) -> Choice:
        if isinstance(node.value, str):
            return self.chooser.named(_SINKS, node, path)
        if not isinstance(node.value, dict):
            raise refusal(node, _OUTPUT_NEEDED)
        block = block_of(node)
        if len(block) != 1:
            keys = f" has the keys {', '.join(block)}" if 0 < len(block) <= _FEW_KEYS else f" has {len(block)} keys"
            raise node.refused(f"this block{keys}; {_OUTPUT_NEEDED}")
        ((name, node),) = block.items()
        with under(key_step(name)):
            settings = {} if node.value is None else dict(block_of(node))
            spooled = {"spool": settings.pop("spool")} if "spool" in settings else {}
            gathering = ErrorCollector()
            with gathering.at():
                chosen = Settings(node, settings, other_keys=("preset", "spool"))
                choice = self.chooser.choice(_SINKS, name, path, chosen)
            with gathering.at():
                spool = {key: _spool_settings(block) for key, block in spooled.items()}
            gathering.require_whole()
            return evolve(choice, **spool)

    def _require_encoder(self, choice: Choice) -> None:
        """Look up the encoder that a sink's settings name, so that one that is missing is told with the others."""
        name = getattr(choice.config, "encoder", None)
        if isinstance(name, str):
            self.chooser.component(_ENCODERS, name, f"{choice.path}.encoder")


def _spool_settings(node: Node) -> Any:
    with under(key_step("spool")):
        return class_reader(SpoolConfig)(node)


def _require_own_place(item: Node, choice: Choice, others: list[Choice]) -> None:
    """Refuse an output that writes where another one does."""
    path = getattr(choice.config, "path", None)
    for other in others:
        if path is not None and other.name == choice.name and getattr(other.config, "path", None) == path:
            raise item.refused(f"{other.path} writes to {path!r} already")
