"""Requirements of studies, notes on scenes that end too early, tables of a terminal, and the report
of a study.
"""

import json
from pathlib import Path

import numpy as np
import pytest
from opir_studies import Study, sweep
from opir_studies.planning import planned_study
from opir_studies.requirements import FigureRequirement, requirements_of
from opir_studies.sweep_command import _tables, as_text
from study_scene import PERIOD, SCENE

from opir_core.cli.main import main
from opir_core.errors import SceneError

UNITS = {"latency_s": "s", "detected": ""}


def test_both_signs_are_read() -> None:
    lower, upper = requirements_of(["detected >= 0.9", "latency_s<=2"], UNITS, "study")
    assert lower == FigureRequirement("detected", 0.9, True)
    assert upper == FigureRequirement("latency_s", 2.0, False)
    assert lower.is_met(np.array([0.9, 0.8, np.nan]), np.ones(3)).tolist() == [True, False, False]
    means = np.array([1.0, 1.0, np.nan])
    assert upper.is_met(means, np.array([1.0, 0.999, np.nan])).tolist() == [True, False, False]
    assert upper.violation(3.0) == pytest.approx(0.5)
    assert str(upper) == "latency_s <= 2"


def notes(scene, **settings):
    return planned_study(Study(scene=scene, **settings)).notes


@pytest.mark.parametrize(
    ("text", "words"),
    [
        ("latency_s", "is not FIGURE >= VALUE"),
        ("latency_s >= x", "is not FIGURE"),
        ("latenci_s >= 1", "'latency_s'"),
    ],
)
def test_invalid_requirements_are_refused(text: str, words: str) -> None:
    with pytest.raises(SceneError, match=words):
        requirements_of([text], UNITS, "study")


def test_figures_to_show_are_known_before_the_first_run() -> None:
    with pytest.raises(SceneError, match="no metric of the study gives 'speed'"):
        planned_study(Study(scene=SCENE, show=("speed",)))


@pytest.mark.slow
def test_the_table_says_who_meets_them_and_what_never_changes(tmp_path) -> None:
    study = Study(
        scene=SCENE,
        vary={PERIOD: [50, 5000]},
        runs=4,
        metrics=("latency", {"detection_by_time": {"times_s": [19.0]}}),
        requirements=("latency_s <= 1",),
        executor="serial",
    )
    text = as_text(sweep(study, tmp_path))
    assert "In every run: detected_by_19_s 1" in text
    assert "latency_s <= 1: met by 1 of 2 designs (50)" in text


def test_a_scene_that_ends_with_the_burn_has_a_note() -> None:
    scene = {**SCENE, "detection": "constant", "tracker": "imm"}
    (note,) = notes(scene, metrics=("warning_time",))
    assert note.startswith("the scene ends at 20 s, 231 s before the burnout of T1")
    assert notes(scene, metrics=("latency",)) == ()
    assert notes({**scene, "duration_s": 285.0}, metrics=("warning_time",)) == ()


def test_metrics_of_tracks_without_a_tracker_have_a_note() -> None:
    *_, note = notes(SCENE, metrics=("custody",))
    assert note == "the scene has no tracker, which its metrics need: set tracker=imm"


def test_a_study_names_the_detection_chosen_and_differences() -> None:
    periods = {"sensors[0].scan_period_ms": (50.0, 100.0)}
    sentence = "detection: constant, since the scene describes no light"
    assert notes(SCENE, vary=periods, metrics=("latency",)) == (sentence,)
    air = {"atmosphere": ("clear", "lowtran")}
    (note,) = notes(SCENE, vary=air, metrics=("latency",))
    assert note.startswith("designs differ in their detection model, constant and snr, besides")
    assert notes({**SCENE, "detection": "snr"}, vary=air, metrics=("latency",)) == ()


def test_wide_tables_are_cut_between_figures() -> None:
    head = ["design", "runs", *(f"figure_{place}" for place in range(9))]
    body = [["1", "5", *["x" * 18] * 9]]
    tables = _tables(head, body, 2)
    assert len(tables) == 3
    assert all(len(line.rstrip()) <= 100 for text in tables for line in text.splitlines())
    assert all(text.startswith("design  runs  figure_") for text in tables)
    assert " ".join(tables).count("figure_") == 9


def test_a_setting_that_is_answered_value_by_value_varies() -> None:
    with pytest.raises(SceneError, match="'targets' does not vary"):
        planned_study(Study(scene=SCENE, split="targets", vary={PERIOD: [50, 100]}))


@pytest.mark.slow
def test_a_study_writes_its_report(tmp_path, capsys, monkeypatch) -> None:
    monkeypatch.chdir(tmp_path)
    Path("scene.json").write_text(json.dumps(SCENE), encoding="utf-8")
    settings = {
        "study": "s",
        "scene": "scene.json",
        "vary": {PERIOD: [5000, 50]},
        "runs": 3,
        "metrics": ["latency"],
        "question": "How soon is a launch seen?",
        "executor": "serial",
        "requirements": ["latency_s <= 1"],
    }
    Path("study.yaml").write_text(json.dumps(settings), encoding="utf-8")
    assert (
        main(["sweep", "study.yaml", "-o", "s", "--report", "page.html", "--figures", "figures"])
        == 0
    )
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "note: detection: constant, since the scene describes no light"
    assert lines[2].startswith("note: latency_s <= 1 is on a mean over the launches that have it")
    assert lines[6].startswith("latency_s <= 1: met by 1 of 2 designs (50)")
    assert lines[-2:] == ["Report: page.html", "Figures: figures"]
    page = Path("page.html").read_text(encoding="utf-8")
    assert "<h1>How soon is a launch seen?</h1>" in page
    assert Path("figures/effect-latency_s.pdf").exists()
