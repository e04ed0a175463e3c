"""Estimates whose motion along an axis is replaced: that has the given moments, and the rest
follows.
"""

import numpy as np
import pytest
from opir_estimation import (
    BOOST,
    COAST,
    Gaussian,
    ImmFilter,
    ModeEstimates,
    Motion,
    information_root,
)
from opir_estimation.filter.hidden_marginal import replaced
from opir_estimation.square_root import covariance

from opir_core.flight import Forces

SIZE = 10


def estimate(seed):
    """Return mean and root of a burn with correlations of all kinds, an axis, and the rows along
    it.
    """
    rng = np.random.default_rng(seed)
    side = (
        rng.normal(size=(1, SIZE, SIZE))
        * np.array([1e4] * 3 + [100.0] * 3 + [5.0] * 3 + [0.01])[:, None]
    )
    axis = rng.normal(size=3)
    axis /= np.linalg.norm(axis)
    rows = np.zeros((3, SIZE))
    for order in range(3):
        rows[order, 3 * order : 3 * order + 3] = axis
    return rng.normal(size=(1, SIZE)) * 1e3, information_root(side), axis[None], rows


MEAN = np.array([[3e5, -700.0, 12.0]])
SPREAD = np.diag([1e9, 1e5, 20.0])[None] + 1e2


@pytest.mark.parametrize("seed", [2, 4])
def test_what_is_along_the_axis_has_the_given_moments(seed):
    mean, root, axis, rows = estimate(seed)
    after, held = replaced(Gaussian(mean, root), axis, MEAN, SPREAD)
    assert rows @ after[0] == pytest.approx(MEAN[0], rel=1e-8)
    assert rows @ covariance(held)[0] @ rows.T == pytest.approx(SPREAD[0], rel=1e-6)


def test_the_rest_is_as_likely_as_before_given_what_is_along_the_axis():
    mean, root, axis, rows = estimate(6)
    after, held = replaced(Gaussian(mean, root), axis, MEAN, SPREAD)
    gains = []
    left = []
    for each in (covariance(root)[0], covariance(held)[0]):
        gain = np.linalg.solve(rows @ each @ rows.T, rows @ each).T
        gains.append(gain)
        left.append(each - gain @ rows @ each)
    assert gains[1] == pytest.approx(gains[0], rel=1e-5, abs=1e-9)
    scale = np.sqrt(np.diag(covariance(root)[0]))
    assert left[1] / np.outer(scale, scale) == pytest.approx(
        left[0] / np.outer(scale, scale), abs=1e-6
    )
    moved = after[0] - mean[0]
    assert moved == pytest.approx(gains[0] @ (MEAN[0] - rows @ mean[0]), rel=1e-6)


def test_its_own_moments_change_nothing():
    mean, root, axis, rows = estimate(8)
    own = (rows @ mean[0])[None], (rows @ covariance(root)[0] @ rows.T)[None]
    after, held = replaced(Gaussian(mean, root), axis, *own)
    assert after == pytest.approx(mean, rel=1e-8)
    assert covariance(held) == pytest.approx(covariance(root), rel=1e-5, abs=1e-6)


def test_a_coast_had_the_given_moments_some_time_ago_and_flies_on_from_there():
    mean = np.array([7e6, 0.0, 0.0, 500.0, 6000.0, 0.0])
    side = np.diag([800.0, 900.0, 700.0, 40.0, 30.0, 20.0])[None]
    coast = Gaussian(mean[None], information_root(side))
    row = np.array([0])
    ago_s = np.array([8.0])
    axis = np.array([[0.0, 0.6, 0.8]])
    along = np.array([[-2e4, 4500.0]])
    spread = np.array([[[4e8, 1e5], [1e5, 1e6]]])
    estimates = ModeEstimates(
        np.array([[0.1, 0.9]]),
        np.zeros((1, SIZE)),
        np.eye(SIZE)[None],
        *coast,
        np.zeros((1, 3)),
    )
    imm = ImmFilter(Motion(BOOST, 0.3, Forces()), Motion(COAST, 0.01, Forces()), 150.0, 1000.0)
    after = imm.coasts_replaced_along(estimates, row, ago_s, axis, along, spread)
    then, held = imm.coasts_before(after, row, ago_s)
    rows = np.kron(np.eye(2), axis)
    assert rows @ then[0] == pytest.approx(along[0], rel=1e-4)
    assert rows @ covariance(held)[0] @ rows.T == pytest.approx(spread[0], rel=0.02)
    # It flies on from there.
    assert after.coast_mean[0, :3] == pytest.approx(then[0, :3] + 8.0 * then[0, 3:], rel=2e-3)
