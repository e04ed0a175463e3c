"""Electrons of a detector without light from outside: dark current, warm optics, reading and
conversion.
"""

import numpy as np
from numpy.typing import ArrayLike

from opir_core.arrays import FloatArray
from opir_photons.radiometry.planck import band_photon_radiance

#: Charge of the electron, C, and Boltzmann's constant, J/K (exact in the SI of 2019).
ELECTRON_C = 1.602176634e-19
BOLTZMANN_J_K = 1.380649e-23

#: Rule 07: W. E. Tennant et al., J. Electron. Mater. 37 (2008) 1406; "Rule 07 revisited", 39 (2010)
#: 1030. Current density, A/cm², the factor of the exponent, and the wavelengths, um, and the power
#: of the correction for short cut-offs, as `rule07_dark_current` of the open program lentil and
#: others quote them from the paper of 2008, which was not at hand. One has -1.162972237 for the
#: factor: 1 % less current at 10 um and 77 K.
_DENSITY_A_CM2 = 8367.00001853855
_FACTOR = -1.16239134096245
_SCALE_UM = 0.200847413564122
_THRESHOLD_UM = 4.63513642316149
_POWER = 0.544071281108481
#: Photon energy times wavelength, eV um, as in Rule 07.
_EV_UM = 1.24

#: m² to cm².
_CM2 = 1e4


def dark_current_density_a_cm2(cutoff_um: ArrayLike, temperature_k: ArrayLike) -> FloatArray:
    """Return dark current densities, A/cm², of good HgCdTe photodiodes by Rule 07.

    Cut-off wavelengths, µm, and detector temperatures, K, broadcast. Fitted to data with λ T from
    400 to 1700 µm K; the dark current of a real array is rarely below it.
    """
    cutoff = np.asarray(cutoff_um, dtype=np.float64)
    temperature = np.asarray(temperature_k, dtype=np.float64)
    short = np.maximum(_SCALE_UM / cutoff - _SCALE_UM / _THRESHOLD_UM, 0.0)
    effective_um = cutoff / (1.0 - short**_POWER)
    with np.errstate(divide="ignore", over="ignore", under="ignore"):
        exponent = _FACTOR * _EV_UM * ELECTRON_C / (BOLTZMANN_J_K * effective_um * temperature)
        return np.asarray(_DENSITY_A_CM2 * np.exp(exponent))


def dark_electrons_per_s(
    cutoff_um: ArrayLike, temperature_k: ArrayLike, pitch_m: ArrayLike, fill_factor: ArrayLike = 1.0
) -> FloatArray:
    """Return the electrons per s of the dark current of square pixels: density times pitch² times
    fill factor.
    """
    area_cm2 = (
        np.square(np.asarray(pitch_m, dtype=np.float64))
        * _CM2
        * np.asarray(fill_factor, dtype=np.float64)
    )
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

    They fill the cone of the f-number f, of projected solid angle π / (4 f² + 1); all else that the
    pixel sees is cold.
    """
    speed = np.asarray(f_number, dtype=np.float64)
    pitch = np.asarray(pitch_m, dtype=np.float64)
    cone = np.pi / (4.0 * speed * speed + 1.0)
    radiance = band_photon_radiance(temperature_k, lower_um, upper_um)
    return np.asarray(np.asarray(emissivity, dtype=np.float64) * radiance * cone * pitch * pitch)


def conversion_noise_electrons(well_e: ArrayLike, bits: ArrayLike) -> FloatArray:
    """Return the standard deviations of converting counts over a well to a number of bits: one step
    over √12.
    """
    return np.asarray(
        np.asarray(well_e, dtype=np.float64)
        * 0.5 ** np.asarray(bits, dtype=np.float64)
        / np.sqrt(12.0)
    )
