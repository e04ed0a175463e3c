"""Clutter behind filters: spectra against correlations, and variances against sums over pairs of
pixels.
"""

import math

import numpy as np
import pytest
from opir_photons.radiometry import (
    FrameDifference,
    PointSpread,
    SpatialTransfer,
    filter_weights,
    signal_gain,
    structure_correlation,
    structure_spectrum,
)
from scipy.special import j0


@pytest.mark.parametrize("exponent", [2.4, 8 / 3, 3.0, 4.0])
def test_the_spectrum_is_the_transform_of_the_correlation(exponent: float) -> None:
    scale = 7.0
    nodes, weights = np.polynomial.legendre.leggauss(40)
    edges = np.linspace(0.0, 40.0 * scale, 400)
    half = 0.5 * np.diff(edges)[:, None]
    middle = 0.5 * (edges[1:] + edges[:-1])[:, None]
    distance = (middle + half * nodes).ravel()
    step = (half * weights).ravel()
    for wavenumber in (0.02, 0.3, 2.0):
        hankel = (
            2
            * np.pi
            * distance
            * j0(wavenumber * distance)
            * structure_correlation(distance, scale, exponent)
        )
        expected = float((hankel * step).sum())
        # The correlation of rough fields bends without end at distance 0.
        assert float(structure_spectrum(wavenumber, scale, exponent)) == pytest.approx(
            expected, rel=2e-3
        )


def test_the_field_correlates_as_broken_cloud() -> None:
    wave = np.geomspace(1e-9, 1e9, 20001)
    power = structure_spectrum(wave, 3.0, 3.0) * wave**2 / (2 * np.pi)
    assert float(power.sum() * math.log(wave[1] / wave[0])) == pytest.approx(1.0, rel=1e-4)
    np.testing.assert_allclose(
        structure_correlation([0.0, 3.0, 9.0], 3.0, 3.0), np.exp([0.0, -1.0, -3.0]), rtol=1e-12
    )


def smoothed_correlation(off: np.ndarray, sigma: float, scale: float) -> np.ndarray:
    """Correlations (n,) of pixels apart by (n, 2), by a sum over the plane, of a field of
    correlation exp(-r/scale).

    Two pixels and two spots make a triangle and a Gaussian of √2 σ along each axis.
    """
    step = 0.02
    reach = 1.0 + 8.0 * sigma
    grid = np.arange(-reach + 0.5 * step, reach, step)
    shift = grid[:, None] - np.linspace(-1.0, 1.0, 401)
    triangle = np.clip(1.0 - np.abs(np.linspace(-1.0, 1.0, 401)), 0.0, None)
    kernel = (np.exp(-np.square(shift) / (4 * sigma**2)) * triangle).sum(axis=1)
    kernel /= kernel.sum()
    both = kernel[:, None] * kernel
    return np.array(
        [(both * np.exp(-np.hypot(grid[:, None] + x, grid + y) / scale)).sum() for x, y in off]
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("kind", "pixels"), [("sum", 1), ("sum", 2), ("surround", 1), ("matched", 1)]
)
@pytest.mark.parametrize("scale", [2.0, 12.0])
def test_the_variance_is_that_of_a_sum_over_pairs_of_pixels(
    kind: str, pixels: int, scale: float
) -> None:
    sigma = 0.4
    weights = filter_weights(kind, pixels, sigma, 1.0)
    place = np.argwhere(np.ones_like(weights))
    apart, which = np.unique(
        (place[:, None] - place[None]).reshape(-1, 2), axis=0, return_inverse=True
    )
    pairs = (weights.ravel()[:, None] * weights.ravel()).ravel()
    expected = float((pairs * smoothed_correlation(apart, sigma, scale)[which.ravel()]).sum())
    result = float(SpatialTransfer.of(weights, PointSpread(math.inf, sigma)).variance(scale, 3.0))
    assert result == pytest.approx(expected, rel=3e-3)


