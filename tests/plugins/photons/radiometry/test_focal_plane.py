"""Spots, pixels, electrons and centroids against integrals, photons thrown one by one, and sums
over pixels.
"""

import math

import numpy as np
import pytest
from opir_photons.radiometry import (
    airy_sigma_rad,
    blurred_sigma_rad,
    centroid_factor_rad,
    centroid_sigma_rad,
    electrons_per_w_m2,
    ensquared_energy,
    filter_weights,
    joined_centroid_variance,
    mean_shares,
    noise_electrons,
    noise_equivalent_irradiance,
    noise_gain,
    photon_centroid_variance,
    signal_gain,
)
from opir_photons.radiometry.pixel_filters import corner_shares
from scipy.integrate import quad
from scipy.special import j1, ndtr


def airy(angle_rad: float, wavelength_m: float, aperture_m: float) -> float:
    """The Airy pattern, power per solid angle, normalised to unit power (Goodman, equation
    4-31).
    """
    peak = 0.25 * math.pi * (aperture_m / wavelength_m) ** 2
    x = math.pi * aperture_m * angle_rad / wavelength_m
    return peak if x == 0.0 else peak * (2.0 * j1(x) / x) ** 2


def test_the_gaussian_matches_the_airy_pattern() -> None:
    sigma = float(airy_sigma_rad(4.0, 0.5))
    assert 1.0 / (2.0 * math.pi * sigma**2) == pytest.approx(airy(0.0, 4e-6, 0.5), rel=1e-12)
    step = 0.01 * sigma
    curvature = (airy(step, 4e-6, 0.5) / airy(0.0, 4e-6, 0.5) - 1.0) / step**2
    assert curvature == pytest.approx(-0.5 / sigma**2, rel=1e-4)
    power = quad(lambda r: 2.0 * math.pi * r * airy(r, 4e-6, 0.5), 0.0, 400 * sigma, limit=4000)[0]
    assert power == pytest.approx(1.0, abs=0.01)


@pytest.mark.parametrize("phase", ["mean", "best", "worst"])
@pytest.mark.parametrize("pixels", [1, 2, 3])
@pytest.mark.parametrize("width", [0.1, 0.35, 1.2])
def test_ensquared_energy_is_the_integral_over_the_square(
    phase: str, pixels: int, width: float
) -> None:
    pixel = 28e-6

    def along(off: float) -> float:
        return float(ndtr((0.5 * pixels - off) / width) - ndtr((-0.5 * pixels - off) / width))

    expected = {
        "best": along(0.0),
        "worst": along(0.5),
        "mean": quad(along, -0.5, 0.5, epsabs=1e-13, limit=400)[0],
    }
    result = ensquared_energy(width * pixel, pixel, pixels, phase)
    assert float(result) == pytest.approx(expected[phase] ** 2, rel=1e-9)


def test_a_point_on_a_corner_shares_its_light_among_four_pixels() -> None:
    assert [float(ensquared_energy(0.0, 1.0, 1, phase)) for phase in ("best", "mean", "worst")] == [
        1.0,
        1.0,
        0.25,
    ]
    assert float(ensquared_energy(0.0, 1.0, 2, "worst")) == 1.0
    with pytest.raises(ValueError, match="'middle' is not one of mean, best, worst"):
        ensquared_energy(0.3, 1.0, 1, "middle")


@pytest.mark.parametrize("pixels", [1, 2, 3])
def test_mean_shares_match_drawn_photons(pixels: int) -> None:
    """400 000 photons; 4.5 standard deviations for each of the pixels."""
    rng = np.random.default_rng(7)
    sigma = 0.4
    thrown = 400_000
    spot = rng.uniform(-0.5, 0.5, (thrown, 2)) + sigma * rng.normal(size=(thrown, 2))
    place = np.floor(spot + 0.5 * pixels).astype(int)
    inside = np.all((place >= 0) & (place < pixels), axis=1)
    result = (
        np.bincount(place[inside] @ [pixels, 1], minlength=pixels**2).reshape(pixels, pixels)
        / thrown
    )
    expected = mean_shares(pixels, sigma, 1.0)
    assert np.all(np.abs(result - expected) < 4.5 * np.sqrt(expected * (1.0 - expected) / thrown))
    assert expected.sum() == pytest.approx(float(ensquared_energy(sigma, 1.0, pixels)), rel=1e-12)
    assert corner_shares(pixels, sigma, 1.0).sum() == pytest.approx(
        float(ensquared_energy(sigma, 1.0, pixels, "worst")), rel=1e-12
    )


def test_filters_pass_their_core_and_no_uniform_background() -> None:
    for kind in ("surround", "matched"):
        for pixels in (1, 2, 3):
            weights = filter_weights(kind, pixels, 0.35, 1.0)
            assert weights.shape == (pixels + 4, pixels + 4)
            assert weights.sum() == pytest.approx(0.0, abs=1e-12)
            np.testing.assert_allclose(weights, weights[::-1, ::-1], atol=1e-15)
    core = filter_weights("surround", 2, 0.35, 1.0)
    assert core[2:4, 2:4].tolist() == [[1.0, 1.0], [1.0, 1.0]]
    assert np.count_nonzero(core < 0.0) == 20
    assert signal_gain(filter_weights("sum", 3, 0.5, 1.0), 0.5, 1.0) == pytest.approx(
        float(ensquared_energy(0.5, 1, 3))
    )
    with pytest.raises(ValueError, match="'median' is not one of sum, surround, matched"):
        filter_weights("median", 1, 0.3, 1.0)


