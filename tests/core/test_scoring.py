"""Scores: each figure against a case whose answer is known without it."""

import json
from math import factorial
from pathlib import Path

import numpy as np
import pytest
from attrs import evolve
from scipy.stats import chi2

from opir_core.cli import main
from opir_core.errors import SceneError
from opir_core.flight import propagate_kepler
from opir_core.geometry import eci_to_ecef
from opir_core.plan import compile_plan
from opir_core.reading import scene_from_mapping
from opir_core.run import run_of_plan
from opir_core.scoring import evidence_of_run, scorecard
from opir_core.scoring.bound import (
    FREE_PRIOR_SIGMA,
    JERK_NOISE_M_S3,
    free_bound,
    position_and_velocity,
    state_bound,
)
from opir_core.scoring.consistency import consistency, containment, nees, proportion, root_mean_square
from opir_core.scoring.evidence import Evidence, true_states
from opir_core.scoring.files import evidence_of_files
from opir_core.scoring.innovations import innovations
from opir_core.scoring.ownership import ownership
from opir_core.scoring.scorecard import ScoreSettings

RNG = np.random.default_rng(11)

SCENE = {
    "scene": "score",
    "epoch": "2026-04-01T12:00:00Z",
    "duration_s": 90.0,
    "seed": 7,
    "sensors": [
        {"model": "SBIRS-GEO", "id": "A", "orbital_slot_deg": -150.0},
        {"model": "SBIRS-GEO", "id": "B", "orbital_slot_deg": -90.0},
    ],
    "targets": [
        {
            "id": "T1",
            "type": "ICBM",
            "launch": {"lat_deg": 34.73, "lon_deg": -120.57, "time_s": 10.0},
            "aim": {"lat_deg": 9.0, "lon_deg": 167.7},
        }
    ],
    "tracker": "stereo-filter",
}


def random_covariance(size):
    root = RNG.normal(size=(size, size)) * np.logspace(0, 4, size)[:, None]
    return root @ root.T


def test_nees_is_the_squared_length_of_whitened_errors():
    covariance = np.stack([random_covariance(6) for _ in range(20)])
    white = RNG.normal(size=(20, 6))
    error = np.einsum("nij,nj->ni", np.linalg.cholesky(covariance), white)
    assert nees(error, covariance) == pytest.approx(np.sum(white**2, axis=1), rel=1e-6)


def test_nees_of_the_unknown_is_nan_and_of_a_false_covariance_inf():
    covariance = np.stack([np.eye(2), np.full((2, 2), np.nan), -np.eye(2), np.ones((2, 2)) * 2.0 - np.eye(2)])
    value = nees(np.ones((4, 2)), covariance)
    assert value[0] == pytest.approx(2.0)
    assert np.isnan(value[1])
    assert np.isinf(value[2:]).all()


def test_honest_samples_pass_and_others_do_not():
    honest = chi2(6).rvs(2000, random_state=3)
    found = consistency(honest, 6)
    assert found.is_inside
    assert found.p_value > 0.001
    assert not consistency(1.3 * honest, 6).is_inside
    # Half far too large, half far too small: the mean is right, the distribution is not.
    mixed = np.where(np.arange(2000) % 2 == 0, 0.2, 1.8) * honest
    assert abs(consistency(mixed, 6).mean / 6.0 - 1.0) < 0.1
    assert consistency(mixed, 6).p_value < 1e-6


def test_containment_of_honest_ellipses_is_nominal():
    values = chi2(2).rvs(5000, random_state=5)
    for nominal in (0.5, 0.9, 0.95):
        share, low, high = containment(values, 2, nominal)
        assert low < nominal < high
        assert share == pytest.approx(nominal, abs=0.02)


def test_a_proportions_interval_is_wilsons():
    # Brown, Cai and DasGupta, Statistical Science 16 (2001): no interval beyond [0, 1], none of length 0 at 0 of n.
    assert proportion(0, 10) == pytest.approx((0.0, 0.0, 0.27753), abs=1e-5)
    assert proportion(10, 10)[2] == pytest.approx(1.0)
    assert np.isnan(proportion(0, 0)).all()


