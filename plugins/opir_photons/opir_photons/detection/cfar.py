"""Cell-averaging CFAR on Gaussian amplitudes: the threshold follows the noise of N reference cells.

The signal of a cell less the mean of the reference cells, over their standard deviation times √(1 +
1/N), has Student's t distribution with N - 1 degrees of freedom; with a signal the noncentral one.
Source: S. M. Kay, Fundamentals of Statistical Signal Processing II: Detection Theory (1998),
example 9.1. Signals are in standard deviations of the noise. Arguments of all functions broadcast.
"""

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import gammainc, gammaincinv, nctdtr, ndtri, stdtrit

from opir_core.arrays import FloatArray
from opir_photons.columns import floats


def cfar_threshold(false_alarm_probability: ArrayLike, cells: ArrayLike) -> FloatArray:
    """Return the thresholds on Student's t that N = `cells` reference cells need for false-alarm
    probabilities.
    """
    return -stdtrit(floats(cells) - 1.0, false_alarm_probability)


def cfar_probability_of_detection(
    snr: ArrayLike, threshold: ArrayLike, cells: ArrayLike
) -> FloatArray:
    """Return the probabilities of detection of signals, with a threshold on Student's t and N =
    `cells` cells.
    """
    count = floats(cells)
    limit = floats(threshold)
    shift = floats(snr) / np.sqrt(1.0 + 1.0 / count)
    # The upper tail as the lower one of the mirrored distribution: no digit is lost where it is
    # small.
    chance = nctdtr(count - 1.0, -shift, -limit)
    # SciPy fails for shifts above 1e5 or so: there the noise of the cell is negligible beside that
    # of the threshold. From a thousand thresholds on P_d is 1, however few the cells.
    ratio = np.minimum(shift / np.maximum(limit, 1.0), 1e3)
    half = 0.5 * (count - 1.0)
    return np.where(np.isnan(chance), gammainc(half, half * ratio * ratio), chance)[()]


def cfar_loss(false_alarm_probability: ArrayLike, cells: ArrayLike) -> FloatArray:
    """Return the CFAR losses, at least 1: the SNR for P_d = 1/2 with N = `cells` cells over that
    with known noise.

    20 log10 of it is the loss in dB. A loss divides the SNR: P_d = Q(T - SNR / loss) with the
    threshold T of known noise is exact at P_d = 1/2 and within 0.03 elsewhere, from 16 cells on and
    P_fa down to 2.8e-7.
    """
    count = floats(cells)
    threshold = cfar_threshold(false_alarm_probability, count)
    needed = _median_shift(count - 1.0, threshold) * np.sqrt(1.0 + 1.0 / count)
    return needed / -ndtri(floats(false_alarm_probability))


def _median_shift(freedom: FloatArray, threshold: FloatArray) -> FloatArray:
    """Return the noncentralities with a given median of Student's t: those of large thresholds, by
    the median of χ², and secant steps where SciPy has the distribution.
    """
    shift: FloatArray = threshold * np.sqrt(2.0 * gammaincinv(0.5 * freedom, 0.5) / freedom)
    for width in (1e-2, 1e-4, 1e-6, 1e-6):
        low, high = (nctdtr(freedom, -shift * (1.0 + side), -threshold) for side in (-width, width))
        middle = nctdtr(freedom, -shift, -threshold)
        with np.errstate(invalid="ignore", divide="ignore"):
            step = (middle - 0.5) * (2.0 * width * shift / (high - low))
        shift = shift - np.where(np.isfinite(step), step, 0.0)
    return shift
