"""Scenes at random, far from any that trackers were made on: what is reported is sound, whatever it
is worth.
"""

import numpy as np
import pytest
from hypothesis import given, settings, strategies as st
from random_scenes import TRACKERS, sensors, targets, tracked_scene

import opir_core as opir
from examples import examples

SEEN = {
    "launch": "launch_covariance",
    "impact": "impact_covariance",
    "burnout": "burnout_covariance",
}


def assert_sound(covariance, where):
    """Fail where covariances (n, d, d) are neither positive definite, each scaled to a unit
    diagonal, nor all nan.
    """
    rows = np.isfinite(covariance).all(axis=(1, 2))
    assert np.isnan(covariance[~rows]).all(), where
    matrices = covariance[rows]
    assert np.array_equal(matrices, matrices.transpose(0, 2, 1)), where
    variance = np.diagonal(matrices, axis1=1, axis2=2)
    assert (variance > 0.0).all(), where
    sigma = np.sqrt(variance)
    assert (
        np.linalg.eigvalsh(matrices / sigma[:, :, None] / sigma[:, None]).min(initial=1.0) > -1e-9
    ), where


def assert_all_sound(tracks, is_arc):
    # A track may have no Keplerian arc yet, and an arc through a thrusting target may be as fast as
    # it likes.
    assert is_arc or np.isfinite(tracks.state).all()
    assert is_arc or np.linalg.norm(tracks.state[:, 3:], axis=1).max(initial=0.0) < 20e3
    assert_sound(tracks.state_covariance, "state")
    for name, spread in SEEN.items():
        value = getattr(tracks, name)
        covariance = getattr(tracks, spread)
        reported = np.isfinite(value).all(axis=1)
        assert np.isnan(value[~reported]).all(), name
        assert_sound(covariance[reported], name)
    assert (tracks.type_probability >= 0.0).all()
    assert np.allclose(tracks.type_probability.sum(axis=1), 1.0)
    for place in (tracks.launch, tracks.impact):
        assert not np.any(np.abs(place[:, 0]) > 0.5 * np.pi)
        assert not np.any(np.abs(place[:, 1]) > np.pi)


@pytest.mark.slow
@pytest.mark.filterwarnings("error")
@settings(examples(24), derandomize=True)
@given(
    sensors=sensors(),
    targets=targets(),
    tracker=st.sampled_from(TRACKERS),
    seed=st.integers(0, 1000),
)
def test_what_is_reported_is_sound(sensors, targets, tracker, seed):
    scene = tracked_scene(sensors, targets, tracker, seed)
    assert_all_sound(opir.simulate(opir.scene_from_mapping(scene)).tracks, tracker == "kepler-arc")
