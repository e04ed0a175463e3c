"""The tracker `imm` in whole runs: it follows what there is, whatever the slicing, and says how
surely.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from two_sensor_scene import two_sensor_scene

import opir_core as opir
from opir_core.interfaces.records import Tracks
from opir_core.planning.plan import compile_plan
from opir_core.simulation.run import plan_windows, run_of_plan

SCENE: Mapping[str, Any] = two_sensor_scene(
    duration_s=40,
    sensors=[
        {"model": "SBIRS-GEO", "id": "WEST", "orbital_slot_deg": -165.0},
        {"model": "NEXTGEN-GEO", "id": "EAST", "orbital_slot_deg": -100.0},
    ],
    targets=[
        {
            "id": "A",
            "type": "ICBM",
            "launch": {"lat_deg": 2.0, "lon_deg": -140.0, "time_s": 3.0},
            "aim": {"lat_deg": -50.0, "lon_deg": -110.0},
        },
        {
            "id": "B",
            "type": "IRBM",
            "launch": {"lat_deg": 2.0, "lon_deg": -139.7, "time_s": 8.0},
            "aim": {"lat_deg": -25.0, "lon_deg": -155.0},
        },
    ],
    tracker="imm",
)


def tracks_of(scene, window_s=None):
    """Return a scene's tracks, and the track of each detection."""
    windows = list(plan_windows(compile_plan(opir.scene_from_mapping(dict(scene))), window_s))
    labels = np.concatenate([window.detections.track for window in windows])
    return Tracks.concatenate([window.tracks for window in windows]), labels


@pytest.fixture(scope="module")
def whole():
    return tracks_of(SCENE)


@pytest.mark.slow
@pytest.mark.parametrize("window_s", [0.37, 1.0, 7.0])
def test_window_sizes_change_no_bit(whole, window_s):
    tracks, labels = tracks_of(SCENE, window_s)
    assert np.array_equal(labels, whole[1])
    assert np.array_equal(tracks.state, whole[0].state)
    assert np.array_equal(tracks.state_covariance, whole[0].state_covariance)


@pytest.mark.slow
@pytest.mark.parametrize("tracker", [{}, {"slice_s": 0.2}])
def test_each_target_has_one_track_near_the_truth(tracker):
    run = opir.simulate(opir.scene_from_mapping({**SCENE, "tracker": {"model": "imm", **tracker}}))
    assert len(np.unique(run.tracks.track)) == 2
    labelled = run.detections.track >= 0
    for number in np.unique(run.tracks.track):
        assert len(np.unique(run.truth.target[labelled & (run.detections.track == number)])) == 1
    trajectories = compile_plan(opir.scene_from_mapping(dict(SCENE))).targets
    final = run.tracks.take(run.tracks.tick_s == 40.0)
    truth = trajectories.position_ecef_m(np.array([0, 1], dtype=np.int32), np.full(2, 40.0))
    separation = np.linalg.norm(final.state[:, None, :3] - truth[None], axis=2)
    nearest = np.argmin(separation, axis=1)
    assert sorted(nearest.tolist()) == [0, 1]
    error = final.state[:, :3] - truth[nearest]
    distance = np.einsum(
        "ni,nij,nj->n", error, np.linalg.inv(final.state_covariance[:, :3, :3]), error
    )
    assert np.all(distance < 21.1), "99.99 % of a chi-squared of three"
    assert np.all(separation[[0, 1], nearest] < 1000.0)


def test_one_sensor_alone_is_honest_about_the_depth():
    """Along the line of sight little is known early on, and the covariance says so; before, it is
    probably a fire.
    """
    scene = {
        **SCENE,
        "sensors": [SCENE["sensors"][0]],
        "duration_s": 50,
        "targets": [SCENE["targets"][0]],
    }
    tracks, _ = tracks_of(scene)
    tracks = tracks.take(np.flatnonzero(tracks.probability_launch > 0.5))
    truth = compile_plan(opir.scene_from_mapping(scene)).targets.position_ecef_m(
        np.zeros(len(tracks), dtype=np.int32), tracks.tick_s
    )
    assert len(tracks) >= 15
    error = tracks.state[:, :3] - truth
    covariance = tracks.state_covariance[:, :3, :3]
    assert np.linalg.eigvalsh(covariance).min() > 0.0
    assert np.all(np.einsum("ni,nij,nj->n", error, np.linalg.inv(covariance), error) < 21.1)
    assert np.sqrt(np.linalg.eigvalsh(covariance)[:, 2]).min() > 1000.0


TRACKERS = ("imm", "kepler-arc")


@pytest.mark.slow
@pytest.mark.parametrize("model", TRACKERS)
def test_of_how_many_scans_a_target_has_to_be_seen_in_the_user_decides(model):
    first_s = []
    for needed in (2, 10, 20):
        tracker = {"model": model, "needed_scans": needed, "recent_scans": 40}
        tracks, _ = tracks_of(
            {**SCENE, "targets": [SCENE["targets"][0]], "duration_s": 15, "tracker": tracker}
        )
        first_s.append(float(tracks.tick_s[0]))
    assert first_s == sorted(first_s)
    assert first_s[0] < first_s[-1]


