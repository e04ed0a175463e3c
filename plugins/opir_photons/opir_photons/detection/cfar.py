"""Cell-averaging CFAR on Gaussian amplitudes: the threshold follows the noise of N reference cells.

The signal of a cell less the mean of the reference cells, over their standard deviation times √(1 +
1/N), has Student's t distribution with N - 1 degrees of freedom; with a signal the noncentral one.
Source: S. M. Kay, Fundamentals of Statistical Signal Processing II: Detection Theory (1998),
example 9.1. Signals are in standard deviations of the noise. Arguments of all functions broadcast.
"""

import numpy as np
from numpy.typing import ArrayLike
from scipy.special import gammainc, gammaincinv, nctdtr, ndtri, stdtr, stdtrit

from opir_core.arrays import FloatArray

#: Shift over threshold from which on the probability of detection is 1, however few the cells.
_LARGEST_RATIO = 1e3


def cfar_threshold(false_alarm_probability: ArrayLike, cells: ArrayLike) -> FloatArray:
    """Return the thresholds on Student's t that N = `cells` reference cells need for false-alarm
    probabilities.
    """
    return -stdtrit(np.asarray(cells, dtype=np.float64) - 1.0, false_alarm_probability)


def cfar_false_alarm_probability(threshold: ArrayLike, cells: ArrayLike) -> FloatArray:
    """Return the false-alarm probabilities of thresholds on Student's t with N = `cells` reference
    cells.
    """
    return stdtr(
        np.asarray(cells, dtype=np.float64) - 1.0, -np.asarray(threshold, dtype=np.float64)
    )


def cfar_probability_of_detection(
    snr: ArrayLike, threshold: ArrayLike, cells: ArrayLike
) -> FloatArray:
    """Return the probabilities of detection of signals, with a threshold on Student's t and N =
    `cells` cells.
    """
    count = np.asarray(cells, dtype=np.float64)
    limit = np.asarray(threshold, dtype=np.float64)
    shift = np.asarray(snr, dtype=np.float64) / np.sqrt(1.0 + 1.0 / count)
    # The upper tail as the lower one of the mirrored distribution: no digit is lost where it is
    # small.
    found = nctdtr(count - 1.0, -shift, -limit)
    # SciPy has none of shifts above 1e5 or so: there the noise of the cell is nothing beside that
    # of the threshold.
    ratio = np.minimum(shift / np.maximum(limit, 1.0), _LARGEST_RATIO)
    return np.where(
        np.isnan(found), gammainc(0.5 * (count - 1.0), 0.5 * (count - 1.0) * ratio * ratio), found
    )[()]


def cfar_loss(false_alarm_probability: ArrayLike, cells: ArrayLike) -> FloatArray:
    """Return the CFAR losses, at least 1: the SNR for P_d = 1/2 with N = `cells` cells over that
    with known noise.

    20 log10 of it is the loss in dB. A loss divides the SNR: P_d = Q(T - SNR / loss) with the
    threshold T of known noise is exact at P_d = 1/2 and within 0.03 elsewhere, from 16 cells on and
    P_fa down to 2.8e-7.
    """
    count = np.asarray(cells, dtype=np.float64)
    threshold = cfar_threshold(false_alarm_probability, count)
    needed = _median_shift(count - 1.0, threshold) * np.sqrt(1.0 + 1.0 / count)
    return needed / -ndtri(np.asarray(false_alarm_probability, dtype=np.float64))


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
