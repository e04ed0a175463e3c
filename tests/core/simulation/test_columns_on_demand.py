"""What nobody reads is not computed: types of detections, in runs without a tracker."""

from typing import Any

import numpy as np
import pytest
from opir_photons.classification.spectral import SpectralClassifier
from opir_studies.metrics.detection_metrics import LatencyMetric
from two_sensor_scene import two_sensor_scene

import opir_core as opir
from opir_core.interfaces.columns import ROWS_SHOWN, names_of
from opir_core.interfaces.records import Detections
from opir_core.simulation.explanation import explained

SCENE = two_sensor_scene(
    sensors=[{"model": "SBIRS-GEO", "id": "S-1", "orbital_slot_deg": -120.0}], detection="snr"
)


@pytest.fixture
def classified(monkeypatch: pytest.MonkeyPatch) -> list[int]:
    """Return the numbers of rows of each call of the classifier."""
    rows: list[int] = []
    original = SpectralClassifier.log_posterior

    def counted(self: SpectralClassifier, sightings: Any) -> Any:
        if len(sightings):
            rows.append(len(sightings))
        return original(self, sightings)

    monkeypatch.setattr(SpectralClassifier, "log_posterior", counted)
    return rows


def test_a_metric_of_times_classifies_nothing(classified: list[int]) -> None:
    run = opir.simulate(opir.scene_from_mapping(SCENE), window_s=20.0)
    assert LatencyMetric().values(run)["detected"] == 1.0
    assert len(run.detections) > 100
    assert repr(run).startswith("<Run of two-sensors:")
    assert "type_log_probability[4]" in repr(run.detections)
    assert classified == []
    assert "reported_type" in run.detections._repr_html_()
    assert classified.pop() == ROWS_SHOWN
    assert run.summary["targets"][0]["reported_type"] is not None
    assert run.detections.type_probability.shape == (len(run.detections), 4)
    assert classified == [len(run.detections)]


@pytest.mark.parametrize(
    ("changes", "is_deferred"),
    [
        ({}, True),
        ({"tracker": "imm"}, False),
        ({"outputs": ["null"]}, False),
        ({"classification": "paper"}, False),
    ],
)
def test_explain_says_that_types_wait_for_a_reader(
    changes: dict[str, Any], is_deferred: bool
) -> None:
    scene = opir.scene_from_mapping({**SCENE, **changes})
    lines = explained(opir.compile_plan(scene))["not_computed"]
    assert any("type probabilities" in line for line in lines) == is_deferred


def test_a_tracker_has_types_computed_once(classified: list[int]) -> None:
    run = opir.simulate(opir.scene_from_mapping({**SCENE, "tracker": "imm"}), window_s=20.0)
    assert sum(classified) == len(run.detections)


def test_columns_do_not_depend_on_when_they_are_computed() -> None:
    scene = opir.scene_from_mapping(SCENE)
    late = opir.simulate(scene).detections
    early = Detections.concatenate(
        window.detections.computed() for window in opir.windows(scene, window_s=7.0)
    )
    for name in names_of(Detections):
        assert getattr(late, name).tobytes() == getattr(early, name).tobytes(), name
    assert np.isfinite(late.confidence).all()