def test_errors_that_depend_on_each_other_widen_the_interval():
    error = np.repeat(RNG.normal(size=20), 50)
    alone, together = root_mean_square(error), root_mean_square(error, np.repeat(np.arange(20), 50))
    assert alone[0] == together[0]
    assert together[2] - together[1] > 4.0 * (alone[2] - alone[1])
    assert np.isnan(root_mean_square(error, np.zeros(1000, dtype=np.int64))[1:]).all()


def test_a_root_mean_square_has_its_interval_about_it():
    value, low, high = root_mean_square(RNG.normal(size=500) * 3.0)
    assert low < value < high
    assert value == pytest.approx(3.0, rel=0.15)
    assert np.isnan(root_mean_square(np.array([np.nan]))).all()


def test_the_bound_of_one_look_of_two_sensors_is_that_of_triangulation():
    target = np.array([[6.6e6, 0.0, 0.0]] * 2)
    sensor = np.array([[3.0e7, 2.5e7, 0.0], [3.0e7, -2.5e7, 1.0e6]])
    sigma = np.array([2e-5, 3e-5])
    bounds = state_bound(np.zeros(1), np.zeros(2), target, sensor, sigma)
    information = np.eye(3) * 1e-12
    for line, spread in zip(target - sensor, sigma, strict=True):
        unit = line / np.linalg.norm(line)
        information += (np.eye(3) - np.outer(unit, unit)) / (np.linalg.norm(line) * spread) ** 2
    assert bounds[0, :3, :3] == pytest.approx(np.linalg.inv(information), rel=1e-9)


@pytest.mark.parametrize("name", ["crlb_geo_60deg_apart", "crlb_three_geo"])
def test_the_bound_is_the_published_one(name):
    cases = json.loads((Path(__file__).parents[1] / "data" / "reference_cases.json").read_text())["cases"]
    case = next(each for each in cases if each["id"] == name)
    given, expected = case["inputs"], case["expected"]
    longitude = np.radians(given["sat_lon_deg"])
    sensor = given["sat_radius_m"] * np.stack([np.cos(longitude), np.sin(longitude), 0.0 * longitude], axis=1)
    target = np.broadcast_to(np.array(expected["target_ecef_m"]), sensor.shape)
    bounds = state_bound(np.zeros(1), np.zeros(len(sensor)), target, sensor, np.array(given["sigma_rad_per_axis"]))
    # A prior of 1000 km tells 1e-7 of what the looks do.
    assert bounds[0, :3, :3] == pytest.approx(np.array(expected["cov_ecef_m2"]), rel=1e-5, abs=1.0)
    assert position_and_velocity(bounds)[0][0] == pytest.approx(expected["rss_m"], rel=1e-6)


def test_the_bound_is_carried_as_small_differences_of_orbits_grow():
    state = np.array([6.9e6, 1.0e6, 2.0e6, -1000.0, 5500.0, 3000.0])
    looks, tick = np.array([0.0, 40.0, 80.0]), 100.0
    at, _ = propagate_kepler(state[:3], state[3:], looks)
    sensors = eci_to_ecef(np.array([[4.0e7, 1.0e7, 0.0], [3.0e7, -3.0e7, 0.0], [4.0e7, 0.0, 1.0e7]]), looks)
    sigma = np.full(3, 1e-5)
    found = state_bound(np.array([tick]), looks, eci_to_ecef(at, looks), sensors, sigma)[0]
    information = np.zeros((6, 6))
    prior = np.diag(1.0 / np.square([1e6] * 3 + [1e4] * 3))
    end = np.concatenate(propagate_kepler(state[:3], state[3:], tick))
    inertial = np.array([[4.0e7, 1.0e7, 0.0], [3.0e7, -3.0e7, 0.0], [4.0e7, 0.0, 1.0e7]])
    for time_s, sensor, place in zip(looks, inertial, at, strict=True):
        flow = differences(end, time_s - tick)
        line = place - sensor
        unit = line / np.linalg.norm(line)
        rows = ((np.eye(3) - np.outer(unit, unit)) / (np.linalg.norm(line) * 1e-5)) @ flow[:3]
        information += rows.T @ rows
    back = differences(end, -tick)
    # The inertial frame of the bound is the Earth-fixed one at the scene's epoch: that of the sensors here.
    expected = np.linalg.inv(information + back.T @ prior @ back)
    for ours, theirs in zip(position_and_velocity(found[None]), position_and_velocity(expected[None]), strict=True):
        assert ours == pytest.approx(theirs, rel=1e-3)


