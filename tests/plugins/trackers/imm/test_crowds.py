"""Which tracks are in crowds: those whose pairing across sensors lines leave open."""

import numpy as np
from opir_trackers.imm.crowds import begun_near, contested_tracks


def contested(shared_in: int, sensors: int) -> list[int]:
    """Return which of two tracks are contested that share a line in some sensors and have their own in others."""
    track = np.tile([0, 1], sensors)
    line = np.concatenate([[2 * one, 2 * one + (one >= shared_in)] for one in range(sensors)])
    return contested_tracks(track, line, np.repeat(np.arange(sensors), 2), np.ones((2, sensors), dtype=bool)).tolist()


def test_two_sensors_that_see_two_tracks_apart_tell_their_lines_in_others_apart() -> None:
    assert contested(0, 2) == []
    assert contested(1, 2) == [0, 1]
    assert contested(1, 3) == []
    assert contested(3, 5) == []
    assert contested(4, 5) == [0, 1]


def test_two_lines_of_one_track_contest_nothing() -> None:
    seen = np.ones((1, 2), dtype=bool)
    assert not len(contested_tracks(np.zeros(2, dtype=np.int64), np.arange(2), np.zeros(2, dtype=np.int64), seen))


def test_tracks_begin_in_a_crowd_where_at_most_two_sensors_see_them() -> None:
    place = np.array([[0.0, 0.0, 0.0], [20e3, 0.0, 0.0], [500e3, 0.0, 0.0]])
    two, three = np.array([[True, True, False]] * 3), np.ones((3, 3), dtype=bool)
    assert begun_near(place, 2, two).tolist() == [0, 1]
    assert not len(begun_near(place, 2, three))
    assert not len(begun_near(place, 1, two))
