"""Sunlight in a band, and the intensity of diffuse spheres in it."""

import math

import numpy as np
from numpy.typing import ArrayLike

from opir_core.arrays import FloatArray
from opir_core.geometry import ASTRONOMICAL_UNIT_M, SUN_RADIUS_M
from opir_photons.columns import floats
from opir_photons.radiometry.planck import band_radiance

#: The Sun's effective temperature, K (IAU 2015 resolution B3).
SUN_TEMPERATURE_K = 5772.0

#: The solid angle of the Sun's disc at one astronomical unit, sr.
SUN_SOLID_ANGLE_SR = float(np.pi * (SUN_RADIUS_M / ASTRONOMICAL_UNIT_M) ** 2)

#: Coefficients of the phase function near π, 2k (-1)^(k+1) / (2k+1)! of β^(2k+1) with β = π - α.
_SERIES = tuple((-1.0) ** (k + 1) * 2.0 * k / math.factorial(2 * k + 1) for k in range(1, 9))


def solar_irradiance(
    lower_um: ArrayLike, upper_um: ArrayLike, temperature_k: ArrayLike = SUN_TEMPERATURE_K
) -> FloatArray:
    """Return the Sun's in-band irradiances at one astronomical unit above the air, W/m², on a plane
    that faces it.

    The Sun is a disc of a black body, by default of 5772 K: 1361 W/m² over all wavelengths (IAU
    2015 resolution B3). Arguments broadcast. Spectral lines, and the lower brightness temperature
    of the Sun in long waves, are left out.
    """
    return band_radiance(temperature_k, lower_um, upper_um) * SUN_SOLID_ANGLE_SR


def lambert_phase(phase_rad: ArrayLike) -> FloatArray:
    """Return the phase function of a diffuse sphere, (sin α + (π - α) cos α) / π: 1 at 0, 1/π at
    π/2, 0 at π.

    The phase angle α is that at the sphere between the directions to the light and to the sensor,
    rad, in [0, π]. Source: H. N. Russell, Astrophysical Journal 43 (1916), 173-196.
    """
    phase = floats(phase_rad)
    # The nearest double to π is 1.2e-16 below π.
    supplement = (np.pi - phase) + 1.2246467991473532e-16
    # Near π, sin β - β cos β of the supplement β cancels: there its series is used.
    small = np.minimum(supplement, 0.5)
    series = np.zeros_like(small)
    for coefficient in reversed(_SERIES):
        series = series * small * small + coefficient
    direct = np.sin(phase) + (np.pi - phase) * np.cos(phase)
    return np.where(supplement < 0.5, small * small * small * series, direct) / np.pi


def lambert_sphere_intensity(
    irradiance_w_m2: ArrayLike, reflecting_area_m2: ArrayLike, phase_rad: ArrayLike
) -> FloatArray:
    """Return radiant intensities of diffuse spheres in parallel light, 2/(3π) E a A Φ(α), W/sr;
    arguments broadcast.

    E is the irradiance of the light, W/m², a A albedo times cross-section, m², and Φ
    `lambert_phase`: over all directions the sphere reflects E a A. Source: as `lambert_phase`.
    """
    size = floats(irradiance_w_m2) * floats(reflecting_area_m2)
    return 2.0 / (3.0 * np.pi) * size * lambert_phase(phase_rad)
