"""States at a tick before which a burn may just have ended: moments over when it did.

A target whose burn ended a moment ago flies free: it is slower than one that still burns by what the thrust would have
added since. Slopes by the parameters know nothing of this: they are those of a burn that goes on, or of one that is
over. Within a few looks nobody can tell which it is; the state then has the moments of both, by the distribution of
the end (`end`).
"""

import math

import numpy as np

from opir_core.arrays import FloatArray, IntArray
from opir_core.constants import EARTH_MU_M3_S2, EARTH_ROTATION_RAD_S
from opir_trackers.profile import flight
from opir_trackers.profile.end import DEVIATES
from opir_trackers.profile.family import Family
from opir_trackers.profile.fit import Hypotheses
from opir_trackers.profile.flight import Moments

#: Ends of the burn that stand for its distribution, of like shares.
_ENDS = 128


def with_ends(state: Moments, hypotheses: Hypotheses, family: Family, chosen: IntArray, tick_s: float) -> Moments:
    """Return states (n, 6) at a tick; of chosen burns that may have ended before it, or not, the moments over both.

    `family` are the paths of the hypotheses (n,), `chosen` (m,) which of them.
    """
    burn_s, start_s = family.courses.burn_s[chosen], family.start_s[chosen]
    spread = hypotheses.spread[chosen]
    gain, variance = family.with_end(hypotheses.spread)
    gain, sigma = gain[chosen], np.sqrt(np.maximum(variance[chosen], 1e-30))
    deviate = _ends_of(hypotheses.end_quantiles[chosen])
    since_s = tick_s - start_s[:, None] - burn_s[:, None] * np.exp(sigma[:, None] * deviate)
    rows = np.flatnonzero((since_s > 0.0).any(axis=1) & (since_s < 0.0).any(axis=1) & (start_s < tick_s))
    if not len(rows):
        return state
    mean, covariance = state.mean.copy(), state.covariance.copy()
    burning, slope, acceleration = flight.burning_states(family, chosen[rows], tick_s)
    thrust = (acceleration - _free_fall(burning))[:, None]
    lost_s = np.maximum(since_s[rows], 0.0)[:, :, None]
    less = np.concatenate([0.5 * np.square(lost_s) * thrust, lost_s * thrust], axis=2)
    with_end = np.sum(slope * (gain / sigma[:, None])[rows, None], axis=2)
    mean[chosen[rows]] = burning - less.mean(axis=1)
    more = _more(less - less.mean(axis=1)[:, None], with_end, deviate[rows])
    total = slope @ spread[rows] @ slope.transpose(0, 2, 1) + more
    covariance[chosen[rows]] = 0.5 * (total + total.transpose(0, 2, 1))
    return Moments(mean, covariance)


def _more(less: FloatArray, with_end: FloatArray, deviate: FloatArray) -> FloatArray:
    """Return what covariances (n, 6, 6) are more by for what states lack (n, ends, 6), of mean 0, at ends' deviates.

    What else is known of the path goes along with its end, by `with_end` (n, 6) a standard deviation: it has a part in
    both.
    """
    mixed = with_end[:, :, None] * np.mean(deviate[:, :, None] * less, axis=1)[:, None]
    more: FloatArray = less.transpose(0, 2, 1) @ less / _ENDS - mixed - mixed.transpose(0, 2, 1)
    return more


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
