"""An undecided pairing is reported as the mixture of its states."""

import numpy as np
import pytest
from opir_estimation import ModeEstimates
from opir_trackers.imm.mixtures import Mixtures


def estimates(count: int) -> ModeEstimates:
    """Return estimates with standard deviations of 100 m and 10 m/s."""
    sigma = np.array([100.0] * 3 + [10.0] * 3 + [5.0] * 3 + [0.01])
    root = np.tile(np.diag(1.0 / sigma), (count, 1, 1))
    mean = np.zeros((count, 10))
    return ModeEstimates(
        np.tile([0.9, 0.1], (count, 1)),
        mean,
        root,
        mean[:, :6],
        root[:, :6, :6].copy(),
        np.ones((count, 3)),
    )


def covariance(part: ModeEstimates) -> np.ndarray:
    side = np.linalg.inv(part.boost_root)
    return side @ side.transpose(0, 2, 1)


def test_mean_and_covariance_are_those_of_all_states_by_their_probabilities() -> None:
    apart = np.array([[900.0, 0.0, 0.0, 30.0, 0.0, 0.0], [0.0, -600.0, 0.0, 0.0, 0.0, 0.0]])
    chance = np.array([0.3, 0.2])
    mixed = Mixtures.of(np.array([4]), 50.0, np.zeros(2, dtype=np.int64), chance, apart)
    reported = mixed.mixed(estimates(3), np.array([2, 4, 6]), 50.0)
    states = np.concatenate([np.zeros((1, 6)), apart])
    weight = np.array([0.5, 0.3, 0.2])
    mean = weight @ states
    spread = (states - mean).T @ np.diag(weight) @ (states - mean)
    assert reported.boost_mean[1, :6] == pytest.approx(mean)
    assert covariance(reported)[1, :6, :6] == pytest.approx(
        np.diag([1e4] * 3 + [1e2] * 3) + spread, rel=1e-9, abs=1e-6
    )
    assert np.array_equal(reported.boost_mean[[0, 2]], np.zeros((2, 10)))
    assert mixed.probability == pytest.approx([0.5])


def test_parts_keep_their_velocities_until_the_next_pairing() -> None:
    apart = np.array([[900.0, 0.0, 0.0, 30.0, 0.0, 0.0]])
    mixed = Mixtures.of(np.array([0]), 50.0, np.zeros(1, dtype=np.int64), np.array([0.5]), apart)
    reported = mixed.mixed(estimates(1), np.array([0]), 54.0)
    assert reported.boost_mean[0, 0] == pytest.approx(0.5 * (900.0 + 4.0 * 30.0))


def test_tracks_that_are_gone_and_none_at_all_change_nothing() -> None:
    known = estimates(2)
    assert Mixtures.empty().mixed(known, np.arange(2), 1.0) is known
    gone = Mixtures.of(
        np.array([7]), 0.0, np.zeros(1, dtype=np.int64), np.array([0.5]), np.ones((1, 6))
    )
    assert np.array_equal(gone.mixed(known, np.arange(2), 1.0).boost_mean, known.boost_mean)
