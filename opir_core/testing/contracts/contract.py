"""The base class of conformance tests, and the error that a failed one raises."""

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any, ClassVar

from opir_core.plugin.components import Component
from opir_core.plugin.host import Host
from opir_core.scene.reading.nodes import InvalidNode, Node
from opir_core.scene.reading.plain_data import node_of_data
from opir_core.scene.reading.structuring import class_reader
from opir_core.testing.bench import BenchRun, bench_host, bench_run


class ConformanceError(AssertionError):
    """A requirement that a component does not meet: `seen` is the observation, `change` the remedy."""

    def __init__(self, seen: str, change: str) -> None:
        self.seen = seen
        self.change = change
        super().__init__(f"{seen}\n{change}")


def require(condition: object, seen: str, change: str) -> None:
    """Raise `ConformanceError` with the observation and the remedy unless a condition holds."""
    if not condition:
        raise ConformanceError(seen, change)


class Contract:
    """The conformance tests of a kind of component.

    Inherit the class of your kind in a test file and set the component's `name`:

        class TestMySensor(SensorContract):
            name = "my-sensor"
            settings = {"scan_period_ms": 50.0}

    `settings` is its block in a scene. `plugins` are the modules of plugins that are not installed.
    `expected_failures` maps tests that it fails to reasons; such a test must fail. The docstring of a test is the
    requirement; a component that does not meet it raises `ConformanceError`. `opir check` runs the same methods
    without pytest.
    """

    kind: ClassVar[type[Component]]
    name: ClassVar[str] = ""
    settings: ClassVar[Mapping[str, Any]] = {}
    plugins: ClassVar[Sequence[str]] = ()
    expected_failures: ClassVar[Mapping[str, str]] = {}

    @classmethod
    @cache
    def host(cls) -> Host:
        """Return the plugin host with the component."""
        return bench_host(cls.plugins)

    @classmethod
    def component(cls) -> Any:
        """Return the component."""
        return cls.host().component(cls.kind, cls.name)

    @classmethod
    def config(cls, **settings: Any) -> Any:
        """Return the component's configuration as read from a scene, with additional settings."""
        return read_config(cls.component(), {**cls.block(), **settings})

    @classmethod
    def block(cls) -> Mapping[str, Any]:
        """Return the settings that the component is tested with."""
        return cls.settings

    @classmethod
    def scene(cls, **changes: Any) -> dict[str, Any]:
        """Return the test scene with the component; `changes` replace keys."""
        raise NotImplementedError

    @classmethod
    @cache
    def run(cls) -> BenchRun:
        """Return the run of the scene, computed once."""
        return cls.run_of(cls.scene())

    @classmethod
    def run_of(cls, scene: Mapping[str, Any], **options: Any) -> BenchRun:
        """Return the run of a scene."""
        return bench_run(scene, cls.host(), **options)


def read_config(component: Any, settings: Mapping[str, Any]) -> Any:
    """Return a component's configuration, read as from a scene; raises `ConformanceError` if invalid."""
    try:
        preset = component.presets.get(settings.get("preset"), {})
        written = {key: value for key, value in settings.items() if key != "preset"}
        node: Node = node_of_data({**preset, **written})
        return class_reader(component.config)(node)
    except InvalidNode as refused:
        problems = "; ".join(
            f"{complaint.path.lstrip('.')}: {complaint.message}".removeprefix(": ") for complaint in refused.complaints
        )
        raise ConformanceError(
            f"{component.kind} {component.name} rejects its settings: {problems}",
            "Give the contract settings = {...} (opir check: --set key=value), or the fields valid defaults.",
        ) from refused


def test_names(contract: type[Contract]) -> list[str]:
    """Return the names of a contract's tests, those of its parents first."""
    names: dict[str, None] = {}
    for parent in reversed(contract.__mro__):
        names |= dict.fromkeys(name for name in vars(parent) if name.startswith("test_"))
    return list(names)


def requirement(contract: type[Contract], test: str) -> str:
    """Return the requirement that a test checks, in one line."""
    return (getattr(contract, test).__doc__ or test).strip().splitlines()[0]


# pytest collects functions by this prefix, also where they are imported.
test_names.__test__ = False  # type: ignore[attr-defined]
