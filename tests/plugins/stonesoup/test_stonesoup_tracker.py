"""The plugin `opir-stonesoup`: what it sees, against the engine, its reader against runs, its
tracker in scenes.
"""

import json
import subprocess
import sys
from datetime import datetime, timedelta

import numpy as np
import pytest
from opir_estimation import FIRST_HEIGHT_M
from opir_stonesoup.models import EarthFixedTransition, SightModel, sensor_axes
from opir_stonesoup.reader import OpirDetectionReader
from opir_stonesoup.tracker import StoneSoupTracker
from opir_stonesoup.upkeep import SilenceDeleter, ground_prior
from opir_studies.comparison import compared
from stonesoup.predictor.kalman import ExtendedKalmanPredictor
from stonesoup.predictor.particle import ParticlePredictor
from stonesoup.tracker.simple import MultiTargetTracker
from stonesoup.types.array import StateVector, StateVectors
from stonesoup.types.hypothesis import SingleHypothesis
from stonesoup.types.prediction import GaussianStatePrediction
from stonesoup.types.state import State
from stonesoup.types.track import Track
from stonesoup.types.update import GaussianStateUpdate, ParticleStateUpdate
from stonesoup.updater.kalman import ExtendedKalmanUpdater

import opir_core as opir
from opir_core.cli.main import main
from opir_core.errors import SceneError
from opir_core.geometry import intersection_with_ellipsoid
from opir_core.interfaces.contexts import TrackerContext
from opir_core.interfaces.records import Detections
from opir_core.planning.plan import compile_plan
from opir_core.simulation.run import plan_windows, run_of_plan

SCENE = "examples/first_light.yaml"
SENSORS = (
    "sensors=[{model: DSP, id: A, orbital_slot_deg: -135.0, scan_period_ms: 1000, scan_phase:"
    " aligned}, {model: SBIRS-GEO, id: B, orbital_slot_deg: -100.0, scan_period_ms: 500,"
    " scan_phase: aligned}]"
)
ALONE = "sensors=[{model: DSP, id: A, orbital_slot_deg: -135.0}]"
LAUNCHES = (
    "targets=[{id: T1, type: ICBM, launch: {lat_deg: 34.73, lon_deg: -120.57, time_s: 5.0}, aim:"
    " {lat_deg: 9.0, lon_deg: 167.7}}, {id: T2, type: IRBM, launch: {lat_deg: 35.6, lon_deg:"
    " -121.2, time_s: 8.0}, aim: {lat_deg: 20.0, lon_deg: -150.0}}]"
)


def plan_of(*overrides):
    return compile_plan(
        opir.load_scene(SCENE, overrides=["outputs=[]", "duration_s=60", SENSORS, *overrides])
    )


def test_true_states_are_seen_where_the_engine_sees_them():
    """The state at the look, light time undone by its velocity; half the acceleration times its
    square is left.
    """
    plan = plan_of()
    run = run_of_plan(plan)
    target = run.truth.target
    look = run.detections.time_s
    left = run.truth.emission_time_s
    where = plan.targets.position_ecef_m
    inside = np.flatnonzero((look > plan.targets.ignition_s[target] + 1.0) & (look < 55.0))
    worst = {True: 0.0, False: 0.0}
    for row in inside.tolist():
        one = target[row : row + 1]
        time = look[row : row + 1]
        velocity = (where(one, time + 0.01) - where(one, time - 0.01)) / 0.02
        sensor = run.detections.sensor_ecef_m[row]
        true = where(one, left[row : row + 1])[0] - sensor
        axes = sensor_axes(sensor)
        x, y, z = axes @ true
        expected = np.array([np.arctan2(z, np.hypot(x, y)), np.arctan2(y, x)])
        mean = np.concatenate([where(one, time)[0], velocity[0]])
        for light_time in worst:
            model = SightModel(
                ndim_state=6,
                mapping=(0, 1, 2),
                noise_covar=np.eye(2),
                translation_offset=StateVector(sensor),
                axes=axes,
                light_time=light_time,
            )
            seen = np.array(model.function(State(StateVector(mean))), float)[:, 0]
            worst[light_time] = max(worst[light_time], float(np.abs(seen - expected).max()))
    assert worst[True] < 1e-8
    assert worst[False] > 1e-6, "without light time it would be reported"


