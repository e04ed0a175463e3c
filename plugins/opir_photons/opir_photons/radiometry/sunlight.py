"""Sunlight in a band, and what diffuse spheres reflect of it."""

import math

import numpy as np
from numpy.typing import ArrayLike

from opir_core.arrays import FloatArray
from opir_core.geometry import ASTRONOMICAL_UNIT_M, SUN_RADIUS_M
from opir_photons.radiometry.planck import band_radiance

#: The Sun's effective temperature, K (IAU 2015 resolution B3).
SUN_TEMPERATURE_K = 5772.0

#: The solid angle of the Sun's disc at one astronomical unit, sr.
SUN_SOLID_ANGLE_SR = float(np.pi * (SUN_RADIUS_M / ASTRONOMICAL_UNIT_M) ** 2)

#: What π exceeds the nearest double by.
_PI_REST = 1.2246467991473532e-16

#: Nearer to π than this the phase function is a series; its coefficients, 2k (-1)^(k+1) / (2k+1)!
#: of β^(2k+1).
_SMALL_REST_RAD = 0.5
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
    phase = np.asarray(phase_rad, dtype=np.float64)
    rest = (np.pi - phase) + _PI_REST
    # Near π, sin β - β cos β of the rest β cancels: there its series is used.
    small = np.minimum(rest, _SMALL_REST_RAD)
    series = np.zeros_like(small)
    for coefficient in reversed(_SERIES):
        series = series * small * small + coefficient
    direct = np.sin(phase) + (np.pi - phase) * np.cos(phase)
    return np.where(rest < _SMALL_REST_RAD, small * small * small * series, direct) / np.pi


def lambert_sphere_intensity(
    irradiance_w_m2: ArrayLike, reflecting_area_m2: ArrayLike, phase_rad: ArrayLike
) -> FloatArray:
    """Return radiant intensities of diffuse spheres in parallel light, 2/(3π) E a A Φ(α), W/sr;
    arguments broadcast.

    E is the irradiance of the light, W/m², a A albedo times cross-section, m², and Φ
    `lambert_phase`: over all directions the sphere reflects E a A. Source: as `lambert_phase`.
    """
    size = np.asarray(irradiance_w_m2, dtype=np.float64) * np.asarray(
        reflecting_area_m2, dtype=np.float64
    )
    return 2.0 / (3.0 * np.pi) * size * lambert_phase(phase_rad)
