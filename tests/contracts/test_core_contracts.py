"""The core's own components keep the contracts of their kinds."""

from collections.abc import Mapping
from typing import Any, ClassVar

import pytest
from opir_testing import (
    AtmosphereContract,
    BackgroundContract,
    ClassifierContract,
    ConfidenceContract,
    DetectionContract,
    DirectorContract,
    EncoderContract,
    RendererContract,
    SensorContract,
    SignatureContract,
    SinkContract,
    SourceContract,
    TargetContract,
    TrackerContract,
)
from opir_testing.bench import TARGETS

from opir_core.plugin import Band


class TestGenericScanner(SensorContract):
    name = "generic-scanner"
    settings: ClassVar[Mapping[str, Any]] = {"scan_pattern": "step-stare", "scan_phase": "swept"}


class TestGenericScannerWithReportingLatency(SensorContract):
    name = "generic-scanner"
    settings: ClassVar[Mapping[str, Any]] = {
        "reporting": {"downlink": {"mean_s": 3.0, "sigma_s": 2.0}}
    }


class TestGenericPointed(SensorContract):
    name = "generic-pointed"


class TestCue(DirectorContract):
    name = "cue"


class TestInformation(DirectorContract):
    name = "information"


class TestOperator(DirectorContract):
    name = "operator"


class TestRoundRobin(DirectorContract):
    name = "round-robin"
    settings: ClassVar[Mapping[str, Any]] = {"places_deg": [[34.7, -120.6], [10.0, 180.0]]}


class TestConstantDetection(DetectionContract):
    name = "constant"
    settings: ClassVar[Mapping[str, Any]] = {"band_confirmation": 0.5}


class TestSnrDetection(DetectionContract):
    name = "snr"


@pytest.mark.slow
class TestSnrDetectionOfEveryLook(DetectionContract):
    name = "snr"
    settings: ClassVar[Mapping[str, Any]] = {"exact": True, "calibrate": "paper"}


class TestCertainDetection(DetectionContract):
    name = "always"


class TestNoDetection(DetectionContract):
    name = "never"


class TestWeightedConfidence(ConfidenceContract):
    name = "weighted"


@pytest.mark.slow
class TestPosteriorConfidence(ConfidenceContract):
    name = "posterior"


class TestFullConfidence(ConfidenceContract):
    name = "always"


class TestNoConfidence(ConfidenceContract):
    name = "never"


class TestConfusionClassifier(ClassifierContract):
    name = "paper"


@pytest.mark.slow
class TestSpectralClassifier(ClassifierContract):
    name = "spectral"
    settings: ClassVar[Mapping[str, Any]] = {"launches": 8}


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


def _as_class(name: str, *keys: str) -> tuple[Mapping[str, Any], ...]:
    """Return the launches of the test scene with another class and these keys."""
    return tuple({**{key: launch[key] for key in keys}, "type": name} for launch in TARGETS)


class TestOrbitTargets(TargetContract):
    name = "orbit"
    launches = _as_class("SLV", "id", "launch")
    settings: ClassVar[Mapping[str, Any]] = {"azimuth_deg": 77.0, "followed_s": 1500.0}


class TestGlideTargets(TargetContract):
    name = "glide"
    launches = tuple(
        {**launch, "aim": aim}
        for launch, aim in zip(
            _as_class("HGV", "id", "launch"),
            (
                {"lat_deg": 9.0, "lon_deg": 167.7},
                {"lat_deg": 10.0, "lon_deg": -140.0},
                {"lat_deg": 50.0, "lon_deg": -150.0},
                {"lat_deg": 5.0, "lon_deg": 60.0},
            ),
            strict=True,
        )
    )


@pytest.mark.slow
class TestAirLaunchTargets(TargetContract):
    name = "air-launch"
    launches = _as_class("SRBM", "id", "launch")
    settings: ClassVar[Mapping[str, Any]] = {"heading_deg": 80.0}


class TestGravityTurnTargets(TargetContract):
    name = "gravity-turn"
    settings: ClassVar[Mapping[str, Any]] = {"loft": 0.2, "early_shutdown_s": 1.0}


class TestClearAtmosphere(AtmosphereContract):
    name = "clear"


class TestNoBackground(BackgroundContract):
    name = "none"


class TestForgeEncoder(EncoderContract):
    name = "forge"


class TestForgeBandsEncoder(EncoderContract):
    name = "forge-bands"


class TestForgeTracksEncoder(EncoderContract):
    name = "forge-tracks"


class TestTracksEncoder(EncoderContract):
    name = "tracks"


class TestJsonLines(SinkContract):
    name = "jsonl"


class TestMemory(SinkContract):
    name = "memory"


class TestNowhere(SinkContract):
    name = "null"


class TestPlume(SignatureContract):
    name = "plume"


TABLE_BANDS = (Band("SWIR", 2.5, 3.0), Band("MWIR", 4.0, 5.0))
REGION = {"south_deg": -10.0, "north_deg": 10.0, "west_deg": -20.0, "east_deg": 20.0}


class TestLowtran(AtmosphereContract):
    name = "lowtran"
    bands = TABLE_BANDS
    settings: ClassVar[Mapping[str, Any]] = {"cloud": {"cover": 0.5, "top_km": 9.0}}


class TestEarth(BackgroundContract):
    name = "earth"
    bands = TABLE_BANDS


class TestFires(SourceContract):
    name = "fires"
    settings: ClassVar[Mapping[str, Any]] = {"field": {"region": REGION, "per_million_km2": 3.0}}


class TestFlares(SourceContract):
    name = "flares"
    settings: ClassVar[Mapping[str, Any]] = {"at": [{"lat_deg": 1.0, "lon_deg": 2.0}]}


class TestGlints(SourceContract):
    name = "glints"
    settings: ClassVar[Mapping[str, Any]] = {
        "at": [{"lat_deg": 1.0, "lon_deg": 2.0}, {"lat_deg": -1.0, "lon_deg": 2.0}]
    }


class TestBolides(SourceContract):
    name = "bolides"
    settings: ClassVar[Mapping[str, Any]] = {"field": {"region": REGION, "per_million_km2": 3.0}}


@pytest.mark.slow
class TestImm(TrackerContract):
    name = "imm"
    settings: ClassVar[Mapping[str, Any]] = {"cadence_s": 5.0}

    @classmethod
    def scene(cls, **changes: Any) -> dict[str, Any]:
        """Return half of the bench's scene, in which tracks begin on every kind of target."""
        return super().scene(**{"duration_s": 45.0, **changes})


class TestKeplerArc(TrackerContract):
    name = "kepler-arc"
    settings: ClassVar[Mapping[str, Any]] = {"cadence_s": 5.0}

    @classmethod
    def scene(cls, **changes: Any) -> dict[str, Any]:
        """Return the beginning of the bench's scene, in which there are tracks soon."""
        return super().scene(**{"duration_s": 30.0, **changes})


class TestReferenceRenderer(RendererContract):
    name = "reference"
