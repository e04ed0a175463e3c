"""The filter of shared errors beside a batch solution, and its scales."""

import numpy as np
import pytest
from opir_trackers.registration.error_filter import SCALES_RAD, ErrorFilter
from opir_trackers.registration.misfits import Misfits
from scipy.stats import multivariate_normal

RNG = np.random.default_rng(4)
NEVER_S = 1e12


def slices(error: np.ndarray, count: int, noise: float) -> list[tuple[np.ndarray, np.ndarray]]:
    """Return rows (2, q) and measurements (2,) of errors (q,), each with unit variance."""
    made = []
    for _ in range(count):
        rows = RNG.standard_normal((2, len(error))) / noise
        made.append((rows, rows @ error + RNG.standard_normal(2)))
    return made


def misfits_of(rows: np.ndarray, seen: np.ndarray) -> Misfits:
    """Return the information of one target."""
    matrix = rows.T @ rows
    vector = rows.T @ seen
    return Misfits(
        np.zeros(1, dtype=np.int64),
        matrix[None],
        vector[None],
        np.array([seen @ seen]),
        np.array([2.0]),
    )


def after(filter_: ErrorFilter, made: list[tuple[np.ndarray, np.ndarray]]) -> ErrorFilter:
    for rows, seen in made:
        filter_ = filter_.updated(misfits_of(rows, seen))
    return filter_


def test_against_a_batch_solution_of_each_scale() -> None:
    stated = np.array([30e-6, 50e-6])
    error = np.array([2e-5, -4e-5, 0.05, 3e-5, 1e-5, -0.02])
    made = slices(error * [1e6, 1e6, 10.0, 1e6, 1e6, 10.0], 6, 5.0)
    made = [(rows * [1e6, 1e6, 10.0, 1e6, 1e6, 10.0], seen) for rows, seen in made]
    filter_ = after(ErrorFilter.of(stated, 0.1, NEVER_S), made)
    rows = np.concatenate([row for row, _ in made])
    seen = np.concatenate([one for _, one in made])
    log = []
    for scale, scale_rad in enumerate(SCALES_RAD):
        variance = np.repeat(np.square(stated) + scale_rad**2, 3)
        variance[2::3] = 0.1**2
        covariance = np.linalg.inv(rows.T @ rows + np.diag(1.0 / variance))
        assert filter_.covariance[scale] == pytest.approx(
            covariance, rel=1e-6, abs=1e-9 * covariance.max()
        )
        mean = covariance @ rows.T @ seen
        assert filter_.mean[scale] == pytest.approx(mean, rel=1e-6, abs=1e-6 * np.abs(mean).max())
        spread = rows @ np.diag(variance) @ rows.T + np.eye(len(rows))
        log.append(multivariate_normal(np.zeros(len(rows)), spread).logpdf(seen))
    prior = np.append(0.96, np.full(len(SCALES_RAD) - 1, 0.04 / (len(SCALES_RAD) - 1)))
    weight = prior * np.exp(np.array(log) - max(log))
    assert filter_.weight == pytest.approx(weight / weight.sum(), rel=1e-5)


def test_sensors_that_are_as_stated_pay_nothing() -> None:
    filter_ = after(
        ErrorFilter.of(np.zeros(2), 0.0, NEVER_S),
        [(r * 1e6, s) for r, s in slices(np.zeros(6), 40, 3.0)],
    )
    known = filter_.reported()
    assert not known.mean.any()
    assert not known.covariance.any()


def test_a_bias_that_nobody_reported_is_found() -> None:
    error = np.array([60e-6, -20e-6, 0.0, 10e-6, 50e-6, 0.0])
    made = [(rows * 1e6, seen) for rows, seen in slices(error * 1e6, 40, 3.0)]
    known = after(ErrorFilter.of(np.zeros(2), 0.0, NEVER_S), made).reported()
    assert known.mean == pytest.approx(error, abs=2.5e-6)
    assert np.sqrt(np.diagonal(known.covariance)).max() < 2e-6


def test_a_bias_that_changes_at_once_is_learnt_anew() -> None:
    first = slices(np.array([60.0, 0.0, 0.0, 0.0, 60.0, 0.0]), 40, 3.0)
    second = slices(np.array([-60.0, 0.0, 0.0, 0.0, -60.0, 0.0]), 40, 3.0)
    made = [(rows * 1e6, seen) for rows, seen in [*first, *second]]
    known = after(ErrorFilter.of(np.zeros(2), 0.0, NEVER_S), made).reported()
    assert known.mean[0] == pytest.approx(-60e-6, abs=3e-6)


def test_a_misfit_that_nobody_else_shows_is_not_believed() -> None:
    made = [(rows * 1e6, seen) for rows, seen in slices(np.zeros(6), 40, 3.0)]
    filter_ = after(ErrorFilter.of(np.full(2, 60e-6), 0.0, NEVER_S), made)
    rows, seen = slices(np.zeros(6), 1, 3.0)[0]
    wrong = filter_.updated(misfits_of(rows * 1e6, seen + 50.0))
    assert wrong.comparisons == filter_.comparisons
    assert (wrong.mean == filter_.mean).all()


def test_drift_returns_to_the_prior() -> None:
    made = [(rows * 1e6, seen) for rows, seen in slices(np.full(6, 30.0), 40, 3.0)]
    filter_ = after(ErrorFilter.of(np.full(2, 60e-6), 0.0, 100.0), made)
    later = filter_.predicted(1e4)
    assert later.mean[:, :2] == pytest.approx(0.0, abs=1e-12)
    assert later.covariance[:, 0, 0] == pytest.approx(filter_.prior[:, 0], rel=1e-6)
