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

_HOMES = {
    "AscendingTargets": "doubles",
    "AtmosphereContract": "contracts.atmospheres_and_backgrounds",
    "BackgroundContract": "contracts.atmospheres_and_backgrounds",
    "Broken": "contracts.contract",
    "CertainDetection": "doubles",
    "ClassifierContract": "contracts.confidence_and_classifiers",
    "ConfidenceContract": "contracts.confidence_and_classifiers",
    "ConstellationContract": "contracts.sensors",
    "Contract": "contracts.contract",
    "CountingTracker": "doubles",
    "DetectionContract": "contracts.detection",
    "EncoderContract": "contracts.outputs",
    "FullConfidence": "doubles",
    "NoAnswer": "doubles",
    "SceneContract": "contracts.scenes",
    "SensorContract": "contracts.sensors",
    "SignatureContract": "contracts.emitters",
    "SilentTracker": "doubles",
    "SinkContract": "contracts.outputs",
    "SourceContract": "contracts.emitters",
    "TargetContract": "contracts.targets",
    "TrackerContract": "contracts.trackers",
    "insist": "contracts.contract",
    "stub_estimates": "doubles",
    "stub_plan": "doubles",
    "stub_scene": "doubles",
    "stub_sensor": "doubles",
    "stub_window": "doubles",
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
    home = _HOMES.get(name)
    if home is None:
        raise AttributeError(f"module 'opir_core.testing' has no attribute {name!r}")
    return getattr(import_module(f"opir_core.testing.{home}"), name)


def __dir__() -> list[str]:
    return __all__
