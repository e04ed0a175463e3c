"""The rules `dual-band-ratio` and `triple-coincidence`: a reference band crosses the threshold, the others fit it.

With y the measured signal of the reference band and x_b those of the others, each in standard deviations of its own
noise, a look detects where y >= T and, for every other band, x_b >= C and lower_b <= (x_b · noise_b) / (y · noise_r) <=
upper_b. Given y the other bands are independent, so the probability is one integral over y, of the normal density times
the chance of each band to fall through its gate; it is evaluated on Gauss-Legendre panels. Where the chances of each
condition alone already fix the probability, no integral is evaluated.
"""

import numpy as np
from attrs import frozen
from numpy.typing import NDArray

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.detection.gate_density import FAR, LOG_HALF, GateDensity, by_steepness, log_integral
from opir_core.detection.quick_gates import quick_chances
from opir_core.detection.redrawing import tail_normals, truncated_normals
from opir_core.detection.threshold import probit

#: From such a slack on, the quick way is near enough.
LEAST_SLACK = 1e-9
#: With gates shut by no more than this, the density is still all but within the panels about where it would be open.
_AJAR = -2.0
#: A chance so small that what it divides counts for nothing.
_NEVER = 1e-290
#: Rows integrated at once.
_ROWS = 2048


@frozen(eq=False)
class RatioGates:
    """`lower` and `upper` (B,) bound the irradiance of each band over that of `reference`; nothing bounds itself."""

    threshold: float
    coincidence: float
    reference: int
    lower: FloatArray
    upper: FloatArray

    @property
    def others(self) -> list[int]:
        """Return the bands beside the reference."""
        return [band for band in range(len(self.lower)) if band != self.reference]

    def log_chances(self, snr: FloatArray, noise: FloatArray, slack: float = 0.0) -> tuple[FloatArray, FloatArray]:
        """Return ln P_d and ln(1 - P_d) (n,) of looks with expected signals (n, B) in noise (n, B), W/m².

        With a `slack`, the integral is left out where each condition's own chance says P_d to within it.
        """
        from scipy.special import log_ndtr

        margins = self.margins(snr, noise)
        least = margins.min(axis=1)
        open_ = _undecided(margins, least, slack)
        log_hit, log_miss = log_ndtr(least), log_ndtr(-least)
        if slack >= LEAST_SLACK:
            chance = quick_chances(self, snr[open_], noise[open_], margins[open_])
            with np.errstate(divide="ignore"):
                log_hit[open_], log_miss[open_] = np.log(chance), np.log1p(-chance)
            return log_hit, log_miss
        steepest = self._steepest(margins, noise)
        for start in range(0, len(open_), _ROWS):
            rows = open_[start : start + _ROWS]
            log_hit[rows], log_miss[rows] = self._integrated(snr[rows], noise[rows], steepest[rows], slack)
        return log_hit, log_miss

    def quantile(self, snr: FloatArray, noise: FloatArray, slack: float) -> FloatArray:
        """Return the standard normal quantiles of P_d (n,), to within a slack of P_d."""
        from scipy.special import ndtri

        if slack < LEAST_SLACK:
            return probit(*self.log_chances(snr, noise, slack))
        margins = self.margins(snr, noise)
        quantile: FloatArray = margins.min(axis=1)
        open_ = _undecided(margins, quantile, slack)
        quantile[open_] = ndtri(quick_chances(self, snr[open_], noise[open_], margins[open_]))
        return quantile

    def passes(self, measured: FloatArray, noise: FloatArray) -> BoolArray:
        """Return which measurements (n, B) detect."""
        reference = measured[:, self.reference]
        passed: BoolArray = reference >= self.threshold
        reference_w_m2 = reference * noise[:, self.reference]
        for band in self.others:
            passed &= measured[:, band] >= self.coincidence
            measured_w_m2 = measured[:, band] * noise[:, band]
            if self.lower[band] > 0.0:
                passed &= measured_w_m2 >= self.lower[band] * reference_w_m2
            if np.isfinite(self.upper[band]):
                passed &= measured_w_m2 <= self.upper[band] * reference_w_m2
        return passed

    def confirming(self, measured: FloatArray) -> NDArray[np.uint8]:
        """Return masks (n,) of the bands that confirm, in measurements (n, B) that detect: all do."""
        return np.full(len(measured), (1 << measured.shape[1]) - 1, dtype=np.uint8)

    def proposed(self, snr: FloatArray, uniforms: FloatArray) -> FloatArray:
        """Return measurements (n, B) above each band's own threshold, from numbers (n, B + 1) in [0, 1)."""
        measured = np.empty(snr.shape)
        for band in range(snr.shape[1]):
            least = self._least(band)
            drawn = snr[:, band] + tail_normals(least - snr[:, band], uniforms[:, band])
            measured[:, band] = np.maximum(drawn, least)
        return measured

    def passing(self, snr: FloatArray, probability: FloatArray) -> FloatArray:
        """Return which share (n,) of proposals detects: the ratios are all they have still to meet."""
        from scipy.special import ndtr

        proposed = np.ones(len(snr))
        for band in range(snr.shape[1]):
            proposed *= ndtr(snr[:, band] - self._least(band))
        return np.minimum(probability / np.maximum(proposed, _NEVER), 1.0)

    def conditional(self, snr: FloatArray, noise: FloatArray, uniforms: FloatArray) -> FloatArray:
        """Return measurements (n, B) conditional on a detection, exactly, from numbers (n, B + 1) in [0, 1)."""
        reference = np.empty(len(snr))
        steepest = self._steepest(self.margins(snr, noise), noise)
        for rows, count in by_steepness(steepest):
            density = GateDensity(self, snr[rows], noise[rows])
            panels = density.panels(count, _AJAR)
            base, gates = density.logarithms(panels.nodes())
            height = np.exp(base + gates - (base + gates).max(axis=1, keepdims=True))
            reference[rows] = np.maximum(panels.inverse(height, uniforms[rows, -1]), self.threshold)
        measured, density = np.empty_like(snr), GateDensity(self, snr, noise)
        measured[:, self.reference] = reference
        for band in self.others:
            low, high = density.gate(reference, band)
            drawn = snr[:, band] + truncated_normals(low - snr[:, band], high - snr[:, band], uniforms[:, band])
            measured[:, band] = np.clip(drawn, low, np.maximum(low, high))
        return measured

    def margins(self, snr: FloatArray, noise: FloatArray) -> FloatArray:
        """Return by how many standard deviations each condition (n, 1 + 3 · others) is met: all are linear."""
        reference = snr[:, self.reference]
        margins = [reference - self.threshold]
        for band in self.others:
            steep = noise[:, self.reference] / noise[:, band]
            margins.append(snr[:, band] - self.coincidence)
            for bound, sign in ((self.lower[band], 1.0), (self.upper[band], -1.0)):
                slope = bound * steep
                is_bound = np.isfinite(bound)
                off = sign * (snr[:, band] - slope * reference) / np.hypot(1.0, slope) if is_bound else np.inf
                margins.append(np.broadcast_to(off, reference.shape))
        return np.stack(margins, axis=1)

    def _least(self, band: int) -> float:
        return self.threshold if band == self.reference else self.coincidence

    def _steepest(self, margins: FloatArray, noise: FloatArray) -> FloatArray:
        """Return the slope (n,) of the steepest side of a gate that is neither open nor shut for sure."""
        steepest = np.ones(len(noise))
        for place, band in enumerate(self.others):
            steep = noise[:, self.reference] / noise[:, band]
            for bound, condition in ((self.lower[band], 2), (self.upper[band], 3)):
                is_near = margins[:, 3 * place + condition] < FAR
                steepest = np.maximum(steepest, np.where(is_near, steep * max(bound, 0.0), 1.0))
        return steepest

    def _integrated(
        self, snr: FloatArray, noise: FloatArray, steepest: FloatArray, slack: float
    ) -> tuple[FloatArray, FloatArray]:
        """Return ln P_d and ln(1 - P_d) by the integral."""
        log_hit, log_missed = np.empty(len(snr)), np.full(len(snr), -np.inf)
        for rows, count in by_steepness(steepest):
            density = GateDensity(self, snr[rows], noise[rows])
            panels = density.panels(count, -np.inf if slack else 0.0)
            base, gates = density.logarithms(panels.nodes())
            log_hit[rows] = log_integral(panels, base + gates)
            if slack:
                continue
            with np.errstate(divide="ignore"):
                shut = np.log(-np.expm1(gates))
            log_missed[rows] = log_integral(panels, base + shut)
        hit = np.minimum(log_hit, 0.0)
        with np.errstate(divide="ignore"):
            left = np.log1p(-np.exp(hit))
        return hit, left if slack else np.where(hit < LOG_HALF, left, self._missed(log_missed, snr))

    def _missed(self, log_shut: FloatArray, snr: FloatArray) -> FloatArray:
        """Return ln(1 - P_d): gates that are shut, or a signal of the reference band below the threshold."""
        from scipy.special import log_ndtr

        added: FloatArray = np.logaddexp(log_ndtr(self.threshold - snr[:, self.reference]), log_shut)
        return np.minimum(added, 0.0)


def _undecided(margins: FloatArray, least: FloatArray, slack: float) -> IntArray:
    """Return the rows of which the conditions' own chances do not say P_d to within a slack."""
    from scipy.special import ndtr, ndtri

    rows = np.flatnonzero((least < FAR) & (least >= (ndtri(slack) if slack else -np.inf)))
    if not slack:
        return rows
    failing = ndtr(-margins[rows, 0])
    for condition in range(1, margins.shape[1]):
        failing += ndtr(-margins[rows, condition])
    # P_d is at most the chance of the condition nearest to failing, and all fail less often than their sum.
    sure = (failing - ndtr(-least[rows]) <= slack) & (failing < 1.0)
    undecided: IntArray = rows[~sure]
    return undecided
