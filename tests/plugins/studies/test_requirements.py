"""Requirements of studies, notes on scenes that end too early, tables of a terminal, and the report
of a study.
"""

import json

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
    least, most = requirements_of(["detected >= 0.9", "latency_s<=2"], UNITS, "study")
    assert (least, most) == (
        FigureRequirement("detected", 0.9, True),
        FigureRequirement("latency_s", 2.0, False),
    )
    assert least.is_met(np.array([0.9, 0.8, np.nan]), np.ones(3)).tolist() == [True, False, False]
    assert most.is_met(np.array([1.0, 1.0, np.nan]), np.array([1.0, 0.999, np.nan])).tolist() == [
        True,
        False,
        False,
    ]
    assert most.violation(3.0) == pytest.approx(0.5)
    assert str(most) == "latency_s <= 2"


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


def test_a_scene_that_ends_with_the_burn_is_reported_to_metrics_of_impacts() -> None:
    scene = {**SCENE, "detection": "constant"}
    (note,) = planned_study(Study(scene=scene, metrics=("warning_time",))).notes
    assert note.startswith("the scene ends at 20 s, 231 s before the burnout of T1")
    assert planned_study(Study(scene=scene, metrics=("latency",))).notes == ()
    long = {**scene, "duration_s": 285.0}
    assert planned_study(Study(scene=long, metrics=("warning_time",))).notes == ()


def test_a_study_says_which_detection_was_chosen_and_where_designs_differ_in_it() -> None:
    vary = {"sensors[0].scan_period_ms": (50.0, 100.0)}
    notes = planned_study(Study(scene=SCENE, vary=vary, metrics=("latency",))).notes
    assert notes == ("detection: constant, since the scene describes no light",)
    vary = {"atmosphere": ("clear", "lowtran")}
    (note,) = planned_study(Study(scene=SCENE, vary=vary, metrics=("latency",))).notes
    assert note.startswith("designs differ in their detection model, constant and snr, besides")
    scene = {**SCENE, "detection": "snr"}
    assert planned_study(Study(scene=scene, vary=vary, metrics=("latency",))).notes == ()


def test_wide_tables_are_cut_between_figures() -> None:
    head = ["design", "runs", *(f"figure_{place}" for place in range(9))]
    body = [["1", "5", *["x" * 18] * 9]]
    cut = _tables(head, body, 2)
    assert len(cut) == 3
    assert all(len(line.rstrip()) <= 100 for each in cut for line in each.splitlines())
    assert all(each.startswith("design  runs  figure_") for each in cut)
    assert " ".join(cut).count("figure_") == 9


def test_a_setting_that_is_answered_value_by_value_varies() -> None:
    with pytest.raises(SceneError, match="'targets' does not vary"):
        planned_study(Study(scene=SCENE, split="targets", vary={PERIOD: [50, 100]}))


@pytest.mark.slow
def test_a_study_writes_its_report(tmp_path, capsys) -> None:
    (tmp_path / "scene.json").write_text(json.dumps(SCENE), encoding="utf-8")
    words = {
        "study": "s",
        "scene": "scene.json",
        "vary": {PERIOD: [5000, 50]},
        "runs": 3,
        "metrics": ["latency"],
    }
    words |= {
        "question": "How soon is a launch seen?",
        "executor": "serial",
        "requirements": ["latency_s <= 1"],
    }
    (tmp_path / "study.yaml").write_text(json.dumps(words), encoding="utf-8")
    page = tmp_path / "page.html"
    figures = tmp_path / "figures"
    command = [
        "sweep",
        str(tmp_path / "study.yaml"),
        "-o",
        str(tmp_path / "s"),
        "--report",
        str(page),
    ]
    assert main([*command, "--figures", str(figures)]) == 0
    lines = capsys.readouterr().out.splitlines()
    assert lines[0] == "note: detection: constant, since the scene describes no light"
    assert lines[4].startswith("latency_s <= 1: met by 1 of 2 designs (50)")
    assert lines[-2:] == [f"Report: {page}", f"Figures: {figures}"]
    assert "<h1>How soon is a launch seen?</h1>" in page.read_text(encoding="utf-8")
    assert (figures / "effect-latency_s.pdf").exists()
