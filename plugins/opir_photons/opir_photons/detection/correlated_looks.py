"""The number of independent looks that looks with correlated noise are worth."""

import numpy as np
from numpy.typing import ArrayLike

from opir_core.arrays import FloatArray
from opir_photons.columns import floats


def effective_looks(correlation: ArrayLike) -> FloatArray:
    """Return the numbers of independent looks that n correlated ones are worth, from their
    correlations (…, n).

    `correlation` holds the correlations of the noise of looks 0, 1, … n - 1 apart, the first of
    which is 1: the mean of n looks has the variance of one over n / (1 + 2 Σ (1 - k/n) ρ_k).
    Source: G. V. Bayley and J. M. Hammersley, Suppl. J. R. Stat. Soc. 8 (1946) 184. Looks of
    opposite noise are worth more than n.
    """
    rho = floats(correlation)
    count = rho.shape[-1]
    share = 1.0 - np.arange(count) / count
    return count / (2.0 * (share * rho).sum(axis=-1) - rho[..., 0])
