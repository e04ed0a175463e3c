"""Calibration: the one factor on a sensor's noise with which it detects the reference target as often as wanted."""

from collections.abc import Callable

import numpy as np
from attrs import evolve

from opir_core.arrays import FloatArray
from opir_core.detection.any_band import AnyBand
from opir_core.detection.irradiance_noise import noise_w_m2
from opir_core.detection.ratio_gates import RatioGates
from opir_core.detection.threshold import probit
from opir_core.errors import ModelError
from opir_core.plugin.radiometer import Radiometer

#: The reference range, m: opir-simulator paper (2026), section 2.4.
REFERENCE_RANGE_M = 3.6e7

#: The factor is sought within so many powers of ten of 1.
_DECADES = 20.0
_HALVINGS = 64
#: Chances nearer to 0 or 1 than this are far from any that is wanted.
_SLACK = 1e-13


def calibrated(
    radiometer: Radiometer, rule: AnyBand | RatioGates, intensity_w_sr: FloatArray, wanted: float, owner: str
) -> Radiometer:
    """Return a radiometer whose noise is scaled so that the reference target is detected with a probability.

    `intensity_w_sr` (B,) are the reference target's in the sensor's bands. Raises `ModelError`, which names the sensor
    as `owner` does, where no factor does it.
    """
    from scipy.special import ndtri

    signal = intensity_w_sr / REFERENCE_RANGE_M**2
    quantile = float(ndtri(wanted))

    def misses(log_factor: float) -> bool:
        noise = noise_w_m2(np.array(radiometer.nei_w_m2) * 10.0**log_factor)[None, :]
        return float(probit(*rule.log_chances(signal[None, :] / noise, noise, _SLACK))[0]) < quantile

    if not misses(_DECADES) or misses(-_DECADES):
        told = ", ".join(f"{one:.3g}" for one in intensity_w_sr)
        raise ModelError(
            f"{owner}: calibrate: paper finds no noise with which the reference ICBM, {told} W/sr in the sensor's"
            f" bands, is detected with probability {wanted:g}; give it bands and plausible_ratios that do not leave"
            " the ICBM out, or calibrate: none"
        )
    factor = 10.0 ** _turn(misses)
    return evolve(radiometer, nei_w_m2=tuple(float(nei * factor) for nei in radiometer.nei_w_m2))


def _turn(misses: Callable[[float], bool]) -> float:
    """Return where a condition turns from false to true, by halving."""
    low, high = -_DECADES, _DECADES
    for _ in range(_HALVINGS):
        middle = 0.5 * (low + high)
        low, high = (low, middle) if misses(middle) else (middle, high)
    return low
