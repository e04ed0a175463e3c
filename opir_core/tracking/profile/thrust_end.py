"""States at a tick before which a burn may just have ended: moments over when it did.

A target whose burn ended a moment ago flies free: it is slower than one that still burns by what the thrust would have
added since. Slopes by the parameters know nothing of this: they are those of a burn that goes on, or of one that is
over. Within a few looks nobody can tell which it is; the state then has the moments of both, by the distribution of
the end (`end`).
"""

import math

import numpy as np

from opir_core.constants import EARTH_MU_M3_S2, EARTH_ROTATION_RAD_S
from opir_core.records import FloatArray, IntArray
from opir_core.tracking.profile import flight
from opir_core.tracking.profile.end import DEVIATES
from opir_core.tracking.profile.family import BURN, SIZE, START, Priors
from opir_core.tracking.profile.fit import Hypotheses, family_of
from opir_core.tracking.profile.flight import Moments

#: Ends of the burn that stand for its distribution, of like shares.
_ENDS = 128


def with_ends(
    state: Moments,
    hypotheses: Hypotheses,
    start_s: FloatArray,
    burn_s: FloatArray,
    tick_s: float,
    priors: Priors,
) -> Moments:
    """Return states (n, 6) at a tick; of burns that may have ended before it, or not, the moments over both.

    `start_s` and `burn_s` (n,) are the hypotheses' own.
    """
    by_end = np.zeros((len(hypotheses), SIZE))
    by_end[:, START], by_end[:, BURN] = 1.0 / burn_s, 1.0
    gain = np.sum(hypotheses.spread * by_end[:, None], axis=2)
    sigma = np.sqrt(np.maximum(np.sum(gain * by_end, axis=1), 1e-30))
    deviate = _ends_of(hypotheses.end_quantiles)
    since_s = tick_s - start_s[:, None] - burn_s[:, None] * np.exp(sigma[:, None] * deviate)
    rows = np.flatnonzero((since_s > 0.0).any(axis=1) & (since_s < 0.0).any(axis=1) & (start_s < tick_s))
    if not len(rows):
        return state
    mean, covariance = state.mean.copy(), state.covariance.copy()
    parts = gain[rows] / sigma[rows, None], deviate[rows], np.maximum(since_s[rows], 0.0)
    mean[rows], covariance[rows] = _both(hypotheses.take(rows), *parts, tick_s, priors)
    return Moments(mean, covariance)


def _both(
    hypotheses: Hypotheses, gain: FloatArray, deviate: FloatArray, since_s: FloatArray, tick_s: float, priors: Priors
) -> tuple[FloatArray, FloatArray]:
    """Return means (n, 6) and covariances (n, 6, 6) of states over ends that were `since_s` (n, ends) ago, or come yet.

    `gain` (n, 10) is by what the parameters go along with ends, which are at `deviate` (n, ends) standard deviations.
    """
    burning, slope, acceleration = flight.burning_states(family_of(hypotheses, priors), tick_s)
    thrust = (acceleration - _free_fall(burning))[:, None]
    lost_s = since_s[:, :, None]
    less = np.concatenate([0.5 * np.square(lost_s) * thrust, lost_s * thrust], axis=2)
    middle = less.mean(axis=1)
    apart = less - middle[:, None]
    total = slope @ hypotheses.spread @ slope.transpose(0, 2, 1) + apart.transpose(0, 2, 1) @ apart / _ENDS
    # What else is known of the path goes along with its end, and so has a part in both.
    with_end = np.sum(slope * gain[:, None], axis=2)
    mixed = with_end[:, :, None] * np.mean(deviate[:, :, None] * apart, axis=1)[:, None]
    total = total - mixed - mixed.transpose(0, 2, 1)
    return burning - middle, 0.5 * (total + total.transpose(0, 2, 1))


def _free_fall(state: FloatArray) -> FloatArray:
    """Return the accelerations (n, 3), ECEF, of states (n, 6) in free flight about a round Earth that turns."""
    place, velocity = state[:, :3], state[:, 3:]
    distance = np.sqrt(np.sum(place * place, axis=1))[:, None]
    turn = EARTH_ROTATION_RAD_S
    found: FloatArray = -EARTH_MU_M3_S2 * place / distance**3
    found[:, 0] += turn * turn * place[:, 0] + 2.0 * turn * velocity[:, 1]
    found[:, 1] += turn * turn * place[:, 1] - 2.0 * turn * velocity[:, 0]
    return found


def _ends_of(quantiles: FloatArray) -> FloatArray:
    """Return places (n, ends) of like shares of distributions of quantiles (n, deviates), straight in between."""
    found: FloatArray = quantiles[:, _BEFORE] + _PART * (quantiles[:, _BEFORE + 1] - quantiles[:, _BEFORE])
    return found


def _places() -> tuple[IntArray, FloatArray]:
    """Return between which deviates the ends are, and how far on."""
    fine = np.linspace(DEVIATES[0], DEVIATES[-1], 1201)
    shares = [0.5 * math.erfc(-each / math.sqrt(2.0)) for each in fine.tolist()]
    deviate = np.interp((np.arange(_ENDS) + 0.5) / _ENDS, shares, fine)
    place = (deviate - DEVIATES[0]) / (DEVIATES[1] - DEVIATES[0])
    before = place.astype(np.int64)
    return before, place - before


_BEFORE, _PART = _places()
