"""Irradiance at an aperture, and the least intensity that a sensor detects."""

import numpy as np
from numpy.typing import ArrayLike

from opir_core.arrays import FloatArray
from opir_photons.columns import floats


def irradiance_at_aperture(
    intensity_w_sr: ArrayLike, range_m: ArrayLike, transmittance: ArrayLike = 1.0
) -> FloatArray:
    """Return irradiances E = I τ / R², W/m², of sources smaller than a pixel.

    In-band radiant intensity I, W/sr, range R, m, and transmittance τ of the path, in [0, 1],
    broadcast; the result has their common shape.
    """
    distance = floats(range_m)
    return np.asarray(intensity_w_sr) * np.asarray(transmittance) / distance / distance


def irradiance_of_projected_area(
    radiance_w_m2_sr: ArrayLike, projected_area_m2: ArrayLike, range_m: ArrayLike
) -> FloatArray:
    """Return irradiances E = L A / R², W/m², of sources of radiance L, W m⁻² sr⁻¹, and area A
    projected to the sensor.

    Area, m², and range, m, broadcast with the radiance.
    """
    return irradiance_at_aperture(
        np.asarray(radiance_w_m2_sr) * np.asarray(projected_area_m2), range_m
    )


def irradiance_of_sphere(
    radiance_w_m2_sr: ArrayLike, surface_area_m2: ArrayLike, range_m: ArrayLike
) -> FloatArray:
    """Return irradiances E = L A / (4 R²), W/m², of spheres of radiance L and surface area A, m²,
    at range R, m.

    The projected area of a sphere is a quarter of its surface. This is the form of the
    opir-simulator paper (2026), section 2.1; for a projected area use
    `irradiance_of_projected_area` (docs/explanation/paper-errata.md).
    """
    return 0.25 * irradiance_of_projected_area(radiance_w_m2_sr, surface_area_m2, range_m)


@np.errstate(divide="ignore", over="ignore")
def minimum_detectable_intensity(
    noise_equivalent_irradiance_w_m2: ArrayLike,
    range_m: ArrayLike,
    transmittance: ArrayLike = 1.0,
    snr: ArrayLike = 5.0,
) -> FloatArray:
    """Return the in-band intensities I_min = NEI R² SNR / τ, W/sr, that give a signal-to-noise
    ratio; inf where τ is 0.

    The noise-equivalent irradiance NEI is in W/m² (1 W/cm² is 1e4 W/m²), the range R in m;
    arguments broadcast. A threshold at that SNR detects such a source in half of the looks. Source:
    opir-simulator paper (2026), section 2.4.
    """
    distance = floats(range_m)
    least = floats(noise_equivalent_irradiance_w_m2) * distance * distance * np.asarray(snr)
    return np.asarray(least / floats(transmittance))