def test_the_bound_of_an_unknown_thrust_is_that_of_kalmans_recursion():
    looks = np.arange(0.0, 20.0, 0.4)
    path = np.array([6.9e6, 0.0, 0.0]) + np.array([0.0, 2000.0, 0.0]) * looks[:, None]
    target = eci_to_ecef(path, looks)
    inertial = np.where(np.arange(len(looks))[:, None] % 2, [3.0e7, 2.5e7, 0.0], [3.0e7, -2.5e7, 1.0e6])
    sigma = np.full(len(looks), 2e-5)
    found = free_bound(np.array([19.6]), looks, target, eci_to_ecef(inertial, looks), sigma)[0]
    covariance = np.diag(np.square(FREE_PRIOR_SIGMA))
    power = np.array([[0.4 ** (b - a) / factorial(b - a) if b >= a else 0.0 for b in range(4)] for a in range(4)])
    step = np.kron(power, np.eye(3))
    orders = [3 - a for a in range(4)]
    noise = [[0.4 ** (a + b + 1) / (factorial(a) * factorial(b) * (a + b + 1)) for b in orders] for a in orders]
    noise = JERK_NOISE_M_S3**2 * np.kron(np.array(noise), np.eye(3))
    for number, (place, sensor) in enumerate(zip(path, inertial, strict=True)):
        covariance = step @ covariance @ step.T + noise if number else covariance
        line = place - sensor
        unit = line / np.linalg.norm(line)
        across = np.linalg.svd(unit[None])[2][1:] / (np.linalg.norm(line) * 2e-5)
        slope = np.concatenate([across, np.zeros((2, 9))], axis=1)
        gain = covariance @ slope.T @ np.linalg.inv(slope @ covariance @ slope.T + np.eye(2))
        rest = np.eye(12) - gain @ slope
        covariance = rest @ covariance @ rest.T + gain @ gain.T
    for ours, theirs in zip(
        position_and_velocity(found[None]), position_and_velocity(covariance[None, :6, :6]), strict=True
    ):
        assert ours == pytest.approx(theirs, rel=1e-5)
    known = state_bound(np.array([19.6]), looks, target, eci_to_ecef(inertial, looks), sigma)
    assert (position_and_velocity(known)[0] < position_and_velocity(found[None])[0]).all()


def judged_innovations(scale):
    """Return the innovations of a tracker that errs `scale` times as much as it says."""
    plan = compile_plan(scene_from_mapping({**SCENE, "duration_s": 130.0}))
    evidence = evidence_of_run(run_of_plan(plan), plan)
    told = evidence.tracks.take(evidence.tracks.track == evidence.tracks.track[0])
    told = told.take((told.tick_s > 30.0) & (told.tick_s < 129.0))
    rng = np.random.default_rng(2)
    sigma = np.array([400.0] * 3 + [5.0] * 3)
    state = true_states(plan, np.zeros(len(told), dtype=np.int32), told.tick_s)
    state = state + scale * sigma * rng.normal(size=state.shape)
    told = evolve(told, state=state, state_covariance=np.tile(np.diag(sigma**2), (len(told), 1, 1)))
    evidence = evolve(evidence, tracks=told)
    return innovations(evidence, ownership(evidence))


