"""The paper's rules over the bands of a sensor: the conditions of a detection.

`AnyBand`: the signal crosses the threshold in at least one band.

`RatioGates` (`dual-band-ratio` and `triple-coincidence`): y is the measured signal of the reference
band, x_b those of the others, each in standard deviations of its own noise. A look detects if y >=
T and, for every other band, x_b >= C and x_b is within `tolerance` standard deviations of a signal
with a ratio x_b / y between the slopes l_b and u_b. That is the generalised likelihood-ratio test
of any ratio in that interval against all ratios (S. M. Kay, Fundamentals of Statistical Signal
Processing II: Detection Theory, 1998, section 6.5): x_b - s y has the variance 1 + s². Given y the
other bands are independent, so P_d is one integral over y, of the normal density times the
probability of each band to pass its gate, on Gauss-Legendre panels. No integral is evaluated if the
probabilities of the single conditions determine P_d.
"""

import numpy as np
from attrs import frozen
from scipy.special import log_ndtr, logsumexp, ndtr, ndtri

from opir_core.arrays import BoolArray, ByteArray, FloatArray, IntArray
from opir_photons.detection.gate_density import (
    FAR,
    LOG_HALF,
    GateDensity,
    by_steepness,
    log_integral,
)
from opir_photons.detection.gate_integrals import Gates, fast_probability
from opir_photons.detection.rejection_sampling import tail_normals, truncated_normals
from opir_photons.detection.threshold import probit

#: Slack of P_d from which the fast integral is accurate enough.
LEAST_SLACK = 1e-9


@frozen(eq=False)
class AnyBand:
    """A detection in any band is one; signals and the threshold are in standard deviations of each
    band's noise.
    """

    threshold: float

    def log_chances(
        self, snr: FloatArray, _slopes: FloatArray, _slack: float = 0.0
    ) -> tuple[FloatArray, FloatArray]:
        """Return ln P_d and ln(1 - P_d) (n,) of looks with expected signals (n, B)."""
        log_miss = _row_sum(log_ndtr(self.threshold - snr))
        with np.errstate(divide="ignore"):
            log_hit = np.log(-np.expm1(log_miss))
        # There 1 - exp(x) is -x to the last bit.
        tiny = np.flatnonzero(log_miss > -1e-17)
        # The probability of a union of such rare events is their sum.
        log_hit[tiny] = logsumexp(log_ndtr(snr[tiny] - self.threshold), axis=1)
        return np.minimum(log_hit, 0.0), log_miss

    def slopes(self, noise: FloatArray, air: FloatArray | None = None) -> FloatArray:
        """Return no slopes, (n, 0): the rule has no gates."""
        return np.empty((len(noise), 0))

    def quantile(self, snr: FloatArray, slopes: FloatArray, slack: float) -> FloatArray:
        """Return the standard normal quantiles of P_d (n,): of one band, SNR - T."""
        if snr.shape[1] == 1:
            return snr[:, 0] - self.threshold
        return probit(*self.log_chances(snr, slopes, slack))

    def passes(self, measured: FloatArray, _slopes: FloatArray) -> BoolArray:
        """Return which measurements (n, B) detect."""
        passed: BoolArray = measured[:, 0] >= self.threshold
        for band in range(1, measured.shape[1]):
            passed |= measured[:, band] >= self.threshold
        return passed

    def confirming(self, measured: FloatArray) -> ByteArray:
        """Return masks (n,) of the confirming bands of measurements (n, B) that detect."""
        bands = np.zeros(len(measured), dtype=np.uint8)
        for band in range(measured.shape[1]):
            bands |= (measured[:, band] >= self.threshold).view(np.uint8) << np.uint8(band)
        return bands

    def strength(self, measured: FloatArray, _slopes: FloatArray) -> FloatArray:
        """Return the SNR (n,) of measurements (n, B): that of the brightest band."""
        return brightest(measured)

    def proposed(self, snr: FloatArray, _slopes: FloatArray, uniforms: FloatArray) -> FloatArray:
        """Return measurements (n, B) that detect, from numbers (n, B + 1) in [0, 1)."""
        return self.conditional(snr, snr, uniforms)

    def passing(self, _snr: FloatArray, probability: FloatArray) -> FloatArray:
        """Return the shares (n,) of proposals that detect: 1."""
        return np.ones(len(probability))

    def conditional(self, snr: FloatArray, _slopes: FloatArray, uniforms: FloatArray) -> FloatArray:
        """Return measurements (n, B) conditional on a detection, exactly, from numbers (n, B + 1)
        in [0, 1).

        The first band above the threshold is drawn from its distribution; bands before it are below
        the threshold, bands after it are free.
        """
        crossing = self._first_crossing(snr, uniforms[:, -1])
        measured = np.empty_like(snr)
        for band in range(snr.shape[1]):
            edge = self.threshold - snr[:, band]
            is_below = band < crossing
            # The distribution below a bound is the mirror image of one above.
            least = np.where(band == crossing, edge, np.where(is_below, -edge, -np.inf))
            drawn = tail_normals(least, uniforms[:, band])
            measured[:, band] = snr[:, band] + np.where(is_below, -drawn, drawn)
        # Rounding may move a crossing signal below the threshold.
        rows = np.arange(len(crossing))
        measured[rows, crossing] = np.maximum(measured[rows, crossing], self.threshold)
        return measured

    def _first_crossing(self, snr: FloatArray, uniform: FloatArray) -> IntArray:
        if snr.shape[1] == 1:
            return np.zeros(len(snr), dtype=np.int64)
        log_below = log_ndtr(self.threshold - snr)
        weight = log_ndtr(snr - self.threshold) + (np.cumsum(log_below, axis=1) - log_below)
        share = np.exp(weight - weight.max(axis=1, keepdims=True))
        cumulative = np.cumsum(share, axis=1)
        band = (uniform[:, None] * cumulative[:, -1:] >= cumulative).sum(axis=1)
        return np.minimum(band, snr.shape[1] - 1)


