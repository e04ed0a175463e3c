"""`opir tune`: the settings it chooses are coarser for looser errors, and meet the error on scenes
it never saw.
"""

import json
from collections.abc import Sequence
from functools import cache
from itertools import combinations
from pathlib import Path

import numpy as np
import pytest
from attrs import evolve
from opir_scoring import evidence_of_run, ownership
from opir_scoring.errors import state_errors
from opir_studies.differences import MEASURES, RunAnswers, answers_of, differences, over_runs
from opir_studies.knobs import knobs_of
from opir_studies.tune_command import as_json, as_text
from opir_studies.tuning import Answered, Tuned, Tuner, overrides_at, timed_answers, tuned
from pyproj import Geod
from study_scene import SCENE

import opir_core as opir
from opir_core.cli.main import main
from opir_core.errors import SceneError
from opir_core.host.host import Host
from opir_core.plugin import Detections
from opir_core.reading import scene_from_mapping, scene_mapping
from opir_core.scene.scene import Scene

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
    found = [answers_of(opir.simulate(evolve(scene, seed=seed), host)) for seed in seeds]
    detection = scene.detection.config
    looks = 20.0 if detection.exact else -np.log10(detection.probability_tolerance)
    return found, 100.0 + 30.0 * looks + 50.0 * scene.light_time


@cache
def choice(path: Path, **wanted: float) -> Tuned:
    return tuned(Tuner(str(path), runs=1, simulate=counted), wanted)


def test_only_settings_of_what_a_scene_names_are_turned() -> None:
    def names(**more: object) -> set[str]:
        return {knob.name for knob in knobs_of(scene_from_mapping({**SCENE, **more}))}

    assert names() == {"light time"}
    assert names(light_time=False, detection="snr") == {
        "probability tolerance",
        "launches of the classifier",
    }
    assert names(light_time=False, detection="snr", classification="none") == {
        "probability tolerance"
    }
    dark = {"detection": "constant", "light_time": False}
    assert names(atmosphere="lowtran", **dark) == set()  # a model is never left out
    assert "tracker cadence" in names(tracker="kepler-arc")
    assert {"tracker cadence and slice", "impact regions"} <= names(tracker="imm")


def test_forces_are_left_out_from_the_highest_term_down() -> None:
    (knob,) = (
        knob
        for knob in knobs_of(scene_from_mapping({**SCENE, "forces": ["j2", "j3", "drag"]}))
        if knob.name == "forces"
    )
    assert knob.levels == ((), ('forces=["j2", "j3"]',), ('forces=["j2"]',), ("forces=kepler",))


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
        seen = [scene_from_mapping(plain, overrides=list(level)) for level in knob.levels]
        assert all(one != other for one, other in combinations(seen, 2))


@pytest.mark.slow
def test_a_run_does_not_differ_from_itself_and_a_coarse_one_does() -> None:
    scene = scene_from_mapping({**SCENE, "tracker": "kepler-arc"})
    exact = answers_of(opir.simulate(scene))
    assert set(differences(exact, exact)) == set(MEASURES)
    assert max(map(abs, differences(exact, exact).values())) == 0.0
    late = differences(answers_of(opir.simulate(evolve(scene, light_time=False))), exact)
    # Light takes 0.12 s: a target that climbs at 100 m/s and turns with the Earth moves some 50 m,
    # 1.4 µrad from orbit.
    assert 0.1 < late["line_of_sight_urad"] < 20.0
    assert late["p_d"] == 0.0


def test_an_answer_that_only_one_run_has_is_an_infinite_error() -> None:
    whole = {**SCENE, "duration_s": 48.0}  # until the track is probably a launch
    scene = scene_from_mapping({**whole, "tracker": "kepler-arc"})
    exact, without = (
        answers_of(opir.simulate(each)) for each in (scene, scene_from_mapping(whole))
    )
    assert differences(without, exact)["launch_km"] == np.inf
    assert differences(without, exact)["position_km"] == np.inf


def test_errors_of_runs_are_joined_by_their_kind() -> None:
    none = dict.fromkeys(MEASURES, 0.0)
    joined = over_runs(
        [
            {**none, "p_d": 1.0, "impact_km": 3.0, "counts": -0.5},
            {**none, "impact_km": 4.0, "counts": 0.5},
        ]
    )
    assert joined["p_d"] == 1.0
    assert joined["impact_km"] == pytest.approx(np.sqrt(12.5))
    assert joined["counts"] == 0.0


