"""What arrives at an aperture: irradiance of intensities, the least intensity detected, clutter as an intensity."""

import numpy as np
from numpy.typing import ArrayLike, NDArray

_Floats = NDArray[np.float64]

#: W/cm² to W/m².
W_M2_PER_W_CM2 = 1e4


def irradiance_w_m2(intensity_w_sr: ArrayLike, range_m: ArrayLike, transmittance: ArrayLike = 1.0) -> _Floats:
    """Return irradiances at an aperture, W/m², of sources smaller than a pixel: E = I τ / R². Arguments broadcast."""
    distance = np.asarray(range_m, dtype=np.float64)
    received: _Floats = np.asarray(intensity_w_sr) * np.asarray(transmittance) / distance / distance
    return received


def irradiance_of_projected_area(
    radiance_w_m2_sr: ArrayLike, projected_area_m2: ArrayLike, range_m: ArrayLike
) -> _Floats:
    """Return irradiances, W/m², of sources of a radiance by their area as it is seen from the sensor: E = L A / R²."""
    return irradiance_w_m2(np.asarray(radiance_w_m2_sr) * np.asarray(projected_area_m2), range_m)


def irradiance_of_sphere(radiance_w_m2_sr: ArrayLike, surface_area_m2: ArrayLike, range_m: ArrayLike) -> _Floats:
    """Return irradiances, W/m², of spheres by the area of their surface: E = L A / (4 R²).

    A sphere shows a quarter of its surface. It is the form in the opir-simulator paper (2026), section 2.1, whose area
    is thus a surface; for a projected area the quarter does not belong there (docs/explanation/paper-errata.md).
    """
    return 0.25 * irradiance_of_projected_area(radiance_w_m2_sr, surface_area_m2, range_m)


@np.errstate(divide="ignore", over="ignore")
def minimum_detectable_intensity_w_sr(
    noise_equivalent_irradiance_w_m2: ArrayLike,
    range_m: ArrayLike,
    transmittance: ArrayLike = 1.0,
    snr: ArrayLike = 5.0,
) -> _Floats:
    """Return the in-band intensities, W/sr, whose signal is `snr` times the noise: NEI R² SNR / τ; inf where τ is 0.

    The noise-equivalent irradiance is in W/m² (1 W/cm² is 1e4 W/m²). A threshold at that SNR detects such a source in
    half of the looks, not in all. Source: opir-simulator paper (2026), section 2.4.
    """
    distance = np.asarray(range_m, dtype=np.float64)
    least = np.asarray(noise_equivalent_irradiance_w_m2, dtype=np.float64) * distance * distance * np.asarray(snr)
    return np.asarray(least / np.asarray(transmittance, dtype=np.float64))


def clutter_intensity_w_sr(clutter_w_m2_sr: ArrayLike, pixel_solid_angle_sr: ArrayLike, range_m: ArrayLike) -> _Floats:
    """Return the intensities, W/sr, that clutter of a radiance amounts to over a pixel's footprint at a range.

    The footprint across the line of sight is solid angle times range squared.
    """
    distance = np.asarray(range_m, dtype=np.float64)
    amounts: _Floats = np.asarray(clutter_w_m2_sr) * np.asarray(pixel_solid_angle_sr) * distance * distance
    return amounts
