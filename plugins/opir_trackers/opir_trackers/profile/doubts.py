"""By how much states at rest, and of upright flight, are less certain than slopes say."""

import numpy as np

from opir_core.arrays import FloatArray
from opir_trackers.profile.family import LIFT, START, Family, Priors
from opir_trackers.profile.fit import Hypotheses

#: How fast a boost sets out, m/s², about, and the least doubt about when it did, s.
_ACCELERATION_M_S2 = 15.0
_START_DOUBT_S = 0.05


def doubts(hypotheses: Hypotheses, family: Family, tick_s: float, state: FloatArray, priors: Priors) -> FloatArray:
    """Return the covariances (n, 6, 6) by which states at rest and upright are less certain than slopes say."""
    # What has no heading yet tells no turn either: it is the class's.
    turn_rad = np.where(hypotheses.is_bent > 0, family.courses.turn_rad, priors.turn_rad[hypotheses.kind])
    spread = hypotheses.spread
    return _at_rest(family, spread, tick_s) + _upright(family, spread, tick_s, state, turn_rad)


def _at_rest(family: Family, spread: FloatArray, tick_s: float) -> FloatArray:
    """Return the covariances (n, 6, 6) by which states at rest are less certain than their slopes say.

    A target that is estimated to start later may have started already: it then moves by the time in doubt.
    """
    doubt_s = np.sqrt(spread[:, START, START]) + _START_DOUBT_S
    waits = tick_s <= family.start_s + doubt_s
    sigma = np.concatenate([np.full(3, 0.5 * _ACCELERATION_M_S2), np.full(3, _ACCELERATION_M_S2)])
    times = doubt_s[:, None] ** np.array([2, 2, 2, 1, 1, 1])
    variance = np.where(waits[:, None], np.square(sigma * times), 0.0)
    more: FloatArray = variance[:, :, None] * np.eye(6)
    return more


def _upright(family: Family, spread: FloatArray, tick_s: float, state: FloatArray, turn_rad: FloatArray) -> FloatArray:
    """Return the covariances (n, 6, 6) by which states of upright flight are less certain than their slopes say.

    A target that is estimated to pitch over later may have done so already: it then leans by what the time in doubt
    bends it, of the whole turn (n,).
    """
    flown = family.courses
    pitch_s = flown.lift * flown.burn_s
    both = spread[:, START, START] + 2.0 * pitch_s * spread[:, START, LIFT]
    doubt_s = np.sqrt(np.maximum(both + np.square(pitch_s) * spread[:, LIFT, LIFT], 0.0))
    upright = tick_s <= family.start_s + pitch_s + doubt_s
    share = np.minimum(doubt_s / flown.burn_s, 1.0) ** flown.pitch_exponent
    lean = turn_rad * np.sin(0.5 * np.pi * share)
    sideways = 0.5 * lean * np.sqrt(np.sum(np.square(state[:, 3:]), axis=1))
    sigma = np.stack([0.5 * sideways * doubt_s] * 3 + [sideways] * 3, axis=1)
    variance = np.where(upright[:, None], np.square(sigma), 0.0)
    more: FloatArray = variance[:, :, None] * np.eye(6)
    return more