@pytest.mark.slow
def test_readers_of_runs_windows_and_events_agree(tmp_path):
    path = tmp_path / "events.jsonl"
    plan = plan_of(LAUNCHES)
    windows = list(plan_windows(plan, 7.0))
    run = run_of_plan(plan_of(LAUNCHES))
    words = [
        word for override in ("duration_s=60", SENSORS, LAUNCHES) for word in ("--set", override)
    ]
    assert main(["run", SCENE, "--quiet", "--out", str(path), *words]) == 0
    readers = [
        OpirDetectionReader.of_run(run),
        OpirDetectionReader.of_windows(windows, plan.sensors, plan.scene.epoch_us),
        OpirDetectionReader.of_events(path),
    ]
    steps = [[(time, list(found)) for time, found in reader] for reader in readers]
    assert len(run.detections) == sum(len(found) for _, found in steps[0]) > 100
    assert max(len(found) for _, found in steps[0]) == 2
    for other in steps[1:]:
        assert [time for time, _ in other] == [time for time, _ in steps[0]]
        for (_, mine), (_, theirs) in zip(steps[0], other, strict=True):
            for one, two in zip(mine, theirs, strict=True):
                assert one.metadata["detection_id"] == two.metadata["detection_id"]
                assert one.metadata["sensor_id"] == two.metadata["sensor_id"]
                np.testing.assert_allclose(
                    np.array(one.state_vector, float),
                    np.array(two.state_vector, float),
                    rtol=0.0,
                    atol=5e-11,
                )
                np.testing.assert_allclose(
                    one.measurement_model.covar(), two.measurement_model.covar(), rtol=1e-6
                )


def test_what_is_no_event_is_reported_with_its_line(tmp_path):
    path = tmp_path / "events.jsonl"
    path.write_text("{}\n")
    with pytest.raises(SceneError, match="line 1: is no event of the encoder forge"):
        OpirDetectionReader.of_events(path)
    with pytest.raises(SceneError, match="cannot be read: no such file"):
        OpirDetectionReader.of_events(tmp_path / "none")


@pytest.mark.parametrize(
    ("key", "value", "words"),
    [
        ("line_of_sight_sigma_urad", -5.0, "line_of_sight_sigma_urad is -5.0, not above 0"),
        (
            "sensor_position_ecef_m",
            [0.0, 0.0, 0.0],
            "sensor_position_ecef_m is the centre of the Earth",
        ),
        (
            "timestamp",
            "2026-04-01T12:00:10+01:00",
            "timestamp '2026-04-01T12:00:10+01:00' is not UTC with a Z",
        ),
    ],
)
def test_an_event_that_gives_no_line_of_sight_is_reported_with_its_line(
    tmp_path, key, value, words
):
    path = tmp_path / "events.jsonl"
    assert main(["run", SCENE, "--quiet", "--out", str(path), "--set", "duration_s=30"]) == 0
    first, second = path.read_text().splitlines()[:2]
    path.write_text(f"{first}\n{json.dumps({**json.loads(second), key: value})}\n")
    with pytest.raises(SceneError) as raised:
        OpirDetectionReader.of_events(path)
    assert f"line 2: is no event of the encoder forge: {words}" in str(raised.value)


