"""Runs are scored from memory and from files alike, compared, and refused where there is nothing to
judge.
"""

import json
import pickle

import numpy as np
import pytest
from json_lines import json_lines
from opir_scoring import (
    RunEvidence,
    ScoreSettings,
    evidence_of_files,
    evidence_of_run,
    ownership,
    scorecard,
    scorecard_text,
)
from opir_testing import stub_estimates
from scored_scene import SCENE

from opir_core import compile_plan, run_of_plan
from opir_core.cli.main import main
from opir_core.errors import Problem, SceneError
from opir_core.output import TracksFile, read_tracks
from opir_core.reading import scene_from_mapping


def synthetic(track, target):
    plan = compile_plan(scene_from_mapping(SCENE))
    run = run_of_plan(plan)
    rows = np.arange(len(track))
    return RunEvidence(
        plan=plan,
        tracks=run.tracks.take(np.zeros(1, dtype=np.int64)),
        time_s=rows.astype(np.float64),
        sensor=(rows % 2).astype(np.int32),
        sigma_rad=np.full(len(rows), 1e-5),
        track=np.array(track),
        target=np.array(target, dtype=np.int32),
        direction_ecef=np.zeros((len(rows), 3)),
        sensor_ecef_m=np.zeros((len(rows), 3)),
    )


@pytest.mark.slow
def test_a_track_belongs_to_the_target_of_most_of_its_detections():
    owners = ownership(synthetic([0, 0, 0, 0, -1], [0, 0, 0, -1, 0]))
    assert owners.target.tolist() == [0]
    assert owners.purity[0] == pytest.approx(0.75)
    assert owners.is_stereo[0]
    noise = ownership(synthetic([0, 0, 0], [-1, -1, 0]))
    assert noise.target.tolist() == [-1]


@pytest.mark.slow
def test_a_scene_is_scored_alike_from_memory_and_from_its_files(tmp_path, capsys):
    scene = tmp_path / "scene.yaml"
    scene.write_text(
        json.dumps({**SCENE, "outputs": [{"jsonl": {"path": str(tmp_path / "events.jsonl")}}]})
    )
    assert main(["run", str(scene), "--quiet"]) == 0
    plan = compile_plan(scene_from_mapping(SCENE))
    here = scorecard([evidence_of_run(run_of_plan(plan), plan)]).as_plain()
    there = scorecard([evidence_of_files(tmp_path / "events.jsonl")]).as_plain()
    for name in ("launches_tracked", "purity", "completeness", "gospa", "seeds"):
        assert there[name] == here[name]
    computed = here["stereo"]["by_time"]
    reference = there["stereo"]["by_time"]
    assert [part["position_m"] for part in computed] == [part["position_m"] for part in reference]
    # Events tell sensors' errors to a few digits.
    for name in ("position_over_bound", "velocity_over_free_bound"):
        assert computed[-1][name]["value"] == pytest.approx(reference[-1][name]["value"], rel=1e-3)
    # Events tell angles to 1e-9 degrees.
    assert computed[1]["nis"]["samples"] > 10
    assert computed[1]["nis"]["mean"] == pytest.approx(reference[1]["nis"]["mean"], rel=1e-3)
    capsys.readouterr()
    assert main(["score", str(tmp_path / "events.jsonl")]) == 0
    reported = capsys.readouterr().out
    assert "launches tracked" in reported
    assert "stereo" in reported


def test_the_text_has_no_interval_that_says_nothing():
    plan = compile_plan(scene_from_mapping({**SCENE, "duration_s": 20.0}))
    card = scorecard([evidence_of_run(run_of_plan(plan), plan)])
    card.figures["first_track_after_s"] = {"value": 1.0, "interval_95": [0.01, 100.0]}
    card.figures["tracks_a_launch"] = {"value": 1.0, "interval_95": [0.5, 2.0]}
    reported = scorecard_text({"imm": card})
    assert "1.00 [0.50, 2.00]" in reported
    assert "[0.01" not in reported


