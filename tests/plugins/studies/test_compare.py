"""`opir compare`: trackers on the same runs, side by side."""

import json

import pytest
from opir_studies import comparison
from opir_studies.comparison import compared
from scored_scene import SCENE
from study_tasks import killed

from opir_core.cli.main import main
from opir_core.errors import OpirError, SceneError


@pytest.mark.slow
def test_compare_tells_every_tracker(tmp_path, capsys):
    scene = tmp_path / "scene.yaml"
    scene.write_text(json.dumps({**SCENE, "duration_s": 40.0}))
    words = ["compare", str(scene), "--runs", "2", "--json", "--tracker", "imm"]
    assert main([*words, "--tracker", "{model: imm, motion: boost}"]) == 0
    reported = json.loads(capsys.readouterr().out)["trackers"]
    assert list(reported) == ["imm", "{model: imm, motion: boost}"]
    assert reported["imm"]["seeds"] == [7, 8]
    assert reported["imm"]["tracking_us_a_detection"]["value"] > 0.0
    assert reported["imm"]["tracking_us_a_track_update"]["value"] > 0.0


@pytest.mark.slow
def test_what_is_wrong_with_the_last_tracker_is_reported_before_the_first_runs(tmp_path):
    scene = tmp_path / "scene.yaml"
    scene.write_text(json.dumps({**SCENE, "duration_s": 30.0}))
    done = []
    for wrong, error in (
        ("none", SceneError),
        ("imn", OpirError),
        ("{model: imm, x: 1}", SceneError),
    ):
        with pytest.raises(error):
            compared(
                str(scene), trackers=["imm", wrong], runs=1, on_run=lambda *run: done.append(run)
            )
    assert not done
    twice = compared(str(scene), trackers=["imm"] * 2, runs=1, on_run=lambda *run: done.append(run))
    assert list(twice.cards) == ["imm"]
    assert twice.automatic == ["detection: constant, since the scene describes no light"]
    assert len(done) == 1


@pytest.mark.slow
def test_compare_tells_trackers_side_by_side(tmp_path, capsys):
    scene = tmp_path / "scene.yaml"
    scene.write_text(json.dumps({**SCENE, "duration_s": 30.0}))
    words = ["compare", str(scene), "--runs", "2", "--tracker", "kepler-arc", "--tracker", "imm"]
    assert main(words) == 0
    reported = capsys.readouterr().out
    assert reported.startswith(
        "2 runs of each tracker (seeds 7 to 8), sensors without pointing bias; [95 % intervals]\n"
    )
    assert "energy score of position: " in reported.splitlines()[2]
    assert len(reported.splitlines()) <= 40
    for figure in (
        "E launch point, m",
        "NEES/6",
        "coverage, %",
        "hypotheses: log score",
        "hypotheses: Brier score",
    ):
        assert figure in reported
    assert (
        reported.rstrip().splitlines()[-1]
        == "kepler-arc: impacts by the paper's law, without containment"
    )


@pytest.mark.slow
def test_details_are_the_scores_of_each_tracker(tmp_path, capsys):
    scene = tmp_path / "scene.yaml"
    scene.write_text(json.dumps({**SCENE, "duration_s": 30.0}))
    words = [
        "compare",
        str(scene),
        "--runs",
        "1",
        "--tracker",
        "kepler-arc",
        "--tracker",
        "imm",
        "--details",
    ]
    assert main(words) == 0
    reported = capsys.readouterr().out
    bins = [line.split()[:2] for line in reported.splitlines() if line.startswith("0-20 ")]
    assert bins[-6:] == [["0-20", "kepler-arc"], ["0-20", "imm"]] * 3
    for figure in (
        "/known",
        "/unknown",
        "NIS/2",
        "reported SRBM",
        "localisation, missed, false",
        "tracks per launch",
    ):
        assert figure in reported


@pytest.mark.slow
def test_figures_do_not_depend_on_how_many_processes_made_them(tmp_path, capsys):
    path = tmp_path / "scene.yaml"
    reported = []
    path.write_text(json.dumps({**SCENE, "duration_s": 35.0}))
    for workers in ("1", "2"):
        words = [
            "compare",
            str(path),
            "--tracker",
            "imm",
            "--tracker",
            "kepler-arc",
            "--runs",
            "2",
            "--json",
        ]
        assert main([*words, "--workers", workers]) == 0
        found = json.loads(capsys.readouterr().out)
        cards = found["trackers"]
        for card in cards.values():
            assert card.pop("tracking_us_a_detection")["value"] > 0.0
            assert card.pop("tracking_us_a_track_update")["value"] > 0.0
        reported.append(found)
    assert reported[0] == reported[1]
    cards = reported[0]["trackers"]
    assert list(cards) == ["imm", "kepler-arc"]
    assert [card["impact_method"] for card in cards.values()] == ["posterior", "paper"]
    assert cards["kepler-arc"]["seeds"] == [SCENE["seed"], SCENE["seed"] + 1]


@pytest.mark.slow
def test_a_process_that_dies_is_reported_in_a_line(tmp_path, capsys, monkeypatch):
    monkeypatch.setattr(comparison, "_scored", killed)
    (tmp_path / "scene.yaml").write_text(json.dumps(SCENE))
    assert main(["compare", str(tmp_path / "scene.yaml"), "--runs", "2", "--workers", "2"]) == 1
    reported = capsys.readouterr().err
    assert (
        "a worker process ended before its run was complete, possibly out of memory; use fewer"
        " --workers" in reported
    )
    assert "Traceback" not in reported


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["compare", "SCENE", "--runs", "0"], "--runs: 0 is not a number of runs"),
        (
            ["compare", "SCENE", "--tracker", "none", "--runs", "1"],
            "none makes no tracks to score; name other trackers with --tracker",
        ),
        (
            ["compare", "SCENE", "--workers", "0"],
            "--workers: 0 is not a number of processes; give 1 or more",
        ),
        (["compare", "SCENE", "--alpha", "3"], "--alpha: must be in (0, 2]"),
        (["compare", "SCENE", "--order", "300"], "--order: too large"),
        (["compare", "SCENE", "--bin-s", "inf"], "--bin-s: must be at least 0.01 and finite"),
    ],
)
def test_what_cannot_be_compared_is_reported(tmp_path, capsys, monkeypatch, words, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "SCENE").write_text(json.dumps(SCENE))
    assert main(words) == 2
    assert message in capsys.readouterr().err
