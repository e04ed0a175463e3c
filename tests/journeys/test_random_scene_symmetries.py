"""Scenes at random: the order of targets, and windows, change no detection and no track."""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from random_scenes import TRACKERS, sensors, targets, tracked_scene
from symmetric_scenes import simulated
from tracks_alike import assert_alike

from examples import examples


@pytest.mark.slow
@settings(examples(16), derandomize=True)
@given(
    sensors=sensors(),
    targets=targets(),
    tracker=st.sampled_from(TRACKERS),
    seed=st.integers(0, 1000),
)
def test_neither_windows_nor_the_order_of_targets_change_a_track(sensors, targets, tracker, seed):
    scene = {**tracked_scene(sensors, targets, tracker, seed), "detection": "constant"}
    run = simulated(scene)
    reversed_run = simulated({**scene, "targets": targets[::-1]}, window_s=1.7)
    assert np.array_equal(run.detections.time_ns, reversed_run.detections.time_ns)
    assert np.array_equal(run.detections.track, reversed_run.detections.track)
    assert len(run.tracks) == len(reversed_run.tracks)
    if len(run.tracks):
        assert_alike(run.tracks, reversed_run.tracks, 1e-9)
