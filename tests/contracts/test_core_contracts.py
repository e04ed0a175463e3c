"""The core's own components keep the contracts of their kinds."""

from collections.abc import Mapping
from typing import Any, ClassVar

from opir_core.testing import (
    AtmosphereContract,
    BackgroundContract,
    ClassifierContract,
    ConfidenceContract,
    DetectionContract,
    EncoderContract,
    SensorContract,
    SignatureContract,
    SinkContract,
    TargetContract,
    TrackerContract,
)


class TestGenericScanner(SensorContract):
    name = "generic-scanner"
    settings: ClassVar[Mapping[str, Any]] = {"scan_pattern": "step-stare", "scan_phase": "swept"}


class TestConstantDetection(DetectionContract):
    name = "constant"
    settings: ClassVar[Mapping[str, Any]] = {"band_confirmation": 0.5}


class TestCertainDetection(DetectionContract):
    name = "always"


class TestNoDetection(DetectionContract):
    name = "never"


class TestWeightedConfidence(ConfidenceContract):
    name = "weighted"


class TestFullConfidence(ConfidenceContract):
    name = "always"


class TestNoConfidence(ConfidenceContract):
    name = "never"


class TestConfusionClassifier(ClassifierContract):
    name = "paper"


class TestTrueType(ClassifierContract):
    name = "always"


class TestNoAnswer(ClassifierContract):
    name = "none"


class TestNeverAnAnswer(ClassifierContract):
    name = "never"


class TestNoTracker(TrackerContract):
    name = "none"


class TestBallisticTargets(TargetContract):
    name = "ballistic"


class TestClearAtmosphere(AtmosphereContract):
    name = "clear"


class TestNoBackground(BackgroundContract):
    name = "none"


class TestForgeEncoder(EncoderContract):
    name = "forge"


class TestJsonLines(SinkContract):
    name = "jsonl"


class TestMemory(SinkContract):
    name = "memory"


class TestNowhere(SinkContract):
    name = "null"


class TestPlume(SignatureContract):
    name = "plume"
