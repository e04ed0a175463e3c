"""The scale of noise from drawn looks, beside densities and filters of SciPy."""

import numpy as np
import pytest
from opir_estimation import GatedPairs
from opir_estimation.registration.noise_scales import (
    LAW,
    LOG_SCALES,
    NoiseScales,
    innovation_log_likelihood,
    prediction_shares,
    scatter_log_likelihood,
)
from scipy.linalg import solve_discrete_are
from scipy.stats import chi2, multivariate_normal

STATED_RAD = 2e-5
LOOKS = 60
AS_STATED = int(np.argmin(np.abs(LOG_SCALES)))


def pairs(innovation: np.ndarray, covariance: np.ndarray) -> GatedPairs:
    """Return pairs with innovations (m, 2), rad, and covariances (m, 2, 2)."""
    count = len(innovation)
    distance = np.einsum("ni,nij,nj->n", innovation, np.linalg.inv(covariance), innovation)
    zeros = np.zeros(count, dtype=np.int64)
    return GatedPairs(
        track=zeros,
        line=np.arange(count),
        time_s=np.zeros(count),
        origin_m=np.tile([42e6, 0.0, 0.0], (count, 1)),
        axes=np.tile(np.eye(3), (count, 1, 1)),
        measured=innovation,
        distance=distance,
        log_volume=np.log(np.linalg.det(covariance)),
        sigma_rad=np.full(count, STATED_RAD),
        trace=np.trace(covariance, axis1=1, axis2=2),
    )


def drawn(
    rng: np.random.Generator, scale: float, prediction: np.ndarray, assumed: float
) -> tuple[np.ndarray, np.ndarray]:
    """Return the log likelihoods (m, g) and degrees (m,) of looks with a scale of noise, whose
    predictions have the covariance (2, 2), rad², while another scale is assumed.
    """
    variance = STATED_RAD**2 * np.eye(2)
    innovation = rng.multivariate_normal(np.zeros(2), prediction + scale**2 * variance, LOOKS)
    covariance = np.tile(prediction + assumed**2 * variance, (LOOKS, 1, 1))
    stated = np.full(LOOKS, STATED_RAD**2)
    return innovation_log_likelihood(
        pairs(innovation, covariance), stated, assumed**2 * stated, np.zeros(LOOKS)
    )


def judged(scales: NoiseScales, log_likelihood: np.ndarray, degrees: np.ndarray) -> NoiseScales:
    return scales.after(np.zeros(len(degrees), dtype=np.int64), log_likelihood, degrees)


def test_the_likelihood_of_a_perfect_prediction_is_that_of_the_noise() -> None:
    rng = np.random.default_rng(1)
    innovation = 3.0 * STATED_RAD * rng.standard_normal((5, 2))
    covariance = np.tile(STATED_RAD**2 * np.eye(2), (5, 1, 1))
    stated = np.full(5, STATED_RAD**2)
    log_likelihood, degrees = innovation_log_likelihood(
        pairs(innovation, covariance), stated, stated, np.zeros(5)
    )
    assert degrees == pytest.approx(2.0)
    share = LAW.noise_outliers
    disc = 1.0 / (np.pi * (LAW.outlier_sigmas * STATED_RAD) ** 2)
    for column in (AS_STATED - 10, AS_STATED, AS_STATED + 13):
        variance = STATED_RAD**2 * np.exp(2.0 * LOG_SCALES[column])
        density = multivariate_normal(np.zeros(2), variance * np.eye(2)).pdf(innovation)
        expected = np.log((1.0 - share) * density + share * disc) + np.log(2.0 * np.pi)
        assert log_likelihood[:, column] == pytest.approx(expected, rel=1e-9)


def test_the_likelihood_of_scatter_is_chi_squared() -> None:
    square = np.array([30.0])
    degrees = np.array([16.0])
    log_likelihood = scatter_log_likelihood(square, degrees, np.zeros(1))[0]
    variance = np.exp(2.0 * LOG_SCALES)
    expected = chi2(16.0).logpdf(30.0 / variance) - np.log(variance)
    constant = (log_likelihood - expected)[AS_STATED]
    assert log_likelihood == pytest.approx(expected + constant, rel=1e-9)