@pytest.mark.parametrize("model", TRACKERS)
def test_more_scans_than_are_kept_are_reported_with_their_place(model):
    with pytest.raises(opir.SceneError, match=r"tracker.*needed_scans"):
        opir.scene_from_mapping({**SCENE, "tracker": {"model": model, "needed_scans": 9}})


def test_bad_settings_are_reported_with_their_place():
    with pytest.raises(opir.SceneError, match=r"tracker\.motion"):
        opir.scene_from_mapping({**SCENE, "tracker": {"model": "imm", "motion": "glide"}})
    for gone, value in (
        ("boost_model", "jerk"),
        ("jerk_noise_m_s3", 0.3),
    ):
        with pytest.raises(opir.SceneError, match=rf"tracker\.{gone}: unknown key"):
            opir.scene_from_mapping({**SCENE, "tracker": {"model": "imm", gone: value}})


@pytest.mark.slow
@pytest.mark.filterwarnings("error")
def test_what_is_known_of_a_dark_flight_stays_known_until_it_comes_down():
    """Nothing is seen after the burn, and little acts on a free flight: where it comes down is as
    sure as it was.
    """
    scanner = {"model": "generic-scanner"}
    slots = {"A": -135.0, "B": -90.0}
    launch = {"lat_deg": 11.0, "lon_deg": -120.0, "time_s": 10.0}
    target = {
        "id": "T",
        "type": "SRBM",
        "launch": launch,
        "aim": {"lat_deg": 9.0, "lon_deg": -123.3},
    }
    changes = {
        "duration_s": 400,
        "sensors": [
            {**scanner, "id": name, "orbital_slot_deg": slot_deg}
            for name, slot_deg in slots.items()
        ],
        "targets": [target],
        "tracker": "imm",
    }
    plan = compile_plan(opir.scene_from_mapping({**SCENE, **changes}))
    tracks = run_of_plan(plan).tracks
    dark = tracks.tick_s > plan.targets.burnout_s[0] + 30.0
    assert tracks.tick_s[-1] > tracks.impact[-1, 2]
    ellipse = tracks.impact_covariance[dark]
    assert np.allclose(ellipse, ellipse[0], rtol=0.01)
    speed_sigma = np.sqrt(np.trace(tracks.state_covariance[dark][:, 3:, 3:], axis1=1, axis2=2))
    assert speed_sigma.max() < 1.1 * speed_sigma[0]


@pytest.mark.slow
@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("tracker", ["imm", "kepler-arc"])
@pytest.mark.parametrize("sigma_urad", [0.0, 0.001])
def test_sensors_without_error_are_followed_as_any(tracker, sigma_urad):
    slots = {"A": -135.0, "B": -90.0}
    scanner = {"model": "generic-scanner", "line_of_sight_sigma_urad": sigma_urad}
    launch = {"lat_deg": 34.73, "lon_deg": -120.57, "time_s": 5.0}
    changes = {
        "sensors": [
            {**scanner, "id": name, "orbital_slot_deg": slot_deg}
            for name, slot_deg in slots.items()
        ],
        "targets": [
            {"id": "T", "type": "ICBM", "launch": launch, "aim": {"lat_deg": 9.0, "lon_deg": 167.7}}
        ],
        "tracker": tracker,
    }
    tracks = opir.simulate(opir.scene_from_mapping({**SCENE, **changes})).tracks
    assert len(tracks) > 25
    assert len(np.unique(tracks.track)) == 1
    assert np.isfinite(tracks.state_covariance).all()
    assert np.linalg.eigvalsh(tracks.state_covariance[:, :3, :3]).min() > 0.0


@pytest.mark.slow
def test_sharp_sensors_that_look_at_one_instant_begin_tracks():
    """Five sensors of 1 urad that first see two launches in one scan: all unclaimed rays are of one
    instant.
    """
    scanner = {"model": "generic-scanner", "line_of_sight_sigma_urad": 1.0, "scan_phase": "aligned"}
    sites = {"A": (34.73, -120.57), "B": (20.0, -110.0)}
    aim = {"lat_deg": 9.0, "lon_deg": 167.7}
    changes = {
        "sensors": [
            {**scanner, "id": f"S{number}", "orbital_slot_deg": -150.0 + 15.0 * number}
            for number in range(5)
        ],
        "targets": [
            {
                "id": name,
                "type": "ICBM",
                "launch": {"lat_deg": lat_deg, "lon_deg": lon_deg, "time_s": 5.0},
                "aim": aim,
            }
            for name, (lat_deg, lon_deg) in sites.items()
        ],
    }
    tracks = opir.simulate(opir.scene_from_mapping({**SCENE, **changes})).tracks
    assert np.unique(tracks.track).tolist() == [0, 1]
