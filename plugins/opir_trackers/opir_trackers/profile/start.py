"""When a boost started, from when it was seen first.

Nothing is seen of a boost before it starts, and not at once: clouds hide it for a time that is half normal. The fit's
normal distribution of the start times what that says of it is truncated; its mean and variance are taken over.
"""

from typing import NamedTuple

import numpy as np

from opir_core.arrays import FloatArray
from opir_trackers.profile.family import START, Priors
from opir_trackers.profile.fit import Hypotheses, Solved
from opir_trackers.profile.seen import TrackHistory

#: The chance that what counts as a boost's first light was none of it: its start may then as well come later.
_STRAY = 0.01

#: From here on, in standard deviations, a normal distribution's tail is told by its asymptotic series.
_FAR = 12.0


def started(hypotheses: Hypotheses, solution: Solved, priors: Priors, seen: TrackHistory) -> Solved:
    """Return the solution, its covariance grown by its misfit, given what the first light says of the start."""
    first_s = np.min(seen.of(hypotheses.track).first_s, axis=1) - hypotheses.anchor_s
    spread = solution.spread * solution.misfit[:, None, None]
    mean, variance = solution.parameters[:, START], spread[:, START, START]
    starts = starts_of(mean, variance, first_s, priors.take(hypotheses.kind).hidden_s)
    gain = spread[:, START] / variance[:, None]
    less = (variance - starts.variance)[:, None, None]
    return Solved(
        solution.parameters + gain * (starts.mean - mean)[:, None],
        spread - less * gain[:, :, None] * gain[:, None, :],
        solution.evidence + starts.evidence,
        solution.misfit,
    )


class Starts(NamedTuple):
    """Starts: means, s, and variances (n,), the logarithms of the likelihoods (n,), and chances (n,) of `stray`.

    That is that what counts as the first light was another's, and tells nothing of the start.
    """

    mean: FloatArray
    variance: FloatArray
    evidence: FloatArray
    stray: FloatArray


def starts_of(mean: FloatArray, variance: FloatArray, first_s: FloatArray, hidden_s: FloatArray) -> Starts:
    """Return when boosts (n,) started that were seen first at `first_s`, (n,) each.

    `mean` and `variance` are the fit's, s, under a prior of the start that is normal about 0, of the standard deviation
    `hidden_s`. In its place comes one that is as wide before the first light, and nothing after it; or, for that
    light may not have been the boost's, as it was.
    """
    width = np.square(hidden_s)
    # The posterior goes with the time u before the first light like exp(-u² / 2 variance - u slope), times this height.
    height = 0.5 * (np.square(first_s) / width - np.square(first_s - mean) / variance - np.log(0.5 * np.pi * variance))
    before = _half_line((mean - first_s) / variance + first_s / width, 1.0 / variance)
    log = np.stack([height + before.log + np.log1p(-_STRAY), np.full(len(mean), np.log(_STRAY))])
    evidence = np.logaddexp(*log)
    share = np.exp(log - evidence)
    middles = np.stack([first_s - before.mean, mean])
    middle = np.sum(share * middles, axis=0)
    within = np.stack([before.variance, variance]) + np.square(middles - middle)
    return Starts(middle, np.sum(share * within, axis=0), evidence, share[1])


class _HalfLine(NamedTuple):
    """Of distributions (n,) over positive numbers: the logarithm of the integral, mean and variance."""

    log: FloatArray
    mean: FloatArray
    variance: FloatArray


def _half_line(slope: FloatArray, curvature: FloatArray) -> _HalfLine:
    """Return what becomes of exp(-curvature u² / 2 - slope u) over positive u."""
    from scipy.special import log_ndtr

    sigma = 1.0 / np.sqrt(curvature)
    z = slope * sigma
    near = np.minimum(z, _FAR)
    log = log_ndtr(-near) + 0.5 * np.square(near) + 0.5 * np.log(2.0 * np.pi)
    hazard = np.exp(-log)
    mean, variance = hazard - near, 1.0 - hazard * (hazard - near)
    is_far, inverse = z > _FAR, 1.0 / np.square(np.maximum(z, _FAR))
    log = np.where(is_far, np.log(np.sqrt(inverse) * (1.0 - inverse * (1.0 - 3.0 * inverse))), log)
    mean = np.where(is_far, np.sqrt(inverse) * (1.0 - inverse * (2.0 - 10.0 * inverse)), mean)
    variance = np.where(is_far, inverse * (1.0 - inverse * (6.0 - 50.0 * inverse)), variance)
    return _HalfLine(log + np.log(sigma), sigma * mean, np.square(sigma) * variance)
