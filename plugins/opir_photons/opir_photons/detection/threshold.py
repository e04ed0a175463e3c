"""A known signal in Gaussian noise of unit standard deviation against a threshold T: P_fa = Q(T),
P_d = Q(T - SNR).

Source: S. M. Kay, Fundamentals of Statistical Signal Processing II: Detection Theory (1998),
section 4.3. Tails are computed by logarithms: no probability, however near 0 or 1, is obtained by
subtraction. The normal distribution and its inverse are SciPy's. Arguments of all functions
broadcast.
"""

from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from opir_core.arrays import FloatArray
from opir_photons.columns import floats


def _special() -> Any:
    """Return `scipy.special`, imported when it is first used: sensors without a false-alarm
    probability need none.
    """
    from scipy import special

    return special


def threshold_sigma(false_alarm_probability: ArrayLike) -> FloatArray:
    """Return the thresholds T = Q⁻¹(P_fa), in standard deviations of the noise, for false-alarm
    probabilities.

    `false_alarm_probability` is per look and resolution cell, in (0, 1), down to the least double;
    `nan` outside. The result has its shape.
    """
    return -_special().ndtri(floats(false_alarm_probability))


def false_alarm_probability(threshold: ArrayLike) -> FloatArray:
    """Return the false-alarm probabilities P_fa = Q(T) of thresholds T, in standard deviations of
    the noise.
    """
    return probability_of_detection(0.0, threshold)


def probability_of_detection(snr: ArrayLike, threshold: ArrayLike) -> FloatArray:
    """Return the probabilities of detection of one look, P_d = Q(T - SNR), in [0, 1].

    `snr` is the signal in standard deviations of the noise (an amplitude ratio, not dB),
    `threshold` is T in the same unit. The result has their common shape; `nan` where an argument
    is. Down to the least double, 5e-324.
    """
    excess = floats(snr) - floats(threshold)
    # SciPy's ndtr is 0 below the least normal double, 2.2e-308; its logarithm goes on.
    tail = np.exp(_special().log_ndtr(excess))
    return np.where(excess < -37.5, tail, _special().ndtr(excess))[()]


def probit(log_hit: FloatArray, log_miss: FloatArray) -> FloatArray:
    """Return the standard normal quantiles of probabilities given by their logarithm and that of
    their complement.
    """
    lower = _special().ndtri_exp(log_hit)
    return np.where(log_hit < log_miss, lower, -_special().ndtri_exp(log_miss))


def m_of_n_probability(probability: ArrayLike, needed: int, looks: int) -> FloatArray:
    """Return the probabilities of at least M = `needed` detections in N = `looks` independent
    looks.

    `probability` is P_d of one look, in [0, 1]; the result has its shape. The upper tail of the
    binomial distribution, by the incomplete beta function: 1 for `needed` <= 0, 0 for more needed
    than looks.
    """
    chance = floats(probability)
    if needed <= 0:
        return np.ones_like(chance)
    if needed > looks:
        return np.zeros_like(chance)
    return _special().betainc(needed, looks - needed + 1, chance)
