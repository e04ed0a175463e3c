"""Noise at the aperture: the detector's, that of the background's photons, and what clutter leaves; all in W/m²."""

import numpy as np
from numpy.typing import ArrayLike

from opir_core.arrays import FloatArray
from opir_core.protocols import Band

#: Planck's constant times the speed of light, J µm (exact in the SI of 2019).
_PHOTON_J_UM = 6.62607015e-34 * 299_792_458.0 * 1e6

#: Noise below it, W/m², is taken for it: a sensor without any would divide by zero.
LEAST_NOISE_W_M2 = 1e-60


def photon_energy_j(band: Band) -> float:
    """Return the energy of a photon in the middle of a band, J."""
    return _PHOTON_J_UM / (0.5 * (band.lower_um + band.upper_um))


def photon_noise_w_m2(irradiance_w_m2: ArrayLike, count_w_m2: ArrayLike) -> FloatArray:
    """Return the standard deviation of an irradiance got by counting photons: sqrt(E · hc/λ / (A η t)), W/m².

    `count_w_m2` is that of one count, hc/λ / (A η t), of aperture, efficiency and integration time. The number of
    counts is E over it, its variance the number itself (Poisson).
    """
    noise: FloatArray = np.sqrt(
        np.asarray(irradiance_w_m2, dtype=np.float64) * np.asarray(count_w_m2, dtype=np.float64)
    )
    return noise


def noise_w_m2(detector_w_m2: ArrayLike, photons_w_m2: ArrayLike = 0.0, clutter_w_m2: ArrayLike = 0.0) -> FloatArray:
    """Return the standard deviation of independent noises together, at least `LEAST_NOISE_W_M2`.

    Noises may be as large as 1e150 W/m²; what of them is below 1e-160 is nothing beside the least.
    """
    # Squares cost a tenth of what `numpy.hypot` does, which is for numbers that have none.
    whole = np.square(np.asarray(detector_w_m2, dtype=np.float64))
    whole = whole + np.square(np.asarray(photons_w_m2, dtype=np.float64))
    whole = whole + np.square(np.asarray(clutter_w_m2, dtype=np.float64))
    return np.maximum(np.sqrt(whole), LEAST_NOISE_W_M2)
