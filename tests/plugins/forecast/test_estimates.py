"""The record of any tracker: moments in and out, and what trackers without modes say of burns."""

import numpy as np
import pytest
from opir_forecast import BoostEstimates, burning_probability, launch_probability


def positive(size: int, rng: np.random.Generator) -> np.ndarray:
    """Return a positive definite matrix of a size."""
    side = rng.normal(size=(size, size))
    return np.asarray(side @ side.T + np.eye(size))


@pytest.mark.parametrize("size", [6, 9, 10])
def test_roots_are_those_of_the_inverse_covariances(size: int) -> None:
    rng = np.random.default_rng(size)
    covariance = np.array([positive(size, rng), positive(size, rng)])
    about = np.array([7e6, 0.0, 0.0, 1e3, 1e3, 0.0, *[10.0] * (size - 6)])
    mean = about + rng.normal(size=(2, size))
    times_s = np.ones(2)
    record = BoostEstimates.of_moments(
        np.array([1, 2]), mean, covariance, times_s, times_s, times_s, 4
    )
    for root, expected in (
        (record.burn_root[:, 0, :size, :size], covariance),
        (record.coast_root, covariance[:, :6, :6]),
    ):
        information = root.transpose(0, 2, 1) @ root
        assert information == pytest.approx(np.linalg.inv(expected), rel=1e-8, abs=1e-10)
    assert np.array_equal(record.burn_mean[:, 2, :size], mean)
    # Without it the force is along the velocity, as wide as its prior.
    if size == 6:
        assert np.linalg.norm(record.burn_mean[:, 0, 6:9], axis=1) == pytest.approx(20.0)
        assert record.burn_root[0, 0, 6, 6] == pytest.approx(0.1)


def test_the_probability_of_a_burn_is_that_of_simulated_burns_and_looks() -> None:
    """Burns of an exponential law, looked at each second: of those silent for three looks, how many
    burn?
    """
    rng = np.random.default_rng(8)
    end_s = rng.exponential(150.0, 400_000)
    looks = rng.random((len(end_s), 40)) < 0.7
    looks &= np.arange(1, 41) < end_s[:, None]
    is_silent = looks[:, 36] & ~looks[:, 37:].any(axis=1)
    share = np.mean(end_s[is_silent] > 40.0)
    pause_s = np.full(1, 1.0 / 0.7)
    stated = burning_probability(np.full(1, 3.0), pause_s, np.full(1, 0.7))
    assert stated[0] == pytest.approx(share, abs=0.02)


def test_a_burn_is_less_probable_the_longer_the_silence() -> None:
    silent_s = np.array([0.0, 1.0, 2.0, 5.0, 60.0])
    chance = burning_probability(silent_s, np.full(5, 1.0), np.full(5, 0.9))
    assert chance[0] == 1.0
    assert (np.diff(chance) < 0.0).all()
    assert chance[-1] < 1e-9


def test_what_stands_is_no_launch_and_what_flies_is_one() -> None:
    still = np.diag([20.0**2] * 3)
    velocity = np.array([[5.0, -3.0, 8.0], [300.0, 0.0, 400.0], [0.0, 0.0, 0.0]])
    covariance = np.array([still, still, np.diag([300.0**2] * 3)])
    chance = launch_probability(velocity, covariance)
    assert chance[0] < 1e-3
    assert chance[1] > 0.999
    # Of what is hardly known the prior of one in a thousand remains.
    assert chance[2] < 2e-3
