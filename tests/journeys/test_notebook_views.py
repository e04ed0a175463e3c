"""Public results in a notebook: a short text without an address, and a view."""

import pytest
from opir_report import StudyPlots
from opir_scoring import evidence_of_run, impact_scores, ownership
from opir_studies import Study, compared, optimise, sweep
from repository import ROOT
from study_scene import PERIOD, SCENE

from opir_core import Host, compile_plan, load_scene, plan_windows, simulate

LONGEST = 400
#: Letters of a view; a map is the largest.
LARGEST_VIEW = 150_000
SCENE_FILE = str(ROOT / "examples" / "first_light.yaml")


@pytest.fixture(scope="module")
def results(tmp_path_factory):
    folder = tmp_path_factory.mktemp("views")
    scene = load_scene(SCENE_FILE, overrides=["duration_s=40", "tracker=kepler-arc"])
    plan = compile_plan(scene)
    run = simulate(scene)
    study = Study(scene=SCENE, vary={PERIOD: [400, 800]}, runs=2, executor="serial")
    evidence = evidence_of_run(run, plan)
    return {
        "scene": scene,
        "plan": plan,
        "run": run,
        "window": next(iter(plan_windows(plan))),
        "sensor": run.sensors[0],
        "scene sensor": scene.sensors[0],
        "scene target": scene.targets[0],
        "targets": plan.targets,
        "detections": run.detections,
        "truth": run.truth,
        "tracks": run.tracks,
        "plots": run.plot,
        "host": Host.discover(),
        "evidence": evidence,
        "scores": impact_scores(evidence, ownership(evidence)),
        "scorecard": run.score(),
        "study": sweep(study, folder / "study"),
        "study plots": StudyPlots(folder / "study"),
        "optimised": optimise(study, folder / "best", "min latency_s", evaluations=1),
        "comparison": compared(
            SCENE_FILE, trackers=["kepler-arc"], runs=1, overrides=["duration_s=40"]
        ),
    }


@pytest.mark.slow
def test_texts_are_short_and_without_an_address(results):
    texts = {name: repr(result) for name, result in results.items()}
    assert {name: text for name, text in texts.items() if len(text) > LONGEST} == {}
    assert {name: text for name, text in texts.items() if " at 0x" in text} == {}
    assert "map()" in texts["plots"]
    assert "effect()" in texts["study plots"]


@pytest.mark.slow
def test_every_result_has_a_view_of_bounded_size(results):
    views = {name: result._repr_html_() for name, result in results.items()}
    assert {name for name, view in views.items() if not view.startswith("<")} == set()
    assert {name: len(view) for name, view in views.items() if len(view) > LARGEST_VIEW} == {}
    assert {name for name, view in views.items() if " at 0x" in view} == set()


@pytest.mark.slow
@pytest.mark.parametrize(
    ("name", "words"),
    [
        ("scene", "<td>DSP-1</td><td>sensor</td><td>DSP</td>"),
        ("scene sensor", "<td>scan_period_ms</td>"),
        ("scene target", "<td>ICBM</td>"),
        ("plan", "<td>DSP-1</td><td>DSP</td><td>150</td>"),
        ("sensor", "<td>scan_period_ms</td><td>200.0</td>"),
        ("targets", "<td>T1</td><td>ICBM</td><td>10.0</td><td>260.0</td>"),
        ("host", "<td>opir-core</td>"),
        ("plots", "<td>nees()</td><td>Draw the NEES of the tracks"),
        ("scorecard", "launches tracked"),
    ],
)
def test_a_view_says_what_is_in_it(results, name, words):
    assert words in results[name]._repr_html_()


@pytest.mark.slow
def test_a_view_of_rows_has_the_first_of_them(results):
    detections = results["detections"]
    view = detections._repr_html_()
    assert str(detections.time_ns[0]) in view
    assert str(detections.time_ns[9]) in view
    assert str(detections.time_ns[10]) not in view
    assert view.count("<tr>") == 11
