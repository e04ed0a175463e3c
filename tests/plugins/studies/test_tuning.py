"""`opir tune`: the settings it chooses are coarser for looser errors, and meet the error on scenes
it never saw.
"""

import json
from collections.abc import Sequence
from functools import cache
from itertools import chain, combinations
from pathlib import Path

import numpy as np
import pytest
from attrs import evolve
from opir_scoring import evidence_of_run, ownership, state_errors
from opir_studies import Tuned
from opir_studies.differences import MEASURES, RunAnswers, answers_of, differences, over_runs
from opir_studies.knobs import Knob, knobs_of
from opir_studies.tune_command import as_json, as_text
from opir_studies.tuning import Answered, Tuner, timed_answers, tuned
from pyproj import Geod
from study_scene import SCENE

import opir_core as opir
from opir_core import Scene
from opir_core.cli.main import main
from opir_core.errors import SceneError
from opir_core.plugin import Detections, Host
from opir_core.reading import scene_from_mapping, scene_mapping

#: With a stated noise: by default the light of the Earth hides plumes from DSP's long waves.
DSP = {
    "model": "DSP",
    "preset": "paper",
    "scan_phase": "random",
    "id": "D",
    "orbital_slot_deg": -135.0,
    "focal_plane": None,
    "nei_w_m2": 5e-13,
}
AIR = {"detection": "snr", "classification": "none", "atmosphere": "lowtran"}
LIT = {**SCENE, "duration_s": 60.0, "sensors": [DSP], **AIR}
#: Another launch, seen by another sensor, at another time of day.
ELSEWHERE = {
    **LIT,
    "scene": "elsewhere",
    "seed": 7,
    "sensors": [{"model": "SBIRS-GEO", "id": "S", "orbital_slot_deg": 15.0}],
    "targets": [
        {
            "id": "A",
            "type": "IRBM",
            "launch": {"lat_deg": 30.0, "lon_deg": 20.0, "time_s": 1.0},
            "aim": {"lat_deg": 20.0, "lon_deg": 40.0},
        }
    ],
}