def test_innovations_of_an_honest_tracker_are_chi_squared():
    found = judged_innovations(1.0)
    assert len(found) > 80
    honest = consistency(found.nis, 2, 0.999)
    assert honest.is_inside
    assert honest.p_value > 0.001
    assert not consistency(judged_innovations(3.0).nis, 2, 0.999).is_inside


def differences(state, span_s):
    """Return how the state a span later differs with the state, by central differences of two-body propagation."""
    steps = np.array([10.0] * 3 + [0.01] * 3)
    up, down = state + np.diag(steps), state - np.diag(steps)
    ends = [np.concatenate(propagate_kepler(each[:, :3], each[:, 3:], span_s), axis=1) for each in (up, down)]
    return ((ends[0] - ends[1]) / (2.0 * steps[:, None])).T


def test_true_states_are_those_of_the_trajectory():
    plan = compile_plan(scene_from_mapping(SCENE))
    times = np.array([5.0, 10.0, 80.0, 200.0, 5000.0])
    states = true_states(plan, np.zeros(5, dtype=np.int32), times)
    assert np.isnan(states[[0, 4]]).all()
    boost = plan.targets.trajectories[0].flight.path
    position, velocity = boost.state(np.zeros(3, dtype=np.int64), times[1:4])
    assert np.abs(states[1:4, :3] - position).max() < 0.02
    # At rest on the pad the velocity is one-sided over a quarter of a second.
    assert np.abs(states[2:4, 3:] - velocity[1:]).max() < 0.2


