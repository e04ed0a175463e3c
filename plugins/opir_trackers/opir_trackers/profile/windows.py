"""Windows through which hypotheses see the lean: a posterior that is long and bent, as a sum of short ones.

What one sensor sees of a burn leaves open how far the path leans towards it or away, and whatever goes along with that:
a long ridge, bent by many times its width, of which a normal distribution about its top says little. Windows are
normal curves along that part of the lean, evenly spaced so that they add up to 1. Each lets a part of the ridge
through, which is as good as straight; the parts' evidence weighs them, and the whole is their sum (Alspach and
Sorenson, "Nonlinear Bayesian estimation using Gaussian sum approximations", IEEE Trans. Autom. Control 17, 1972, 439).

Trials beside the hypotheses that a track has: where they start, and what becomes of what they find.
"""

from typing import NamedTuple

import numpy as np
from attrs import evolve

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.scene.scene import TARGET_TYPES
from opir_trackers.profile.family import LIFT, SIZE, START, TURN_EAST, TURN_NORTH, Priors, natural
from opir_trackers.profile.fit import SPACING, Hypotheses, plausible
from opir_trackers.profile.hypotheses import joined, probability

#: Where windows lie at first, over the length that the class's lean has; the least lean tried beside their line.
_FIRST = np.linspace(-1.5, 1.5, 9)
_LEAST_SIDE = 0.1

#: Where windows lie on a posterior, in its standard deviations.
_LATER = np.linspace(-3.2, 3.2, 9)

#: Windows wider than so many of the posterior's standard deviations are laid anew.
_WIDE = 1.0

#: Windows are laid anew where one that is not there would hold more than this: ten times what is given up.
_MISSED = 0.01

#: A ridge bent by less than this share of its width, one standard deviation off, is straight.
_STRAIGHT = 0.15

#: A ridge whose arc leaves its tangent by more than this share of its width across, one standard deviation off, may
#: bend yet as it gets narrower: what lies along leans as far, on a circle about the vertical.
_ARC = 0.5

_LEAN = slice(TURN_EAST, TURN_NORTH + 1)

#: How much sooner than it is fitted a boost that one sensor sees is tried to have started, s: up to twice as long as
#: clouds hide most. Slopes at a late start do not lead to an early one, for what has just begun leans nowhere yet.
SOONER_S = (12.0, 26.0)

#: A late pitch start, standard deviations of the class's.
_LATE = 2.5


def windowed(hypotheses: Hypotheses, priors: Priors, is_alone: BoolArray) -> Hypotheses:
    """Return hypotheses of a class's lean in every heading, one of each track and class split by windows.

    Windows lie along the part of the lean that is least known; each is tried on both sides of that line, and, of what
    one sensor sees alone (n,), at sooner starts.
    """
    chosen = np.unique(class_of(hypotheses), return_index=True)[1]
    hypotheses, is_alone = hypotheses.take(chosen), is_alone[chosen]
    trial = _headed(hypotheses, priors, np.linalg.eigh(hypotheses.spread[:, _LEAN, _LEAN])[1][:, :, 1])
    return Hypotheses.concatenate([trial, *_sooner(trial, is_alone)])


