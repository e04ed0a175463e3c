"""Labels summed out: held to the filter that knows them, and to trying every explanation."""

from itertools import product

import numpy as np
import pytest
from attrs import evolve
from opir_estimation import (
    GatedPairs,
    PredictedMeasurements,
    SharedLooks,
    equivalent_pairs,
    label_posterior,
)

RANGE_M = 3.7e7
SIGMA_RAD = 20e-6
#: Log odds of a detection over a miss and clutter, with P_d of 0.9 and little clutter.
LOG_ODDS = float(np.log(0.9 / (0.1 * 2.0 * np.pi * 100.0)))


def path_of(tracks: int, sigma_m: float) -> PredictedMeasurements:
    """Return tracks at a distance along x, known to `sigma_m` in position alone."""
    derivative = np.zeros((tracks, 5, 3))
    derivative[:, 0, 0] = RANGE_M
    root = np.zeros((tracks, 12, 12))
    root[:, :3, :3] = sigma_m * np.eye(3)
    return PredictedMeasurements(0.0, derivative, root)


def looks_of(
    measured_m: np.ndarray, track: np.ndarray, line: np.ndarray, look: np.ndarray
) -> SharedLooks:
    """Return pairs (k,) with innovations (k, 2), m across the line of sight."""
    count = len(track)
    axes = np.tile(np.array([[0.0, 1.0, 0.0], [0.0, 0.0, 1.0], [1.0, 0.0, 0.0]]), (count, 1, 1))
    pairs = GatedPairs(
        track,
        line,
        np.zeros(count),
        np.zeros((count, 3)),
        axes,
        measured_m / RANGE_M,
        np.zeros(count),
        np.zeros(count),
        np.full(count, SIGMA_RAD),
    )
    return SharedLooks(pairs, look, np.full(count, LOG_ODDS), np.zeros(count, dtype=np.int32))


def crossed(targets_m: np.ndarray, scans: int, rng: np.random.Generator) -> SharedLooks:
    """Return all pairs of as many tracks, predicted at 0, with the lines of targets (n, 2)."""
    count = len(targets_m)
    lines = targets_m + SIGMA_RAD * RANGE_M * rng.normal(size=(scans, count, 2))
    scan, track, place = np.array(list(product(range(scans), range(count), range(count)))).T
    return looks_of(lines[scan, place], track, scan * count + place, scan * count + track)


def test_one_scan_has_the_probabilities_of_every_explanation() -> None:
    """Two tracks and two lines, one of which both may have: five explanations. Newcomers bound the
    odds of a pair by 1 / 0.03.
    """
    measured_m = np.array([[100.0, 0.0], [900.0, 300.0], [100.0, 300.0]])
    looks = looks_of(measured_m, np.array([0, 0, 1]), np.array([0, 1, 1]), np.array([0, 0, 1]))
    posterior = label_posterior(looks, path_of(2, 200.0), light_time=False)
    noise_m2 = (SIGMA_RAD * RANGE_M) ** 2
    variance_m2 = noise_m2 + 200.0**2
    likelihood = np.exp(-0.5 * np.sum(measured_m**2, axis=1) / variance_m2)
    odds = np.exp(LOG_ODDS) * RANGE_M**2 / variance_m2
    ratio = likelihood * min(odds, noise_m2 / variance_m2 / 0.03)
    both = ratio[0] * ratio[2]
    total = 1.0 + ratio.sum() + both
    expected = np.array([ratio[0] + both, ratio[1], ratio[2] + both]) / total
    assert posterior.probability == pytest.approx(expected, abs=1e-3)


def test_a_lone_track_keeps_its_lines() -> None:
    rng = np.random.default_rng(2)
    looks = crossed(np.array([[150.0, -80.0]]), 10, rng)
    posterior = label_posterior(looks, path_of(1, 500.0), light_time=False)
    assert posterior.probability.mean() > 0.85
    pairs = equivalent_pairs(looks, posterior)
    weight = 1.0 / np.square(pairs.sigma_rad)
    assert weight.sum() == pytest.approx(10.0 / SIGMA_RAD**2, rel=0.2)
    mean = (weight[:, None] * pairs.measured).sum(axis=0) / weight.sum()
    expected = looks.pairs.measured.mean(axis=0)
    assert mean * RANGE_M == pytest.approx(expected * RANGE_M, abs=60.0)


def test_labels_in_doubt_inform_less_and_remain_consistent() -> None:
    """Tracks 1.1 km apart, known to 300 m: their squared errors, over 200 draws, are as stated."""
    rng = np.random.default_rng(3)
    squares = []
    shares = []
    for _ in range(200):
        error_m = 300.0 * rng.normal(size=(2, 2))
        apart_m = np.array([[0.0, 0.0], [1100.0, 0.0]])
        looks = crossed(apart_m, 10, rng)
        track = looks.pairs.track
        start_m = apart_m + error_m
        shift = start_m[track] / RANGE_M
        moved = looks._replace(pairs=evolve(looks.pairs, measured=looks.pairs.measured - shift))
        pairs = equivalent_pairs(moved, label_posterior(moved, path_of(2, 300.0), light_time=False))
        weight_m2 = 1.0 / np.square(pairs.sigma_rad * RANGE_M)
        for number in range(2):
            rows = pairs.track == number
            total = weight_m2[rows].sum() + 300.0**-2
            pull = (weight_m2[rows, None] * pairs.measured[rows] * RANGE_M).sum(axis=0) / total
            squares.append(total * np.sum((start_m[number] + pull - apart_m[number]) ** 2) / 2.0)
            shares.append(weight_m2[rows].sum() * (SIGMA_RAD * RANGE_M) ** 2 / 10.0)
    assert 0.2 < np.mean(shares) < 0.9
    assert 0.6 < np.mean(squares) < 1.25


def test_a_line_that_nobody_explains_moves_nobody() -> None:
    measured_m = np.array([[0.0, 0.0], [3000.0, 0.0]])
    looks = looks_of(measured_m, np.zeros(2, dtype=int), np.arange(2), np.zeros(2, dtype=int))
    posterior = label_posterior(looks, path_of(1, 50.0), light_time=False)
    assert posterior.probability[0] > 0.9
    assert posterior.probability[1] < 1e-2
    assert len(equivalent_pairs(looks, posterior)) == 1
