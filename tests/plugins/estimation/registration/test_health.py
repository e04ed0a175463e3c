"""What `imm` finds of its sensors: summary, manifest, saved run, `explain`, `score`, status and
metrics.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import yaml
from attrs import evolve
from http_service import serving
from opir_estimation import Registration, sensor_health
from opir_estimation.registration.error_filter import ErrorFilter, Moments
from opir_estimation.registration.health import unobservable
from waiting import until

import opir_core as opir
from opir_core.cli.main import main
from opir_core.plugin import SensorHealth

SCENE: dict[str, Any] = {
    "scene": "reports",
    "epoch": "2026-04-01T18:00:00Z",
    "duration_s": 12.0,
    "seed": 4,
    "sensors": [
        {
            "model": "SBIRS-GEO",
            "id": name,
            "orbital_slot_deg": slot,
            "line_of_sight_bias_sigma_urad": 60.0,
        }
        for name, slot in (("WEST", -150.0), ("EAST", -95.0))
    ],
    "targets": [
        {
            "id": "T",
            "type": "IRBM",
            "launch": {"lat_deg": 10.0, "lon_deg": -130.0, "time_s": 1.0},
            "aim": {"lat_deg": 20.0, "lon_deg": -115.0},
        }
    ],
    "tracker": {"model": "imm"},
}


def test_unknown_is_none_and_known_is_plain() -> None:
    figures = {
        "noise_scale": np.array([1.5, np.nan]),
        "bias_rad": np.array([[1e-6, np.nan], [0.0, 2e-6]]),
    }
    west, second = SensorHealth.of(figures, ("one", "other")).documents()
    assert west["noise_scale"] == 1.5
    assert west["bias_rad"] == [1e-6, None]
    assert west["clock_s"] is None
    assert second["noise_scale"] is None
    assert second["text"] == "other"
    json.dumps([west, second], allow_nan=False)


def test_an_unobservable_combination_is_a_difference() -> None:
    """Two sensors, whose north angles are seen as a sum alone, and whose east angles are known."""
    covariance = np.zeros((6, 6))
    for pair, variance in (((0, 3), 1e-3), ((1, 4), 1.0)):
        block = variance * np.array([[0.5, -0.5], [-0.5, 0.5]]) + 1e-4 * np.eye(2)
        covariance[np.ix_(pair, pair)] = block
    prior = np.array([1.0, 1.0, 0.0, 1.0, 1.0, 0.0])
    (combination,) = unobservable(Moments(np.zeros(6), covariance), prior)
    difference = np.array([0.0, 1.0, 0.0, 0.0, -1.0, 0.0])
    assert abs(combination[1]) == pytest.approx(1.0, abs=1e-9)
    assert combination * combination[1] == pytest.approx(difference, abs=1e-9)


def test_a_sensor_without_compared_looks_is_not_judged() -> None:
    """Two of three sensors without biases compared 400 targets; the third has no look."""
    registration = Registration.of(ErrorFilter.of(np.zeros(3), 0.0, 600.0), np.full(3, 0.1))
    weight = np.eye(len(registration.errors.log_weight))[0]
    errors = evolve(
        registration.errors, comparisons=400, log_weight=np.log(np.maximum(weight, 1e-300))
    )
    looks = np.array([400.0, 400.0, 0.0])
    registration = evolve(
        registration,
        errors=errors,
        known=errors.reported(),
        wide=errors.moments(),
        innovations=evolve(registration.innovations, looks=looks, square=2.0 * looks),
    )
    texts = sensor_health(registration, ("WEST", "EAST", "IDLE")).text
    assert ["no sign of a bias" in text for text in texts] == [True, True, False]
    assert texts[2].startswith("not judged: no look of it was compared with a track")


def test_targets_that_share_lines_are_seen_but_not_compared() -> None:
    """Two launches side by side, each seen by both sensors."""
    target = SCENE["targets"][0]
    beside = target | {"id": "B", "launch": target["launch"] | {"lat_deg": 10.001}}
    sensors = [sensor | {"line_of_sight_bias_sigma_urad": 0.0} for sensor in SCENE["sensors"]]
    scene = SCENE | {"sensors": sensors, "targets": [target, beside]}
    run = opir.simulate(opir.scene_from_mapping(scene))
    assert {(0, 0), (1, 0)} <= set(zip(run.detections.sensor, run.truth.target, strict=True))
    words = "bias assumed to be 0: no target was compared between two sensors"
    for sensor in run.summary["sensors"]:
        assert sensor["health"]["text"].startswith(words)


@pytest.mark.slow
def test_summary_manifest_saved_run_explain_and_score(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    path = tmp_path / "scene.yaml"
    events = tmp_path / "run.jsonl"
    path.write_text(yaml.safe_dump(SCENE), encoding="utf-8")
    assert main(["explain", str(path)]) == 0
    assert "WEST: 0 ± 60 µrad east, 0 ± 60 µrad north (as stated" in capsys.readouterr().out
    assert main(["run", str(path), "--out", str(events)]) == 0
    printed = capsys.readouterr().out
    manifest = json.loads((tmp_path / "run.manifest.json").read_text(encoding="utf-8"))
    texts = [row["text"] for row in manifest["sensor_health"]]
    assert f"WEST: {texts[0]}" in printed
    assert "not observable" in texts[0]
    saved = opir.load_run(events)
    health = [row["health"] for row in saved.summary["sensors"]]
    assert health == manifest["sensor_health"]
    assert main(["score", str(events)]) == 0
    scored = capsys.readouterr().out
    assert f"EAST: {texts[1]}" in scored
    assert "true bias" in scored


@pytest.mark.slow
def test_status_and_metrics_of_a_service(tmp_path: Path) -> None:
    with serving(tmp_path, "--speed", "6", scene=yaml.safe_dump(SCENE)) as stand:
        until(
            lambda: (stand.ask("GET", "/status").json["sensors"][0]["health"] or {}).get(
                "noise_scale"
            )
        )
        row = stand.ask("GET", "/status").json["sensors"][0]
        page = stand.ask("GET", "/metrics").body.decode()
    assert len(row["health"]["bias_rad"]) == 2
    assert 'opir_sensor_bias_radians{sensor_id="WEST",axis="east"}' in page
    assert 'opir_sensor_noise_ratio{sensor_id="EAST"}' in page


def test_a_run_without_a_tracker_says_nothing_of_its_sensors() -> None:
    run = opir.simulate(opir.scene_from_mapping({**SCENE, "duration_s": 3.0, "tracker": "none"}))
    assert [row["health"] for row in run.summary["sensors"]] == [None, None]
