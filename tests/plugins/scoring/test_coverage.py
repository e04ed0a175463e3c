"""What tracks cover: ticks at which nothing is reported count, and so does what is reported after a
track was lost.
"""

import numpy as np
import pytest
from attrs import evolve
from opir_scoring import (
    GEOMETRIES,
    Scorecard,
    coverage,
    evidence_of_run,
    ownership,
    point_errors,
    rows_in_force,
    scorecard,
    scorecard_text,
    state_errors,
    true_states_ecef,
)
from opir_scoring.sensor_coverage import GospaSettings, gospa_parts, mean_gospa, ticks_s
from scored_scene import SCENE

from opir_core import compile_plan, run_of_plan
from opir_core.reading import scene_from_mapping

FIRST_S = 30.0
LAST_S = 80.0


@pytest.fixture(scope="module")
def reported():
    """Return a run of 90 s whose one launch, at 10 s, is tracked from 30 to 80 s, 100 m off."""
    plan = compile_plan(scene_from_mapping(SCENE))
    run = run_of_plan(plan)
    rows = np.flatnonzero((run.tracks.tick_s >= FIRST_S) & (run.tracks.tick_s <= LAST_S))
    tracks = run.tracks.take(rows)
    true = true_states_ecef(plan, np.zeros(len(tracks), dtype=np.int32), tracks.tick_s)
    evidence = evidence_of_run(run, plan)
    return evolve(evidence, tracks=evolve(tracks, state=true + np.eye(6)[0] * 100.0))


def lost_and_found(reported, at_s=50.0):
    """Return the same run, with another number from `at_s` on, and nothing reported for the five
    seconds before.
    """
    tracks = reported.tracks.take(
        np.flatnonzero((reported.tracks.tick_s < at_s - 5.0) | (reported.tracks.tick_s >= at_s))
    )
    later = tracks.tick_s >= at_s
    state = tracks.state + np.where(later, 900.0, 0.0)[:, None] * np.eye(6)[0]
    return evolve(
        reported,
        tracks=evolve(tracks, track=np.where(later, 7, tracks.track), state=state),
        track=np.where((reported.track >= 0) & (reported.time_s >= at_s), 7, reported.track),
    )


@pytest.mark.slow
def test_ticks_are_those_at_which_the_tracker_is_asked(reported):
    assert ticks_s(reported).tolist() == list(range(1, 91))
    elsewhere = evolve(
        reported, tracks=evolve(reported.tracks, tick_s=reported.tracks.tick_s + 0.3)
    )
    assert np.array_equal(ticks_s(elsewhere), np.unique(reported.tracks.tick_s + 0.3))


def test_ticks_without_tracks_are_not_covered(reported):
    seen_s = reported.time_s[reported.target == 0][0]
    due = np.arange(np.ceil(seen_s), 91.0)
    result = coverage(reported, ownership(reported))
    assert result.share == pytest.approx([51.0 / len(due)])
    assert result.first_track_s == pytest.approx([FIRST_S - seen_s])
    parts = gospa_parts(reported, ownership(reported), GospaSettings())
    # Truth is known from ignition, at 10 s, on.
    assert len(parts) == 81
    assert np.count_nonzero(parts[:, 2]) == 81 - 51
    assert parts[parts[:, 2] == 0.0, 0] == pytest.approx(100.0)


def test_a_run_without_tracks_misses_everything(reported):
    silent = evolve(
        reported, tracks=reported.tracks.take(slice(0, 0)), track=np.full_like(reported.track, -1)
    )
    figures = scorecard([silent]).figures
    assert figures["launches_tracked"]["value"] == 0.0
    assert figures["completeness"]["value"] == 0.0
    assert figures["gospa"]["a_target_m"]["value"] == pytest.approx(5000.0 / np.sqrt(2.0))


def test_distance_per_target_is_free_of_their_number():
    power = 150.0**2
    for targets in (1.0, 4.0, 100.0):
        parts = np.array([[np.sqrt(targets * power), targets * power, 0.0, 0.0, targets]])
        assert mean_gospa(parts, 2.0) == pytest.approx(
            [np.sqrt(targets) * 150.0, 150.0, power, 0.0, 0.0]
        )
    assert np.isnan(mean_gospa(np.empty((0, 5)), 2.0)).all()


def test_what_is_reported_after_a_track_was_lost_is_judged_too(reported):
    evidence = lost_and_found(reported)
    owners = ownership(evidence)
    assert owners.target.tolist() == [0, 0]
    result = coverage(evidence, owners)
    assert result.tracks.tolist() == [2]
    assert result.share[0] == pytest.approx(
        coverage(reported, ownership(reported)).share[0] * 46.0 / 51.0
    )
    errors = state_errors(evidence, owners)
    assert len(errors) == 46
    assert np.round(np.unique(errors.position_m)).tolist() == [100.0, 1000.0]
    assert scorecard([evidence]).figures["tracks_a_launch"]["value"] == 2.0
    last = point_errors(evidence, owners)
    assert np.array_equal(
        last.launch_m,
        point_errors(evolve(evidence, tracks=evidence.tracks.take([-1])), owners).launch_m,
    )


def test_the_track_with_most_detections_is_in_force(reported):
    both = evolve(reported.tracks, track=reported.tracks.track + 5)
    tracks = reported.tracks.concatenate([reported.tracks, both])
    tracks = tracks.take(np.lexsort((tracks.track, tracks.tick_s)))
    few = np.flatnonzero(reported.track >= 0)[:3]
    track = reported.track.copy()
    track[few] = both.track[0]
    evidence = evolve(reported, tracks=tracks, track=track)
    rows = rows_in_force(evidence, ownership(evidence))
    assert set(evidence.tracks.track[rows].tolist()) == set(reported.tracks.track.tolist())
    assert len(rows) == len(reported.tracks)


@pytest.mark.slow
def test_targets_of_biased_sensors_are_scored_apart():
    """Of two launches far apart each is seen by one sensor, one of which has a bias."""
    east = {
        "id": "T2",
        "type": "ICBM",
        "launch": {"lat_deg": 45.0, "lon_deg": 60.0, "time_s": 5.0},
        "aim": {"lat_deg": 5.0, "lon_deg": 100.0},
    }
    sensors = [
        {"model": "SBIRS-GEO", "id": "A", "orbital_slot_deg": -130.0},
        {
            "model": "SBIRS-GEO",
            "id": "B",
            "orbital_slot_deg": 60.0,
            "line_of_sight_bias_sigma_urad": 30.0,
        },
    ]
    scene = {**SCENE, "duration_s": 40.0, "sensors": sensors, "targets": [*SCENE["targets"], east]}
    plan = compile_plan(scene_from_mapping(scene))
    figures = scorecard([evidence_of_run(run_of_plan(plan), plan)]).figures
    assert {name: figures[name]["targets"] for name in GEOMETRIES} == {
        "mono": 1,
        "stereo": 0,
        "mono_biased": 1,
        "stereo_biased": 0,
    }
    for name in ("mono", "mono_biased"):
        assert figures[name]["launches_reported"] == 1
        assert figures[name]["impacts_reported"] == 1
        assert figures[name]["by_time"][0]["nis"]["samples"] > 5
    text = scorecard_text({"tracker": Scorecard(figures)})
    assert "mono with biased sensors, by time since ignition" in text
    assert "stereo" not in text
