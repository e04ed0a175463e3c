"""Means of lines of sight some of which do not belong: each counts as far as it may be one of the others.

A ray is its target's, with the error that it states, or it is a stray one, evenly spread over the gate through which
association took it. Mean, shares and the chance of strays are those at which the likelihood of that mixture is highest,
by expectation and maximisation from the median on (Dempster, Laird and Rubin, J. Roy. Stat. Soc. B 39, 1977, 1); what
the mean then tells is the observed information (Louis, J. Roy. Stat. Soc. B 44, 1982, 226).
"""

from typing import NamedTuple

import numpy as np

from opir_core.arrays import FloatArray, IntArray

#: The gate's radius, standard deviations of a ray: strays are evenly spread over it.
GATE = 4.5

#: Before any ray is seen, strays are believed to be this share, as if so many rays had said so.
_SHARE, _BELIEVED = 0.01, 3.0

#: The share from which to set out.
_FIRST_SHARE = 0.05

#: Rays are expected where the path is so well known, standard deviations of a ray.
_NEAR = 0.7

#: What a median tells of what a mean does.
_MEDIAN_TOLD = 2.0 / np.pi

#: Turns of expectation and maximisation.
_TURNS = 6

#: Fewer rays than this do not tell which of them strays.
_FEWEST = 3

#: A ray counts at least this little, and a group tells at least this share of what its weights say.
_LEAST_WEIGHT, _LEAST_TOLD = 1e-6, 0.2


class Weights(NamedTuple):
    """What rays count in their group's mean, and what they add to what it tells of each angle, (n,), 1/rad²."""

    weight: FloatArray
    information: FloatArray


def weights_of(
    group: IntArray,
    owner: IntArray,
    seen: FloatArray,
    sigma_rad: FloatArray,
    is_expected: bool,
    stray: FloatArray | None = None,
) -> Weights:
    """Return the weights of rays (n,) at places (n, 2), rad, of groups that come sorted, from 0.

    Strays are as frequent as `stray` (n,) says; where that is not known, in all groups of an owner (n,) alike. Places
    that are counted from where rays are expected tell, if `is_expected`, that their mean is near: this guides what
    strays, and is no part of the mean.
    """
    whole = 1.0 / np.square(sigma_rad)
    count = np.bincount(group)
    few = (count < _FEWEST)[group]
    _, owner = np.unique(owner, return_inverse=True)
    rays = np.bincount(owner)
    mean, share = medians(group, seen), np.full(len(rays), _FIRST_SHARE)
    pull = _pull(group, mean, whole) if is_expected else np.zeros(len(count))
    mean /= (1.0 + pull / np.bincount(group, _MEDIAN_TOLD * whole))[:, None]
    for turn in range(_TURNS):
        square = np.sum(np.square(seen - mean[group]), axis=1) * whole
        chance, density = share[owner] if stray is None else stray, np.exp(-0.5 * square) / (2.0 * np.pi)
        own = np.where(few, 1.0, (1.0 - chance) * density / ((1.0 - chance) * density + chance / _AREA))
        own = np.maximum(own, _LEAST_WEIGHT)
        if turn + 1 < _TURNS:
            total = np.bincount(group, own * whole) + pull
            mean = np.stack([np.bincount(group, own * whole * seen[:, axis]) / total for axis in (0, 1)], axis=1)
            share = (np.bincount(owner, 1.0 - own) + _SHARE * _BELIEVED) / (rays + _BELIEVED)
    part = _part_told(group, own * whole, own, square, pull)[group]
    # Of few rays any may be a stray one: their mean is as uncertain as both kinds are together.
    mixed = 1.0 if stray is None else 1.0 + stray * (0.25 * GATE**2 - 1.0)
    return Weights(own * whole, np.where(few, whole / mixed, own * whole * part))


def _part_told(
    group: IntArray, weight: FloatArray, own: FloatArray, square: FloatArray, pull: FloatArray
) -> FloatArray:
    """Return which part of what weights of rays (n,) add up to their groups' means (g,) know."""
    # Of a ray that may be a stray one, the mean knows less: w - w (1 - w) r², averaged over both angles.
    told, most = np.bincount(group, weight * (1.0 - 0.5 * (1.0 - own) * square)), np.bincount(group, weight)
    part = np.maximum(told / most, _LEAST_TOLD)
    # Where a path guides the weights the mean goes along with it by a share, and tells so much less of it: of a place
    # known from means with shares b of what is known already, the variance is 1 / (1 - 2 b) of that which they say.
    along = (1.0 - part) * pull / (part * most + pull)
    known: FloatArray = part * np.square(1.0 - along)
    return known


def _pull(group: IntArray, middle: FloatArray, whole: FloatArray) -> FloatArray:
    """Return what groups' expected places, the origin, count beside their rays: the less, the farther their medians."""
    count = np.bincount(group)
    one = np.bincount(group, whole) / count
    far = np.sum(middle * middle, axis=1) * one / (_NEAR**2 + 2.0 / count)
    found: FloatArray = one / _NEAR**2 / np.square(1.0 + 0.05 * far)
    return found


_AREA = np.pi * GATE**2


def medians(group: IntArray, seen: FloatArray) -> FloatArray:
    """Return the medians (groups, 2) of both columns; groups come sorted, from 0."""
    count = np.bincount(group)
    first = np.cumsum(count) - count
    found = np.empty((len(count), 2))
    for axis in range(2):
        ordered = seen[np.lexsort((seen[:, axis], group)), axis]
        found[:, axis] = 0.5 * (ordered[first + (count - 1) // 2] + ordered[first + count // 2])
    return found


def detrended(group: IntArray, seen: FloatArray, time_s: FloatArray) -> FloatArray:
    """Return places (n, 2) without what they drift by in their groups: the line through the medians of both halves."""
    count = np.bincount(group)
    order = np.lexsort((time_s, group))
    rank = np.empty(len(group), dtype=np.int64)
    rank[order] = np.arange(len(group)) - (np.cumsum(count) - count)[group[order]]
    late = rank >= (count[group] + 1) // 2
    many = count >= 2 * _FEWEST
    half = 2 * group + late
    known, place = np.unique(half, return_inverse=True)
    turn = np.argsort(place, kind="stable")
    middle, when = np.full((2 * len(count), 2), np.nan), np.full((2 * len(count), 2), np.nan)
    middle[known] = medians(place[turn], seen[turn])
    when[known] = medians(place[turn], np.stack([time_s, time_s], axis=1)[turn])
    span = when[1::2, :1] - when[::2, :1]
    slope = np.where((many & (span[:, 0] > 0.0))[:, None], (middle[1::2] - middle[::2]) / span, 0.0)
    level: FloatArray = seen - slope[group] * (time_s - when[2 * group, 0])[:, None]
    return level
