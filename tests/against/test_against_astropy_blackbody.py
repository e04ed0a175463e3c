"""Spectral and total radiance against astropy's BlackBody and the law of Stefan and Boltzmann."""

import astropy.units as u
import numpy as np
import pytest
from astropy.constants import sigma_sb
from astropy.modeling.physical_models import BlackBody
from opir_photons.radiometry.planck import band_radiance, planck_radiance

WAVELENGTHS_UM = np.linspace(1.0, 30.0, 300)


@pytest.mark.parametrize("temperature_k", [150.0, 300.0, 1500.0, 6000.0])
def test_spectral_radiance(temperature_k):
    body = BlackBody(temperature_k * u.K, scale=1.0 * u.W / (u.m**2 * u.sr * u.um))
    reference = body(WAVELENGTHS_UM * u.um)
    np.testing.assert_allclose(
        planck_radiance(temperature_k, WAVELENGTHS_UM), reference.value, rtol=1e-12
    )


@pytest.mark.parametrize("temperature_k", [100.0, 300.0, 6000.0])
def test_all_wavelengths_together_are_stefan_boltzmann(temperature_k):
    total = sigma_sb.si.value * temperature_k**4 / np.pi
    # From 1e-3 µm to 1e9 µm all but 1e-20 is within.
    np.testing.assert_allclose(band_radiance(temperature_k, 1e-3, 1e9), total, rtol=3e-10)
    parts = [1e-3, 0.5, 1.0, 3.0, 10.0, 50.0, 1e3, 1e9]
    assert sum(band_radiance(temperature_k, parts[:-1], parts[1:])) == pytest.approx(
        total, rel=1e-10
    )
