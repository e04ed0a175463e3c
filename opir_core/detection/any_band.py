"""The rule `any band`: a look detects where the measured signal crosses the threshold in at least one band."""

import numpy as np
from attrs import frozen
from numpy.typing import NDArray

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.detection.redrawing import tail_normals
from opir_core.detection.threshold import probit

#: Below it, 1 - exp(x) is -x to the last bit.
_LINEAR = -1e-17


@frozen(eq=False)
class AnyBand:
    """Bands are judged one by one; signals and thresholds are in standard deviations of each band's noise."""

    threshold: float

    def log_chances(self, snr: FloatArray, _noise: FloatArray, _slack: float = 0.0) -> tuple[FloatArray, FloatArray]:
        """Return ln P_d and ln(1 - P_d) (n,) of looks with expected signals (n, B)."""
        from scipy.special import log_ndtr, logsumexp

        log_miss = _sum(log_ndtr(self.threshold - snr))
        with np.errstate(divide="ignore"):
            log_hit = np.log(-np.expm1(log_miss))
        tiny = np.flatnonzero(log_miss > _LINEAR)
        # The sum of chances that small is their union.
        log_hit[tiny] = logsumexp(log_ndtr(snr[tiny] - self.threshold), axis=1)
        return np.minimum(log_hit, 0.0), log_miss

    def quantile(self, snr: FloatArray, noise: FloatArray, slack: float) -> FloatArray:
        """Return the standard normal quantiles of P_d (n,); of one band it is by how much the threshold is exceeded."""
        one: FloatArray = snr[:, 0] - self.threshold
        return one if snr.shape[1] == 1 else probit(*self.log_chances(snr, noise, slack))

    def passes(self, measured: FloatArray, _noise: FloatArray) -> BoolArray:
        """Return which measurements (n, B) detect."""
        passed: BoolArray = measured[:, 0] >= self.threshold
        for band in range(1, measured.shape[1]):
            passed |= measured[:, band] >= self.threshold
        return passed

    def confirming(self, measured: FloatArray) -> NDArray[np.uint8]:
        """Return masks (n,) of the bands that confirm, in measurements (n, B) that detect."""
        bands = np.zeros(len(measured), dtype=np.uint8)
        for band in range(measured.shape[1]):
            bands |= (measured[:, band] >= self.threshold).view(np.uint8) << np.uint8(band)
        return bands

    def proposed(self, snr: FloatArray, uniforms: FloatArray) -> FloatArray:
        """Return measurements (n, B) that detect, from numbers (n, B + 1) in [0, 1): the inverse is cheap."""
        return self.conditional(snr, snr, uniforms)

    def passing(self, _snr: FloatArray, probability: FloatArray) -> FloatArray:
        """Return which share (n,) of proposals detects: all."""
        return np.ones(len(probability))

    def conditional(self, snr: FloatArray, _noise: FloatArray, uniforms: FloatArray) -> FloatArray:
        """Return measurements (n, B) conditional on a detection, exactly, from numbers (n, B + 1) in [0, 1).

        The first band to cross is drawn from its distribution; bands before it lie below the threshold, it lies above,
        and those after it are free.
        """
        first = self._first_crossing(snr, uniforms[:, -1])
        measured = np.empty_like(snr)
        for band in range(snr.shape[1]):
            edge = self.threshold - snr[:, band]
            is_before = band < first
            # What lies below a bound is what lies above its mirror image, mirrored.
            least = np.where(band == first, edge, np.where(is_before, -edge, -np.inf))
            drawn = tail_normals(least, uniforms[:, band])
            measured[:, band] = snr[:, band] + np.where(is_before, -drawn, drawn)
        # Rounding may put a number that crosses just below the threshold.
        rows = np.arange(len(first))
        measured[rows, first] = np.maximum(measured[rows, first], self.threshold)
        return measured

    def _first_crossing(self, snr: FloatArray, uniform: FloatArray) -> IntArray:
        from scipy.special import log_ndtr

        if snr.shape[1] == 1:
            return np.zeros(len(snr), dtype=np.int64)
        log_below = log_ndtr(self.threshold - snr)
        before = np.cumsum(log_below, axis=1) - log_below
        weight = log_ndtr(snr - self.threshold) + before
        share = np.exp(weight - weight.max(axis=1, keepdims=True))
        passed = np.cumsum(share, axis=1)
        first: IntArray = np.minimum((uniform[:, None] * passed[:, -1:] >= passed).sum(axis=1), snr.shape[1] - 1)
        return first


def _sum(columns: FloatArray) -> FloatArray:
    """Return the sums of rows, added band by band: the order does not hang on how many rows there are."""
    total = columns[:, 0].copy()
    for band in range(1, columns.shape[1]):
        total += columns[:, band]
    return total
