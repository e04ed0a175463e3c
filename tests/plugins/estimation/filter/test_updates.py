"""Updates, mixtures and mode probabilities of the filter against the textbook's covariance form."""

import numpy as np
import pytest
from opir_estimation import BOOST, COAST, ImmFilter, ModeEstimates, Motion, information_root
from opir_estimation.filter.measurement_updates import (
    least_squares,
    log_determinant_ratio,
    measurement_update,
    moment_matched,
)
from opir_estimation.filter.mode_mixing import mode_update

from opir_core.arrays import FloatArray
from opir_core.flight.forces import Forces

FILTER = ImmFilter(Motion(BOOST, 0.3, Forces()), Motion(COAST, 0.01, Forces()), 150.0, 1000.0)


def roots(count: int, size: int, seed: int) -> FloatArray:
    """Return upper triangular information roots."""
    return np.triu(np.random.default_rng(seed).normal(size=(count, size, size))) + 2.0 * np.eye(
        size
    )


def covariance_of(root: FloatArray) -> FloatArray:
    return np.linalg.inv(root.transpose(0, 2, 1) @ root)


@pytest.mark.parametrize("count", [1, 4])
def test_an_update_is_kalmans(count: int) -> None:
    """K = P Hᵀ (H P Hᵀ + I)⁻¹ for whitened rows, about a point that is not the mean; the misfit is
    that of both.
    """
    rng = np.random.default_rng(1)
    root = roots(count, 4, 2)
    prior = covariance_of(root)
    rows = rng.normal(size=(count, 3, 4))
    off = rng.normal(size=(count, 4))
    residual = rng.normal(size=(count, 3))
    owed = np.einsum("nij,nj->ni", root, off)
    after, step, misfit = measurement_update(
        root, owed, np.concatenate([rows, residual[:, :, None]], axis=2)
    )
    for row in range(count):
        seen = rows[row] @ prior[row] @ rows[row].T + np.eye(3)
        gain = prior[row] @ rows[row].T @ np.linalg.inv(seen)
        innovation = residual[row] - rows[row] @ off[row]
        assert step[row] == pytest.approx(off[row] + gain @ innovation)
        assert covariance_of(after)[row] == pytest.approx(
            prior[row] - gain @ rows[row] @ prior[row]
        )
        assert misfit[row] == pytest.approx(innovation @ np.linalg.solve(seen, innovation))


def test_roots_are_those_of_the_covariance_and_their_determinants() -> None:
    side = np.random.default_rng(3).normal(size=(3, 4, 6))
    root = information_root(side)
    assert covariance_of(root) == pytest.approx(side @ side.transpose(0, 2, 1))
    other = roots(3, 4, 4)
    ratio = np.linalg.slogdet(root)[1] - np.linalg.slogdet(other)[1]
    for rows in (slice(0, 3), slice(0, 1)):
        assert log_determinant_ratio(root[rows], other[rows]) == pytest.approx(ratio[rows])


def test_least_squares_are_those_of_the_rows() -> None:
    stack = np.random.default_rng(5).normal(size=(2, 7, 4))
    _, solution, left = least_squares(stack)
    for row in range(2):
        best, misfit, *_ = np.linalg.lstsq(stack[row, :, :3], stack[row, :, 3], rcond=None)
        assert solution[row] == pytest.approx(best)
        assert left[row] == pytest.approx(misfit[0])


@pytest.mark.parametrize("count", [1, 3])
def test_matched_moments_are_those_of_the_mixture(count: int) -> None:
    rng = np.random.default_rng(6)
    weight = rng.dirichlet([1.0, 1.0], count)
    means = tuple(rng.normal(size=(count, 4)) for _ in range(2))
    parts = roots(count, 4, 7), roots(count, 4, 8)
    mean, root = moment_matched(weight, means, parts)
    for row in range(count):
        every = np.stack([each[row] for each in means])
        center = weight[row] @ every
        second = sum(weight[row, k] * covariance_of(parts[k])[row] for k in range(2))
        second = second + (every - center).T @ np.diag(weight[row]) @ (every - center)
        assert mean[row] == pytest.approx(center)
        assert covariance_of(root)[row] == pytest.approx(second)


def bank(weight: FloatArray, rate: FloatArray) -> ModeEstimates:
    """Return tracks with boosts and coasts of their own."""
    count = len(weight)
    rng = np.random.default_rng(9)
    mean = rng.normal(size=(count, BOOST)) * np.repeat([1e3, 30.0, 5.0, 0.1], 3)
    coast = mean[:, :COAST] + rng.normal(size=(count, COAST)) * np.repeat([100.0, 5.0], 3)
    boosts = roots(count, BOOST, 10) / np.repeat([100.0, 10.0, 3.0, 0.1], 3)
    coasts = roots(count, COAST, 11) / np.repeat([100.0, 10.0], 3)
    return ModeEstimates(weight, mean, boosts, coast, coasts, rate)


