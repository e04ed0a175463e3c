"""When a burn ends, from the looks that detect and those that do not.

Light that was seen says that the burn lasted to then; each look after it that saw nothing is as improbable as a missed
detection if the burn went on. The fit's normal distribution of the end of the burn times that likelihood is no normal
distribution; its mean and variance are taken over by quadrature, which for those two is exact.
"""

from typing import NamedTuple

import numpy as np
from attrs import frozen

from opir_core.records import FloatArray, IntArray

#: The chance that a sensor stops to see a burning target for a reason of its own, between two looks.
_LOST = 1e-5

#: Places of the quadrature, and the finest distance between them, s.
_PLACES, _FINEST_S = 96, 0.02

#: Beyond so many standard deviations an end is out of the question.
_FAR = 5.0


@frozen(eq=False)
class Silence:
    """What sensors saw last of n hypotheses' burns, (n, sensors): nan where they saw nothing at all.

    `last_s` is when the last light left, `until_s` to when light could have been seen since, `chance` that of a
    detection in a look and `period_s` (sensors,) the time between looks.
    """

    last_s: FloatArray
    until_s: FloatArray
    chance: FloatArray
    period_s: FloatArray

    def take(self, rows: IntArray) -> "Silence":
        """Return the silence of some hypotheses."""
        return Silence(self.last_s[rows], self.until_s[rows], self.chance[rows], self.period_s)


class Ends(NamedTuple):
    """Means, s, and variances (n,), s², of the ends of burns, and the logarithms of the likelihoods (n,)."""

    mean_s: FloatArray
    variance_s2: FloatArray
    evidence: FloatArray


def ends_of(mean_s: FloatArray, variance_s2: FloatArray, silence: Silence) -> Ends:
    """Return the ends of burns that the fit holds for normal (n,), given the silence."""
    sigma = np.sqrt(variance_s2)
    last = np.max(np.where(np.isfinite(silence.last_s), silence.last_s, -np.inf), axis=1, initial=-np.inf)
    until = np.max(np.where(np.isfinite(silence.last_s), silence.until_s, -np.inf), axis=1, initial=-np.inf)
    near = np.flatnonzero(np.isfinite(last) & (mean_s - _FAR * sigma < np.maximum(last, until)))
    mean, variance = mean_s.copy(), variance_s2.copy()
    evidence = sum(_log_silence(silence, each, mean_s[:, None])[:, 0] for each in range(silence.last_s.shape[1]))
    evidence = np.zeros(len(mean_s)) + evidence
    if len(near):
        part = silence.take(near)
        found = _moments(mean_s[near], sigma[near], last[near], until[near], part)
        mean[near], variance[near], evidence[near] = found
    return Ends(mean, variance, evidence)


def _moments(
    mean: FloatArray, sigma: FloatArray, last: FloatArray, until: FloatArray, silence: Silence
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return means, variances and log likelihoods of n burns, over ends e = last + fine (e^x - 1), x evenly spaced."""
    reach = np.maximum(np.maximum(mean + 6.0 * sigma, until) - last, sigma) + 1.0
    top = np.log1p(reach / _FINEST_S)
    x = (np.arange(_PLACES) + 0.5) / _PLACES * top[:, None]
    after = _FINEST_S * np.expm1(x)
    log = np.log(_FINEST_S * np.exp(x) * (top / _PLACES)[:, None])
    log = log - 0.5 * np.square((last[:, None] + after - mean[:, None]) / sigma[:, None])
    for sensor in range(silence.last_s.shape[1]):
        log = log + _log_silence(silence, sensor, last[:, None] + after)
    most = log.max(axis=1)
    share = np.exp(log - most[:, None])
    total = share.sum(axis=1)
    middle = (share * after).sum(axis=1) / total
    variance = (share * np.square(after - middle[:, None])).sum(axis=1) / total
    evidence = most + np.log(total) - np.log(sigma * np.sqrt(2.0 * np.pi))
    return last + middle, np.maximum(variance, _FINEST_S**2), evidence


def _log_silence(silence: Silence, sensor: int, end: FloatArray) -> FloatArray:
    """Return the log likelihoods (n, places) of a sensor's silence, were the burns to end then."""
    known = np.isfinite(silence.last_s[:, sensor, None])
    last, until = (np.nan_to_num(v[:, sensor, None]) for v in (silence.last_s, silence.until_s))
    missed = np.maximum(np.floor((np.minimum(end, until) - last) / silence.period_s[sensor] + 1e-6), 0.0)
    log = np.logaddexp(missed * np.log1p(-silence.chance[:, sensor, None]), np.log(_LOST))
    return np.where(known, log, 0.0)
