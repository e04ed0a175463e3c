"""The target models `orbit` and `glide` in scenes: models by class, truth, scores and summaries
without an impact.
"""

import json

import numpy as np
import opir_forecast.plugin as forecast
import opir_photons.detection.plugin as snr
import opir_photons.radiometry.plugin as light
import pytest
from opir_scoring import evidence_of_run, scorecard
from opir_testing.bench import bench_scene
from opir_trackers import plugin as trackers

from opir_core import Host, SceneError, compile_plan, run_of_plan, scene_from_mapping
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_MU_M3_S2
from opir_core.geometry import ecef_to_eci
from opir_core.reading import scene_mapping

HOST = Host.of(trackers, forecast, light, snr)
LAUNCH = {"lat_deg": 28.5, "lon_deg": -80.6, "time_s": 5.0}
SLV = {"id": "SLV-1", "type": "SLV", "launch": LAUNCH, "azimuth_deg": 90.0}
HGV = {"id": "HGV-1", "type": "HGV", "launch": LAUNCH, "aim": {"lat_deg": 40.0, "lon_deg": -30.0}}
ICBM = {"id": "ICBM-1", "type": "ICBM", "launch": LAUNCH, "aim": {"lat_deg": 60.0, "lon_deg": 30.0}}
STARING = {"model": "generic-scanner", "orbital_slot_deg": -60.0, "scan_period_ms": 500.0}


def scene_of(*targets, **changes):
    return scene_from_mapping(bench_scene(targets=list(targets), **changes), host=HOST)


def plan_of(*targets, follows=False, **changes):
    sensors = [
        {**STARING, "id": "S1", "follows_bodies": follows},
        {**STARING, "id": "S2", "orbital_slot_deg": -110.0},
    ]
    return compile_plan(
        scene_of(*targets, sensors=sensors, **{"duration_s": 700.0, **changes}), HOST
    )


def problems_of(*targets):
    with pytest.raises(SceneError) as caught:
        compile_plan(scene_of(*targets), HOST)
    return {problem.path: problem.message for problem in caught.value.problems}


@pytest.mark.parametrize(("target", "model"), [(SLV, "orbit"), (HGV, "glide"), (ICBM, "ballistic")])
def test_a_target_without_a_model_has_that_of_its_class(target, model):
    scene = scene_of(target)
    assert scene.targets[0].model.name == model
    assert scene_from_mapping(scene_mapping(scene), host=HOST) == scene


@pytest.mark.parametrize(
    ("target", "words"),
    [
        (
            {**ICBM, "type": "HGV", "model": "ballistic"},
            "HGV has the model glide, not ballistic; omit model",
        ),
        (
            {**ICBM, "type": "SLV", "model": "glide"},
            "SLV has the model orbit, not glide; omit model",
        ),
        (
            {**SLV, "type": "ICBM", "model": "orbit"},
            "ICBM has the model ballistic, not orbit; omit model",
        ),
    ],
)
def test_a_model_of_another_flight_is_refused(target, words):
    assert problems_of(target) == {"targets[0].type": words}


def test_keys_of_another_model_are_refused_with_their_place():
    with pytest.raises(
        SceneError, match=r"targets\[0\].aim: unknown key; it belongs to the target models"
    ):
        scene_of({**SLV, "aim": HGV["aim"]})


def test_an_aim_point_out_of_reach_of_a_glide_is_refused():
    message = problems_of({**HGV, "aim": {"lat_deg": 29.0, "lon_deg": -80.0}})["targets[0].aim"]
    assert "81 km from the launch point; HGV flies 2000 to 8000 km" in message


def test_the_truth_of_an_insertion_has_an_orbit_and_no_impact():
    (truth,) = plan_of({**SLV, "altitude_km": 300.0}).targets.truth()
    assert "impact" not in truth
    assert "aim" not in truth
    json.dumps(truth, allow_nan=False)
    orbit = truth["orbit"]
    assert orbit["altitude_m"] == pytest.approx(300e3, abs=0.01)
    assert orbit["eccentricity"] < 1e-8
    axis_m = EARTH_EQUATORIAL_RADIUS_M + 300e3
    assert orbit["semi_major_axis_m"] == pytest.approx(axis_m, abs=0.1)
    assert orbit["period_s"] == pytest.approx(
        2.0 * np.pi * np.sqrt(axis_m**3 / EARTH_MU_M3_S2), abs=1e-3
    )
    # Due east from 28.5 degrees north, whose geocentric latitude is 28.34.
    assert orbit["inclination_deg"] == pytest.approx(28.34, abs=0.15)


