"""A known signal in unit Gaussian noise against a threshold: P_fa = Q(t), P_d = Q(t - SNR).

Tails are kept by logarithms: no probability, however near 0 or 1, is got by subtraction. The normal distribution and
its inverse are SciPy's (`scipy.special`), imported where they are used.
"""

import numpy as np
from numpy.typing import ArrayLike

from opir_core.arrays import FloatArray


def threshold_sigma(false_alarm_probability: ArrayLike) -> FloatArray:
    """Return thresholds, in standard deviations of the noise, that noise alone crosses with these probabilities.

    Probabilities in (0, 1), down to the least double; nan outside.
    """
    from scipy.special import ndtri

    threshold: FloatArray = -ndtri(np.asarray(false_alarm_probability, dtype=np.float64))
    return threshold


def false_alarm_probability(threshold: ArrayLike) -> FloatArray:
    """Return the probabilities that noise alone crosses thresholds, in standard deviations: Q(t)."""
    return probability_of_detection(0.0, threshold)


def probability_of_detection(snr: ArrayLike, threshold: ArrayLike) -> FloatArray:
    """Return Q(threshold - SNR), in [0, 1]: the probability that a signal in unit noise crosses a threshold."""
    from scipy.special import ndtr

    probability: FloatArray = ndtr(np.asarray(snr, dtype=np.float64) - np.asarray(threshold, dtype=np.float64))
    return probability


def log_probability_of_detection(snr: ArrayLike, threshold: ArrayLike) -> FloatArray:
    """Return ln Q(threshold - SNR), exact where the probability itself is too small for a double."""
    from scipy.special import log_ndtr

    logarithm: FloatArray = log_ndtr(np.asarray(snr, dtype=np.float64) - np.asarray(threshold, dtype=np.float64))
    return logarithm


def snr_needed(probability: ArrayLike, threshold: ArrayLike) -> FloatArray:
    """Return the signal-to-noise ratios that are detected with these probabilities, (0, 1)."""
    from scipy.special import ndtri

    snr: FloatArray = np.asarray(threshold, dtype=np.float64) + ndtri(np.asarray(probability, dtype=np.float64))
    return snr


def probit(log_hit: FloatArray, log_miss: FloatArray) -> FloatArray:
    """Return the standard normal quantiles of probabilities given by their logarithm and that of their complement."""
    from scipy.special import ndtri_exp

    quantile: FloatArray = np.where(log_hit < log_miss, ndtri_exp(log_hit), -ndtri_exp(log_miss))
    return quantile


def m_of_n(probability: ArrayLike, needed: int, looks: int) -> FloatArray:
    """Return the probability of at least `needed` detections in `looks` independent looks of one probability each."""
    from scipy.special import betainc

    chance = np.asarray(probability, dtype=np.float64)
    if needed <= 0:
        return np.ones_like(chance)
    if needed > looks:
        return np.zeros_like(chance)
    result: FloatArray = betainc(needed, looks - needed + 1, chance)
    return result


def marcum_q1(a: ArrayLike, b: ArrayLike) -> FloatArray:
    """Return Marcum's Q function of order 1: a steady signal of amplitude a behind an envelope detector, threshold b.

    P_d = Q1(sqrt(2 S), sqrt(-2 ln P_fa)) for a ratio S of signal power to noise power (Marcum, RAND RM-754, 1947).
    """
    from scipy.stats import ncx2

    tail: FloatArray = ncx2.sf(np.square(b), 2, np.square(a))
    return tail


def albersheim_snr_db(probability: float, false_alarms: float, pulses: int = 1) -> float:
    """Return Albersheim's estimate of the SNR, dB, that `pulses` added after an envelope detector need.

    W. J. Albersheim, Proc. IEEE 69 (1981): within 0.2 dB for P_d 0.1 to 0.9, P_fa 1e-7 to 1e-3, 1 to 8096 pulses.
    """
    a = np.log(0.62 / false_alarms)
    b = np.log(probability / (1.0 - probability))
    spread = 6.2 + 4.54 / np.sqrt(pulses + 0.44)
    return float(-5.0 * np.log10(pulses) + spread * np.log10(a + 0.12 * a * b + 1.7 * b))
