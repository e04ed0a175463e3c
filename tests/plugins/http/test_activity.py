"""The page's counts of detections are exact for the two minutes that they are said to be of."""

from collections import Counter

import numpy as np
from opir_http.activity import SECONDS, Activity

START_S = 1_775_044_800


def test_counts_are_those_of_the_last_two_minutes() -> None:
    """Ten minutes of detections in windows of random length, reported up to three seconds late."""
    rng = np.random.default_rng(3)
    time_us = np.sort(rng.integers(0, 600_000_000, 20_000)) + START_S * 1_000_000
    time_us += rng.integers(-3_000_000, 1, len(time_us))
    sensor = rng.integers(0, 3, len(time_us)).astype(np.int32)
    activity = Activity(["A", "B", "C"])
    for rows in np.array_split(np.arange(len(time_us)), np.sort(rng.integers(0, len(time_us), 40))):
        activity.add(sensor[rows], time_us[rows])
    end_s = START_S + 599
    document = activity.document(end_s * 1_000_000 + 999_999)
    assert document["first_s"] == end_s - SECONDS
    for number, name in enumerate("ABC"):
        expected = Counter((time_us[sensor == number] // 1_000_000).tolist())
        assert document["sensors"][name] == [
            expected[document["first_s"] + at] for at in range(SECONDS + 1)
        ]


def test_what_is_older_is_forgotten() -> None:
    activity = Activity(["A"])
    activity.add(np.zeros(5, dtype=np.int32), np.full(5, START_S * 1_000_000))
    assert sum(activity.document((START_S + SECONDS) * 1_000_000)["sensors"]["A"]) == 5
    assert sum(activity.document((START_S + SECONDS + 1) * 1_000_000)["sensors"]["A"]) == 0
    assert sum(Activity(["A"]).document(START_S * 1_000_000)["sensors"]["A"]) == 0