@pytest.mark.parametrize("count", [1, 3])
def test_reported_moments_are_those_of_both_modes(count: int) -> None:
    weight = np.array([[0.7, 0.3], [0.2, 0.8], [1.0, 0.0]])[:count]
    estimates = bank(weight, np.ones((count, 3)))
    mean, covariance = FILTER.moments(estimates)
    for row in range(count):
        every = np.stack([estimates.boost_mean[row, :COAST], estimates.coast_mean[row]])
        center = weight[row] @ every
        parts = (
            covariance_of(estimates.boost_root)[row, :COAST, :COAST],
            covariance_of(estimates.coast_root)[row],
        )
        second = weight[row, 0] * parts[0] + weight[row, 1] * parts[1]
        second = second + (every - center).T @ np.diag(weight[row]) @ (every - center)
        assert mean[row] == pytest.approx(center)
        assert covariance[row] == pytest.approx(second, rel=1e-6, abs=1e-6)


def test_silence_makes_a_burn_as_improbable_as_poissons_law_says() -> None:
    """Of 30 detections in 10 s none in half a second: exp(-1.5), beside a coast that is never
    detected.
    """
    weight = np.array([[0.9, 0.1], [0.9, 0.1]])
    rate = np.array([[30.0, 10.0, 0.2], [30.0, 10.0, 0.2]])
    estimates = bank(weight, rate)
    step_s = 0.5
    hits = np.array([0.0, 2.0])
    silent_s = np.array([step_s, 0.1])
    after, counted = mode_update(estimates, hits, silent_s, np.zeros((2, 2)), step_s, 10.0)
    quiet = 0.9 * np.exp(-1.5)
    assert after[0] == pytest.approx([quiet / (quiet + 0.1), 0.1 / (quiet + 0.1)])
    assert counted[0] == pytest.approx([30.0, 10.0, 0.7])
    kept = np.exp(-step_s / 10.0)
    assert after[1] == pytest.approx([0.9, 0.1])
    assert counted[1] == pytest.approx([2.0 + 30.0 * kept, step_s + 10.0 * kept, 0.1])
    for row in range(2):
        rows = [row]
        alone = mode_update(
            estimates.take(rows), hits[rows], silent_s[rows], np.zeros((1, 2)), step_s, 10.0
        )
        assert alone[0][0] == pytest.approx(after[row])
        assert alone[1][0] == pytest.approx(counted[row])


def test_what_looks_say_of_a_mode_multiplies_its_probability() -> None:
    estimates = bank(np.array([[0.5, 0.5]]), np.array([[10.0, 10.0, 0.0]]))
    after, _ = mode_update(estimates, np.ones(1), np.zeros(1), np.log([[3.0, 1.0]]), 1.0, 10.0)
    assert after[0] == pytest.approx([0.75, 0.25])


def test_predicted_boosts_grow_by_the_transition_and_the_noise() -> None:
    """F P Fᵀ + Q about the means, with both modes for themselves: targets that never switch."""
    still = ImmFilter(Motion(BOOST, 0.3, Forces()), Motion(COAST, 0.01, Forces()), np.inf, np.inf)
    estimates = bank(np.array([[0.5, 0.5], [0.6, 0.4]]), np.ones((2, 3)))
    place = np.tile([0.0, 0.0, 6.5e6], (2, 1))
    mean = estimates.boost_mean.copy()
    coast = estimates.coast_mean.copy()
    mean[:, :3] += place
    coast[:, :3] += place
    estimates = ModeEstimates(
        estimates.weight,
        mean,
        estimates.boost_root,
        coast,
        estimates.coast_root,
        estimates.detection_rate,
    )
    step = np.full(2, 1.5)
    after = still.predicted(estimates, 1.5)
    modes = [
        (still.boost, mean, estimates.boost_root, after.boost_mean, after.boost_root),
        (still.coast, coast, estimates.coast_root, after.coast_mean, after.coast_root),
    ]
    for motion, before, root, mean_after, root_after in modes:
        moved = motion.propagated(before, step)
        matrix = motion.transition(0.5 * (before + moved)[:, :3], step)
        noise = motion.noise_root(step)
        expected = matrix @ covariance_of(root) @ matrix.transpose(
            0, 2, 1
        ) + noise @ noise.transpose(0, 2, 1)
        scale = np.sqrt(np.einsum("nii,njj->nij", expected, expected))
        assert mean_after == pytest.approx(moved, rel=1e-9)
        assert (np.abs(covariance_of(root_after) - expected) < 1e-5 * scale).all()
