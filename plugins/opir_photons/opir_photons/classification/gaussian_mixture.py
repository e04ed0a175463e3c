"""Gaussian mixtures in the log domain: of signals measured in independent noise, and of a count.

A component is normal in x = (s, m): in-band signals s (B,) and a count m without noise. A measurement y = s + noise,
with variances v (B,), has the density N(mean_s, C_ss + diag v); the count given y is normal too. Both follow from one
elimination by bands, element by element.
"""

from collections.abc import Iterator, Sequence

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray, IntArray

#: Least variance, in squared units of the signals: no singular density without signal and noise.
_LEAST_VARIANCE = 1e-12

#: Numbers of a column that is worked on at once.
_CACHED = 1 << 16

_LOG_TWO_PI = float(np.log(2.0 * np.pi))


@frozen(eq=False)
class Components:
    """K components: logarithms of their weights (K,), means (K, D) and covariances (K, D, D)."""

    log_weight: FloatArray
    mean: FloatArray
    covariance: FloatArray


@frozen(eq=False)
class Mixture:
    """Components for each elevation bin: weights (bins, K), means (D, bins, K), covariances (D, D, bins, K).

    Components `edges[c]` to `edges[c + 1]` are those of class c, padded with components of weight 0.
    """

    log_weight: FloatArray
    mean: FloatArray
    covariance: FloatArray
    edges: IntArray

    @classmethod
    def of(cls, places: Sequence[Sequence[Components]]) -> "Mixture":
        """Return the mixture of the classes' components in each bin."""
        widths = [max(1, *(len(part.log_weight) for part in parts)) for parts in zip(*places, strict=True)]
        edges = np.cumsum([0, *widths])
        size = places[0][0].mean.shape[1]
        log_weight = np.full((len(places), edges[-1]), -np.inf)
        mean = np.zeros((size, len(places), edges[-1]))
        covariance = np.zeros((size, size, len(places), edges[-1])) + np.eye(size)[:, :, None, None]
        for place, parts in enumerate(places):
            for start, part in zip(edges[:-1].tolist(), parts, strict=True):
                own = slice(start, start + len(part.log_weight))
                log_weight[place, own] = part.log_weight
                mean[:, place, own] = part.mean.T
                covariance[:, :, place, own] = part.covariance.transpose(1, 2, 0)
        return cls(log_weight, mean, covariance, edges)

    def given_signal(
        self, place: int, signal: FloatArray, variance: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return ln weight · p(y), and the mean and the variance of the count given y, (K, n) each.

        Signals and variances are (B, n), of rows in the bin `place`.
        """
        covariance = list(self.covariance[:, :, place, :, None])
        off = [value - mean for value, mean in zip([*signal, 0.0], self.mean[:, place, :, None], strict=True)]
        deviance, volume = np.zeros((1, 1)), np.ones((1, 1))
        for row, noise in enumerate(variance):
            pivot = np.maximum(covariance[row][row] + noise, _LEAST_VARIANCE)
            per_pivot = 1.0 / pivot
            for later in range(row + 1, len(covariance)):
                factor = covariance[row][later] * per_pivot
                off[later] = off[later] - factor * off[row]
                covariance[later] = list(covariance[later])
                for column in range(later, len(covariance)):
                    covariance[later][column] = covariance[later][column] - factor * covariance[row][column]
            deviance = deviance + off[row] * off[row] * per_pivot
            volume = volume * pivot
        density = self.log_weight[place, :, None] - 0.5 * (deviance + np.log(volume) + len(signal) * _LOG_TWO_PI)
        return density, -off[-1], np.maximum(covariance[-1][-1], _LEAST_VARIANCE)

    def by_class(self, log_densities: FloatArray) -> FloatArray:
        """Return ln of the sums (classes, n) of densities (K, n)."""
        starts, widths = self.edges[:-1], np.diff(self.edges)
        most = np.maximum.reduceat(log_densities, starts, axis=0)
        at = np.where(most > -np.inf, most, 0.0)
        shares = exp_of_share(log_densities - np.repeat(at, widths, axis=0))
        return most + np.log(np.maximum(np.add.reduceat(shares, starts, axis=0), 1.0))


def blocks(place: IntArray, components: int) -> Iterator[tuple[int, IntArray]]:
    """Yield bins with row numbers of theirs, few enough that columns of all components stay in the cache."""
    step = max(_CACHED // components, 1)
    for number in np.unique(place).tolist():
        rows = np.flatnonzero(place == number)
        for start in range(0, len(rows), step):
            yield number, rows[start : start + step]


def log_counts(count: FloatArray, mean: FloatArray, variance: FloatArray, least: float) -> FloatArray:
    """Return ln p (K, n) of counts (n,), normal with these means and variances (K, n).

    Densities are reflected at `least`, below which there are none (B. W. Silverman, Density Estimation for Statistics
    and Data Analysis, 1986, section 2.10).
    """
    per_variance = -0.5 / variance
    straight, turned = np.square(count - mean) * per_variance, np.square((2.0 * least - count) - mean) * per_variance
    both = np.log1p(exp_of_share(-np.abs(straight - turned)))
    return np.maximum(straight, turned) + both - 0.5 * (np.log(variance) + _LOG_TWO_PI)


def exp_of_share(log_share: FloatArray) -> FloatArray:
    """Return exp of values up to 0, at least 1e-304: subnormal results take far longer, and 1 + 1e-304 is 1."""
    return np.exp(np.maximum(log_share, -700.0))


def log_sum(terms: FloatArray) -> FloatArray:
    """Return ln Σ exp (n,) of terms (m, n); -inf if all are."""
    most = np.maximum.reduce(terms, axis=0, initial=-np.inf)
    at, total = np.where(most > -np.inf, most, 0.0), np.zeros(len(most))
    # One term after another: the order of summation must not depend on the number of rows.
    for term in terms:
        total += exp_of_share(term - at)
    # The largest term is 1: a smaller sum has no terms.
    return most + np.log(np.maximum(total, 1.0))


def log_shares(values: FloatArray) -> FloatArray:
    """Return the log softmax (n, m) of rows, without overflow; a row of -inf is nan."""
    with np.errstate(invalid="ignore"):
        off = values - values.max(axis=-1, keepdims=True)
    return off - np.log(np.exp(off).sum(axis=-1, keepdims=True))


def cell_moments(
    signal: FloatArray, count: FloatArray, weight: FloatArray, cell: IntArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return weights (K,), means (K, B + 1) and covariances (K, B + 1, B + 1) of samples (n,), by cells."""
    x = np.concatenate([signal, count[:, None]], axis=1)
    _, row = np.unique(cell, return_inverse=True)
    total = np.bincount(row, weight).astype(np.float64)
    mean = np.stack([np.bincount(row, weight * column) for column in x.T], axis=1) / total[:, None]
    off = x - mean[row]
    products = (weight[:, None, None] * off[:, :, None] * off[:, None, :]).reshape(len(x), -1)
    spread = np.stack([np.bincount(row, column) for column in products.T], axis=1) / total[:, None]
    return total, mean, spread.reshape(-1, x.shape[1], x.shape[1])
