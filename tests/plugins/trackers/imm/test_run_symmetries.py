"""Runs of `imm` that differ in what no track can depend on: order, numbers, windows, longitude."""

import numpy as np
import pytest
from symmetric_scenes import BLIND, CROWDED_DEG, scene, simulated, turned
from tracks_alike import DRAWN, assert_alike, assert_drawn_alike, assert_states_alike, moved

import opir_core as opir
from opir_core.plugin import Tracks

#: Another order of sums changes their last bits; iterations of the update may then end one later,
#: at 0.01 standard deviations, and what is drawn about a state follows.
ROUNDING = 1e-8
ITERATED_SIGMAS = 0.05
ITERATED = (*DRAWN, "state", "state_covariance")


#: Where aircraft are rare, 40 s tell one sensor a launch.
IMM = {
    "model": "imm",
    "hypotheses": {
        "flashes_per_day": 0.07,
        "aircraft_per_day": 0.02,
        "take_offs_per_day": 0.0,
        "reentries_per_day": 0.005,
        "others_per_day": 0.0015,
    },
}


@pytest.fixture(scope="module")
def run() -> opir.Run:
    return simulated(scene(IMM))


@pytest.fixture(scope="module")
def crowded() -> opir.Run:
    return simulated(scene(IMM, CROWDED_DEG))


def assert_same_health(run: opir.Run, other: opir.Run) -> None:
    """Fail unless the tracker says the same of each sensor; others may be there that see
    nothing.
    """
    health = {row["sensor_id"]: row["health"] for row in other.summary["sensors"]}
    for row in run.summary["sensors"]:
        for name, value in row["health"].items():
            other_value = health[row["sensor_id"]][name]
            if value is None or name == "text":
                assert name == "text" or other_value is None
            else:
                assert other_value == pytest.approx(value, rel=1e-3, abs=1e-9), name


def assert_alike_but_for_iterations(
    tracks: Tracks, other: Tracks, sigmas: float = ITERATED_SIGMAS
) -> None:
    """Fail unless tracks are the same to rounding, states and forecasts to what iterations and
    draws leave.
    """
    assert_alike(tracks, other, ROUNDING, apart=ITERATED)
    assert_states_alike(tracks, other, sigmas)
    assert_drawn_alike(tracks, other)


def test_the_scene_has_what_is_compared(run: opir.Run, crowded: opir.Run) -> None:
    """Tracks of two sensors and of one that is not the first, impacts, regions, biases."""
    seers = {
        track: set(run.detections.sensor[run.detections.track == track].tolist())
        for track in range(4)
    }
    assert sorted(map(sorted, seers.values())) == [[0, 1], [0, 1], [0, 1], [2]]
    assert len(np.unique(crowded.tracks.track)) == 4
    for track in range(4):
        rows = run.tracks.track == track
        assert np.isfinite(run.tracks.impact[rows, 0]).any()
        assert any(run.tracks.impact_regions[rows])
        assert np.isfinite(run.tracks.launch[rows, 0]).any()


@pytest.mark.parametrize("order", [[2, 1, 0], [1, 2, 0]])
def test_the_order_of_sensors_changes_no_track(run: opir.Run, order: list[int]) -> None:
    mapping = scene(IMM)
    other = simulated({**mapping, "sensors": [mapping["sensors"][number] for number in order]})
    assert_alike_but_for_iterations(run.tracks, other.tracks)
    assert_same_health(run, other)


@pytest.mark.parametrize("degrees", [None, CROWDED_DEG])
def test_a_blind_sensor_before_the_others_changes_no_track(
    run: opir.Run, crowded: opir.Run, degrees: float | None
) -> None:
    mapping = scene(IMM) if degrees is None else scene(IMM, degrees)
    other = simulated({**mapping, "sensors": [BLIND, *mapping["sensors"]]})
    alone = run if degrees is None else crowded
    assert_alike_but_for_iterations(alone.tracks, other.tracks)
    assert_same_health(alone, other)


def test_the_order_of_targets_changes_no_track(crowded: opir.Run) -> None:
    mapping = scene(IMM, CROWDED_DEG)
    other = simulated({**mapping, "targets": mapping["targets"][::-1]})
    assert_alike(crowded.tracks, other.tracks, 0.0)
    assert_same_health(crowded, other)


def test_windows_change_no_track(crowded: opir.Run) -> None:
    other = simulated(scene(IMM, CROWDED_DEG), window_s=0.37)
    assert_alike(crowded.tracks, other.tracks, 0.0)
    assert np.array_equal(crowded.detections.track, other.detections.track)
    assert_same_health(crowded, other)


@pytest.mark.parametrize("turn_deg", [37.25, pytest.param(-30.0, marks=pytest.mark.slow)])
def test_a_scene_further_east_has_the_same_tracks_further_east(
    run: opir.Run, turn_deg: float
) -> None:
    """Forecasts are of draws about inertial axes, and differ by chance; states in the dark hold
    their gliders.
    """
    other = simulated(turned(scene(IMM), turn_deg))
    assert np.array_equal(run.detections.time_ns, other.detections.time_ns)
    expected = moved(run.tracks, turn_rad=np.radians(turn_deg))
    assert_alike_but_for_iterations(expected, other.tracks, sigmas=0.3)
    assert_same_health(run, other)


def test_sensors_further_east_alone_change_much(run: opir.Run) -> None:
    """The comparison can fail."""
    expected = moved(run.tracks, turn_rad=np.radians(0.01))
    with pytest.raises(AssertionError):
        assert_alike(expected, run.tracks, ROUNDING, apart=DRAWN)