def test_the_truth_of_a_glide_goes_over_its_end_to_the_aim_point():
    (truth,) = plan_of(HGV).targets.truth()
    json.dumps(truth, allow_nan=False)
    assert truth["burnout_s"] < truth["glide_end"]["time_s"] < truth["impact"]["time_s"]
    assert truth["glide_end"]["height_m"] > 15e3
    assert (truth["impact"]["lat_deg"], truth["impact"]["lon_deg"]) == pytest.approx(
        (40.0, -30.0), abs=1e-6
    )
    assert truth["miss_m"] < 0.01


def test_orbits_are_seen_as_long_as_the_scene_says():
    plan = plan_of({**SLV, "followed_s": 150.0}, follows=True)
    assert plan.targets.end_s[0] == plan.targets.burnout_s[0] + 150.0
    time_s = run_of_plan(plan).truth.emission_time_s
    assert plan.targets.burnout_s[0] + 140.0 < time_s.max() <= plan.targets.end_s[0]
    assert plan_of(SLV).targets.end_s[0] == plan.targets.burnout_s[0]


def test_an_orbit_that_is_followed_stays_at_its_radius():
    plan = plan_of({**SLV, "followed_s": 20_000.0}, follows=True)
    time_s = np.linspace(plan.targets.burnout_s[0], plan.targets.end_s[0], 500)
    position = plan.targets.position_ecef_m(np.zeros(500, dtype=np.int32), time_s)
    radius_m = np.linalg.norm(ecef_to_eci(position, time_s), axis=1)
    np.testing.assert_allclose(radius_m, EARTH_EQUATORIAL_RADIUS_M + 200e3, atol=0.05)


def test_drag_lowers_an_orbit_that_is_followed():
    settings = {"followed_s": 6000.0, "ballistic_coefficient_kg_m2": 100.0}
    radii = []
    for forces in ("kepler", ["drag"]):
        plan = plan_of({**SLV, **settings}, follows=True, forces=forces)
        time_s = np.array([plan.targets.end_s[0]])
        radii.append(
            np.linalg.norm(plan.targets.position_ecef_m(np.zeros(1, dtype=np.int32), time_s))
        )
    assert 500.0 < radii[0] - radii[1] < 50e3


def test_a_glide_is_followed_to_its_impact():
    plan = plan_of(HGV, follows=True)
    (truth,) = plan.targets.truth()
    assert plan.targets.end_s[0] == truth["impact"]["time_s"]
    flown = plan.targets.position_ecef_m(
        np.zeros(200, np.int32), np.linspace(5.0, plan.targets.end_s[0], 200)
    )
    assert np.isfinite(flown).all()


@pytest.mark.slow
def test_summaries_and_scores_do_without_an_impact():
    """A launch into orbit beside a ballistic one: its class, its right type UNKNOWN, said, and one
    impact of two.
    """
    plan = plan_of(SLV, ICBM, tracker="imm")
    run = run_of_plan(plan)
    rows = {row["target_id"]: row for row in run.summary["targets"]}
    assert rows["SLV-1"]["target_type"] == "SLV"
    figures = scorecard([evidence_of_run(run, plan)]).as_plain()
    assert list(figures["type_confusion"]) == ["ICBM", "SLV"]
    assert figures["stereo"]["impacts_reported"] == 1
    assert figures["stereo"]["targets"] == 2
    assert figures["type_right"]["value"] == 1.0


@pytest.mark.slow
def test_no_tracker_predicts_an_impact_of_a_body_in_orbit():
    plan = plan_of({**SLV, "followed_s": 300.0}, follows=True, tracker="imm", duration_s=800.0)
    tracks = run_of_plan(plan).tracks
    coasting = tracks.take(tracks.tick_s > plan.targets.burnout_s[0] + 60.0)
    assert len(coasting) > 100
    assert np.isnan(coasting.impact).all()


def test_bodies_of_gliders_are_warmer_than_those_of_others():
    """By default 1200 K against 300 K: brighter in medium waves after burnout."""
    sensor = {
        **STARING,
        "id": "S",
        "follows_bodies": True,
        "bands": {"MWIR": [4.0, 5.0]},
        "nei_w_m2": 1e-12,
    }
    changes = {
        "sensors": [sensor],
        "detection": {"model": "snr", "calibrate": "none"},
        "classification": "none",
    }
    plan = compile_plan(scene_of(HGV, ICBM, duration_s=600.0, **changes), HOST)
    run = run_of_plan(plan)
    after_burnout = run.truth.emission_time_s > plan.targets.burnout_s[run.truth.target] + 1.0
    looks = np.bincount(run.truth.target[after_burnout], minlength=2)
    assert looks[0] > 100
    assert looks[1] == 0
