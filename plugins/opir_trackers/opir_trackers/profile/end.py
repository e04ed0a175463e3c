"""When a burn ends, from the looks that detect and those that do not.

Light that was seen says that the burn lasted to then; each look after it that saw nothing is as improbable as a missed
detection if the burn went on. The fit's normal distribution of the logarithm of the burn's length times that likelihood
is no normal distribution; its mean and variance are taken over by quadrature, which for those two is exact.
"""

import math
from typing import NamedTuple

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray, IntArray

#: How often a sensor stops to see a burning target for a reason of its own, 1/s: once in ten days; notional.
_LOST_PER_S = 1e-6

#: That a sensor stopped for a reason of its own, and a burn may so go on, is left out where it is less probable.
_LEAST = 1e-3

#: Places of the quadrature, and the finest distance between them, s.
_PLACES, _FINEST_S = 128, 0.02

#: No end is known better than this, s: the rounding of the quadrature.
_SHARPEST_S = 0.002

#: Nodes of Gauss's rule for what depends on the end of a burn.
RULE = 5

#: Quantiles of an end are told at the shares that a normal distribution has below these, standard deviations.
DEVIATES = np.linspace(-3.0, 3.0, 13)
_SHARES = np.array([0.5 * math.erfc(-each / math.sqrt(2.0)) for each in DEVIATES])

#: Beyond so many standard deviations an end is out of the question.
_FAR = 5.0

#: A fit that knows the logarithm of a burn's length no better than this, or has it beyond that, has run away: its end
#: stays what the fit says.
_VAGUE, _LONGEST = 2.0, 20.0


@frozen(eq=False)
class Silence:
    """What sensors saw last of n hypotheses' burns, (n, sensors): nan where they saw nothing at all.

    `last_s` is when the last light left, `until_s` before when light could have been seen since (a look at a tick is
    the next tick's), `chance` that of a detection in a look and `period_s` (sensors,) the time between looks.
    """

    last_s: FloatArray
    until_s: FloatArray
    chance: FloatArray
    period_s: FloatArray

    def take(self, rows: IntArray) -> "Silence":
        """Return the silence of some hypotheses."""
        return Silence(self.last_s[rows], self.until_s[rows], self.chance[rows], self.period_s)


class BurnEnds(NamedTuple):
    """Burns' lengths: means and variances (n,) of their logarithms, and the logarithms of the likelihoods (n,).

    `nodes` and `weights` (n, nodes) are Gauss's rule for their distribution, of mean 0 and variance 1: what is taken
    over the end of a burn needs no more than these places. `quantiles` (n, deviates) are those of the shares that a
    normal distribution has below `DEVIATES`, so scaled too: of a normal distribution they are the `DEVIATES`.
    """

    mean: FloatArray
    variance: FloatArray
    evidence: FloatArray
    nodes: FloatArray
    weights: FloatArray
    quantiles: FloatArray


def ends_of(start_s: FloatArray, mean: FloatArray, variance: FloatArray, silence: Silence) -> BurnEnds:
    """Return the ends of burns from starts (n,), the logarithms of whose lengths the fit holds for normal (n,)."""
    sigma = np.sqrt(variance)
    last = np.max(np.where(np.isfinite(silence.last_s), silence.last_s, -np.inf), axis=1, initial=-np.inf)
    until = np.max(np.where(np.isfinite(silence.last_s), silence.until_s, -np.inf), axis=1, initial=-np.inf)
    length = np.clip(mean, -_LONGEST, _LONGEST)
    told = (sigma < _VAGUE) & (length == mean)
    early = start_s + np.exp(length - _FAR * np.minimum(sigma, _VAGUE))
    near = np.flatnonzero(told & np.isfinite(last) & (early < np.maximum(last, until)) & (last > start_s))
    middle = (start_s + np.exp(length))[:, None]
    evidence = sum(_log_silence(silence, each, middle)[0][:, 0] for each in range(silence.last_s.shape[1]))
    found = BurnEnds(
        mean.copy(),
        variance.copy(),
        np.zeros(len(mean)) + evidence,
        *normal_rule(len(mean)),
        normal_quantiles(len(mean)),
    )
    if len(near):
        part = _moments(start_s[near], mean[near], sigma[near], last[near], until[near], silence.take(near))
        for whole, some in zip(found, part, strict=True):
            whole[near] = some
    return found


def normal_rule(count: int) -> tuple[FloatArray, FloatArray]:
    """Return nodes and weights (n, nodes) of Gauss and Hermite's rule."""
    from numpy.polynomial.hermite_e import hermegauss

    nodes, weights = hermegauss(RULE)
    return np.tile(nodes, (count, 1)), np.tile(weights / weights.sum(), (count, 1))


def normal_quantiles(count: int) -> FloatArray:
    """Return the quantiles (n, deviates) of normal distributions."""
    return np.tile(DEVIATES, (count, 1))


