"""For plugin authors: conformance tests to inherit, test doubles, and a pytest plugin.

Each name is imported when it is first used, so that the pytest plugin is cheap without conformance tests.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from opir_core.testing.contracts.confidence_and_classifiers import ClassifierContract, ConfidenceContract
    from opir_core.testing.contracts.contract import ConformanceError, Contract, require
    from opir_core.testing.contracts.detection import DetectionContract
    from opir_core.testing.contracts.outputs import EncoderContract, SinkContract
    from opir_core.testing.contracts.radiometry import (
        AtmosphereContract,
        BackgroundContract,
        SignatureContract,
        SourceContract,
    )
    from opir_core.testing.contracts.renderers import RendererContract
    from opir_core.testing.contracts.results import (
        ExecutorContract,
        ExporterContract,
        MetricContract,
        RunViewContract,
    )
    from opir_core.testing.contracts.scenes import SceneContract
    from opir_core.testing.contracts.sensors import ConstellationContract, SensorContract
    from opir_core.testing.contracts.target_classes import TargetClassContract
    from opir_core.testing.contracts.targets import TargetContract
    from opir_core.testing.contracts.trackers import TrackerContract
    from opir_core.testing.doubles import (
        CertainDetection,
        CountingTracker,
        FullConfidence,
        SilentTracker,
        UnknownClassifier,
        VerticalTargets,
        stub_estimates,
        stub_plan,
        stub_regions,
        stub_scene,
        stub_sensor,
        stub_window,
    )

#: The module of each name, by which it is imported when it is first used.
_HOMES = {
    "contracts.confidence_and_classifiers": "ClassifierContract ConfidenceContract",
    "contracts.contract": "ConformanceError Contract require",
    "contracts.detection": "DetectionContract",
    "contracts.outputs": "EncoderContract SinkContract",
    "contracts.radiometry": "AtmosphereContract BackgroundContract SignatureContract SourceContract",
    "contracts.renderers": "RendererContract",
    "contracts.results": "ExecutorContract ExporterContract MetricContract RunViewContract",
    "contracts.scenes": "SceneContract",
    "contracts.sensors": "ConstellationContract SensorContract",
    "contracts.target_classes": "TargetClassContract",
    "contracts.targets": "TargetContract",
    "contracts.trackers": "TrackerContract",
    "doubles": (
        "CertainDetection CountingTracker FullConfidence SilentTracker UnknownClassifier VerticalTargets "
        "stub_estimates stub_plan stub_regions stub_scene stub_sensor stub_window"
    ),
}

__all__ = [
    "AtmosphereContract",
    "BackgroundContract",
    "CertainDetection",
    "ClassifierContract",
    "ConfidenceContract",
    "ConformanceError",
    "ConstellationContract",
    "Contract",
    "CountingTracker",
    "DetectionContract",
    "EncoderContract",
    "ExecutorContract",
    "ExporterContract",
    "FullConfidence",
    "MetricContract",
    "RendererContract",
    "RunViewContract",
    "SceneContract",
    "SensorContract",
    "SignatureContract",
    "SilentTracker",
    "SinkContract",
    "SourceContract",
    "TargetClassContract",
    "TargetContract",
    "TrackerContract",
    "UnknownClassifier",
    "VerticalTargets",
    "require",
    "stub_estimates",
    "stub_plan",
    "stub_regions",
    "stub_scene",
    "stub_sensor",
    "stub_window",
]


def __getattr__(name: str) -> Any:
    for home, names in _HOMES.items():
        if name in names.split():
            value = globals()[name] = getattr(import_module(f"opir_core.testing.{home}"), name)
            return value
    raise AttributeError(f"module 'opir_core.testing' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
