"""Electrons of detectors without light: Rule 07, warm optics by quadrature, conversion by
drawing.
"""

import numpy as np
import pytest
from opir_photons.radiometry import (
    conversion_noise_electrons,
    dark_current_density_a_cm2,
    dark_electrons_per_s,
    warm_optics_photons_per_s,
)
from scipy.constants import c, h, k
from scipy.integrate import quad


def test_dark_current_is_log_linear_in_inverse_cutoff() -> None:
    """Rule 07 above 4.635 um: ln J against 1 / (λ T) has the slope -1.16239 · 1.24 eV um over
    Boltzmann's constant.
    """
    cutoff = np.array([5.0, 9.0, 12.0])
    temperature = np.array([80.0, 77.0, 60.0])
    inverse = 1.0 / (cutoff * temperature)
    logarithm = np.log(dark_current_density_a_cm2(cutoff, temperature))
    slope = np.diff(logarithm) / np.diff(inverse)
    np.testing.assert_allclose(slope, -1.16239134 * 1.24 / 8.617333e-5, rtol=1e-5)


@pytest.mark.parametrize(
    ("cutoff_um", "temperature_k", "density"),
    [(10.0, 77.0, 3.047e-6), (5.0, 120.0, 6.450e-9), (2.5, 200.0, 6.384e-9)],
)
def test_dark_current_is_that_of_good_arrays(
    cutoff_um: float, temperature_k: float, density: float
) -> None:
    """By the other constants in use, with -1.162972237 in the exponent; 2.5 um is in the range of
    the correction.
    """
    assert float(dark_current_density_a_cm2(cutoff_um, temperature_k)) == pytest.approx(
        density, rel=0.02
    )


def test_dark_current_rises_without_steps() -> None:
    cutoff = np.array([1.5, 2.0, 3.0, 4.0, 5.0, 7.0, 10.0, 14.0])
    logarithm = np.log(dark_current_density_a_cm2(cutoff, 100.0))
    assert (np.diff(logarithm) > 0.0).all()
    assert (np.diff(dark_current_density_a_cm2(4.0, np.linspace(60.0, 300.0, 50))) > 0.0).all()
    near = dark_current_density_a_cm2(np.array([4.63513, 4.63514]), 100.0)
    assert near[1] / near[0] == pytest.approx(1.0, abs=0.1)


def test_pixels_have_the_dark_current_of_their_area() -> None:
    result = float(dark_electrons_per_s(10.0, 77.0, 30e-6, 0.8))
    expected = float(dark_current_density_a_cm2(10.0, 77.0)) * (30e-4) ** 2 * 0.8 / 1.602176634e-19
    assert result == pytest.approx(expected, rel=1e-12)


def test_warm_optics_fill_the_cone_of_the_f_number() -> None:
    def photons(wavelength_m: float) -> float:
        return 2.0 * c / wavelength_m**4 / np.expm1(h * c / (wavelength_m * k * 260.0))

    radiance = quad(photons, 4e-6, 5e-6)[0]
    half_angle = np.arctan(1.0 / (2.0 * 2.5))
    cone = np.pi * np.sin(half_angle) ** 2
    result = float(warm_optics_photons_per_s(260.0, 4.0, 5.0, 0.3, 2.5, 30e-6))
    assert result == pytest.approx(0.3 * radiance * cone * (30e-6) ** 2, rel=1e-9)


def test_conversion_adds_the_noise_of_rounding() -> None:
    counts = np.random.default_rng(1).uniform(0.0, 4096.0, 200_000)
    step = 4096.0 / 2**6
    off = counts - np.floor(counts / step) * step - 0.5 * step
    assert float(conversion_noise_electrons(4096.0, 6)) == pytest.approx(off.std(), rel=0.01)
