"""Radii of ellipsoids that hold what they say of mixtures, against closed forms and against chance."""

import numpy as np
import pytest
from attrs import evolve
from opir_trackers.profile.flight import Moments
from opir_trackers.profile.report import holding_sigmas
from scipy.stats import chi2, kstest, ncx2

from opir_core.interfaces.records import TRACK_CONTAINMENTS
from opir_core.scoring.consistency import nees, on_normal_scale

SHARES = np.array(TRACK_CONTAINMENTS)

#: Metres and metres a second, as states have them.
SCALE = np.array([1e4, 2e4, 5e3, 100.0, 300.0, 50.0])


def mixture(parts, weight):
    """Return the mean and covariance of one mixture of normal distributions."""
    mean = weight @ parts.mean
    away = parts.mean - mean
    total = np.einsum("n,nij->ij", weight, parts.covariance + away[:, :, None] * away[:, None, :])
    return Moments(mean[None], total[None])


def random_parts(rng, count, apart):
    """Return normal distributions of random shapes, so many of their standard deviations apart."""
    turn = rng.normal(size=(count, 6, 6)) * SCALE[:, None]
    return Moments(
        apart * rng.normal(size=(count, 6)) * SCALE, turn @ turn.transpose(0, 2, 1) + np.diag(SCALE**2) * 0.1
    )


def drawn(parts, weight, count, rng):
    """Return states (count, 6) drawn from a mixture."""
    which = rng.choice(len(weight), count, p=weight)
    root = np.linalg.cholesky(parts.covariance)
    return parts.mean[which] + np.einsum("nij,nj->ni", root[which], rng.normal(size=(count, 6)))


@pytest.mark.parametrize("seed", [0, *(pytest.param(seed, marks=pytest.mark.slow) for seed in range(1, 6))])
@pytest.mark.parametrize("apart", [0.0, 0.5, 2.0])
def test_ellipsoids_hold_what_they_say_of_states_drawn_at_random(seed, apart):
    rng = np.random.default_rng(seed)
    weight = rng.dirichlet(np.ones(4))
    parts = random_parts(rng, 4, apart)
    told = mixture(parts, weight)
    (radii,) = holding_sigmas(parts, weight, np.zeros(4, dtype=np.int64), told)
    away = drawn(parts, weight, 40_000, rng) - told.mean
    value = nees(away, np.repeat(told.covariance, len(away), axis=0))
    held = [np.mean(np.sqrt(value) <= radius) for radius in radii]
    # To a hundredth of what is held, as it says, and chance.
    assert held == pytest.approx(SHARES, abs=0.012 + 3.3 * np.sqrt(0.25 / 40_000))


def test_of_two_like_parts_the_radii_are_those_of_a_normal_distribution_and_of_one_none_are_told():
    parts = random_parts(np.random.default_rng(1), 1, 0.0)
    twice = parts.take(np.zeros(2, dtype=np.int64))
    (radii,) = holding_sigmas(twice, np.full(2, 0.5), np.zeros(2, dtype=np.int64), parts)
    assert radii == pytest.approx(np.sqrt(chi2.ppf(SHARES, 6)), rel=2e-3)
    assert np.isnan(holding_sigmas(parts, np.ones(1), np.zeros(1, dtype=np.int64), parts)).all()


def test_of_equal_parts_opposite_one_another_the_radii_are_those_of_a_distance_that_is_not_central():
    away = np.zeros(6)
    away[0] = 2.0
    parts = Moments(np.stack([away, -away]) * SCALE, np.tile(np.diag(SCALE**2), (2, 1, 1)))
    told = Moments(np.zeros((1, 6)), np.diag(SCALE**2)[None])
    (radii,) = holding_sigmas(parts, np.full(2, 0.5), np.zeros(2, dtype=np.int64), told)
    assert ncx2.cdf(np.square(radii), 6, 4.0) == pytest.approx(SHARES, abs=0.01)


def test_on_their_scale_errors_of_a_mixture_have_the_distribution_that_is_tested():
    """A narrow distribution and a wide one of the same middle: as told χ² of six degrees, and as it is not."""
    rng = np.random.default_rng(2)
    parts = Moments(np.zeros((2, 6)), np.stack([np.diag(SCALE**2), 4.0 * np.diag(SCALE**2)]))
    weight = np.array([0.75, 0.25])
    told = mixture(parts, weight)
    away = drawn(parts, weight, 500, rng)
    value = nees(away, np.repeat(told.covariance, 500, axis=0))
    radii = holding_sigmas(parts, weight, np.zeros(2, dtype=np.int64), told)
    assert kstest(value, chi2(6).cdf).pvalue < 1e-6
    assert kstest(on_normal_scale(value, np.repeat(radii, 500, axis=0), 6), chi2(6).cdf).pvalue > 0.01


def test_what_is_not_known_has_no_radii_and_tracks_stand_alone():
    rng = np.random.default_rng(3)
    parts, weight, row = random_parts(rng, 7, 1.0), rng.dirichlet(np.ones(7)), np.array([0, 1, 0, 2, 1, 2, 3])
    parts = evolve(parts, mean=np.where(np.arange(7)[:, None] == 3, np.nan, parts.mean))
    told = random_parts(rng, 4, 1.0)
    every = holding_sigmas(parts, weight, row, told)
    assert np.isnan(every[2:]).all()
    for track in (0, 1):
        mine = np.flatnonzero(row == track)
        alone = holding_sigmas(parts.take(mine), weight[mine], np.zeros(2, dtype=np.int64), told.take([track]))
        assert alone[0] == pytest.approx(every[track], rel=1e-12)
        assert np.all(np.diff(every[track]) > 0.0)
