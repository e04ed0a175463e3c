"""Gaussian mixtures in the log domain: of signals measured in independent noise, and of a count.

A component is normal in x = (s, m): in-band signals s (B,) and a count m without noise. A
measurement y = s + noise, with variances v (B,), has the density N(mean_s, C_ss + diag v); the
count given y is normal too. Both follow from one elimination by bands, element by element.
"""

from collections.abc import Iterator, Sequence

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray, IntArray

_LOG_TWO_PI = float(np.log(2.0 * np.pi))

#: Numbers in a column of a block of rows and components: a dozen columns fit the processor's cache.
_BLOCK_NUMBERS = 1 << 16

#: Exponents below are raised to it: doubles near their end take many times as long.
_LEAST_EXPONENT = -300.0


@frozen(eq=False)
class Components:
    """K components: logarithms of their weights (K,), means (K, D) and covariances (K, D, D)."""

    log_weight: FloatArray
    mean: FloatArray
    covariance: FloatArray


@frozen(eq=False)
class _Conditioned:
    """Components given signals, (n, K) each: ln of their weights and exponentials, the product of
    the inverse variances of the signals, and residual and inverse variance of the count.

    `work` is overwritten.
    """

    exponent: FloatArray
    precision: FloatArray
    count_residual: FloatArray
    count_precision: FloatArray
    work: FloatArray

    def count_density(self, shift: FloatArray) -> FloatArray:
        """Return the normal densities (n, K) of the counts plus those of counts shifted (n,)."""
        residual = self.count_residual
        work = self.work
        density = np.zeros_like(residual)
        for step in (0.0, shift[:, None]):
            residual += step
            np.multiply(residual, residual, out=work)
            work *= self.count_precision
            work *= -0.5
            density += _exponentials(work)
        np.multiply(self.count_precision, 0.5 / np.pi, out=work)
        density *= np.sqrt(work, out=work)
        return density


def _exponentials(exponent: FloatArray) -> FloatArray:
    """Return exp of exponents, in their place."""
    np.maximum(exponent, _LEAST_EXPONENT, out=exponent)
    return np.exp(exponent, out=exponent)


def _invert(variance: FloatArray) -> None:
    """Invert variances in their place."""
    # No singular density without signal and noise.
    np.maximum(variance, 1e-12, out=variance)
    np.divide(1.0, variance, out=variance)


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
        self, place: IntArray, signal: FloatArray, variance: FloatArray, count: FloatArray
    ) -> tuple[FloatArray, FloatArray]:
        """Return ln weight · p(y) and ln p(count | y), (n, K) each.

        `place` (n,) are the bins; signals and variances are (n, B), counts (n,).
        """
        log_density, log_count = np.empty((2, len(place), self.log_weight.shape[1]))
        for rows, given in self._conditioned(place, signal, variance, count):
            log_density[rows] = given.exponent + 0.5 * np.log(given.precision)
            square = given.count_residual * given.count_residual
            log_count[rows] = 0.5 * (
                np.log(given.count_precision) - square * given.count_precision - _LOG_TWO_PI
            )
        return log_density, log_count

    def log_class_densities(
        self,
        place: IntArray,
        signal: FloatArray,
        variance: FloatArray,
        count: FloatArray,
        least: float,
        floor: float,
    ) -> FloatArray:
        """Return ln (n, classes) of the sums over a class's components of weight · p(y) p(count | y).

        Arguments are as in `log_densities`. Normal densities of counts are reflected at `least`,
        below which there are none (B. W. Silverman, Density Estimation for Statistics and Data
        Analysis, 1986, section 2.10), and are at least `floor`, which is positive. Logarithms are
        of sums, not of components: these would cost as much as all else.
        """
        starts = self.edges[:-1]
        widths = self.edges[1:] - starts
        log_density = np.empty((len(place), len(starts)))
        for rows, given in self._conditioned(place, signal, variance, count):
            density = given.count_density(2.0 * (least - count[rows]))
            np.maximum(density, floor, out=density)
            density *= np.sqrt(given.precision, out=given.precision)
            peak = np.maximum.reduceat(given.exponent, starts, axis=1)
            scale = np.where(peak > -np.inf, peak, 0.0)
            exponent = given.exponent
            exponent -= np.repeat(scale, widths, axis=1)
            density *= _exponentials(exponent)
            log_density[rows] = peak + np.log(np.add.reduceat(density, starts, axis=1))
        return log_density

    def _conditioned(
        self, place: IntArray, signal: FloatArray, variance: FloatArray, count: FloatArray
    ) -> Iterator[tuple[IntArray, "_Conditioned"]]:
        """Yield rows of one bin and their components given the signals, a few rows at a time: the
        work stays in the processor's cache, and is overwritten by the next rows.
        """
        size, _, components = self.mean.shape
        step = max(_BLOCK_NUMBERS // components, 1)
        work = np.empty((size * (size + 5) // 2 + 3, min(step, len(place)), components))
        measured = np.concatenate([signal, count[:, None]], axis=1)
        for number in np.unique(place).tolist():
            of_bin = np.flatnonzero(place == number)
            for start in range(0, len(of_bin), step):
                rows = of_bin[start : start + step]
                block = work[:, : len(rows)]
                yield rows, self._given(number, measured[rows].T, variance[rows].T, block)

    def _given(
        self, place: int, measured: FloatArray, variance: FloatArray, work: FloatArray
    ) -> "_Conditioned":
        """Return the components of a bin given signals: `measured` (B + 1, n) with the counts,
        `variance` (B, n).
        """
        size = len(measured)
        bands = size - 1
        residual, buffers = work[:size], iter(work[size:])
        np.subtract(measured[:, :, None], self.mean[:, place, None], out=residual)
        exponent, precision, inverse, scaled, product = (next(buffers) for _ in range(5))
        exponent[:] = self.log_weight[place] - 0.5 * bands * _LOG_TWO_PI
        precision[:] = 1.0
        upper = {
            (row, column): self.covariance[row, column, place]
            for row in range(size)
            for column in range(row, size)
        }
        changed = {entry: next(buffers) for entry in upper if entry[0]}
        for row in range(bands):
            np.add(upper[row, row], variance[row, :, None], out=inverse)
            _invert(inverse)
            precision *= inverse
            for column in range(row + 1, size):
                np.multiply(upper[row, column], inverse, out=scaled)
                for other in range(column, size):
                    np.multiply(scaled, upper[row, other], out=product)
                    entry = column, other
                    upper[entry] = np.subtract(upper[entry], product, out=changed[entry])
                residual[column] -= np.multiply(scaled, residual[row], out=product)
            np.multiply(residual[row], residual[row], out=product)
            product *= inverse
            product *= 0.5
            exponent -= product
        inverse[:] = upper[bands, bands]
        _invert(inverse)
        return _Conditioned(exponent, precision, residual[bands], inverse, product)

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