def test_predictions_under_other_noise_are_those_of_a_stationary_filter() -> None:
    """The Riccati equation of constant velocity with random accelerations, looks once a second."""
    motion = np.array([[1.0, 1.0], [0.0, 1.0]])
    push = np.array([[0.5], [1.0]])
    position = np.array([[1.0, 0.0]])

    def predicted(noise: float) -> float:
        covariance = solve_discrete_are(motion.T, position.T, 0.3 * push @ push.T, [[noise]])
        return float(covariance[0, 0])

    noise = np.array([[0.09, 1.0, 4.0, 25.0]])
    shares = prediction_shares(np.array([predicted(1.0)]), np.ones(1), noise)
    expected = [predicted(variance) / predicted(1.0) for variance in noise[0]]
    assert shares[0] == pytest.approx(expected, rel=1e-6)


@pytest.mark.parametrize("scale", [0.01, 0.3, 1.0, 2.0, 5.0])
def test_a_drawn_scale_is_within_its_interval(scale: float) -> None:
    """With the prediction's covariance known, as where the filter has adopted the scale."""
    held = []
    for seed in range(40):
        rng = np.random.default_rng([2, seed])
        prediction = (scale * STATED_RAD) ** 2 * np.array([[0.6, 0.2], [0.2, 0.3]])
        scales = judged(NoiseScales.of(1), *drawn(rng, scale, prediction, scale))
        off = scales.log_mean[0] - np.log(scale)
        held.append(abs(off) <= 1.96 * scales.log_sigma[0])
        assert abs(off) < 0.35
    assert np.mean(held) >= 0.85


def test_noise_as_stated_is_assumed_to_be_so() -> None:
    for seed in range(40):
        looks = drawn(np.random.default_rng([3, seed]), 1.0, np.zeros((2, 2)), 1.0)
        assert judged(NoiseScales.of(1), *looks).believed == 1.0


def test_a_mended_sensor_is_believed_soon() -> None:
    rng = np.random.default_rng(4)
    scales = NoiseScales.of(1)
    for _ in range(10):
        scales = judged(scales.at(10.0), *drawn(rng, 5.0, np.zeros((2, 2)), 5.0))
    assert scales.believed[0] == pytest.approx(5.0, rel=0.1)
    log_likelihood, degrees = drawn(rng, 1.0, np.zeros((2, 2)), 5.0)
    few = judged(scales.at(10.0), log_likelihood[:20], degrees[:20])
    assert few.believed == 1.0


def test_a_sensor_may_have_the_noise_of_another_until_its_looks_say_otherwise() -> None:
    rng = np.random.default_rng(6)
    scales = judged(NoiseScales.of(2), *drawn(rng, 5.0, np.zeros((2, 2)), 5.0))
    assert scales.believed[0] == pytest.approx(5.0, rel=0.2)
    assert 2.0 < scales.believed[1] < 5.0
    log_likelihood, degrees = drawn(rng, 1.0, np.zeros((2, 2)), scales.believed[1])
    second = np.ones(10, dtype=np.int64)
    believed = scales.after(second, log_likelihood[:10], degrees[:10]).believed
    assert believed[0] == pytest.approx(5.0, rel=0.2)
    assert believed[1] == 1.0


def test_outliers_are_no_noise() -> None:
    rng = np.random.default_rng(5)
    is_far = rng.random(400) < 0.3
    innovation = STATED_RAD * rng.standard_normal((400, 2))
    innovation[is_far] *= 20.0
    covariance = np.tile(STATED_RAD**2 * np.eye(2), (400, 1, 1))
    stated = np.full(400, STATED_RAD**2)
    looks = innovation_log_likelihood(pairs(innovation, covariance), stated, stated, np.zeros(400))
    assert judged(NoiseScales.of(1), *looks).log_mean == pytest.approx(0.0, abs=0.15)


def test_noise_below_the_least_is_not_judged() -> None:
    """Looks without error of a sensor whose stated noise is the least."""
    covariance = np.tile(STATED_RAD**2 * np.eye(2), (LOOKS, 1, 1))
    stated = np.full(LOOKS, STATED_RAD**2)
    looks = pairs(np.zeros((LOOKS, 2)), covariance)
    scales = judged(NoiseScales.of(1), *innovation_log_likelihood(looks, stated, stated, stated))
    assert scales.believed == 1.0
    scatter = scatter_log_likelihood(np.zeros(5), np.full(5, 16.0), np.ones(5))
    assert judged(NoiseScales.of(1), scatter, np.full(5, 16.0)).believed == 1.0