def test_the_matched_filter_is_the_best() -> None:
    rng = np.random.default_rng(3)
    sigma = 0.45
    matched = filter_weights("matched", 1, sigma, 1.0)
    best = signal_gain(matched, sigma, 1.0) / math.sqrt(noise_gain(matched))
    for _ in range(200):
        other = matched + 0.05 * rng.normal(size=matched.shape)
        other -= other.mean()
        assert signal_gain(other, sigma, 1.0) / math.sqrt(noise_gain(other)) <= best


def test_electrons_noise_and_nei_of_a_sensor_worked_out_by_hand() -> None:
    """0.5 m, τ 0.7, η 0.6, 10 ms at 2.75 µm: 8.247e-4 m² s, photons of 7.223e-20 J."""
    per_unit = float(electrons_per_w_m2(2.75, 0.5, 0.7, 0.6, 0.01))
    assert per_unit == pytest.approx(math.pi / 4 * 0.25 * 0.42 * 0.01 / 7.22342e-20, rel=1e-5)
    noise = float(noise_electrons(background_e=9e4, dark_e=1e4, read_e=300.0))
    assert noise == pytest.approx(math.sqrt(9e4 + 1e4 + 9e4))
    share = float(ensquared_energy(0.35, 1.0))
    nei = float(noise_equivalent_irradiance(noise, per_unit, share))
    assert nei * per_unit * share == pytest.approx(noise)
    assert float(noise_equivalent_irradiance(noise, per_unit, share, 2.0)) == pytest.approx(
        nei * math.sqrt(2.0)
    )


def test_sampling_and_blur() -> None:
    rng = np.random.default_rng(5)
    turn = rng.uniform(0, 2 * np.pi, 10**6)
    along = rng.uniform(-0.5, 0.5, 10**6)
    spot = 3.0 * rng.normal(size=10**6) + 4.0 * rng.normal(size=10**6) + 20.0 * along * np.cos(turn)
    assert float(blurred_sigma_rad(3.0, 4.0, 20.0)) == pytest.approx(spot.std(), rel=3e-3)


def lattice_sigma(snr: float, width: float, signal: float, phases: int) -> float:
    """The bound by a plain sum of derivatives taken by differences, at phases over the whole
    pixel.
    """
    reach = math.ceil(6 * width) + 2
    step = 1e-5
    total = 0.0
    edges = np.arange(-reach, reach + 2) - 0.5

    def image(x: float, y: float) -> np.ndarray:
        rows, columns = (np.diff(ndtr((edges - at) / width)) for at in (x, y))
        return np.outer(rows, columns)

    grid = (np.arange(phases) + 0.5) / phases - 0.5
    for x in grid:
        for y in grid:
            slope = (image(x + step, y) - image(x - step, y)) / (2 * step)
            total += 1.0 / (slope**2 / (snr**-2.0 + image(x, y) / signal)).sum()
    return math.sqrt(total / phases**2)


@pytest.mark.parametrize("width", [0.3, 0.5, 1.0, 1.8])
@pytest.mark.parametrize(("snr", "signal"), [(20.0, math.inf), (20.0, 400.0), (1e6, 400.0)])
def test_the_centroid_bound_is_that_of_a_sum_over_pixels(
    width: float, snr: float, signal: float
) -> None:
    expected = lattice_sigma(snr, width, signal, 16)
    result = float(centroid_sigma_rad(snr, 28e-6 * width, 28e-6, signal))
    assert result == pytest.approx(28e-6 * expected, rel=1e-3)
    white = float(centroid_factor_rad(width, 1.0)) / snr
    photons = float(photon_centroid_variance(width, 1.0)) / signal
    assert math.sqrt(float(joined_centroid_variance(white**2, photons))) == pytest.approx(
        expected, rel=0.05
    )


def test_wide_spots_have_the_bounds_of_finely_sampled_ones() -> None:
    for width in (3.0, 6.0, 40.0):
        factor = math.sqrt(8 * math.pi) * width**2
        assert float(centroid_factor_rad(width, 1.0)) == pytest.approx(factor, rel=0.02)
        assert float(centroid_sigma_rad(50.0, width, 1.0)) == pytest.approx(factor / 50.0, rel=0.02)
        assert float(centroid_sigma_rad(1e9, width, 1.0, 900.0)) == pytest.approx(
            width / 30.0, rel=0.01
        )


def test_arrays_broadcast() -> None:
    assert centroid_sigma_rad(np.array([[10.0], [20.0]]), np.array([0.4, 0.5, 0.6]), 1.0).shape == (
        2,
        3,
    )
    assert ensquared_energy(np.array([0.3, 0.4]), 1.0, np.array([[1], [2]])).shape == (2, 2)
