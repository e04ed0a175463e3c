"""Nodes to a scene: every part is read, so that all errors are reported at once."""

from typing import Any

from attrs import evolve

from opir_core.plugin.host import Host
from opir_core.scene.reading.component_reader import ComponentReader, Settings
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


class SceneBuilder:
    """Reads one scene; `collector` has what is wrong with it, `components.failures` what is wrong with plugins."""

    def __init__(self, host: Host) -> None:
        self.collector = ErrorCollector()
        self.components = ComponentReader(host)

    def scene(self, root: Node) -> Scene | None:
        """Return the scene, or None if there are errors."""
        values: dict[str, Any] = {}
        with self.collector.at():
            values = class_reader(SceneFile).values(root, self.collector, home=self.components.home_elsewhere)
        parts = self._parts(values)
        if not self.collector.is_whole or self.components.failures:
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
        """Return the parts of the scene, read from its blocks."""
        parts: dict[str, Any] = {"targets": (), "sources": (), "outputs": ()}
        if values.get("forces") is not None:
            with self.collector.at(key_step("forces")):
                parts["forces"] = read_forces(values["forces"])
        lists = {
            "sensors": SensorReader(self.components).sensors,
            "targets": TargetReader(self.components, values.get("duration_s")).targets,
            "sources": lambda node: SourceReader(self.components, parts["targets"]).sources(node),
            "outputs": self._outputs,
        }
        for key, read in lists.items():
            if key in values:
                with self.collector.at(key_step(key)):
                    parts[key] = read(values[key])
        for key, (hook, default) in CHOICES.items():
            with self.collector.at(key_step(key)):
                parts[key] = self._model(hook, values.get(key), key, default)
        return parts

    def _model(self, hook: str, node: Node | None, key: str, default: str) -> Choice:
        if node is None:
            return self.components.choice(hook, default, key, Settings(Node({})))
        return self.components.named(hook, node, key)

    def _outputs(self, node: Node) -> tuple[Choice, ...]:
        collector, outputs = ErrorCollector(), list[Choice]()
        for index, item in enumerate(items_of(node)):
            with collector.at(index_step(index)):
                choice = self._output(item, f"outputs[{index}]")
                self._require_encoder(choice)
                _require_own_place(item, choice, outputs)
                outputs.append(choice)
        collector.require_whole()
        return tuple(outputs)

    def _output(self, node: Node, path: str) -> Choice:
        if isinstance(node.value, str):
            return self.components.named(_SINKS, node, path)
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
            collector = ErrorCollector()
            with collector.at():
                chosen = Settings(node, settings, other_keys=("preset", "spool"))
                choice = self.components.choice(_SINKS, name, path, chosen)
            with collector.at():
                spool = {key: _spool_settings(block) for key, block in spooled.items()}
            collector.require_whole()
            return evolve(choice, **spool)

    def _require_encoder(self, choice: Choice) -> None:
        """Look up the encoder of a sink, so that a missing one is reported with the other errors."""
        name = getattr(choice.config, "encoder", None)
        if isinstance(name, str):
            self.components.component(_ENCODERS, name, f"{choice.path}.encoder")


def _spool_settings(node: Node) -> Any:
    with under(key_step("spool")):
        return class_reader(SpoolConfig)(node)


def _require_own_place(item: Node, choice: Choice, others: list[Choice]) -> None:
    """Reject an output that writes to the path of another."""
    path = getattr(choice.config, "path", None)
    for other in others:
        if path is not None and other.name == choice.name and getattr(other.config, "path", None) == path:
            raise item.refused(f"{other.path} writes to {path!r} already")
