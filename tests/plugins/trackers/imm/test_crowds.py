"""Which tracks are in crowds: those whose pairing across sensors lines leave open."""

import numpy as np
import pytest
from opir_testing.doubles import stub_sensor
from opir_trackers.imm import focal_plane
from opir_trackers.imm.crowds import (
    Crowds,
    SensorView,
    begun_near,
    contested_tracks,
    corrected_crowds,
)
from opir_trackers.pairing import Directions
from scipy.spatial.transform import Rotation

from opir_core.geometry import local_axes


def contested(shared_in: int, sensors: int) -> list[int]:
    """Return which of two tracks are contested that share a line in some sensors and have their own
    in others.
    """
    track = np.tile([0, 1], sensors)
    line = np.concatenate([[2 * one, 2 * one + (one >= shared_in)] for one in range(sensors)])
    return contested_tracks(
        track, line, np.repeat(np.arange(sensors), 2), np.ones((2, sensors), dtype=bool)
    ).tolist()


def test_two_sensors_that_see_two_tracks_apart_tell_their_lines_in_others_apart() -> None:
    assert contested(0, 2) == []
    assert contested(1, 2) == [0, 1]
    assert contested(1, 3) == []
    assert contested(3, 5) == []
    assert contested(4, 5) == [0, 1]


def test_two_lines_of_one_track_contest_nothing() -> None:
    seen = np.ones((1, 2), dtype=bool)
    assert not len(
        contested_tracks(
            np.zeros(2, dtype=np.int64), np.arange(2), np.zeros(2, dtype=np.int64), seen
        )
    )


def test_tracks_begin_in_a_crowd_where_at_most_two_sensors_see_them() -> None:
    place = np.array([[0.0, 0.0, 0.0], [20e3, 0.0, 0.0], [500e3, 0.0, 0.0]])
    two = np.array([[True, True, False]] * 3)
    three = np.ones((3, 3), dtype=bool)
    assert begun_near(place, 2, two).tolist() == [0, 1]
    assert not len(begun_near(place, 2, three))
    assert not len(begun_near(place, 1, two))


def test_crowds_follow_a_change_of_the_errors_that_are_taken_off_their_lines() -> None:
    sensors = (stub_sensor("A", -40.0), stub_sensor("B", 20.0))
    view = SensorView(sensors, np.zeros(2), False)
    which = np.array([0, 1])
    target = np.array([5.9e6, 1.2e6, 2.4e6])
    change = np.array([[60e-6, -40e-6, 0.0], [-20e-6, 50e-6, 0.25]])
    origin = view.positions(which, np.zeros(2))
    motion = target - origin, np.tile([100.0, 800.0, 900.0], (2, 1)), np.zeros((2, 3))
    tracks = focal_plane.begun(
        np.zeros(2, dtype=np.int64), which, 0.0, motion, np.zeros((2, 3, 3, 1)), np.zeros(2)
    )
    unit = (target - origin) / np.linalg.norm(target - origin, axis=1)[:, None]
    kept = Directions(
        np.zeros(2, dtype=np.int64), which, np.zeros(2), origin, unit, np.full(2, 1e-5)
    )
    after = corrected_crowds(Crowds(tracks, kept, errors=np.zeros((2, 3))), change, view)
    for row, axes in enumerate(local_axes(origin)):
        # Less an error to the east, nadir moves west: a turn about north. Less one to the north: a
        # turn against east.
        turn = Rotation.from_rotvec(change[row, 0] * axes[1] - change[row, 1] * axes[0])
        assert after.stored.direction_ecef[row] == pytest.approx(turn.apply(unit[row]), abs=2e-8)
        one = np.array([row])
        before = tracks.directions(one, tracks.places(one, np.array([3.0 + change[row, 2]]))[0])[0]
        now = after.tracks.directions(one, after.tracks.places(one, np.array([3.0]))[0])[0]
        assert now == pytest.approx(turn.apply(before), abs=2e-8)
    assert after.stored.time_s.tolist() == [0.0, 0.0]
