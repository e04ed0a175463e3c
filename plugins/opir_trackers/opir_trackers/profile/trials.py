"""Trials beside the hypotheses that a track has: where they start, and what becomes of what they find."""

import numpy as np
from attrs import evolve

from opir_core.arrays import FloatArray, IntArray
from opir_trackers.profile.family import LIFT, START, TURN_NORTH, Priors
from opir_trackers.profile.fit import Hypotheses
from opir_trackers.profile.hypotheses import joined
from opir_trackers.profile.windows import SOONER_S, class_of

#: An early pitch start, standard deviations of the class's.
_EARLY = -1.0

#: By how much the logarithm of what trials found has to exceed what was found before, to take its place.
_MORE = 0.5

#: Trials beyond these standard deviations, squared, from all that was found are something else: in start and lean.
_BESIDE = 9.0
_APART = slice(START, TURN_NORTH + 1)


def pitched_early(hypotheses: Hypotheses, priors: Priors) -> Hypotheses:
    """Return trials, through the same windows, of boosts that pitched over before their first light.

    A pitch that was seen to start bends rows as no earlier one does: within a window a posterior has a part to either
    side of the first light, and steps from one do not lead to the other.
    """
    parameters = hypotheses.parameters.copy()
    parameters[:, START] -= SOONER_S[0]
    parameters[:, LIFT] = _EARLY * priors.take(hypotheses.kind).lift_sigma
    return evolve(hypotheses, parameters=parameters)


def enlarged(found: Hypotheses, trial: Hypotheses) -> Hypotheses:
    """Return hypotheses with what trials found beside them; where trials found much more, the trials instead.

    The parts of a posterior add up to the evidence of the whole: of two sums, the larger has found more of it.
    """
    _, group = np.unique(np.append(class_of(found), class_of(trial)), return_inverse=True)
    mine, theirs, count = group[: len(found)], group[len(found) :], int(group.max(initial=-1)) + 1
    misfit = np.full(count, np.inf)
    np.minimum.at(misfit, mine, found.misfit)
    more = _summed(trial, theirs, count) > _summed(found, mine, count) + _MORE * misfit
    near, other = joined(theirs, mine)
    away = (trial.parameters[other] - found.parameters[near])[:, _APART]
    spread = (trial.spread[other] + found.spread[near])[:, _APART, _APART]
    square = np.sum(away * np.linalg.solve(spread, away[:, :, None])[:, :, 0], axis=1)
    nearest = np.full(len(trial), np.inf)
    np.minimum.at(nearest, other, square)
    return Hypotheses.concatenate([found.take(~more[mine]), trial.take(more[theirs] | (nearest > _BESIDE))])


def _summed(hypotheses: Hypotheses, group: IntArray, count: int) -> FloatArray:
    """Return the logarithms (count,) of the sums of evidence of groups; minus infinity of none."""
    most = np.full(count, -np.inf)
    np.maximum.at(most, group, hypotheses.evidence)
    with np.errstate(divide="ignore"):
        total: FloatArray = np.log(np.bincount(group, np.exp(hypotheses.evidence - most[group]), count))
    return np.where(np.isfinite(most), most + total, -np.inf)