def test_of_a_particle_filter_the_mean_is_reported():
    """The state vector of particles has them all; the first one is kilometres from their mean."""
    plan = plan_of()
    rng = np.random.default_rng(0)
    mean = np.append([-2.7e6, -4.6e6, 3.7e6], np.full(6, 10.0))
    sigma = np.repeat([1e3, 1e2, 10.0], 3)
    cloud = StateVectors((mean + 1e3 * sigma * rng.normal(size=(200, 9))).T)
    begun = datetime(1970, 1, 1) + timedelta(microseconds=plan.scene.epoch_us)
    weight = rng.uniform(size=200)
    seen = ParticleStateUpdate(
        cloud,
        hypothesis=SingleHypothesis(None, None),
        weight=weight / weight.sum(),
        timestamp=begun,
    )
    inner = MultiTargetTracker(
        initiator=None, deleter=None, detector=None, data_associator=None, updater=None
    )
    inner._tracks.add(Track([seen]))
    context = TrackerContext(sensors=plan.sensors, epoch_us=plan.scene.epoch_us, duration_s=60.0)
    predictor = ParticlePredictor(EarthFixedTransition(noise=0.0))
    reported = StoneSoupTracker(inner, predictor, context).step(0.0, Detections.empty())
    assert reported.state[0] == pytest.approx(
        np.average(np.array(cloud, float), axis=1, weights=weight)[:6], rel=1e-9
    )
    assert reported.state_covariance[0] == pytest.approx(
        np.cov(np.array(cloud, float)[:6], aweights=weight, ddof=0)
    )


@pytest.mark.slow
def test_the_tracker_with_one_target_is_a_plain_loop_of_stone_soups_extended_filter():
    run = run_of_plan(plan_of("tracker=stonesoup"))
    predictor = ExtendedKalmanPredictor(EarthFixedTransition())
    updater = ExtendedKalmanUpdater(use_joseph_cov=True)
    now = None
    first = run.detections.line_of_sight_ecef[:1]
    for time, found in OpirDetectionReader.of_run(run):
        for detection in found:
            if now is None:
                place = intersection_with_ellipsoid(
                    run.detections.sensor_ecef_m[:1], first, FIRST_HEIGHT_M
                )[0]
                ahead = GaussianStatePrediction(*ground_prior(place, 9), timestamp=time)
            else:
                ahead = predictor.predict(now, timestamp=time)
            now = updater.update(SingleHypothesis(ahead, detection))
    assert now is not None
    assert len(set(run.tracks.track.tolist())) == 1
    end = predictor.predict(now, timestamp=now.timestamp.replace(minute=1, second=0, microsecond=0))
    assert run.tracks.tick_s[-1] == 60.0
    assert run.tracks.hypothesis_probability.sum(axis=1) == pytest.approx(np.ones(len(run.tracks)))
    sigma = np.sqrt(np.diag(np.array(end.covar, float)))[:6]
    assert np.all(
        np.abs(run.tracks.state[-1] - np.array(end.state_vector, float)[:6, 0]) < 1e-6 * sigma
    )
    np.testing.assert_allclose(
        run.tracks.state_covariance[-1] / np.outer(sigma, sigma),
        np.array(end.covar, float)[:6, :6] / np.outer(sigma, sigma),
        atol=1e-6,
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    "tracker",
    [
        "stonesoup",
        pytest.param("{model: stonesoup, filter: ukf}", marks=pytest.mark.slow),
        "{model: stonesoup, association: jpda, motion: jerk, noise: 0.3}",
    ],
)
def test_two_launches_are_two_tracks_that_know_how_wrong_they_are(tracker):
    plan = plan_of(f"tracker={tracker}", LAUNCHES, "duration_s=45")
    run = run_of_plan(plan)
    tracks = run.tracks
    assert set(tracks.track.tolist()) == {0, 1}
    last = np.flatnonzero(tracks.tick_s == 45.0)
    owners = []
    for row in last.tolist():
        error = (
            plan.targets.position_ecef_m(np.arange(2, dtype=np.int32), np.full(2, 45.0))
            - tracks.state[row, :3]
        )
        spread = tracks.state_covariance[row, :3, :3]
        distance = (error * np.linalg.solve(spread, error.T).T).sum(axis=1)
        owners.append(int(distance.argmin()))
        assert distance.min() < 16.27, "the 99.9 % point of chi-squared with 3 degrees of freedom"
        assert np.linalg.eigvalsh(tracks.state_covariance[row]).min() > 0.0
    assert sorted(owners) == [0, 1]
    reported = run.detections.track >= 0
    assert reported.mean() > 0.8
    assert np.array_equal(
        np.array(owners)[run.detections.track[reported]], run.truth.target[reported]
    )


