"""Trackers know a sensor's confusion matrix only where the classifier reports by it."""

import pytest

from opir_core import compile_plan
from opir_core.reading import scene_from_mapping

ROW = {"ICBM": 0.9, "UNKNOWN": 0.1}


def plan(classification: str):
    return compile_plan(
        scene_from_mapping(
            {
                "scene": "one",
                "epoch": "2026-04-01T12:00:00Z",
                "duration_s": 5.0,
                "sensors": [
                    {
                        "model": "generic-scanner",
                        "id": "S",
                        "orbital_slot_deg": -120.0,
                        "confusion": {"ICBM": ROW},
                    }
                ],
                "targets": [
                    {
                        "id": "T",
                        "type": "ICBM",
                        "launch": {"lat_deg": 34.7, "lon_deg": -120.6, "time_s": 1.0},
                        "aim": {"lat_deg": 9.0, "lon_deg": 167.7},
                    }
                ],
                "detection": "constant",
                "classification": classification,
            }
        )
    )


def test_a_classifier_that_draws_from_the_matrices() -> None:
    (sensor,) = plan("paper").tracker_sensors()
    assert sensor.confusion["ICBM"] == ROW


@pytest.mark.parametrize("classification", ["none", "always"])
def test_a_classifier_that_reports_otherwise(classification: str) -> None:
    (sensor,) = plan(classification).tracker_sensors()
    assert not sensor.confusion