@pytest.fixture(scope="module")
def path(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return written(tmp_path_factory.mktemp("tune"), LIT)


def written(folder: Path, scene: object) -> Path:
    path = folder / "scene.yaml"
    path.write_text(json.dumps(scene), encoding="utf-8")
    return path


def counted(scene: Scene, seeds: Sequence[int], host: Host) -> Answered:
    """Return answers with a cost that falls with every level, so that no choice depends on the
    machine.
    """
    answers_of_seeds = [answers_of(opir.simulate(evolve(scene, seed=seed), host)) for seed in seeds]
    detection = scene.detection.config
    looks = 20.0 if detection.exact else -np.log10(detection.probability_tolerance)
    return answers_of_seeds, 100.0 + 30.0 * looks + 50.0 * scene.light_time


@cache
def choice(path: Path, **bounds: float) -> Tuned:
    return tuned(Tuner(str(path), runs=1, simulate=counted), bounds)


def answers(scene: dict[str, object] | Scene, *overrides: str) -> RunAnswers:
    """Return the answers of a run of a scene."""
    if not isinstance(scene, Scene):
        scene = scene_from_mapping(scene, overrides=list(overrides))
    return answers_of(opir.simulate(scene))


def knobs(**settings: object) -> dict[str, Knob]:
    """Return the knobs of the scene with other settings, by name."""
    return {knob.name: knob for knob in knobs_of(scene_from_mapping({**SCENE, **settings}))}


@pytest.mark.parametrize(
    ("settings", "names"),
    [
        ({}, {"light time"}),
        (
            {"light_time": False, "detection": "snr"},
            {"probability tolerance", "launches of the classifier"},
        ),
        (
            {"light_time": False, "detection": "snr", "classification": "none"},
            {"probability tolerance"},
        ),
        # A model is never left out.
        ({"light_time": False, "detection": "constant", "atmosphere": "lowtran"}, set()),
        ({"light_time": False, "tracker": "kepler-arc"}, {"tracker cadence"}),
        (
            {"light_time": False, "tracker": "imm"},
            {"tracker cadence and slice", "impact regions"},
        ),
    ],
)
def test_only_settings_of_named_components_are_turned(
    settings: dict[str, object], names: set[str]
) -> None:
    assert set(knobs(**settings)) == names


def test_forces_are_left_out_from_the_highest_term_down() -> None:
    levels = knobs(forces=["j2", "j3", "drag"])["forces"].levels
    assert levels == ((), ('forces=["j2", "j3"]',), ('forces=["j2"]',), ("forces=kepler",))


@pytest.mark.slow
def test_every_level_is_a_valid_scene() -> None:
    named = {
        "forces": ["j2", "j3", "j4", "drag"],
        "tracker": "imm",
        "classification": "spectral",
        "detection": "snr",
    }
    plain = {**SCENE, **named, "atmosphere": "lowtran"}
    for knob in knobs_of(scene_from_mapping(plain)):
        scenes = [scene_from_mapping(plain, overrides=list(level)) for level in knob.levels]
        assert all(scene != another for scene, another in combinations(scenes, 2))


@pytest.mark.slow
def test_a_run_does_not_differ_from_itself_and_a_coarse_one_does() -> None:
    scene = scene_from_mapping({**SCENE, "tracker": "kepler-arc"})
    exact = answers(scene)
    assert differences(exact, exact) == dict.fromkeys(MEASURES, 0.0)
    errors = differences(answers(evolve(scene, light_time=False)), exact)
    # Light takes 0.12 s: a target that climbs at 100 m/s and turns with the Earth moves some 50 m,
    # 1.4 µrad from orbit.
    assert 0.1 < errors["line_of_sight_urad"] < 20.0
    assert errors["p_d"] == 0.0


def test_an_answer_that_only_one_run_has_is_an_infinite_error() -> None:
    scene = {**SCENE, "duration_s": 48.0}  # until the track is probably a launch
    errors = differences(answers(scene), answers({**scene, "tracker": "kepler-arc"}))
    assert errors["launch_km"] == errors["position_km"] == np.inf


def test_errors_of_runs_are_joined_by_their_kind() -> None:
    none = dict.fromkeys(MEASURES, 0.0)
    errors = over_runs(
        [
            {**none, "p_d": 1.0, "impact_km": 3.0, "counts": -0.5},
            {**none, "impact_km": 4.0, "counts": 0.5},
        ]
    )
    expected = {**none, "p_d": 1.0, "impact_km": np.sqrt(12.5)}
    assert errors == pytest.approx(expected)


@pytest.mark.slow
def test_looser_errors_give_coarser_and_cheaper_settings(path: Path) -> None:
    strict, middle, loose = choices = [choice(path, p_d=bound) for bound in (1e-4, 1e-2, 0.5)]
    for bound, decision in zip((1e-4, 1e-2, 0.5), choices, strict=True):
        assert decision.meets
        assert decision.checked.error("p_d") <= bound
    assert strict.chosen.levels < middle.chosen.levels < loose.chosen.levels
    assert strict.chosen.time_s > middle.chosen.time_s > loose.chosen.time_s


@pytest.mark.slow
def test_settings_are_loosened_that_do_not_matter_for_the_error(
    path: Path,
) -> None:
    strict = choice(path, line_of_sight_urad=0.1)
    assert "light_time=false" not in strict.overrides
    assert (
        "detection.probability_tolerance=1.0e-1" in strict.overrides
    )  # it moves lines of sight by 0.01 µrad
    loose = choice(path, line_of_sight_urad=100.0)
    assert "light_time=false" in loose.overrides


def test_a_tolerance_is_never_looser_than_the_wanted_error_of_p_d() -> None:
    (knob,) = knobs_of(scene_from_mapping({**LIT, "light_time": False}))
    allowed = [level for level in range(len(knob.levels)) if knob.allows(level, {"p_d": 1e-3})]
    assert knob.levels[allowed[-1]][0] == "detection.probability_tolerance=1.0e-3"
    assert knob.allows(len(knob.levels) - 1, {"impact_km": 1.0})


def test_p_d_is_compared_where_nothing_is_detected() -> None:
    # Noisy detectors, which the thick air of the first seconds blinds.
    faint = {**LIT, "sensors": [{**DSP, "nei_w_m2": 3e-12}]}
    lit = answers({**faint, "atmosphere": "clear"})
    exact = {"model": "snr", "exact": True}
    dark = answers({**faint, "atmosphere": "lowtran", "detection": exact})
    assert differences(dark, lit)["p_d"] > 0.1


@pytest.mark.slow
@pytest.mark.parametrize("bound", [1e-4, 1e-2])
def test_the_choice_meets_the_error_on_another_scene(path: Path, bound: float) -> None:
    exact_levels = [knob.levels[0] for knob in knobs_of(scene_from_mapping(ELSEWHERE))]
    exact = answers(ELSEWHERE, *chain(*exact_levels))
    assert len(exact.detections) > 100
    coarse = answers(ELSEWHERE, *choice(path, p_d=bound).overrides)
    assert differences(coarse, exact)["p_d"] <= bound


@pytest.mark.parametrize(
    ("bounds", "overrides", "message"),
    [
        ({"impact": 1.0}, [], r"no error is called 'impact'.*impact_km"),
        ({"impact_km": 0.0}, [], "not a positive error"),
        ({}, [], "name an error"),
        (
            {"p_d": 0.1, "impact_km": 1.0},
            [],
            r"--error impact_km: even the most exact run .* tracker is none",
        ),
        ({"counts": 0.1}, ["duration_s=1.01"], r"counts: even .* last longer"),
    ],
)
def test_unknown_and_impossible_errors_are_refused(
    path: Path, bounds: dict[str, float], overrides: list[str], message: str
) -> None:
    with pytest.raises(SceneError, match=message):
        tuned(Tuner(str(path), overrides=overrides, runs=1, simulate=counted), bounds)


@pytest.mark.slow
def test_the_command_prints_overrides_that_run(
    path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    command = f"tune {path} --error p_d=1e-2 --runs 1".split()
    assert main([*command, "--json"]) == 0
    document = json.loads(capsys.readouterr().out)
    assert document["meets"]
    assert document["errors"]["p_d"] <= 1e-2
    settings = [f"--set={override}" for override in document["overrides"]]
    assert main(["validate", str(path), *settings]) == 0
    capsys.readouterr()
    assert main(command) == 0
    out = capsys.readouterr().out
    assert f"opir run {path} --set detection" in out
    assert "processor time" in out


@pytest.mark.parametrize(
    ("words", "message"), [("p_d", "has no number"), ("pd=1", "no error is called 'pd'")]
)
def test_the_command_refuses_errors_that_it_does_not_know(
    path: Path, words: str, message: str, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["tune", str(path), "--error", words]) == 2
    assert message in capsys.readouterr().err


@pytest.mark.slow
def test_replicates_of_a_plan_have_the_answers_of_single_runs() -> None:
    scene = scene_from_mapping({**LIT, "duration_s": 20.0})
    host = Host.discover()
    replicates, time_s = timed_answers(scene, [4, 5], host)
    for seed, replicate in zip((4, 5), replicates, strict=True):
        single = answers(evolve(scene, seed=seed))
        assert differences(replicate, single) == dict.fromkeys(MEASURES, 0.0)
        assert np.array_equal(replicate.detections.detection_id, single.detections.detection_id)
    assert time_s > 0.0


@pytest.mark.slow
def test_no_settings_are_run_twice(path: Path) -> None:
    calls = []

    def noted(scene: Scene, seeds: Sequence[int], host: Host) -> Answered:
        calls.append((json.dumps(scene_mapping(scene), default=str), tuple(seeds)))
        return counted(scene, seeds, host)

    tuned(Tuner(str(path), runs=1, simulate=noted), {"p_d": 1e-3})
    # The scene's own settings run once more, first and uncounted, for what is imported.
    assert len(calls) - len(set(calls)) <= 1


@pytest.mark.slow
def test_errors_are_named_that_get_worse_unasked(path: Path) -> None:
    bounds = {"counts": 0.5}
    decision = choice(path, **bounds)
    unasked = decision.not_asked(bounds)
    assert "light_time=false" in decision.overrides
    assert {"line_of_sight_urad", "latency_s"} <= set(unasked)
    assert decision.not_asked(dict.fromkeys(MEASURES, 1.0)) == []
    text = as_text(str(path), decision, bounds)
    assert "not asked for, and larger" in text
    assert "largest error of a measured line of sight" in text
    assert "the scene's own level" in text
    assert json.loads(as_json(decision, bounds))["not_asked"] == unasked


@pytest.mark.slow
def test_errors_from_the_truth_are_those_of_score() -> None:
    run = opir.simulate(scene_from_mapping({**SCENE, "tracker": "imm"}))
    evidence = evidence_of_run(run, run.plan)
    scored = state_errors(evidence, ownership(evidence)).position_m
    assert len(scored) > 10
    assert answers_of(run).from_truth["position_km"] == pytest.approx(
        1e-3 * np.sqrt(np.mean(scored**2)), rel=1e-9
    )


#: Two launches that come down.
PAIR = {**SCENE, "tracker": {"model": "imm", "cadence_s": 2.0, "slice_s": 2.0}, "light_time": False}
PAIR["targets"] = [SCENE["targets"][0], {**SCENE["targets"][0], "id": "T2"}]
#: How far estimates are from the truth, km, and in which direction, and the cost of a run, by the
#: tracker's cadence, s.
PLANTED = {
    1.0: (0.6, 0.0, 1.86),
    2.0: (0.6, 90.0, 1.0),
    5.0: (3.0, 0.0, 0.9),
    10.0: (9.0, 0.0, 0.8),
}


def planted(scene: Scene, seeds: Sequence[int], lost: float | None = None) -> Answered:
    """Return answers whose impact points are planted; at the cadence `lost` the second launch has
    none.
    """
    cadence_s = scene.tracker.config.cadence_s
    away_km, bearing_deg, cost_s = PLANTED[cadence_s]
    truth = np.radians([[9.0, 167.7], [9.0, 167.7]])
    lon, lat, _ = Geod(ellps="WGS84").fwd(167.7, 9.0, bearing_deg, 1e3 * away_km)
    impact = np.column_stack([np.radians([[lat, lon], [lat, lon]]), [0.0, 0.0]])
    if cadence_s == lost:
        impact[1] = np.nan
    nothing = np.full(2, np.nan)
    share = float(np.isfinite(impact[:, 0]).mean())
    answers = RunAnswers(
        detections=Detections.empty(),
        looks=np.empty(0, dtype=np.int64),
        probability=np.empty(0),
        first_s=np.full(2, np.inf),
        truth=truth,
        ticks=np.empty(0, dtype=np.int64),
        states=np.empty((0, 3)),
        launch=np.full((2, 3), np.nan),
        impact=impact,
        area_km2=nothing,
        contained=nothing,
        from_truth={"position_km": np.nan, "launch_km": np.nan, "impact_km": away_km},
        estimated={"position_km": 0.0, "launch_km": 0.0, "impact_km": share},
    )
    return [answers] * len(seeds), cost_s + 0.001 * (
        scene.tracker.config.forecast.config.renewal_share < 0.5
    )


def tuned_pair(
    tmp_path: Path, bound_km: float, lost: float | None = None, cadence_s: float = 2.0
) -> Tuned:
    path = written(tmp_path, {**PAIR, "tracker": {**PAIR["tracker"], "cadence_s": cadence_s}})
    tuner = Tuner(
        str(path), runs=1, simulate=lambda scene, seeds, _host: planted(scene, seeds, lost)
    )
    return tuned(tuner, {"impact_km": bound_km})


def test_settings_of_the_scene_stay_if_they_are_near_the_truth(tmp_path: Path) -> None:
    decision = tuned_pair(tmp_path, 1.0)
    assert decision.given.errors["impact_km"] == pytest.approx(0.6 * np.sqrt(2.0), rel=1e-3)
    assert decision.given.error("impact_km") == pytest.approx(0.6)
    assert (decision.overrides, decision.meets) == ((), True)
    assert decision.chosen.time_s < decision.exact.time_s / 1.8
    lines = as_text("scene.yaml", decision, {"impact_km": 1.0}).splitlines()
    assert lines[-1] == "opir run scene.yaml"
    assert "1.00 of the scene's own settings" in lines[0]
    assert [line.split()[-1] for line in lines if line.startswith("tracker cadence")] == ["3"]


def test_cheaper_settings_within_the_bounds_take_their_place(tmp_path: Path) -> None:
    decision = tuned_pair(tmp_path, 7.0)
    assert "tracker.cadence_s=5.0" in decision.overrides
    assert decision.chosen.time_s < decision.given.time_s


def test_settings_that_lose_a_launch_are_not_chosen(tmp_path: Path) -> None:
    decision = tuned_pair(tmp_path, 1.0, lost=2.0)
    assert decision.given.error("impact_km") == np.inf
    assert "tracker.cadence_s=1.0" in decision.overrides
    assert "0.6 (50 % of launches)" in as_text("scene.yaml", decision, {"impact_km": 1.0})


def test_settings_of_the_scene_far_from_the_truth_are_changed(tmp_path: Path) -> None:
    assert "tracker.cadence_s=1.0" in tuned_pair(tmp_path, 1.0, cadence_s=10.0).overrides


def test_launches_that_only_one_run_tracks_are_an_infinite_error() -> None:
    planted_answers = planted(scene_from_mapping(PAIR), [1])[0][0]
    ticks = np.array([2000, 2001, 4000, 4001])  # of launches 0 and 1
    exact = evolve(planted_answers, ticks=ticks, states=np.zeros((4, 3)), contained=np.ones(2))
    partial = evolve(
        exact, ticks=ticks[::2], states=np.zeros((2, 3)), contained=np.array([1.0, np.nan])
    )
    for run, error in ((exact, 0.0), (partial, np.inf)):
        errors = differences(run, exact)
        assert errors["position_km"] == errors["region_contains"] == error
