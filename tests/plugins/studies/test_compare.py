"""`opir compare`: trackers on the same runs, side by side."""

import json
import shlex

import pytest
from opir_studies import compared
from scored_scene import SCENE
from study_tasks import killed

from opir_core.cli.main import main
from opir_core.errors import OpirError, SceneError

BOTH = "--tracker imm --tracker kepler-arc"


@pytest.fixture
def compare(tmp_path, monkeypatch, capsys):
    """Return a function that compares trackers on the scene for a duration, and returns the text
    printed.
    """
    monkeypatch.chdir(tmp_path)

    def printed(words, duration_s=30.0, code=0):
        (tmp_path / "scene.yaml").write_text(json.dumps({**SCENE, "duration_s": duration_s}))
        assert main(["compare", "scene.yaml", *shlex.split(words)]) == code
        captured = capsys.readouterr()
        return captured.err if code else captured.out

    return printed


@pytest.mark.slow
def test_every_tracker_and_its_settings_have_scores(compare):
    printed = compare("--runs 2 --json --tracker imm --tracker '{model: imm, modes: boost}'", 40.0)
    reported = json.loads(printed)["trackers"]
    assert list(reported) == ["imm", "{model: imm, modes: boost}"]
    assert reported["imm"]["seeds"] == [7, 8]
    assert reported["imm"]["tracking_us_a_detection"]["value"] > 0.0
    assert reported["imm"]["tracking_us_a_track_update"]["value"] > 0.0


@pytest.mark.slow
def test_parts_of_a_tracker_are_compared_by_their_settings(compare):
    words = "--runs 1 --json --tracker imm --vary tracker.association=jpda --vary tracker.modes=boost,boost-coast"
    reported = json.loads(compare(words, 40.0))["trackers"]
    names = [f"imm association=jpda, modes={modes}" for modes in ("boost", "boost-coast")]
    assert list(reported) == names


def test_values_of_no_setting_and_parts_of_none_are_refused(compare):
    assert "write PATH=VALUE,VALUE" in compare("--vary tracker.association", code=2)
    refused = compare("--tracker imm --vary tracker.association=jpda,gnnn", code=2)
    assert "tracker.association: no tracker part is named 'gnnn'" in refused


@pytest.mark.slow
def test_an_invalid_last_tracker_is_reported_before_the_runs(tmp_path):
    scene = tmp_path / "scene.yaml"
    scene.write_text(json.dumps({**SCENE, "duration_s": 30.0}))
    runs = []

    def cards(*trackers):
        return compared(str(scene), trackers=trackers, runs=1, on_run=lambda *run: runs.append(run))

    for wrong, error in (
        ("none", SceneError),
        ("imn", OpirError),
        ("{model: imm, x: 1}", SceneError),
    ):
        with pytest.raises(error):
            cards("imm", wrong)
    assert not runs
    repeated = cards("imm", "imm")
    assert list(repeated.cards) == ["imm"]
    assert repeated.automatic == ["detection: constant, since the scene describes no light"]
    assert len(runs) == 1


@pytest.mark.slow
def test_trackers_stand_side_by_side(compare):
    reported = compare("--runs 2 --tracker kepler-arc --tracker imm")
    lines = reported.rstrip().splitlines()
    assert lines[0] == (
        "2 runs of each tracker (seeds 7 to 8), sensors without pointing bias; [95 % intervals]"
    )
    assert "energy score of position: " in lines[2]
    assert len(lines) <= 40
    for figure in (
        "E launch point, m",
        "NEES/6",
        "coverage, %",
        "hypotheses: log score",
        "hypotheses: Brier score",
    ):
        assert figure in reported
    assert lines[-1] == "detection: constant, since the scene describes no light"


@pytest.mark.slow
def test_details_are_the_scores_of_each_tracker(compare):
    reported = compare("--runs 1 --tracker kepler-arc --tracker imm --details")
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
def test_figures_do_not_depend_on_the_number_of_processes(compare):
    reported = []
    for workers in (1, 2):
        document = json.loads(compare(f"{BOTH} --runs 2 --json --workers {workers}", 35.0))
        for card in document["trackers"].values():
            assert card.pop("tracking_us_a_detection")["value"] > 0.0
            assert card.pop("tracking_us_a_track_update")["value"] > 0.0
        reported.append(document)
    assert reported[0] == reported[1]
    cards = reported[0]["trackers"]
    assert list(cards) == ["imm", "kepler-arc"]
    assert [card["impact_method"] for card in cards.values()] == ["posterior", "posterior"]
    assert cards["kepler-arc"]["seeds"] == [SCENE["seed"], SCENE["seed"] + 1]


@pytest.mark.slow
def test_a_process_that_dies_is_reported_in_a_line(compare, monkeypatch):
    monkeypatch.setattr("opir_studies.comparison._scored", killed)
    reported = compare("--runs 2 --workers 2", code=1)
    assert (
        "a worker process ended before its run was complete, possibly out of memory; use fewer"
        " --workers" in reported
    )
    assert "Traceback" not in reported


@pytest.mark.parametrize(
    ("words", "message"),
    [
        ("--runs 0", "--runs: 0 is not a number of runs"),
        (
            "--tracker none --runs 1",
            "none makes no tracks to score; name other trackers with --tracker",
        ),
        ("--workers 0", "--workers: 0 is not a number of processes; give 1 or more"),
        ("--alpha 3", "--alpha: must be in (0, 2]"),
        ("--order 300", "--order: too large"),
        ("--bin-s inf", "--bin-s: must be at least 0.01 and finite"),
    ],
)
def test_impossible_comparisons_are_reported(compare, words, message):
    assert message in compare(words, code=2)