def test_displaced_frames_leave_one_minus_correlation() -> None:
    """Of the directions of a drift the mean is taken, here over 64 of them."""
    sigma = 0.5
    scale = 6.0
    drift = 1.3
    transfer = SpatialTransfer.of(np.ones((1, 1)), PointSpread(math.inf, sigma), drift)
    turn = 2 * np.pi * (np.arange(64) + 0.5) / 64
    apart = smoothed_correlation(
        drift * np.stack([np.cos(turn), np.sin(turn)], axis=1), sigma, scale
    ).mean()
    here = smoothed_correlation(np.zeros((1, 2)), sigma, scale)[0]
    remaining = float(transfer.variance(scale, 3.0, FrameDifference(1.0, 0.0, drift)))
    assert remaining == pytest.approx(2.0 * (here - apart), rel=5e-3)


def test_residuals_of_small_and_large_displacements() -> None:
    weights = filter_weights("matched", 1, 0.4, 1.0)
    transfer = SpatialTransfer.of(weights, PointSpread(math.inf, 0.4), 100.0)
    alone = float(transfer.variance(8.0, 3.0))
    gradient = float(
        (
            structure_spectrum(transfer.wavenumber, 8.0, 3.0)
            * transfer.weight
            * transfer.wavenumber**2
        ).sum()
    )
    for registration, drift in ((1e-4, 0.0), (0.0, 1e-4), (2e-4, 3e-4)):
        remaining = float(transfer.variance(8.0, 3.0, FrameDifference(1.0, registration, drift)))
        # Half of a squared gradient lies along each axis; the registration error is of both frames
        # and both axes.
        assert remaining == pytest.approx(
            gradient * (2.0 * registration**2 + 0.5 * drift**2), rel=1e-5
        )
    assert float(transfer.variance(8.0, 3.0, FrameDifference(1.0, 0.0, 90.0))) == pytest.approx(
        2.0 * alone, rel=0.02
    )
    assert float(transfer.variance(8.0, 3.0, FrameDifference(1.0, 9.0, 0.0))) == pytest.approx(
        2.0 * alone, rel=1e-3
    )


def test_large_structure_leaks_by_the_power_law() -> None:
    """High-pass filters see k^-α alone: variance goes as ℓ^(2 - α)."""
    for exponent in (8 / 3, 3.0, 3.5):
        transfer = SpatialTransfer.of(
            filter_weights("surround", 1, 0.35, 1.0), PointSpread(math.inf, 0.35)
        )
        near, far = transfer.variance([1e3, 1e4], exponent)
        assert far / near == pytest.approx(10.0 ** (2.0 - exponent), rel=0.02)


def test_correlation_of_looks() -> None:
    weights = filter_weights("matched", 1, 0.35, 1.0)
    transfer = SpatialTransfer.of(weights, PointSpread(math.inf, 0.35), 50.0)
    registered = FrameDifference(5.0, 0.02, 0.0)
    drifting = FrameDifference(5.0, 0.0, 0.002)
    # Registration errors are new in each frame; a frame is in two differences, a lag apart.
    jittered = transfer.correlation(10.0, 3.0, [0.0, 0.1, 5.0, 7.0], registered)
    np.testing.assert_allclose(jittered, [1.0, 0.0, -0.5, 0.0], atol=2e-3)
    # Drift leaves the same gradient look after look, until the target moves on by a pixel or so.
    resting = transfer.correlation(10.0, 3.0, [0.0, 0.1, 1.0], drifting)
    np.testing.assert_allclose(resting, 1.0, atol=0.01)
    moving = transfer.correlation(10.0, 3.0, [0.0, 0.1, 1.0, 10.0], drifting, motion_per_s=2.0)
    assert moving[0] == pytest.approx(1.0)
    assert moving[1] > 0.9
    assert abs(moving[2]) < 0.5
    assert abs(moving[3]) < 0.02
    spatial = transfer.correlation(10.0, 3.0, [0.0, 100.0], None, motion_per_s=1.0)
    np.testing.assert_allclose(spatial, [1.0, 0.0], atol=0.02)


def test_filters_leak_less_than_a_pixel_per_signal() -> None:
    remaining = {}
    for kind in ("sum", "surround", "matched"):
        weights = filter_weights(kind, 1, 0.35, 1.0)
        variance = SpatialTransfer.of(weights, PointSpread(math.inf, 0.35)).variance(10.0, 3.0)
        remaining[kind] = math.sqrt(float(variance)) / signal_gain(weights, 0.35, 1)
    assert remaining["surround"] < 0.4 * remaining["sum"]
    assert remaining["matched"] < 0.4 * remaining["sum"]
