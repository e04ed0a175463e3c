"""Gaussian mixtures in the log domain: of signals measured in independent noise, and of a count.

A component is normal in x = (s, m): in-band signals s (B,) and a count m without noise. A
measurement y = s + noise, with variances v (B,), has the density N(mean_s, C_ss + diag v); the
count given y is normal too. Both follow from one elimination by bands, element by element.
"""

from collections.abc import Sequence

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray, IntArray

_LOG_TWO_PI = float(np.log(2.0 * np.pi))


@frozen(eq=False)
class Components:
    """K components: logarithms of their weights (K,), means (K, D) and covariances (K, D, D)."""

    log_weight: FloatArray
    mean: FloatArray
    covariance: FloatArray


@frozen(eq=False)
class Mixture:
    """Components for each elevation bin: weights (bins, K), means (D, bins, K), covariances (D, D,
    bins, K).

    Components `edges[c]` to `edges[c + 1]` are those of class c, padded with components of weight
    0.
    """

    log_weight: FloatArray
    mean: FloatArray
    covariance: FloatArray
    edges: IntArray

    @classmethod
    def of(cls, places: Sequence[Sequence[Components]]) -> "Mixture":
        """Return the mixture of the classes' components in each bin."""
        widths = [
            max(1, *(len(components.log_weight) for components in of_class))
            for of_class in zip(*places, strict=True)
        ]
        edges = np.cumsum([0, *widths])
        size = places[0][0].mean.shape[1]
        log_weight = np.full((len(places), edges[-1]), -np.inf)
        mean = np.zeros((size, len(places), edges[-1]))
        covariance = np.zeros((size, size, len(places), edges[-1])) + np.eye(size)[:, :, None, None]
        for place, of_place in enumerate(places):
            for start, components in zip(edges[:-1].tolist(), of_place, strict=True):
                columns = slice(start, start + len(components.log_weight))
                log_weight[place, columns] = components.log_weight
                mean[:, place, columns] = components.mean.T
                covariance[:, :, place, columns] = components.covariance.transpose(1, 2, 0)
        return cls(log_weight, mean, covariance, edges)

    def log_densities(
        self,
        place: IntArray,
        signal: FloatArray,
        variance: FloatArray,
        count: FloatArray,
        least: float = -np.inf,
    ) -> tuple[FloatArray, FloatArray]:
        """Return ln weight · p(y) and ln p(count | y), (n, K) each.

        `place` (n,) are the bins; signals and variances are (n, B), counts (n,). Normal densities
        of counts are reflected at `least`, below which there are none (B. W. Silverman, Density
        Estimation for Statistics and Data Analysis, 1986, section 2.10).
        """
        # A few rows at a time: their columns stay in the processor's cache.
        step = max((1 << 18) // (self.log_weight.shape[1] * self.mean.shape[0] ** 2), 1)
        densities = [
            self._of_rows(place[rows], signal[rows], variance[rows], count[rows], least)
            for rows in (slice(start, start + step) for start in range(0, max(len(place), 1), step))
        ]
        log_density, log_count = map(np.concatenate, zip(*densities, strict=True))
        return log_density, log_count

    def _of_rows(
        self,
        place: IntArray,
        signal: FloatArray,
        variance: FloatArray,
        count: FloatArray,
        least: float,
    ) -> tuple[FloatArray, FloatArray]:
        bands = signal.shape[1]
        size = bands + 1
        work = np.empty((size, size + 1, len(signal), self.log_weight.shape[1]))
        work[:, :size] = self.covariance[:, :, place]
        band = np.arange(bands)
        work[band, band] += variance.T[:, :, None]
        measured = np.concatenate([signal, count[:, None]], axis=1)
        work[:, size] = measured.T[:, :, None] - self.mean[:, place]
        log_density = self.log_weight[place]
        for row in range(bands):
            log_density += self._eliminated(work, row)
        counted = self._eliminated(work, bands)
        if least == -np.inf:
            return log_density, counted
        work[bands, -1] += 2.0 * (least - count)[:, None]
        return log_density, np.logaddexp(counted, self._eliminated(work, bands))

    def _eliminated(self, work: FloatArray, row: int) -> FloatArray:
        """Return the log density of one variable given those before it, and condition those after
        it on it.
        """
        # No singular density without signal and noise.
        pivot = np.maximum(work[row, row], 1e-12)
        residual = work[row, -1]
        factors = work[row + 1 :, row] / pivot
        work[row + 1 :, row + 1 :] -= factors[:, None] * work[row, row + 1 :]
        return -0.5 * (residual * residual / pivot + np.log(pivot) + _LOG_TWO_PI)

    def by_class(self, log_densities: FloatArray) -> FloatArray:
        """Return ln of the sums (n, classes) of densities (n, K)."""
        starts = self.edges[:-1]
        widths = self.edges[1:] - self.edges[:-1]
        peak = np.maximum.reduceat(log_densities, starts, axis=1)
        scale = np.where(peak > -np.inf, peak, 0.0)
        shares = np.exp(log_densities - np.repeat(scale, widths, axis=1))
        return peak + np.log(np.maximum(np.add.reduceat(shares, starts, axis=1), 1.0))


def log_sum(values: FloatArray) -> FloatArray:
    """Return ln Σ exp (n,) of rows (n, m), m > 0; -inf if all values are."""
    peak = values.max(axis=-1)
    scale = np.where(peak > -np.inf, peak, 0.0)
    # The largest term is 1: a smaller sum has no terms.
    return peak + np.log(np.maximum(np.exp(values - scale[..., None]).sum(axis=-1), 1.0))


def log_shares(values: FloatArray) -> FloatArray:
    """Return the log softmax (n, m) of rows, without overflow; a row of -inf is nan."""
    with np.errstate(invalid="ignore"):
        off = values - values.max(axis=-1, keepdims=True)
    return off - np.log(np.exp(off).sum(axis=-1, keepdims=True))


def cell_moments(
    signal: FloatArray, count: FloatArray, weight: FloatArray, cell: IntArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return weights (K,), means (K, B + 1) and covariances (K, B + 1, B + 1) of samples (n,), by
    cells.
    """
    x = np.concatenate([signal, count[:, None]], axis=1)
    _, row = np.unique(cell, return_inverse=True)
    total = np.bincount(row, weight).astype(np.float64)

    def means(columns: FloatArray) -> FloatArray:
        sums = [np.bincount(row, column) for column in columns.T]
        return np.stack(sums, axis=1) / total[:, None]

    mean = means(weight[:, None] * x)
    off = x - mean[row]
    products = (weight[:, None, None] * off[:, :, None] * off[:, None, :]).reshape(len(x), -1)
    return total, mean, means(products).reshape(-1, x.shape[1], x.shape[1])
