"""For plugin authors: contracts to inherit, doubles of the parts a component works with, and a pytest plugin.

Each name is imported when it is first used, so the pytest plugin costs nothing where no contract is tested.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from opir_core.testing.contracts.atmospheres_and_backgrounds import AtmosphereContract, BackgroundContract
    from opir_core.testing.contracts.confidence_and_classifiers import ClassifierContract, ConfidenceContract
    from opir_core.testing.contracts.contract import Broken, Contract, insist
    from opir_core.testing.contracts.detection import DetectionContract
    from opir_core.testing.contracts.emitters import SignatureContract, SourceContract
    from opir_core.testing.contracts.outputs import EncoderContract, SinkContract
    from opir_core.testing.contracts.scenes import SceneContract
    from opir_core.testing.contracts.sensors import ConstellationContract, SensorContract
    from opir_core.testing.contracts.targets import TargetContract
    from opir_core.testing.contracts.trackers import TrackerContract
    from opir_core.testing.doubles import (
        AscendingTargets,
        CertainDetection,
        CountingTracker,
        FullConfidence,
        NoAnswer,
        SilentTracker,
        stub_estimates,
        stub_plan,
        stub_scene,
        stub_sensor,
        stub_window,
    )

#: The module of each name, by which it is imported when it is first used.
_HOMES = {
    "contracts.atmospheres_and_backgrounds": "AtmosphereContract BackgroundContract",
    "contracts.confidence_and_classifiers": "ClassifierContract ConfidenceContract",
    "contracts.contract": "Broken Contract insist",
    "contracts.detection": "DetectionContract",
    "contracts.emitters": "SignatureContract SourceContract",
    "contracts.outputs": "EncoderContract SinkContract",
    "contracts.scenes": "SceneContract",
    "contracts.sensors": "ConstellationContract SensorContract",
    "contracts.targets": "TargetContract",
    "contracts.trackers": "TrackerContract",
    "doubles": (
        "AscendingTargets CertainDetection CountingTracker FullConfidence NoAnswer SilentTracker "
        "stub_estimates stub_plan stub_scene stub_sensor stub_window"
    ),
}

__all__ = [
    "AscendingTargets",
    "AtmosphereContract",
    "BackgroundContract",
    "Broken",
    "CertainDetection",
    "ClassifierContract",
    "ConfidenceContract",
    "ConstellationContract",
    "Contract",
    "CountingTracker",
    "DetectionContract",
    "EncoderContract",
    "FullConfidence",
    "NoAnswer",
    "SceneContract",
    "SensorContract",
    "SignatureContract",
    "SilentTracker",
    "SinkContract",
    "SourceContract",
    "TargetContract",
    "TrackerContract",
    "insist",
    "stub_estimates",
    "stub_plan",
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
