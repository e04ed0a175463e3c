"""The filter of shared errors beside a batch solution, and its scales."""

import numpy as np
import pytest
from opir_estimation.registration.error_filter import CLOCK_SCALES_S, SCALES_RAD, ErrorFilter
from opir_estimation.registration.misfits import Misfits
from scipy.stats import multivariate_normal

NEVER_S = 1e12
Slice = tuple[np.ndarray, np.ndarray]


def slices(seed: int, error: np.ndarray, count: int = 40, noise: float = 3.0) -> list[Slice]:
    """Return rows (2, q) and measurements (2,) of errors (q,), each with unit variance."""
    rng = np.random.default_rng([4, seed])
    rows = rng.standard_normal((count, 2, len(error))) / noise
    return list(zip(rows, rows @ error + rng.standard_normal((count, 2)), strict=True))


def informed(filter_: ErrorFilter, measured: list[Slice], scale: np.ndarray) -> ErrorFilter:
    """Return a filter after slices, one target each, of errors in units of 1 / scale (q,)."""
    for rows, measurement in measured:
        rows = rows * scale
        misfits = Misfits(
            np.zeros(1, dtype=np.int64),
            (rows.T @ rows)[None],
            (rows.T @ measurement)[None],
            np.array([measurement @ measurement]),
            np.array([2.0]),
        )
        filter_ = filter_.updated(misfits)
    return filter_


def filter_of(
    bias_sigma_rad: float, *measured: Slice, correlation_s: float = NEVER_S
) -> ErrorFilter:
    """Return the filter of two sensors after slices in µrad."""
    filter_ = ErrorFilter.of(np.full(2, bias_sigma_rad), 0.0, correlation_s)
    return informed(filter_, list(measured), np.full(6, 1e6))


def test_against_a_batch_solution_of_each_scale() -> None:
    stated = np.array([30e-6, 50e-6])
    error = np.array([2e-5, -4e-5, 0.05, 3e-5, 1e-5, -0.02])
    scale = np.array([1e6, 1e6, 10.0, 1e6, 1e6, 10.0])
    measured = slices(1, error * scale, 6, 5.0)
    filter_ = informed(ErrorFilter.of(stated, 0.1, NEVER_S), measured, scale)
    rows = np.concatenate([slice_rows * scale for slice_rows, _ in measured])
    measurement = np.concatenate([values for _, values in measured])
    log = []
    for number, scale_rad in enumerate(SCALES_RAD):
        variance = np.repeat(np.square(stated) + scale_rad**2, 3)
        variance[2::3] = 0.1**2
        covariance = np.linalg.inv(rows.T @ rows + np.diag(1.0 / variance))
        mean = covariance @ rows.T @ measurement
        slack = 1e-9 * covariance.max()
        assert filter_.covariance[number] == pytest.approx(covariance, rel=1e-6, abs=slack)
        slack = 1e-6 * np.abs(mean).max()
        assert filter_.mean[number] == pytest.approx(mean, rel=1e-6, abs=slack)
        spread = rows @ np.diag(variance) @ rows.T + np.eye(len(rows))
        log.append(multivariate_normal(np.zeros(len(rows)), spread).logpdf(measurement))
    unstated = len(SCALES_RAD) - 1
    prior = np.append(0.96, np.full(unstated, 0.04 / unstated))
    weight = prior * np.exp(np.array(log) - max(log))
    assert filter_.weight == pytest.approx(weight / weight.sum(), rel=1e-5)


def test_against_a_batch_solution_of_each_clock() -> None:
    """Three sensors whose clocks are not stated; that of the second is off by 0.4 s."""
    scale = np.tile([1e6, 1e6, 10.0], 3)
    error = np.zeros(9)
    error[5] = 0.4
    measured = slices(8, error * scale, 60)
    filter_ = informed(ErrorFilter.of(np.zeros(3), 0.0, NEVER_S), measured, scale)
    rows = np.concatenate([slice_rows * scale for slice_rows, _ in measured])
    measurement = np.concatenate([values for _, values in measured])
    biases = [np.tile([scale_rad**2, scale_rad**2, 0.0], 3) for scale_rad in SCALES_RAD]
    clocks = [
        np.eye(9)[3 * sensor + 2] * scale_s**2 for scale_s in CLOCK_SCALES_S for sensor in range(3)
    ]
    log = [
        multivariate_normal(
            np.zeros(len(rows)), rows @ np.diag(variance) @ rows.T + np.eye(len(rows))
        ).logpdf(measurement)
        for variance in (*biases, *clocks)
    ]
    prior = np.concatenate([[0.96], np.full(6, 0.04 / 6), np.full(6, 0.0015)])
    weight = prior * np.exp(np.array(log) - max(log))
    assert filter_.weight == pytest.approx(weight / weight.sum(), rel=1e-5, abs=1e-12)
    reported = filter_.reported()
    assert reported.mean[5] == pytest.approx(0.4, abs=4.0 * np.sqrt(reported.covariance[5, 5]))
    assert np.abs(reported.mean[[0, 1, 3, 4, 6, 7]]).max() < 1e-7
    assert np.abs(reported.mean[[2, 8]]).max() < 0.01


def test_sensors_that_are_as_stated_pay_nothing() -> None:
    errors = filter_of(0.0, *slices(2, np.zeros(6))).reported()
    assert not errors.mean.any()
    assert not errors.covariance.any()


def test_an_unstated_bias_is_found() -> None:
    bias_urad = np.array([60.0, -20.0, 0.0, 10.0, 50.0, 0.0])
    errors = filter_of(0.0, *slices(3, bias_urad)).reported()
    assert errors.mean == pytest.approx(1e-6 * bias_urad, abs=2.5e-6)
    assert np.sqrt(np.diagonal(errors.covariance)).max() < 2e-6


def test_a_bias_that_changes_at_once_is_learnt_anew() -> None:
    bias_urad = np.array([60.0, 0.0, 0.0, 0.0, 60.0, 0.0])
    measured = [*slices(4, bias_urad), *slices(5, -bias_urad)]
    assert filter_of(0.0, *measured).reported().mean[0] == pytest.approx(-60e-6, abs=3e-6)


def test_a_misfit_that_no_other_target_shows_is_rejected() -> None:
    measured = slices(6, np.zeros(6), 41)
    rows, measurement = measured.pop()
    filter_ = filter_of(60e-6, *measured)
    updated = informed(filter_, [(rows, measurement + 50.0)], np.full(6, 1e6))
    assert updated.comparisons == filter_.comparisons
    assert (updated.mean == filter_.mean).all()


def test_drift_returns_to_the_prior() -> None:
    filter_ = filter_of(60e-6, *slices(7, np.full(6, 30.0)), correlation_s=100.0)
    later = filter_.predicted(1e4)
    assert later.mean[:, :2] == pytest.approx(0.0, abs=1e-12)
    assert later.covariance[:, 0, 0] == pytest.approx(filter_.prior[:, 0], rel=1e-6)