@pytest.mark.slow
def test_tracks_of_burnt_out_launches_are_not_false():
    srbm = {
        "id": "T2",
        "type": "SRBM",
        "launch": {"lat_deg": 36.0, "lon_deg": -115.0, "time_s": 2.0},
        "aim": {"lat_deg": 38.0, "lon_deg": -114.0},
    }
    plan = compile_plan(
        scene_from_mapping({**SCENE, "duration_s": 80.0, "targets": [*SCENE["targets"], srbm]})
    )
    run = run_of_plan(plan)
    assert plan.targets.burnout_s[1] < 75.0
    assert np.count_nonzero(run.tracks.tick_s > 75.0) > 5
    result = scorecard([evidence_of_run(run, plan)], ScoreSettings(cutoff_m=5e4)).figures["gospa"]
    assert result["false_a_target"]["value"] == 0.0
    assert result["localisation_a_target"]["value"] > 0.0


def test_an_error_crosses_processes_whole():
    error = SceneError([Problem("targets[0]", "wrong"), Problem("", "more")], source="here.yaml")
    repeated = pickle.loads(pickle.dumps(error))
    assert (str(repeated), repeated.problems, repeated.source) == (
        str(error),
        error.problems,
        error.source,
    )


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["score", "nothing.jsonl"], "there is no manifest file"),
        (
            ["score", "nothing.jsonl", "--bin-s", "0.009"],
            "--bin-s: must be at least 0.01 and finite",
        ),
        (["score", "nothing.jsonl", "--bin-s", "inf"], "--bin-s: must be at least 0.01 and finite"),
        (["score", "nothing.jsonl", "--cutoff-m", "0"], "--cutoff-m: must be positive and finite"),
        (
            ["score", "nothing.jsonl", "--cutoff-m", "inf"],
            "--cutoff-m: must be positive and finite",
        ),
        (["score", "nothing.jsonl", "--order", "0.9"], "--order: must be at least 1 and finite"),
        (["score", "nothing.jsonl", "--order", "inf"], "--order: must be at least 1 and finite"),
        (
            ["score", "nothing.jsonl", "--order", "80"],
            "--order: too large: the cut-off to this power overflows",
        ),
        (["score", "nothing.jsonl", "--alpha", "0"], "--alpha: must be in (0, 2]"),
        (["score", "nothing.jsonl", "--alpha", "2.1"], "--alpha: must be in (0, 2]"),
        (
            ["score", "nothing.jsonl", "--bin-s", "0.01", "--order", "1", "--alpha", "2"],
            "there is no manifest file",
        ),
    ],
)
def test_what_cannot_be_judged_is_reported(tmp_path, capsys, monkeypatch, words, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "SCENE").write_text(json.dumps(SCENE))
    assert main(words) == 2
    assert message in capsys.readouterr().err


def test_radii_of_ellipses_in_the_tracks_file(tmp_path):
    reported = stub_estimates(
        2,
        impact=0.5,
        impact_sigmas=[[0.8, 1.9, 2.6], [np.nan] * 3],
        state_sigmas=[[np.nan] * 3, [1.0, 3.0, 4.0]],
    )
    with TracksFile(tmp_path / "tracks.jsonl") as file:
        file.write(reported)
    assert np.array_equal(
        read_tracks(tmp_path / "tracks.jsonl").impact_sigmas, reported.impact_sigmas, equal_nan=True
    )
    rows = json_lines(tmp_path / "tracks.jsonl")
    for row in rows:
        del row["impact"]["ellipse_sigmas"]
    old = "".join(json.dumps(row) + "\n" for row in rows)
    (tmp_path / "tracks.jsonl").write_text(old)
    read = read_tracks(tmp_path / "tracks.jsonl").impact_sigmas
    assert read.shape == (2, 3)
    assert np.isnan(read).all()
