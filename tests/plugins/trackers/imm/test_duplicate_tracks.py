"""Which of two tracks that follow one target is let go, and which two follow two."""

import numpy as np
from opir_trackers.imm.prune import duplicates
from opir_trackers.imm.state import SharedDetections, sighting_memory_s

NUMBER = np.array([3, 7])
HITS = np.array([40, 12])
SEEN = np.ones((2, 2), dtype=bool)
OLD = np.zeros(2, dtype=bool)


def states(apart_m: float, sigma_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Return two states that are so far apart along the third axis, each off by `sigma_m` there,
    and covariances.
    """
    state = np.tile([6.4e6, 0.0, 0.0, 0.0, 100.0, 0.0], (2, 1))
    state[1, 2] += apart_m
    covariance = np.tile(np.diag([1e3, 1e3, sigma_m, 50.0, 50.0, 50.0]) ** 2, (2, 1, 1))
    return state, covariance


def sightings(first: list[int], second: list[int]) -> SharedDetections:
    """Return that the first track was seen in some scans of a sensor, the second in others."""
    scan = np.array(first + second)
    number = np.repeat(NUMBER, [len(first), len(second)])
    return SharedDetections(number, np.zeros(len(scan), dtype=np.int32), scan, 10.0 * scan)


def test_alike_tracks_without_a_common_scan_merge() -> None:
    seen = sightings([1, 2], [3, 4])
    for hits, lesser in ((HITS, [False, True]), (HITS[::-1], [True, False])):
        assert duplicates(NUMBER, *states(3e3, 2e3), seen, hits, SEEN, OLD).tolist() == lesser


def test_of_three_alike_those_that_no_sensor_sees_both_of_are_left_to_their_pairing() -> None:
    """With a third beside them, one of the first sensor alone and one of the second may be of
    different targets.
    """
    number = np.array([3, 7, 9])
    hits = np.array([40, 12, 30])
    old = np.zeros(3, dtype=bool)
    state, covariance = (np.concatenate([each, each[:1]]) for each in states(3e3, 2e3))
    seen = SharedDetections(
        np.repeat(number, 2), np.zeros(6, dtype=np.int32), np.arange(6), np.zeros(6)
    )
    reported = {
        name: duplicates(number, state, covariance, seen, hits, sensors, fresh).tolist()
        for name, sensors, fresh in (
            ("all seen by both", np.ones((3, 2), dtype=bool), old),
            ("the second by another", np.array([[True, False], [False, True], [True, False]]), old),
            ("the second fresh", np.ones((3, 2), dtype=bool), np.array([False, True, False])),
        )
    }
    assert reported == {
        "all seen by both": [False, True, True],
        "the second by another": [False, False, True],
        "the second fresh": [False, False, True],
    }


def test_one_scan_that_sees_both_or_too_few_scans_leave_two() -> None:
    assert not duplicates(
        NUMBER, *states(3e3, 2e3), sightings([1, 2, 3], [3, 4]), HITS, SEEN, OLD
    ).any()
    assert not duplicates(NUMBER, *states(3e3, 2e3), sightings([1, 2], [3]), HITS, SEEN, OLD).any()
    assert not duplicates(
        NUMBER, *states(3e4, 2e3), sightings([1, 2], [3, 4]), HITS, SEEN, OLD
    ).any()


def test_one_sensors_tracks_are_one_as_far_apart_as_their_covariances_reach() -> None:
    reported = duplicates(NUMBER, *states(250e3, 100e3), sightings([1, 2], [3, 4]), HITS, SEEN, OLD)
    assert reported.tolist() == [False, True]


def test_scans_are_remembered_as_long_as_slices_are_too_short_for_four_of_them() -> None:
    """Of a sensor with 2 s between scans the last four, of one with 0.2 s those of a slice of 1
    s.
    """
    memory_s = sighting_memory_s(np.array([2.0, 0.2]), 1.0, 4)
    assert memory_s.tolist() == [8.0, 0.0]
    before = SharedDetections(
        NUMBER, np.array([0, 1], dtype=np.int32), np.array([5, 50]), np.array([10.0, 10.0])
    )
    nothing = SharedDetections.empty()
    later = [
        before.after(nothing, time_s, memory_s, first=first).number.tolist()
        for time_s, first in ((11.0, 100), (18.5, 100), (18.5, int(NUMBER[1])))
    ]
    assert later == [[int(NUMBER[0])], [], [int(NUMBER[1])]]
