"""A whole run: its columns, its summary, its manifest."""

import json

import numpy as np
import pytest
from repository import TEST_SCENES

import opir_core as opir
from opir_core import Run
from opir_core.plugin import REPORTED_TYPES

EXAMPLE = TEST_SCENES / "pacific_test_range.yaml"


@pytest.fixture(scope="module")
def run() -> Run:
    return opir.simulate(opir.load_scene(EXAMPLE, overrides=["duration_s=90", "tracker=imm"]))


def test_columns_lie_side_by_side_and_in_time(run: Run) -> None:
    assert len(run.detections) == len(run.truth) > 1000
    assert np.all(np.diff(run.detections.time_ns) >= 0)
    assert {int(track) for track in run.tracks.track} == {0, 1, 2}
    with pytest.raises(ValueError, match="read-only"):
        run.detections.confidence[0] = 0.0


def test_the_summary_counts_what_the_columns_hold(run: Run) -> None:
    for number, row in enumerate(run.summary["sensors"]):
        assert row["detections"] == int((run.detections.sensor == number).sum())
    for number, row in enumerate(run.summary["targets"]):
        actual = run.truth.target == number
        times_s = run.detections.time_ns[actual] * 1e-9
        types = np.bincount(run.detections.reported_type[actual], minlength=4)
        assert row["detections"] == int(actual.sum())
        assert row["first_detection_s"] == pytest.approx(times_s.min())
        assert row["last_detection_s"] == pytest.approx(times_s.max())
        assert row["latency_s"] == pytest.approx(times_s.min() - row["ignition_s"])
        assert row["reported_type"] == REPORTED_TYPES[types.argmax()]
        assert row["highest_confidence"] == pytest.approx(run.detections.confidence[actual].max())
        assert row["sensors"] == len(np.unique(run.detections.sensor[actual]))


def test_the_manifest_names_every_component_and_its_distribution(run: Run) -> None:
    named = {(row["kind"], row["name"]): row["distribution"] for row in run.manifest["components"]}
    assert named["sensor_models", "DSP"] == "opir-dsp"
    assert named["constellations", "NEXTGEN-GEO"] == "opir-nextgen"
    assert named["detection_models", "constant"] == "opir-core"
    assert named["event_encoders", "forge"] == "opir-core"
    assert json.loads(json.dumps(run.manifest)) == run.manifest


@pytest.mark.slow
def test_a_scene_from_the_manifest_gives_the_same_detections(run: Run) -> None:
    repeat = opir.simulate(opir.scene_from_mapping(run.manifest["scene"]))
    assert repeat.manifest == run.manifest
    assert repeat.detections.detection_id.tobytes() == run.detections.detection_id.tobytes()


def test_targets_that_nobody_sees_are_summed_up_too() -> None:
    scene = opir.load_scene(EXAMPLE, overrides=["detection=never"])
    rows = opir.simulate(scene).summary["targets"]
    assert [row["detections"] for row in rows] == [0, 0, 0]
    assert all(row["first_detection_s"] is None and row["reported_type"] is None for row in rows)