def synthetic(track, target):
    plan = compile_plan(scene_from_mapping(SCENE))
    run = run_of_plan(plan)
    rows = np.arange(len(track))
    return Evidence(
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


def test_a_track_belongs_to_the_target_of_most_of_its_detections():
    owners = ownership(synthetic([0, 0, 0, 0, -1], [0, 0, 0, -1, 0]))
    assert owners.target.tolist() == [0]
    assert owners.purity[0] == pytest.approx(0.75)
    assert owners.is_stereo[0]
    noise = ownership(synthetic([0, 0, 0], [-1, -1, 0]))
    assert noise.target.tolist() == [-1]
    assert not noise.is_best.any()


def test_a_scene_is_scored_alike_from_memory_and_from_its_files(tmp_path, capsys):
    scene = tmp_path / "scene.yaml"
    scene.write_text(json.dumps({**SCENE, "outputs": [{"jsonl": {"path": str(tmp_path / "events.jsonl")}}]}))
    assert main(["run", str(scene), "--quiet"]) == 0
    plan = compile_plan(scene_from_mapping(SCENE))
    here = scorecard([evidence_of_run(run_of_plan(plan), plan)]).as_plain()
    there = scorecard([evidence_of_files(tmp_path / "events.jsonl")]).as_plain()
    for name in ("launches_tracked", "purity", "completeness", "gospa", "seeds"):
        assert there[name] == here[name]
    ours, theirs = here["stereo"]["by_time"], there["stereo"]["by_time"]
    assert [part["position_m"] for part in ours] == [part["position_m"] for part in theirs]
    # Events tell sensors' errors to a few digits.
    for name in ("position_over_bound", "velocity_over_free_bound"):
        assert ours[-1][name]["value"] == pytest.approx(theirs[-1][name]["value"], rel=1e-3)
    # Events tell angles to 1e-9 degrees.
    assert ours[1]["nis"]["samples"] > 10
    assert ours[1]["nis"]["mean"] == pytest.approx(theirs[1]["nis"]["mean"], rel=1e-3)
    capsys.readouterr()
    assert main(["score", str(tmp_path / "events.jsonl")]) == 0
    told = capsys.readouterr().out
    assert "launches tracked" in told
    assert "stereo" in told


def test_tracks_of_burnt_out_launches_are_not_false():
    srbm = {
        "id": "T2",
        "type": "SRBM",
        "launch": {"lat_deg": 36.0, "lon_deg": -115.0, "time_s": 2.0},
        "aim": {"lat_deg": 38.0, "lon_deg": -114.0},
    }
    plan = compile_plan(scene_from_mapping({**SCENE, "duration_s": 80.0, "targets": [*SCENE["targets"], srbm]}))
    run = run_of_plan(plan)
    assert plan.targets.burnout_s[1] < 75.0
    assert np.count_nonzero(run.tracks.tick_s > 75.0) > 5
    found = scorecard([evidence_of_run(run, plan)], ScoreSettings(cutoff_m=5e4)).figures["gospa"]
    assert found["false_a_target"]["value"] == 0.0
    assert found["localisation_a_target"]["value"] > 0.0


def test_compare_tells_every_tracker(tmp_path, capsys):
    scene = tmp_path / "scene.yaml"
    scene.write_text(json.dumps({**SCENE, "duration_s": 40.0}))
    words = ["compare", str(scene), "--runs", "2", "--json", "--tracker", "stereo-filter"]
    assert main([*words, "--tracker", "{model: stereo-filter, motion: boost}"]) == 0
    told = json.loads(capsys.readouterr().out)
    assert list(told) == ["stereo-filter", "{model: stereo-filter, motion: boost}"]
    assert told["stereo-filter"]["seeds"] == [7, 8]
    assert told["stereo-filter"]["tracking_us_a_detection"]["value"] > 0.0
    assert told["stereo-filter"]["tracking_us_a_track_update"]["value"] > 0.0


def test_compare_tells_trackers_side_by_side(tmp_path, capsys):
    scene = tmp_path / "scene.yaml"
    scene.write_text(json.dumps({**SCENE, "duration_s": 30.0}))
    words = ["compare", str(scene), "--runs", "2", "--tracker", "kepler-arc", "--tracker", "stereo-filter"]
    assert main(words) == 0
    told = capsys.readouterr().out
    assert told.startswith("2 runs of each tracker (seeds 7 to 8), sensors without bias; [95 % intervals]; GOSPA: c")
    bins = [line.split()[:2] for line in told.splitlines() if line.startswith("0-20")]
    assert bins == [["0-20", "kepler-arc"], ["0-20", "stereo-filter"]] * 2
    for figure in ("/known", "/unknown", "NEES/6", "NIS/2", "impact km", "told SRBM", "located, missed, false"):
        assert figure in told


@pytest.mark.parametrize(
    ("words", "message"),
    [
        (["compare", "SCENE", "--runs", "0"], "--runs: 0 is not a number of runs"),
        (["compare", "SCENE", "--tracker", "none", "--runs", "1"], "none makes no tracks to judge"),
        (["compare", "SCENE", "--alpha", "3"], "--alpha: must be in (0, 2]"),
        (["score", "nothing.jsonl"], "the manifest is not there"),
    ],
)
def test_what_cannot_be_judged_is_told(tmp_path, capsys, monkeypatch, words, message):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "SCENE").write_text(json.dumps(SCENE))
    assert main(words) == 2
    assert message in capsys.readouterr().err


def test_files_of_different_runs_are_refused(tmp_path):
    scene = tmp_path / "scene.yaml"
    scene.write_text(json.dumps({**SCENE, "outputs": [{"jsonl": {"path": str(tmp_path / "events.jsonl")}}]}))
    main(["run", str(scene), "--quiet"])
    main(["run", str(scene), "--quiet", "--seed", "8", "--out", str(tmp_path / "other.jsonl")])
    with pytest.raises(SceneError, match="the files are of different runs"):
        evidence_of_files(tmp_path / "events.jsonl", truth=tmp_path / "other.truth.jsonl")
    (tmp_path / "events.tracks.jsonl").write_text("{}\n")
    with pytest.raises(SceneError, match="line 1: a track without"):
        evidence_of_files(tmp_path / "events.jsonl")
