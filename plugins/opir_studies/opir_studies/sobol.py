"""Global sensitivity: Sobol indices of the settings of a study, with intervals.

The first-order index of a setting is the share of a figure's variance that goes with this setting
alone, the total index that which it has a part in (Sobol, Mathematics and Computers in Simulation
55 (2001), 271). Estimators: Saltelli et al. and Jansen, as in Saltelli et al., Computer Physics
Communications 181 (2010), 259, table 2.
"""

from typing import NamedTuple

import numpy as np

from opir_core.arrays import FloatArray, IntArray

_RESAMPLES = 1000
_QUANTILE = 1.959963984540054


class SobolIndex(NamedTuple):
    """Indices (k,) of settings, and the half widths (k,) of their 95 % intervals by bootstrap."""

    first: FloatArray
    first_half: FloatArray
    total: FloatArray
    total_half: FloatArray


def sobol_points(settings: int, samples: int, seed: int) -> FloatArray:
    """Return points (samples · (settings + 2), settings) in the unit cube: two independent samples,
    then the first one with each setting in turn of the second.

    Samples are of a scrambled Sobol sequence, best a power of two of them.
    """
    from scipy.stats import qmc  # takes half a second

    # A sequence of twice the dimensions: its halves are independent of each other.
    sequence = qmc.Sobol(2 * settings, seed=np.random.default_rng(seed))
    power = int(np.ceil(np.log2(samples))) if samples > 1 else 0
    pairs = sequence.random_base2(power)[:samples]
    base = pairs[:, :settings]
    other_base = pairs[:, settings:]
    exchanged = [
        np.where(np.arange(settings) == setting, other_base, base) for setting in range(settings)
    ]
    return np.concatenate([base, other_base, *exchanged])


def sobol_indices(values: FloatArray, settings: int, seed: int = 0) -> SobolIndex:
    """Return the indices of settings from the values (n,) of a figure at `sobol_points`.

    nan where a value is unknown, or all are equal.
    """
    base, other_base, *exchanged = values.reshape(settings + 2, -1)
    samples = len(base)
    rows = np.random.default_rng(seed).integers(samples, size=(_RESAMPLES, samples))
    whole = np.arange(samples)[None]
    pairs = [
        (_indices(base, other_base, column, whole), _indices(base, other_base, column, rows))
        for column in exchanged
    ]
    estimates = np.array([estimate[:, 0] for estimate, _ in pairs])
    halves = np.array([_QUANTILE * resampled.std(axis=1, ddof=1) for _, resampled in pairs])
    return SobolIndex(estimates[:, 0], halves[:, 0], estimates[:, 1], halves[:, 1])


def _indices(
    base: FloatArray, other_base: FloatArray, exchanged: FloatArray, rows: IntArray
) -> FloatArray:
    """Return first-order and total index (2, m) of a setting over resampled rows (m, n)."""
    both = np.concatenate([base[rows], other_base[rows]], axis=1)
    # Centred: the estimator of the first-order index is exact for any origin, and noisy far off.
    centre = both.mean(axis=1, keepdims=True)
    variance = both.var(axis=1)
    variance = np.where(variance > 0.0, variance, np.nan)
    difference = exchanged[rows] - base[rows]
    first = np.mean((other_base[rows] - centre) * difference, axis=1) / variance
    total = 0.5 * np.mean(np.square(difference), axis=1) / variance
    return np.stack([first, total])