def test_a_target_that_goes_on_being_seen_keeps_its_track_however_far_away_it_may_be():
    """One sensor leaves it open along its lines of sight; a second track would take it to be near
    the ground.
    """
    plan = plan_of("tracker={model: stonesoup, lost_sigma_m: 8000}", ALONE, "duration_s=45")
    run = run_of_plan(plan)
    sigma_m = np.sqrt(np.trace(run.tracks.state_covariance[-1, :3, :3]))
    assert sigma_m > 2.0 * 8000.0
    assert set(run.tracks.track.tolist()) == {0}
    assert np.mean(run.detections.track == 0) > 0.9


@pytest.mark.parametrize(
    ("silent_s", "sigma_m", "ends"), [(20, 1e6, False), (40, 1e6, True), (40, 1e5, False)]
)
def test_a_track_that_little_is_known_of_ends_when_it_is_no_longer_seen(silent_s, sigma_m, ends):
    start = datetime(2026, 4, 1)
    moment = {"state_vector": np.zeros((6, 1)), "covar": np.eye(6) * sigma_m**2}
    track = Track([GaussianStateUpdate(**moment, hypothesis=None, timestamp=start)])
    track.append(GaussianStatePrediction(**moment, timestamp=start + timedelta(seconds=silent_s)))
    deleter = SilenceDeleter(needed_hits=1, tentative_s=30.0, silence_s=120.0, lost_sigma_m=3e5)
    assert deleter.check_for_deletion(track) == ends
    track[-1].covar[0, 0] = np.nan
    assert deleter.check_for_deletion(track)


@pytest.mark.slow
def test_windows_change_nothing():
    overrides = ("tracker=stonesoup", LAUNCHES, "duration_s=30")
    whole, cut = (run_of_plan(plan_of(*overrides), window_s) for window_s in (None, 0.7))
    assert whole.tracks.state.tobytes() == cut.tracks.state.tobytes()
    assert whole.detections.track.tobytes() == cut.detections.track.tobytes()
    assert len(whole.tracks) > 20


@pytest.mark.slow
def test_its_tracks_have_hypotheses_and_regions_unless_none_are_asked_for():
    with_regions, without = (
        run_of_plan(plan_of(f"tracker={{model: stonesoup, forecast: {name}}}", "duration_s=60"))
        for name in ("regions", "none")
    )
    assert np.array_equal(with_regions.tracks.state, without.tracks.state)
    last = with_regions.tracks.take(slice(-1, None))
    assert last.impact_regions[0]
    assert last.probability_launch[0] > 0.99
    assert last.probability_burning[0] > 0.9
    assert last.hypothesis_probability.sum() == pytest.approx(1.0)
    assert not any(without.tracks.impact_regions)
    assert np.isnan(without.tracks.impact).all()


def test_it_is_compared_with_other_trackers():
    overrides = ["outputs=[]", "duration_s=45", SENSORS]
    cards = compared(SCENE, trackers=["imm", "stonesoup"], runs=2, overrides=overrides).cards
    assert set(cards) == {"imm", "stonesoup"}
    for card in cards.values():
        assert card.figures["launches_tracked"]["value"] == 1.0
        assert card.figures["purity"]["value"] == 1.0


def test_describing_the_tracker_imports_no_stone_soup():
    code = (
        "import sys; from opir_stonesoup import plugin; list(plugin.opir_trackers());"
        " print(*sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not {"stonesoup", "scipy", "numba"} & {
        name.partition(".")[0] for name in done.stdout.split()
    }
