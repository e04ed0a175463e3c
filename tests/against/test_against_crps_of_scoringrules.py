"""Proper scores against closed forms, and against another library on drawn ensembles."""

import numpy as np
import pytest
import scoringrules
from opir_scoring import brier_scores, energy_scores, log_scores
from opir_scoring.proper_scores import weighted_energy
from scipy.stats import chi2

from opir_core.interfaces import TRACK_CONTAINMENTS


def covariance_of(rng, size):
    draw = rng.normal(size=(size, size)) * np.geomspace(1.0, 30.0, size)
    return draw @ draw.T


def test_in_one_dimension_the_energy_score_is_the_crps_of_a_normal():
    rng = np.random.default_rng(1)
    error = rng.normal(0.0, 3.0, 50)
    sigma = rng.uniform(0.01, 5.0, 50)
    result = energy_scores(error[:, None], np.square(sigma)[:, None, None])
    np.testing.assert_allclose(
        result, scoringrules.crps_normal(0.0, error, sigma), rtol=1e-7, atol=1e-7
    )


@pytest.mark.parametrize("size", [2, 3, 6])
def test_energy_scores_of_normals_are_those_of_large_ensembles(size):
    rng = np.random.default_rng(size)
    for _ in range(3):
        covariance = covariance_of(rng, size)
        error = rng.multivariate_normal(np.zeros(size), 2.0 * covariance)
        ensemble = rng.multivariate_normal(error, covariance, 2500)
        reference = scoringrules.es_ensemble(np.zeros(size), ensemble, estimator="fair")
        assert energy_scores(error[None], covariance[None])[0] == pytest.approx(reference, rel=0.06)


def test_radii_of_ellipsoids_stretch_the_distribution():
    rng = np.random.default_rng(5)
    covariance = covariance_of(rng, 6)
    freedom = 6
    usual = np.sqrt(chi2.ppf(TRACK_CONTAINMENTS, freedom))
    error = rng.multivariate_normal(np.zeros(6), covariance)
    alike, normal = (
        energy_scores(error[None], covariance[None], radii) for radii in (usual[None], None)
    )
    np.testing.assert_allclose(alike, normal, rtol=1e-9)
    # All radii twice as large: the covariance is four times as large.
    for axes in (slice(None), slice(0, 3), slice(3, 6)):
        wide = energy_scores(error[None], covariance[None], 2.0 * usual[None], axes)
        assert wide[0] == pytest.approx(
            energy_scores(error[None], 4.0 * covariance[None], None, axes)[0], rel=0.03
        )


def test_points_are_scored_as_an_ensemble():
    rng = np.random.default_rng(7)
    points = rng.normal(size=(40, 2))
    weight = rng.uniform(size=40)
    offset = np.linalg.norm(points, axis=1)
    separation = np.linalg.norm(points[:, None] - points, axis=2)
    assert weighted_energy(np.ones(40), offset, separation) == pytest.approx(
        float(scoringrules.es_ensemble(np.zeros(2), points))
    )
    ensemble = np.repeat(points, np.round(100 * weight).astype(int), axis=0)
    reference = float(scoringrules.es_ensemble(np.zeros(2), ensemble))
    assert weighted_energy(np.round(100 * weight), offset, separation) == pytest.approx(reference)


def test_log_and_brier_scores_of_two_classes():
    stated = np.array([0.9, 0.2, 0.5])
    is_true = np.array([1, 1, 0])
    probability = np.stack([1.0 - stated, stated], axis=1)
    np.testing.assert_allclose(
        log_scores(probability, is_true), scoringrules.log_score(is_true, stated)
    )
    # Over both classes the score of Brier's paper is twice that of one of them.
    np.testing.assert_allclose(
        brier_scores(probability, is_true), 2.0 * scoringrules.brier_score(is_true, stated)
    )