def brightest(measured: FloatArray) -> FloatArray:
    """Return the largest signal (n,) of rows (n, B), band by band."""
    best: FloatArray = measured[:, 0].copy()
    for band in range(1, measured.shape[1]):
        np.maximum(best, measured[:, band], out=best)
    return best


def _row_sum(columns: FloatArray) -> FloatArray:
    """Return the sums of rows, added band by band: the order does not depend on the number of
    rows.
    """
    total = columns[:, 0].copy()
    for band in range(1, columns.shape[1]):
        total += columns[:, band]
    return total


@frozen(eq=False)
class RatioGates(Gates):
    """A detection in all bands: signals at least `threshold` in one band and `coincidence` in the
    others.

    `lower` and `upper` (B,) bound the ratio of each band's irradiance to that of the band
    `reference`, whose own bounds are not used; `tolerance` is how far beyond these bounds noise may
    carry a measurement, in standard deviations. Methods take the slopes (n, 2 (B - 1)) that
    `slopes` returns: bounds on ratios of signals in units of their noise.
    """

    def log_chances(
        self, snr: FloatArray, slopes: FloatArray, slack: float = 0.0
    ) -> tuple[FloatArray, FloatArray]:
        """Return ln P_d and ln(1 - P_d) (n,) of looks with expected signals (n, B) and slopes (n, 2
        (B - 1)).

        With a `slack`, the integral is omitted where the single conditions determine P_d to within
        it.
        """
        margins = self.margins(snr, slopes)
        least = margins.min(axis=1)
        open_ = _undecided(margins, least, slack)
        log_hit = log_ndtr(least)
        log_miss = log_ndtr(-least)
        if slack >= LEAST_SLACK:
            chance = fast_probability(self, snr[open_], slopes[open_], margins[open_])
            with np.errstate(divide="ignore"):
                log_hit[open_] = np.log(chance)
                log_miss[open_] = np.log1p(-chance)
            return log_hit, log_miss
        steepest = self._steepest(margins, slopes)
        for rows in np.split(open_, range(2048, len(open_), 2048)):
            log_hit[rows], log_miss[rows] = self._integrated(
                snr[rows], slopes[rows], steepest[rows], slack
            )
        return log_hit, log_miss

    def quantile(self, snr: FloatArray, slopes: FloatArray, slack: float) -> FloatArray:
        """Return the standard normal quantiles of P_d (n,), to within a slack of P_d."""
        if slack < LEAST_SLACK:
            return probit(*self.log_chances(snr, slopes, slack))
        margins = self.margins(snr, slopes)
        quantile: FloatArray = margins.min(axis=1)
        open_ = _undecided(margins, quantile, slack)
        quantile[open_] = ndtri(fast_probability(self, snr[open_], slopes[open_], margins[open_]))
        return quantile

    def passes(self, measured: FloatArray, slopes: FloatArray) -> BoolArray:
        """Return which measurements (n, B) detect."""
        reference = measured[:, self.reference]
        passed: BoolArray = reference >= self.threshold
        for band in self.others:
            low, high = self.gate(reference, slopes, band)
            passed &= (measured[:, band] >= low) & (measured[:, band] <= high)
        return passed

    def confirming(self, measured: FloatArray) -> ByteArray:
        """Return masks (n,) of the confirming bands of measurements (n, B) that detect: all."""
        return np.full(len(measured), (1 << measured.shape[1]) - 1, dtype=np.uint8)

    def strength(self, measured: FloatArray, _slopes: FloatArray) -> FloatArray:
        """Return the SNR (n,) of measurements (n, B): that of the brightest band."""
        return brightest(measured)

    def proposed(self, snr: FloatArray, _slopes: FloatArray, uniforms: FloatArray) -> FloatArray:
        """Return measurements (n, B) above each band's own threshold, from numbers (n, B + 1) in
        [0, 1).
        """
        measured = np.empty(snr.shape)
        for band in range(snr.shape[1]):
            least = self._least(band)
            drawn = snr[:, band] + tail_normals(least - snr[:, band], uniforms[:, band])
            measured[:, band] = np.maximum(drawn, least)
        return measured

    def passing(self, snr: FloatArray, probability: FloatArray) -> FloatArray:
        """Return the shares (n,) of proposals that detect: those that also meet the ratios."""
        proposed = np.ones(len(snr))
        for band in range(snr.shape[1]):
            proposed *= ndtr(snr[:, band] - self._least(band))
        return np.minimum(probability / np.maximum(proposed, 1e-290), 1.0)

    def conditional(self, snr: FloatArray, slopes: FloatArray, uniforms: FloatArray) -> FloatArray:
        """Return measurements (n, B) conditional on a detection, exactly, from numbers (n, B + 1)
        in [0, 1).
        """
        reference = np.empty(len(snr))
        steepest = self._steepest(self.margins(snr, slopes), slopes)
        for rows, count in by_steepness(steepest):
            density = GateDensity(self, snr[rows], slopes[rows])
            # From this margin on the peak of the density is near the point where gates open.
            panels = density.panels(count, -2.0)
            base, gates = density.logarithms(panels.nodes())
            height = np.exp(base + gates - (base + gates).max(axis=1, keepdims=True))
            reference[rows] = np.maximum(panels.inverse(height, uniforms[rows, -1]), self.threshold)
        measured = np.empty_like(snr)
        measured[:, self.reference] = reference
        for band in self.others:
            low, high = self.gate(reference, slopes, band)
            expected = snr[:, band]
            noise = truncated_normals(low - expected, high - expected, uniforms[:, band])
            measured[:, band] = np.clip(expected + noise, low, np.maximum(low, high))
        return measured

    def margins(self, snr: FloatArray, slopes: FloatArray) -> FloatArray:
        """Return the margins (n, 1 + 3 · others) of the linear conditions, in standard
        deviations.
        """
        reference = snr[:, self.reference]
        margins = [reference - self.threshold]
        for band in self.others:
            margins.append(snr[:, band] - self.coincidence)
            for slope, sign in zip(self.sides(slopes, band), (1.0, -1.0), strict=True):
                with np.errstate(invalid="ignore"):
                    off = sign * (snr[:, band] - slope * reference) / np.hypot(1.0, slope)
                margins.append(np.where(np.isfinite(slope), off + self.tolerance, np.inf))
        return np.stack(margins, axis=1)

    def _least(self, band: int) -> float:
        return self.threshold if band == self.reference else self.coincidence

    def _steepest(self, margins: FloatArray, slopes: FloatArray) -> FloatArray:
        """Return the slope (n,) of the steepest side of a gate that may be open or shut."""
        steepest = np.ones(len(slopes))
        for place, band in enumerate(self.others):
            for slope, condition in zip(self.sides(slopes, band), (2, 3), strict=True):
                is_uncertain = margins[:, 3 * place + condition] < FAR
                steepest = np.maximum(steepest, np.where(is_uncertain, slope, 1.0))
        return steepest

    def _integrated(
        self, snr: FloatArray, slopes: FloatArray, steepest: FloatArray, slack: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return ln P_d and ln(1 - P_d) by the integral."""
        log_hit = np.empty(len(snr))
        log_shut = np.full(len(snr), -np.inf)
        for rows, count in by_steepness(steepest):
            density = GateDensity(self, snr[rows], slopes[rows])
            panels = density.panels(count, -np.inf if slack else 0.0)
            base, gates = density.logarithms(panels.nodes())
            log_hit[rows] = log_integral(panels, base + gates)
            if not slack:
                with np.errstate(divide="ignore"):
                    shut = np.log(-np.expm1(gates))
                log_shut[rows] = log_integral(panels, base + shut)
        log_hit = np.minimum(log_hit, 0.0)
        with np.errstate(divide="ignore"):
            log_miss = np.log1p(-np.exp(log_hit))
        if not slack:
            # A gate is shut, or the reference band is below the threshold.
            log_below = log_ndtr(self.threshold - snr[:, self.reference])
            summed = np.minimum(np.logaddexp(log_below, log_shut), 0.0)
            log_miss = np.where(log_hit < LOG_HALF, log_miss, summed)
        return log_hit, log_miss


def _undecided(margins: FloatArray, least: FloatArray, slack: float) -> IntArray:
    """Return the rows whose P_d the single conditions do not determine to within a slack."""
    rows = np.flatnonzero((least < FAR) & (least >= (ndtri(slack) if slack else -np.inf)))
    if not slack:
        return rows
    failing = ndtr(-margins[rows, 0])
    for condition in range(1, margins.shape[1]):
        failing += ndtr(-margins[rows, condition])
    # P_d is at most the least probability of a condition; the probability of any failure is at most
    # the sum.
    is_known = (failing - ndtr(-least[rows]) <= slack) & (failing < 1.0)
    return rows[~is_known]
