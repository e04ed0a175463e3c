"""A contract: the component it is about, and what all its tests start from.

The verdict of a contract's test: what a component does, and what to change.
"""

from collections.abc import Mapping, Sequence
from functools import cache
from typing import Any, ClassVar

from opir_core.plugin.components import Component
from opir_core.plugin.host import Host
from opir_core.scene.reading.nodes import InvalidNode, Node
from opir_core.scene.reading.plain_data import node_of_data
from opir_core.scene.reading.structuring import class_reader
from opir_core.testing.bench import BenchRun, bench_host, bench_run


class Broken(AssertionError):  # noqa: N818 - a verdict, as pytest.Failed
    """A promise that a component does not keep; `seen` says what was seen, `change` what to change."""

    def __init__(self, seen: str, change: str) -> None:
        self.seen = seen
        self.change = change
        super().__init__(f"{seen}\n{change}")


def insist(kept: object, seen: str, change: str) -> None:
    """Raise `Broken` unless a promise is kept."""
    if not kept:
        raise Broken(seen, change)


class Contract:
    """The tests that every component of a kind passes.

    Inherit the contract of your kind in a test file and give the component's `name`:

        class TestMySensor(SensorContract):
            name = "my-sensor"
            settings = {"scan_period_ms": 50.0}

    `settings` is its block in a scene. `plugins` are names of modules that hold plugins which are not installed.
    `expected_failures` are tests that it fails, each with a reason; one that passes all the same is a failure.
    A test's docstring is its promise; what breaks one is raised as `Broken`, with what to change. No test needs pytest:
    `opir check` runs the same methods.
    """

    kind: ClassVar[type[Component]]
    name: ClassVar[str] = ""
    settings: ClassVar[Mapping[str, Any]] = {}
    plugins: ClassVar[Sequence[str]] = ()
    expected_failures: ClassVar[Mapping[str, str]] = {}

    @classmethod
    @cache
    def host(cls) -> Host:
        """Return the host that has the component."""
        return bench_host(cls.plugins)

    @classmethod
    def component(cls) -> Any:
        """Return the component."""
        return cls.host().component(cls.kind, cls.name)

    @classmethod
    def config(cls, **settings: Any) -> Any:
        """Return the component's configuration as a scene would read it, with more settings."""
        return read_config(cls.component(), {**cls.block(), **settings})

    @classmethod
    def block(cls) -> Mapping[str, Any]:
        """Return the settings that the component is tested with."""
        return cls.settings

    @classmethod
    def scene(cls, **changes: Any) -> dict[str, Any]:
        """Return the bench's scene with the component in it; `changes` replace keys."""
        raise NotImplementedError

    @classmethod
    @cache
    def run(cls) -> BenchRun:
        """Return the run of the scene, made once."""
        return cls.run_of(cls.scene())

    @classmethod
    def run_of(cls, scene: Mapping[str, Any], **how: Any) -> BenchRun:
        """Return the run of any scene."""
        return bench_run(scene, cls.host(), **how)


def read_config(component: Any, settings: Mapping[str, Any]) -> Any:
    """Return a component's configuration, read as from a scene; raises `Broken` where its own settings do not fit."""
    try:
        preset = component.presets.get(settings.get("preset"), {})
        written = {key: value for key, value in settings.items() if key != "preset"}
        node: Node = node_of_data({**preset, **written})
        return class_reader(component.config)(node)
    except InvalidNode as refused:
        told = "; ".join(
            f"{complaint.path.lstrip('.')}: {complaint.message}".removeprefix(": ") for complaint in refused.complaints
        )
        raise Broken(
            f"{component.kind} {component.name} does not read its settings: {told}",
            "Give the contract settings = {...} (opir check: --set key=value), or the fields lawful defaults.",
        ) from refused


def test_names(contract: type[Contract]) -> list[str]:
    """Return the names of a contract's tests, those of its parents first."""
    names: dict[str, None] = {}
    for parent in reversed(contract.__mro__):
        names |= dict.fromkeys(name for name in vars(parent) if name.startswith("test_"))
    return list(names)


def promise(contract: type[Contract], test: str) -> str:
    """Return what a test promises, in one line."""
    return (getattr(contract, test).__doc__ or test).strip().splitlines()[0]


# pytest collects functions by this prefix, also where they are imported.
test_names.__test__ = False  # type: ignore[attr-defined]
