"""What the prior of the burnout speed says of boosts far from where it was linearised: along ends that are open.

Fits follow the acceleration at the start and its growth. The burnout speed, which priors know, is what these come to by
the end, and grows the faster the later that is. A fit takes its prior as linear where it stands, which is good for what
has been seen. Ends of burns that are open lie far from there: were the prior still linear for them, late ends would
have speeds that no target of the class reaches.
"""

from typing import NamedTuple

import numpy as np

from opir_core.arrays import FloatArray
from opir_trackers.profile.family import BURN, SHAPE, SPEED, Natural, Priors, natural
from opir_trackers.profile.fit import plausible

#: A prior that holds more than this share of what is known of the speed stays linear: without it nothing would be left.
_MOST = 0.99

#: Steps of Newton's method for how far to go, and the largest share of the way by which each shortens it.
_STEPS, _SHORTER = 2, 0.5


class Placed(NamedTuple):
    """Parameters (m, 10), what is left of them (m, 10, 10), and logarithms (m,) of how much likelier the places are."""

    parameters: FloatArray
    spread: FloatArray
    log: FloatArray


def placed(stood: FloatArray, parameters: FloatArray, spread: FloatArray, priors: Priors, misfit: FloatArray) -> Placed:
    """Return places with the prior of the burnout speed linear there, (m, 10), not where hypotheses `stood`, (m, 10).

    `spread` (m, 10, 10) is what is left of the parameters where the end is given; `priors` are one row each; `misfit`
    (m,) is by how much less all counts that a hypothesis knows. Squares taken out of a normal distribution's exponent,
    or put into it, leave a normal distribution.
    """
    there, here = natural(stood, priors), natural(parameters, priors)
    before, after = _slope(there), _slope(here)
    weight = 1.0 / (np.square(priors.speed_sigma) * misfit)
    by_before = _times(spread, before)
    known = weight * np.sum(before * by_before, axis=1)
    weight, known = (np.where(known < _MOST, each, 0.0) for each in (weight, known))
    told = there.parameters[:, SPEED] + np.sum(before * (parameters - stood), axis=1)
    share = weight / (1.0 - known)
    free = parameters + by_before * (share * told)[:, None]
    freed = spread + by_before[:, :, None] * (by_before * share[:, None])[:, None]
    speed = here.parameters[:, SPEED] + np.sum(after * (free - parameters), axis=1)
    by_after = _times(freed, after)
    total = 1.0 + weight * np.sum(after * by_after, axis=1)
    share_after = weight / total
    held = freed - by_after[:, :, None] * (by_after * share_after[:, None])[:, None]
    square = share * np.square(told) - share_after * np.square(speed)
    log = 0.5 * (square - np.log((1.0 - known) * total))
    return Placed(free - by_after * (share_after * speed)[:, None], held, log)


def moved_by_speed(
    parameters: FloatArray, step: FloatArray, sigmas: float, priors: Priors, misfit: FloatArray
) -> FloatArray:
    """Return parameters (m, 10) moved along steps (m, 10) of so many standard deviations, as far as speeds go straight.

    What is left is normally distributed in the burnout speed as far as that is what its prior says, not in parameters.
    """
    here = natural(parameters, priors)
    wanted = np.sum(_slope(here) * step, axis=1)
    share = np.minimum(np.square(wanted / (sigmas * priors.speed_sigma)) / misfit, 1.0)
    found = parameters + step
    for _ in range(_STEPS):
        there = natural(plausible(found, priors), priors)
        rate = np.sum(_slope(there) * step, axis=1)
        more = there.parameters[:, SPEED] - here.parameters[:, SPEED] - wanted
        shorter = share * more / np.where(rate == 0.0, np.inf, rate)
        found = found - np.clip(shorter, -_SHORTER, _SHORTER)[:, None] * step
    return plausible(found, priors)


def _slope(found: Natural) -> FloatArray:
    """Return the slopes (m, 10) of the logarithm of burnout speed by the fitted parameters."""
    slope = np.zeros_like(found.parameters)
    slope[:, SPEED], slope[:, BURN], slope[:, SHAPE] = 1.0, found.by_burn, found.by_rate
    return slope


def _times(matrices: FloatArray, vectors: FloatArray) -> FloatArray:
    product: FloatArray = np.sum(matrices * vectors[:, None], axis=2)
    return product