def _sooner(trial: Hypotheses, is_alone: BoolArray) -> list[Hypotheses]:
    """Return the trials of hypotheses (n,) that one sensor sees alone, as many of each, at sooner starts."""
    alone = trial.take(np.repeat(is_alone, len(trial) // max(len(is_alone), 1)))
    parts = []
    for sooner_s in SOONER_S:
        parameters = alone.parameters.copy()
        parameters[:, START] -= sooner_s
        parts.append(evolve(alone, parameters=parameters))
    return parts


def _headed(hypotheses: Hypotheses, priors: Priors, along: FloatArray) -> Hypotheses:
    """Return hypotheses (n,) split by windows over the whole length of the class's lean, along lines (n, 2)."""
    prior = priors.take(hypotheses.kind)
    radius = prior.turn_rad * natural(hypotheses.parameters, prior).lean
    count, tries = len(hypotheses), 2 * len(_FIRST)
    middle = np.tile(np.repeat(_FIRST, 2), count)
    side = np.tile([1.0, -1.0], count * len(_FIRST)) * np.sqrt(np.maximum(1.0 - middle * middle, _LEAST_SIDE**2))
    radius, along = np.repeat(radius, tries), np.repeat(along, tries, axis=0)
    trial = hypotheses.take(np.repeat(np.arange(count), tries))
    parameters = trial.parameters.copy()
    parameters[:, TURN_EAST] = radius * (middle * along[:, 0] - side * along[:, 1])
    parameters[:, TURN_NORTH] = radius * (middle * along[:, 1] + side * along[:, 0])
    window = _windows(along, radius * middle, radius * (_FIRST[1] - _FIRST[0]))
    return evolve(trial, parameters=parameters, window=window, is_bent=np.ones_like(trial.is_bent))


def _windows(along: FloatArray, middle: FloatArray, apart: FloatArray) -> FloatArray:
    return np.column_stack([along, middle, np.square(SPACING / apart)])


class _Ridges(NamedTuple):
    """Groups of hypotheses of a track and class that have windows: which is whose, and how their sums lie.

    `group` (n,) and `share` (n,) in it; by group (g,) the line (g, 2), the mean and standard deviation along it, and
    over that the width of windows; `arc` is by how much a circle about the vertical leaves its tangent one standard
    deviation off, over the width of parts across.
    """

    group: IntArray
    share: FloatArray
    along: FloatArray
    mean: FloatArray
    sigma: FloatArray
    width: FloatArray
    arc: FloatArray

    @classmethod
    def of(cls, hypotheses: Hypotheses) -> "_Ridges":
        _, group = np.unique(class_of(hypotheses), return_inverse=True)
        share = np.maximum(probability(hypotheses), 1e-12)
        share = share / np.bincount(group, share)[group]
        lean = hypotheses.parameters[:, _LEAN]
        mean = np.stack([np.bincount(group, share * lean[:, i]) for i in range(2)], axis=1)
        apart = lean - mean[group]
        within = _averaged(hypotheses.spread[:, _LEAN, _LEAN], share, group)
        value, axes = np.linalg.eigh(within + _averaged(apart[:, :, None] * apart[:, None], share, group))
        along, sigma = axes[:, :, 1], np.sqrt(np.maximum(value[:, 1], 1e-18))
        width = np.bincount(group, share / np.sqrt(hypotheses.window[:, 3]))
        across = np.sqrt(np.maximum(np.linalg.eigvalsh(within)[:, 0], 1e-18))
        arc = 0.5 * np.square(sigma) / (across * np.maximum(np.hypot(mean[:, 0], mean[:, 1]), 1e-9))
        return cls(group, share, along, np.sum(mean * along, axis=1), sigma, width / sigma, arc)


def _averaged(matrices: FloatArray, share: FloatArray, group: IntArray) -> FloatArray:
    """Return the means (g, 2, 2) of matrices (n, 2, 2) that have shares (n,) in groups (n,)."""
    entries = [np.bincount(group, share * matrices[:, i, j]) for i in (0, 1) for j in (0, 1)]
    return np.asarray(np.stack(entries, axis=1).reshape(-1, 2, 2), dtype=np.float64)


def anew(hypotheses: Hypotheses, priors: Priors, is_alone: BoolArray) -> Hypotheses:
    """Return trials in every heading of the tracks and classes that have windows, as if split for the first time.

    A split that comes before the path leans takes noise for a lean, and what it then gives up does not come back by
    itself. Each trial starts from the likeliest hypothesis, with its pitch start and with a late one, and, of what one
    sensor sees alone (n,), at sooner starts.
    """
    split = hypotheses.window[:, 3] > 0.0
    seen, is_alone = hypotheses.take(split), is_alone[split]
    if not len(seen):
        return seen
    ridges = _Ridges.of(seen)
    order = np.lexsort((-seen.evidence, ridges.group))
    first = order[np.append(True, np.diff(ridges.group[order]) != 0)]
    base = seen.take(first)
    late = base.parameters.copy()
    late[:, LIFT] = np.maximum(late[:, LIFT], _LATE * priors.take(base.kind).lift_sigma)
    # One width of windows for a class: that of its likeliest hypothesis.
    trial = _headed(base, priors, ridges.along)
    again = trial.parameters.copy()
    again[:, LIFT] = np.repeat(late[:, LIFT], 2 * len(_FIRST))
    return Hypotheses.concatenate([trial, evolve(trial, parameters=again), *_sooner(trial, is_alone[first])])


def laid(hypotheses: Hypotheses, priors: Priors) -> tuple[Hypotheses, BoolArray]:
    """Return hypotheses with narrower windows where those they have are too wide, and which (n,) those are."""
    narrow = hypotheses.window[:, 3] > 0.0
    if not narrow.any():
        return hypotheses, narrow
    seen, rest = hypotheses.take(narrow), hypotheses.take(~narrow)
    ridges = _Ridges.of(seen)
    wide = (ridges.width > _WIDE) | (_left_out(seen, ridges) > _MISSED)
    again = _relaid(seen, ridges, np.flatnonzero(wide), priors)
    kept = seen.take(~wide[ridges.group] | _lie_apart(seen, ridges))
    parts = [rest, kept, again]
    every = Hypotheses.concatenate(parts)
    return every, np.repeat([False, False, True], [len(part) for part in parts])


def _lie_apart(hypotheses: Hypotheses, ridges: _Ridges) -> BoolArray:
    """Return which (n,) hypotheses lie where not even the next of windows laid anew would see them: other headings."""
    place = np.sum(hypotheses.parameters[:, _LEAN] * ridges.along[ridges.group], axis=1)
    reach = (2.0 * _LATER[-1] - _LATER[-2]) * ridges.sigma
    apart: BoolArray = np.abs(place - ridges.mean[ridges.group]) > reach[ridges.group]
    return apart


def _left_out(hypotheses: Hypotheses, ridges: _Ridges) -> FloatArray:
    """Return how much (g,) the next window beyond either end of ridges would hold, were it there.

    Of evenly spaced windows on a normal distribution the shares' logarithms lie on a parabola, of which the last two at
    an end and the widths tell the next. Windows that cover a whole circle of leans, twice, end where that ends.
    """
    place, group = hypotheses.window[:, 2], ridges.group
    found = np.zeros(len(ridges.mean))
    twice = np.zeros(len(ridges.mean), dtype=np.bool_)
    bend = np.exp(-np.square(SPACING * ridges.width) / (1.0 + np.square(ridges.width)))
    for order in (np.lexsort((place, group)), np.lexsort((-place, group))):
        last = np.flatnonzero(np.append(True, np.diff(group[order]) != 0))
        last = last[np.bincount(group)[group[order[last]]] > 1]
        end, inner = order[last], order[last + 1]
        share = np.square(ridges.share[end]) / ridges.share[inner] * bend[group[end]]
        np.maximum.at(found, group[end], share)
    order = np.lexsort((place, group))
    same = (np.diff(group[order]) == 0) & (np.diff(place[order]) == 0.0)
    twice[group[order[1:]][same]] = True
    return np.where(twice, 0.0, found)


def _relaid(hypotheses: Hypotheses, ridges: _Ridges, wide: IntArray, priors: Priors) -> Hypotheses:
    """Return new hypotheses of groups, each from that one of the old that is nearest along the line."""
    if not len(wide):
        return hypotheses.take(wide)
    group, step = np.repeat(wide, len(_LATER)), np.tile(_LATER, len(wide))
    along = ridges.along[group]
    middle = ridges.mean[group] + step * ridges.sigma[group]
    place = np.sum(hypotheses.parameters[:, _LEAN] * ridges.along[ridges.group], axis=1)
    away = np.abs(place - middle[:, None]) + np.where(ridges.group == group[:, None], 0.0, np.inf)
    near = np.argmin(away, axis=1)
    trial = hypotheses.take(near)
    by_place = np.sum(trial.spread[:, :, _LEAN] * along[:, None], axis=2)
    rate = by_place / np.sum(by_place[:, _LEAN] * along, axis=1)[:, None]
    moved = trial.parameters + rate * (middle - place[near])[:, None]
    parameters = plausible(moved, priors.take(trial.kind))
    window = _windows(along, middle, (_LATER[1] - _LATER[0]) * ridges.sigma[group])
    return evolve(trial, parameters=parameters, window=window)


def straightened(hypotheses: Hypotheses) -> tuple[Hypotheses, BoolArray]:
    """Return hypotheses with those one that lie along a straight line, and which (n,) those are."""
    narrow = hypotheses.window[:, 3] > 0.0
    if not narrow.any():
        return hypotheses, narrow
    seen, rest = hypotheses.take(narrow), hypotheses.take(~narrow)
    ridges = _Ridges.of(seen)
    straight = (_bends(seen, ridges) < _STRAIGHT) & (ridges.arc < _ARC) & (ridges.width < 1.2 * _WIDE)
    order = np.lexsort((-seen.evidence, ridges.group))
    first = order[np.append(True, np.diff(ridges.group[order]) != 0)]
    lone = seen.take(first[straight])
    parts = [rest, seen.take(~straight[ridges.group]), evolve(lone, window=np.zeros_like(lone.window))]
    return Hypotheses.concatenate(parts), np.repeat([False, False, True], [len(part) for part in parts])


def _bends(hypotheses: Hypotheses, ridges: _Ridges) -> FloatArray:
    """Return by how much (g,) ridges leave their tangents a standard deviation off, over their width there.

    Of neighbours along the line one tells where the other lies, were the ridge straight.
    """
    count = len(ridges.mean)
    place = np.sum(hypotheses.parameters[:, _LEAN] * ridges.along[ridges.group], axis=1)
    order = np.lexsort((place, ridges.group))
    left, right = order[:-1], order[1:]
    both = ridges.group[left] == ridges.group[right]
    left, right = left[both], right[both]
    group = ridges.group[left]
    along, spread = ridges.along[group], hypotheses.spread[left]
    step = place[right] - place[left]
    by_place = np.sum(spread[:, :, _LEAN] * along[:, None], axis=2)
    rate = by_place / np.sum(by_place[:, _LEAN] * along, axis=1)[:, None]
    away = hypotheses.parameters[right] - hypotheses.parameters[left] - rate * step[:, None]
    scale = np.sqrt(np.diagonal(spread, axis1=1, axis2=2))
    unit = spread / (scale[:, :, None] * scale[:, None]) + 1e-12 * np.eye(SIZE)
    square = np.sum(away / scale * np.linalg.solve(unit, (away / scale)[:, :, None])[:, :, 0], axis=1)
    bend = np.sqrt(np.maximum(square, 0.0)) * np.square(ridges.sigma[group] / np.maximum(step, 1e-9))
    weight = np.sqrt(ridges.share[left] * ridges.share[right]) + 1e-12
    total = np.bincount(group, weight, count)
    found: FloatArray = np.where(total > 0.0, np.bincount(group, weight * bend, count) / np.maximum(total, 1e-12), 0.0)
    return found


def class_of(hypotheses: Hypotheses) -> IntArray:
    """Return numbers (n,), the same for hypotheses of a track and class."""
    key: IntArray = hypotheses.track * len(TARGET_TYPES) + hypotheses.kind
    return key


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
