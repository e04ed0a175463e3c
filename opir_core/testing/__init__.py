"""For plugin authors: doubles of the parts a component works with."""

from opir_core.testing.doubles import (
    AscendingTargets,
    CertainDetection,
    CountingTracker,
    FullConfidence,
    NoAnswer,
    SilentTracker,
    stub_plan,
    stub_scene,
    stub_sensor,
)

__all__ = [
    "AscendingTargets",
    "CertainDetection",
    "CountingTracker",
    "FullConfidence",
    "NoAnswer",
    "SilentTracker",
    "stub_plan",
    "stub_scene",
    "stub_sensor",
]
