"""Electrons of a detector without light from outside: dark current, warm optics, reading and
conversion.
"""

import numpy as np
from numpy.typing import ArrayLike

from opir_core.arrays import FloatArray
from opir_photons.columns import floats
from opir_photons.laws import law
from opir_photons.radiometry.planck import BOLTZMANN_J_K, band_photon_radiance

#: Charge of the electron, C (exact in the SI of 2019).
ELECTRON_C = 1.602176634e-19


def dark_current_density_a_cm2(cutoff_um: ArrayLike, temperature_k: ArrayLike) -> FloatArray:
    """Return dark current densities, A/cm², of good HgCdTe photodiodes by Rule 07.

    Cut-off wavelengths, µm, and detector temperatures, K, broadcast. Fitted to data with λ T from
    400 to 1700 µm K; the dark current of a real array is rarely below it. Source:
    `opir_photons/data/dark_current.json`.
    """
    rule = law("dark_current")
    cutoff = floats(cutoff_um)
    scale_um = rule["scale_um"]
    short = np.maximum(scale_um / cutoff - scale_um / rule["threshold_um"], 0.0)
    effective_um = cutoff / (1.0 - short ** rule["power"])
    with np.errstate(all="ignore"):
        energy_j = rule["exponent_factor"] * rule["photon_ev_um"] * ELECTRON_C
        exponent = energy_j / (BOLTZMANN_J_K * effective_um * floats(temperature_k))
        return np.asarray(rule["density_a_cm2"] * np.exp(exponent))


def dark_electrons_per_s(
    cutoff_um: ArrayLike, temperature_k: ArrayLike, pitch_m: ArrayLike, fill_factor: ArrayLike = 1.0
) -> FloatArray:
    """Return the electrons per s of the dark current of square pixels: density times pitch² times
    fill factor.
    """
    area_cm2 = np.square(floats(pitch_m)) * 1e4 * floats(fill_factor)
    return np.asarray(dark_current_density_a_cm2(cutoff_um, temperature_k) * area_cm2 / ELECTRON_C)


def warm_optics_photons_per_s(
    temperature_k: ArrayLike,
    lower_um: ArrayLike,
    upper_um: ArrayLike,
    emissivity: ArrayLike,
    f_number: ArrayLike,
    pitch_m: ArrayLike,
) -> FloatArray:
    """Return the in-band photons per s from optics of a temperature and emissivity on pixels of a
    pitch.

    They fill the cone of the f-number f, of projected solid angle π / (4 f² + 1); all else in the
    pixel's view is cold.
    """
    speed = floats(f_number)
    pitch = floats(pitch_m)
    cone = np.pi / (4.0 * speed * speed + 1.0)
    radiance = band_photon_radiance(temperature_k, lower_um, upper_um)
    return np.asarray(floats(emissivity) * radiance * cone * pitch * pitch)


def conversion_noise_electrons(well_e: ArrayLike, bits: ArrayLike) -> FloatArray:
    """Return the standard deviations of converting counts over a well to a number of bits: one step
    over √12.
    """
    return np.asarray(floats(well_e) * 0.5 ** floats(bits) / np.sqrt(12.0))
