"""The rule `likelihood`: all bands together, each with the weight that its signal has in the
likelihood ratio.

Signals x (B,) are in standard deviations of each band's noise, which is independent and Gaussian.
The likelihood ratio of an expected signal s against noise grows with u · x, u = s / |s| (S. M. Kay,
Fundamentals of Statistical Signal Processing II: Detection Theory, 1998, section 4.3), which has
unit variance. So a look detects if u · x >= T, with

    P_fa = Q(T) for any number of bands        P_d = Q(T - |s|)        |s|² = Σ s_b²

A band in which nothing is expected weighs nothing, and another band never lowers P_d. The weights
are those of the target that is looked at: a bank of filters for all spectra would do the same at a
slightly larger T. Noise alone is weighed as the reference target.
"""

import numpy as np
from attrs import frozen
from scipy.special import log_ndtr, ndtri

from opir_core.arrays import BoolArray, ByteArray, FloatArray
from opir_photons.detection.rejection_sampling import LEAST_UNIFORM, tail_normals


@frozen(eq=False)
class FusedBands:
    """A detection where the weighted sum of all bands crosses the threshold.

    `design` (B,) are the irradiances by which noise alone is weighed; a band confirms a detection
    if its own signal is at least `coincidence`. The slopes (n, B) of methods are the weights u that
    `directions` returns.
    """

    threshold: float
    design: FloatArray
    coincidence: float

    def directions(self, snr: FloatArray, noise: FloatArray) -> FloatArray:
        """Return the weights (n, B), of unit length, of expected signals (n, B); of the design
        where there is none.
        """
        weight: FloatArray = np.maximum(snr, 0.0)
        dark = np.flatnonzero(_length(weight) == 0.0)
        if len(dark):
            weight[dark] = self.slopes(noise[dark])
        return weight / _length(weight)[:, None]

    def slopes(self, noise: FloatArray, air: FloatArray | None = None) -> FloatArray:
        """Return the weights (n, B) of the design for noise (n, B), W/m²."""
        # Scaled by the least noise: irradiances over noise of 1e-60 W/m² have no square.
        weight = self.design / self.design.max() * (noise.min(axis=1, keepdims=True) / noise)
        return weight / _length(weight)[:, None]

    def log_chances(
        self, snr: FloatArray, slopes: FloatArray, _slack: float = 0.0
    ) -> tuple[FloatArray, FloatArray]:
        """Return ln P_d and ln(1 - P_d) (n,) of looks with expected signals (n, B) and weights (n,
        B).
        """
        margin = self.quantile(snr, slopes, _slack)
        return log_ndtr(margin), log_ndtr(-margin)

    def quantile(self, snr: FloatArray, slopes: FloatArray, _slack: float) -> FloatArray:
        """Return the standard normal quantiles of P_d (n,): u · s - T."""
        return _dot(snr, slopes) - self.threshold

    def passes(self, measured: FloatArray, slopes: FloatArray) -> BoolArray:
        """Return which measurements (n, B) detect."""
        return _dot(measured, slopes) >= self.threshold

    def strength(self, measured: FloatArray, slopes: FloatArray) -> FloatArray:
        """Return the SNR (n,) of measurements: that of the weighted sum."""
        return _dot(measured, slopes)

    def confirming(self, measured: FloatArray) -> ByteArray:
        """Return masks (n,) of the bands of measurements (n, B) that are above `coincidence`; the
        brightest always.
        """
        bands = np.zeros(len(measured), dtype=np.uint8)
        brightest = measured.argmax(axis=1)
        for band in range(measured.shape[1]):
            is_there = (measured[:, band] >= self.coincidence) | (brightest == band)
            bands |= is_there.view(np.uint8) << np.uint8(band)
        return bands

    def proposed(self, snr: FloatArray, slopes: FloatArray, uniforms: FloatArray) -> FloatArray:
        """Return measurements (n, B) that detect, from numbers (n, B + 1) in [0, 1)."""
        return self.conditional(snr, slopes, uniforms)

    def passing(self, _snr: FloatArray, probability: FloatArray) -> FloatArray:
        """Return the shares (n,) of proposals that detect: 1."""
        return np.ones(len(probability))

    def conditional(self, snr: FloatArray, slopes: FloatArray, uniforms: FloatArray) -> FloatArray:
        """Return measurements (n, B) conditional on a detection, exactly, from numbers (n, B + 1)
        in [0, 1).

        Noise along the weights is drawn above the threshold, noise across them freely.
        """
        free = ndtri(np.maximum(uniforms[:, :-1], LEAST_UNIFORM))
        along = tail_normals(self.threshold - _dot(snr, slopes), uniforms[:, -1])
        measured = snr + free + (along - _dot(free, slopes))[:, None] * slopes
        # Rounding may move a crossing signal below the threshold.
        short = self.threshold - _dot(measured, slopes)
        measured += np.where(short > 0.0, short + 1e-12 * self.threshold, 0.0)[:, None] * slopes
        return measured


def _dot(left: FloatArray, right: FloatArray) -> FloatArray:
    """Return the sums of products of rows, added band by band: the order does not depend on the
    number of rows.
    """
    total: FloatArray = left[:, 0] * right[:, 0]
    for band in range(1, left.shape[1]):
        total += left[:, band] * right[:, band]
    return total


def _length(rows: FloatArray) -> FloatArray:
    return np.sqrt(_dot(rows, rows))