def _moments(
    start: FloatArray, mean: FloatArray, sigma: FloatArray, last: FloatArray, until: FloatArray, silence: Silence
) -> BurnEnds:
    """Return the ends of n burns, by quadrature over ends e = last + fine (e^x - 1), x evenly spaced."""
    latest = np.maximum(start + np.exp(mean + 6.0 * sigma), until)
    reach = np.maximum(latest - last, sigma * (last - start)) + 1.0
    top = np.log1p(reach / _FINEST_S)
    x = (np.arange(_PLACES) + 0.5) / _PLACES * top[:, None]
    after = _FINEST_S * np.expm1(x)
    burn = (last - start)[:, None] + after
    length = np.log(burn)
    log = np.log(_FINEST_S * np.exp(x) * (top / _PLACES)[:, None] / burn)
    log = log - 0.5 * np.square((length - mean[:, None]) / sigma[:, None])
    log, evidence = _seen(log, silence, last[:, None] + after)
    share = np.exp(log)
    middle = (share * length).sum(axis=1)
    apart = length - middle[:, None]
    variance = (share * np.square(apart)).sum(axis=1)
    evidence = evidence - np.log(sigma * np.sqrt(2.0 * np.pi))
    scale = np.sqrt(np.maximum(variance, 1e-30))[:, None]
    rule = gauss_rule(apart / scale, share, RULE)
    x = _quantiles(share) / _PLACES * top[:, None]
    quantiles = (np.log((last - start)[:, None] + _FINEST_S * np.expm1(x)) - middle[:, None]) / scale
    return BurnEnds(middle, np.maximum(variance, np.square(_SHARPEST_S / (last - start))), evidence, *rule, quantiles)


def _quantiles(share: FloatArray) -> FloatArray:
    """Return how many places (n, deviates) hold the shares `_SHARES` of distributions over places (n, m)."""
    count, places = share.shape
    below = np.cumsum(share, axis=1)
    # What is not known must not put others' sums out of order.
    below = np.nan_to_num(below / below[:, -1:], nan=1.0)
    # One search for all rows: each row's sums stand a whole above those before it.
    row = np.arange(count)[:, None]
    sought = np.searchsorted((below + row).ravel(), (_SHARES + row).ravel()).reshape(count, -1) - places * row
    place = np.clip(sought, 0, places - 1)
    before = np.where(place > 0, np.take_along_axis(below, np.maximum(place - 1, 0), axis=1), 0.0)
    within = (_SHARES - before) / np.maximum(np.take_along_axis(below, place, axis=1) - before, 1e-300)
    found: FloatArray = place + np.clip(within, 0.0, 1.0)
    return found


def gauss_rule(value: FloatArray, share: FloatArray, nodes: int) -> tuple[FloatArray, FloatArray]:
    """Return Gauss's rule, nodes and weights (n, nodes), of distributions over places (n, m), of mean 0 and variance 1.

    The recurrence of the orthogonal polynomials is Stieltjes's; nodes are the eigenvalues of its Jacobi matrix (Golub
    and Welsch, Math. Comp. 23, 1969, 221).
    """
    count = len(value)
    matrix = np.zeros((count, nodes, nodes))
    before, here, size = np.zeros_like(value), np.ones_like(value), np.ones(count)
    squared = np.zeros(count)
    for order in range(nodes):
        square = share * here * here
        norm = square.sum(axis=1)
        if order:
            squared = norm / size
            matrix[:, order, order - 1] = matrix[:, order - 1, order] = np.sqrt(np.maximum(squared, 0.0))
        shift = (square * value).sum(axis=1) / np.maximum(norm, 1e-300)
        matrix[:, order, order] = shift
        before, here, size = here, (value - shift[:, None]) * here - squared[:, None] * before, np.maximum(norm, 1e-300)
    node, axes = np.linalg.eigh(matrix)
    return node, np.square(axes[:, 0])


def _seen(log: FloatArray, silence: Silence, end: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the logarithms of shares (n, places) of ends, from those the fit has, and of their sums (n,).

    A sensor that may have stopped to see lets a burn go on for as long as the fit leaves open: a tail so far off that
    it outweighs all the rest in the variance, however small its chance. As any hypothesis it is left out if improbable.
    """
    told = [_log_silence(silence, sensor, end) for sensor in range(silence.last_s.shape[1])]
    whole, total = _normalised(log + sum(each for each, _ in told))
    for every, missed in told:
        lost = np.sum(np.exp(whole) * -np.expm1(missed - every), axis=1)
        log = log + np.where(lost[:, None] < _LEAST, missed, every)
    return _normalised(log)[0], total


def _normalised(log: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the logarithms of shares (n, places) that add up to 1, and of what they added up to (n,)."""
    most = log.max(axis=1)
    total: FloatArray = most + np.log(np.exp(log - most[:, None]).sum(axis=1))
    return log - total[:, None], total


def _log_silence(silence: Silence, sensor: int, end: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the log likelihoods (n, places) of a sensor's silence, were the burns to end then; and of missed looks."""
    known = np.isfinite(silence.last_s[:, sensor, None])
    last, until = (np.nan_to_num(v[:, sensor, None]) for v in (silence.last_s, silence.until_s))
    missed = np.maximum(np.floor((np.minimum(end, until) - last) / silence.period_s[sensor] - 1e-6), 0.0)
    log = np.where(known, missed * np.log1p(-silence.chance[:, sensor, None]), 0.0)
    return np.where(known, np.logaddexp(log, np.log(_LOST_PER_S * silence.period_s[sensor])), 0.0), log