@pytest.mark.slow
def test_looser_errors_give_coarser_and_cheaper_settings(path: Path) -> None:
    bounds = (1e-4, 1e-2, 0.5)
    found = [choice(path, p_d=bound) for bound in bounds]
    for bound, each in zip(bounds, found, strict=True):
        assert each.meets
        assert each.checked.error("p_d") <= bound
    assert found[0].chosen.levels < found[1].chosen.levels < found[2].chosen.levels
    assert found[0].chosen.time_s > found[1].chosen.time_s > found[2].chosen.time_s


@pytest.mark.slow
def test_a_setting_that_does_not_matter_for_the_error_is_loosened_and_one_that_does_is_not(
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
    sensors = [{**sensor, "nei_w_m2": 3e-12} for sensor in LIT["sensors"]]
    faint = {**LIT, "sensors": sensors}
    lit, dark = (
        answers_of(
            opir.simulate(scene_from_mapping({**faint, "atmosphere": air, "detection": model}))
        )
        for air, model in (("clear", "snr"), ("lowtran", {"model": "snr", "exact": True}))
    )
    assert differences(dark, lit)["p_d"] > 0.1


@pytest.mark.slow
@pytest.mark.parametrize("bound", [1e-4, 1e-2])
def test_the_choice_meets_the_error_on_a_scene_that_it_was_not_made_on(
    path: Path, bound: float
) -> None:
    found = choice(path, p_d=bound)
    knobs = knobs_of(scene_from_mapping(ELSEWHERE))
    exact, chosen = (
        answers_of(opir.simulate(scene_from_mapping(ELSEWHERE, overrides=list(overrides))))
        for overrides in (overrides_at(knobs, [0] * len(knobs)), found.overrides)
    )
    assert len(exact.detections) > 100
    assert differences(chosen, exact)["p_d"] <= bound


def test_unknown_and_impossible_errors_are_refused(path: Path) -> None:
    with pytest.raises(SceneError, match=r"no error is called 'impact'.*impact_km"):
        tuned(Tuner(str(path)), {"impact": 1.0})
    with pytest.raises(SceneError, match="not a positive error"):
        tuned(Tuner(str(path)), {"impact_km": 0.0})
    with pytest.raises(SceneError, match="name an error"):
        tuned(Tuner(str(path)), {})


def test_errors_of_what_a_scene_does_not_tell_are_refused(path: Path) -> None:
    with pytest.raises(
        SceneError, match=r"--error impact_km: even the most exact run .* tracker is none"
    ):
        tuned(Tuner(str(path), runs=1, simulate=counted), {"p_d": 0.1, "impact_km": 1.0})
    with pytest.raises(SceneError, match=r"counts: even .* last longer"):
        tuned(
            Tuner(str(path), overrides=["duration_s=1.01"], runs=1, simulate=counted),
            {"counts": 0.1},
        )


@pytest.mark.slow
def test_the_command_prints_overrides_that_run(
    path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    assert main(["tune", str(path), "--error", "p_d=1e-2", "--runs", "1", "--json"]) == 0
    found = json.loads(capsys.readouterr().out)
    assert found["meets"]
    assert found["errors"]["p_d"] <= 1e-2
    assert (
        main(
            [
                "validate",
                str(path),
                *(word for each in found["overrides"] for word in ("--set", each)),
            ]
        )
        == 0
    )
    capsys.readouterr()
    assert main(["tune", str(path), "--error", "p_d=1e-2", "--runs", "1"]) == 0
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
    found, time_s = timed_answers(scene, [4, 5], host)
    for seed, each in zip((4, 5), found, strict=True):
        alone = answers_of(opir.simulate(evolve(scene, seed=seed), host))
        assert max(map(abs, differences(each, alone).values())) == 0.0
        assert np.array_equal(each.detections.detection_id, alone.detections.detection_id)
    assert time_s > 0.0


@pytest.mark.slow
def test_no_settings_are_run_twice(path: Path) -> None:
    asked = []

    def noted(scene: Scene, seeds: Sequence[int], host: Host) -> Answered:
        asked.append((json.dumps(scene_mapping(scene), default=str), tuple(seeds)))
        return counted(scene, seeds, host)

    tuned(Tuner(str(path), runs=1, simulate=noted), {"p_d": 1e-3})
    # The scene's own settings run once more, first and uncounted, for what is imported.
    assert len(asked) - len(set(asked)) <= 1


@pytest.mark.slow
def test_what_was_not_asked_for_is_named_where_it_gets_worse(path: Path) -> None:
    found = choice(path, counts=0.5)
    assert "light_time=false" in found.overrides
    assert {"line_of_sight_urad", "latency_s"} <= set(found.not_asked({"counts": 0.5}))
    assert found.not_asked(dict.fromkeys(MEASURES, 1.0)) == []
    text = as_text(str(path), found, {"counts": 0.5})
    assert "not asked for, and larger" in text
    assert "largest error of a measured line of sight" in text
    assert "the scene's own level" in text
    assert json.loads(as_json(found, {"counts": 0.5}))["not_asked"] == found.not_asked(
        {"counts": 0.5}
    )


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
    return [answers] * len(seeds), cost_s + 0.001 * (scene.tracker.config.regions_every_s < 60.0)


def tuned_pair(
    tmp_path: Path, wanted_km: float, lost: float | None = None, cadence_s: float = 2.0
) -> Tuned:
    path = written(tmp_path, {**PAIR, "tracker": {**PAIR["tracker"], "cadence_s": cadence_s}})
    tuner = Tuner(
        str(path), runs=1, simulate=lambda scene, seeds, _host: planted(scene, seeds, lost)
    )
    return tuned(tuner, {"impact_km": wanted_km})


def test_settings_of_the_scene_that_are_as_near_to_the_truth_as_any_stay(tmp_path: Path) -> None:
    found = tuned_pair(tmp_path, 1.0)
    assert found.given.errors["impact_km"] == pytest.approx(0.6 * np.sqrt(2.0), rel=1e-3)
    assert found.given.error("impact_km") == pytest.approx(0.6)
    assert (found.overrides, found.meets) == ((), True)
    assert found.chosen.time_s < found.exact.time_s / 1.8
    text = as_text("scene.yaml", found, {"impact_km": 1.0})
    assert text.splitlines()[-1] == "opir run scene.yaml"
    assert "1.00 of the scene's own settings" in text
    assert [
        line.split()[-1] for line in text.splitlines() if line.startswith("tracker cadence")
    ] == ["3"]


def test_cheaper_settings_that_meet_the_wish_take_their_place(tmp_path: Path) -> None:
    found = tuned_pair(tmp_path, 7.0)
    assert "tracker.cadence_s=5.0" in found.overrides
    assert found.chosen.time_s < found.given.time_s


def test_settings_that_lose_a_launch_are_no_choice_however_near_the_others_are(
    tmp_path: Path,
) -> None:
    found = tuned_pair(tmp_path, 1.0, lost=2.0)
    assert found.given.error("impact_km") == np.inf
    assert "tracker.cadence_s=1.0" in found.overrides
    assert "0.6 (50 % of launches)" in as_text("scene.yaml", found, {"impact_km": 1.0})


def test_settings_of_the_scene_that_are_far_from_the_truth_are_changed(tmp_path: Path) -> None:
    found = tuned_pair(tmp_path, 1.0, cadence_s=10.0)
    assert "tracker.cadence_s=1.0" in found.overrides


def test_launches_that_only_one_run_tracks_are_an_infinite_error() -> None:
    both = planted(scene_from_mapping(PAIR), [1])[0][0]
    ticks = np.array([2000, 2001, 4000, 4001])  # of launches 0 and 1
    exact = evolve(both, ticks=ticks, states=np.zeros((4, 3)), contained=np.array([1.0, 1.0]))
    one = evolve(
        exact, ticks=ticks[::2], states=np.zeros((2, 3)), contained=np.array([1.0, np.nan])
    )
    assert (
        differences(exact, exact)["position_km"]
        == differences(exact, exact)["region_contains"]
        == 0.0
    )
    assert (
        differences(one, exact)["position_km"]
        == differences(one, exact)["region_contains"]
        == np.inf
    )
