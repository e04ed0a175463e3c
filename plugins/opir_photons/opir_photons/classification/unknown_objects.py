"""The density of unknown objects: broad in the same measurements as those of the classes and sources,
and sharp nowhere.

Its apparent intensity is uniform in the logarithm in each band by itself, and so are its colours;
the number of its detections is uniform in the logarithm, up to those of a day. A measurement that no
other density explains raises its share.
"""

from functools import cache

import numpy as np

from opir_core.arrays import FloatArray

#: Least and largest intensity, W/sr: decades below and above those of all classes and sources;
#: notional.
LEAST_W_SR = 1.0
MOST_W_SR = 1e9

#: Length of the range of intensities in their logarithm.
_LENGTH = float(np.log(MOST_W_SR / LEAST_W_SR))

#: Share of the noise below which intensities count as 0; number of deviations from which on noise
#: is a small correction.
_DARK = 0.01
_BRIGHT = 8.0


def log_unknown(
    signal: FloatArray, variance: FloatArray, count: FloatArray, looks_per_day: float
) -> FloatArray:
    """Return ln (n,) of the number of detections, for each object, of intensities (n, B), W/sr, and
    counts (n,).

    The noise of the intensities has the variances (n, B).
    """
    lasting = 1.0 - np.log(np.maximum(count, 1.0)) / np.log(max(looks_per_day, 2.0))
    # Objects of more than a day are a thousandth.
    density = np.log(np.maximum(lasting, 1e-3))
    for band in range(signal.shape[1]):
        density = density + log_uniform_in_noise(signal[:, band], variance[:, band])
    return density


def log_uniform_in_noise(measured: FloatArray, variance: FloatArray) -> FloatArray:
    """Return ln (n,) of the density of an intensity s, with d ln s uniform between the limits,
    measured in noise.

    With u = y/σ it is φ(u) (ln(0.01 σ/least) + ∫ exp(u t - t²/2) dt/t) / (σ length), t from 0.01
    on; for large u (1 + 1/u² + 3/u⁴) / (y length), the moments of 1/s.
    """
    sigma = np.sqrt(np.maximum(variance, 1e-12))
    u = measured / sigma
    dark = np.clip(np.log(_DARK * sigma / LEAST_W_SR), 0.0, _LENGTH)
    faint = np.minimum(u, _BRIGHT)
    integral = np.log(dark + np.exp(np.interp(faint, *_log_integral())))
    of_faint = -0.5 * faint * faint - 0.5 * float(np.log(2.0 * np.pi)) + integral
    of_bright = _log_of_bright(np.maximum(u, _BRIGHT))
    return np.where(u <= _BRIGHT, of_faint, of_bright) - np.log(sigma) - np.log(_LENGTH)


def _log_of_bright(u: FloatArray) -> FloatArray:
    inverse = 1.0 / np.square(u)
    return np.log1p(inverse + 3.0 * inverse * inverse) - np.log(u)


@cache
def _log_integral() -> tuple[FloatArray, FloatArray]:
    """Return ln ∫ exp(u t - t²/2) dt/t, t from 0.01 on, at u from -8 to 8 (n,)."""
    u = np.linspace(-_BRIGHT, _BRIGHT, 321)
    log_t = np.linspace(np.log(_DARK), np.log(40.0), 4001)
    t = np.exp(log_t)
    return u, np.log(np.trapezoid(np.exp(u[:, None] * t - 0.5 * t * t), log_t, axis=1))
