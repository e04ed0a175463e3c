"""Radiometry's own properties: extremes, narrow and swapped bands, irradiance, and temperatures
from two bands.
"""

import numpy as np
import pytest
from hypothesis import given, strategies as st
from opir_photons.radiometry import (
    band_photon_radiance,
    band_radiance,
    band_radiance_slope,
    grey_body_intensity,
    irradiance_at_aperture,
    irradiance_of_projected_area,
    irradiance_of_sphere,
    minimum_detectable_intensity,
    planck_radiance,
    two_colour_temperature,
)

from opir_core.cli.main import main
from opir_core.plugin import Band

SWIR = Band("SWIR", 2.5, 3.0)
MWIR = Band("MWIR", 4.0, 5.0)
TEMPERATURES = st.floats(0.0, 1e9)
EDGES = st.floats(0.05, 1e4)


@given(TEMPERATURES, EDGES, EDGES)
def test_radiance_is_finite_and_turns_with_its_edges(temperature, one, other):
    for radiance in (band_radiance, band_photon_radiance):
        lower = min(one, other)
        upper = max(one, other)
        value = float(radiance(temperature, lower, upper))
        assert np.isfinite(value)
        assert value >= 0.0
        assert float(radiance(temperature, upper, lower)) == -value


@given(st.floats(20.0, 1e5), st.floats(1.0, 30.0), st.floats(1e-3, 10.0), st.floats(1e-6, 1.0))
def test_radiance_rises_with_temperature_and_adds_up_over_bands(temperature, lower, width, share):
    upper = lower + width
    middle = lower + share * width
    total = float(band_radiance(temperature, lower, upper))
    assert float(band_radiance(temperature * 1.001, lower, upper)) > total
    parts = band_radiance(temperature, [lower, middle], [middle, upper])
    assert parts.sum() == pytest.approx(total, rel=1e-11)


def test_narrow_bands_follow_the_spectrum():
    assert band_radiance(1500.0, 4.3, 4.3) == 0.0
    width = 2.0**-40
    assert band_radiance(1500.0, 4.0, 4.0 + width) / width == pytest.approx(
        planck_radiance(1500.0, 4.0), rel=1e-11
    )


def test_cold_and_senseless_arguments():
    assert band_radiance(0.0, 3.0, 5.0) == 0.0
    assert planck_radiance(0.0, 4.0) == 0.0
    assert np.isnan(band_radiance([-1.0, np.nan, 300.0], [3.0, 3.0, -1.0], 5.0)).all()
    assert np.isnan(planck_radiance(-1.0, 4.0))


def test_the_slope_is_the_derivative():
    step = 1e-3
    rise = band_radiance(1000.0 + step, 3.0, 5.0) - band_radiance(1000.0 - step, 3.0, 5.0)
    assert band_radiance_slope(1000.0, 3.0, 5.0) == pytest.approx(rise / (2.0 * step), rel=1e-8)


def test_a_sphere_shows_a_quarter_of_its_surface():
    radius = 5.0
    radiance = 1e4
    distance = 3.6e7
    by_surface = irradiance_of_sphere(radiance, 4.0 * np.pi * radius**2, distance)
    assert by_surface == pytest.approx(
        irradiance_of_projected_area(radiance, np.pi * radius**2, distance), rel=1e-15
    )
    intensity = grey_body_intensity(1500.0, np.pi * radius**2, 0.3, 2.5, 3.0)
    assert intensity == pytest.approx(
        0.3 * np.pi * radius**2 * band_radiance(1500.0, 2.5, 3.0), rel=1e-15
    )


@given(st.floats(1e-20, 1e-3), st.floats(1e3, 1e9), st.floats(1e-6, 1.0), st.floats(0.1, 100.0))
def test_the_least_intensity_has_the_asked_signal_to_noise(nei, distance, transmittance, snr):
    least = minimum_detectable_intensity(nei, distance, transmittance, snr)
    assert irradiance_at_aperture(least, distance, transmittance) / nei == pytest.approx(
        snr, rel=1e-12
    )


def test_nothing_is_detected_through_an_opaque_sky():
    assert minimum_detectable_intensity(1e-12, 3.6e7, 0.0) == np.inf


def test_two_colours_give_the_temperature_back():
    temperature = np.geomspace(60.0, 19_000.0, 200)
    bands = [(SWIR.lower_um, SWIR.upper_um), (MWIR.lower_um, MWIR.upper_um)]
    first, second = (grey_body_intensity(temperature, 7.0, 0.2, *edges) for edges in bands)
    result = two_colour_temperature(first, second, 0.0, 0.0, SWIR, MWIR)
    np.testing.assert_allclose(result.temperature_k, temperature, rtol=1e-11)
    assert (result.variance_k2 == 0.0).all()
    assert (np.diff(first / second) > 0.0).all()


@pytest.mark.slow
def test_the_variance_of_a_temperature_is_what_noise_makes_of_it():
    truth = 1600.0
    noise = 0.01
    draws = 5_000
    rng = np.random.default_rng(7)
    first, second = (
        float(band_radiance(truth, band.lower_um, band.upper_um)) for band in (SWIR, MWIR)
    )
    noisy = rng.normal(1.0, noise, (2, draws))
    result = two_colour_temperature(
        first * noisy[0], second * noisy[1], (noise * first) ** 2, (noise * second) ** 2, SWIR, MWIR
    )
    predicted = two_colour_temperature(
        first, second, (noise * first) ** 2, (noise * second) ** 2, SWIR, MWIR
    )
    # The sample variance of 5 000 draws is within 6.6 % of the truth with 99.9 %.
    assert result.temperature_k.var() == pytest.approx(float(predicted.variance_k2), rel=0.066)


def test_ratios_of_no_temperature_have_none():
    result = two_colour_temperature([1.0, 1e-30, 1e9, -1.0, 0.0], 1.0, 0.1, 0.1, SWIR, MWIR)
    assert np.isfinite(result.temperature_k[0])
    assert np.isnan(result.temperature_k[1:]).all()


def test_bands_in_the_wrong_order_are_refused():
    with pytest.raises(ValueError, match="MWIR does not lie at shorter wavelengths than SWIR"):
        two_colour_temperature(1.0, 1.0, 0.1, 0.1, MWIR, SWIR)


def test_the_command_says_which_unit_gives_which(capsys):
    assert main(["physics", "min-intensity"]) == 0
    assert capsys.readouterr().out == (
        "NEI 5e-14 W/m2: 324 W/sr\nNEI 5e-14 W/cm2 = 5e-10 W/m2: 3.24e+06 W/sr\n"
    )
    with pytest.raises(SystemExit):
        main(["physics", "min-intensity", "--transmittance", "1.5"])
