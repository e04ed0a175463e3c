"""Ghosts: two near tracks that each hold one sensor's rays of the other's target.

Assignments are made sensor by sensor. Two tracks may agree with each sensor's picture and yet follow no target: each
sits where one target's ray from one sensor passes another target's ray from a second. So for rivals (tracks that gate
the same rays) the rays of one sensor are exchanged on trial, and whatever explains a whole slice better stays.
"""

from typing import NamedTuple

import numpy as np

from opir_core.records import BoolArray, FloatArray, IntArray
from opir_core.tracking.association import Chances
from opir_core.tracking.gating import Pairs
from opir_core.tracking.rays import Rays
from opir_core.tracking.switching_filter import Bank, SwitchingFilter

#: Rivals share at least this share of the rays that one of them holds of a sensor.
_LEAST_SHARED = 0.25

#: Tracks known better than this share of one look's error, at a geostationary range, are past being ghosts.
_FIRM, _RANGE_M = 0.5, 3.6e7

#: An exchange has to explain the rays better by this much (log likelihood).
_LEAST_GAIN = 1.0


class Exchange(NamedTuple):
    """Trials: two tracks (n,) each and the sensor whose rays they exchange."""

    first: IntArray
    second: IntArray
    sensor: IntArray


def without_ghosts(
    filter_: SwitchingFilter, bank: Bank, time_s: float, pairs: Pairs, used: BoolArray, rays: Rays, chances: Chances
) -> BoolArray:
    """Return which pairs (n,) are used after the exchanges of one sensor's rays that explain a slice better.

    `bank` holds the estimates before the slice; `used` which pairs an assignment chose.
    """
    loose = filter_.outlook(bank, time_s).reach_m(0.0) > _FIRM * rays.sigma_rad.max(initial=0.0) * _RANGE_M
    trial = _rivals(pairs, used, rays)
    trial = Exchange(*(column[loose[trial.first] | loose[trial.second]] for column in trial))
    if not len(trial.first):
        return used
    held = np.flatnonzero(used)
    pulled, whose = _exchanged(pairs, held, rays, trial)
    count = len(trial.first)
    tracks = np.stack([trial.first, trial.second], axis=1).ravel()
    kept, mine = _all_rays(pairs, held, tracks)
    before = _score(filter_, bank, time_s, pairs, kept, mine, tracks, rays, chances).reshape(count, 2)
    after = _score(filter_, bank, time_s, pairs, pulled, whose, tracks, rays, chances).reshape(count, 2)
    gain = after.sum(axis=1) - before.sum(axis=1)
    return _applied(used, pairs, trial, gain, pulled, whose)


def _rivals(pairs: Pairs, used: BoolArray, rays: Rays) -> Exchange:
    """Return who may exchange what: neighbours in the lists of the tracks that gate each used ray."""
    order = np.lexsort((pairs.track, pairs.ray))
    track, ray = pairs.track[order], pairs.ray[order]
    near = np.flatnonzero(ray[1:] == ray[:-1])
    sensor = rays.sensor[ray[near]].astype(np.int64)
    trials, times = np.unique(np.stack([track[near], track[near + 1], sensor], axis=1), axis=0, return_counts=True)
    size = int(pairs.track.max(initial=0)) + 1
    seers = int(rays.sensor.max(initial=0)) + 1
    held = np.bincount(pairs.track[used] * seers + rays.sensor[pairs.ray[used]], minlength=size * seers)
    enough = times >= _LEAST_SHARED * np.maximum(held[trials[:, 0] * seers + trials[:, 2]], 1)
    stereo = (held.reshape(size, seers) > 0).sum(axis=1)
    both = (stereo[trials[:, 0]] > 1) & (stereo[trials[:, 1]] > 1)
    return Exchange(*trials[enough & both].T)


def _exchanged(pairs: Pairs, held: IntArray, rays: Rays, trial: Exchange) -> tuple[IntArray, IntArray]:
    """Return pairs and the side (twice the trial, and one for the second track) they are used on after an exchange."""
    size = len(rays) + 1
    key = pairs.track * size + pairs.ray
    order = np.argsort(key)
    found, sides = [], []
    for side, (one, other) in enumerate(((trial.first, trial.second), (trial.second, trial.first))):
        own, mine = _all_rays(pairs, held, one)
        stays = rays.sensor[pairs.ray[own]] != trial.sensor[mine]
        theirs, whose = _all_rays(pairs, held, other)
        comes = rays.sensor[pairs.ray[theirs]] == trial.sensor[whose]
        sought = one[whose[comes]] * size + pairs.ray[theirs[comes]]
        place = order[np.minimum(np.searchsorted(key, sought, sorter=order), len(key) - 1)]
        gated = key[place] == sought
        found += [own[stays], place[gated]]
        sides += [2 * mine[stays] + side, 2 * whose[comes][gated] + side]
    return np.concatenate(found), np.concatenate(sides)


def _all_rays(pairs: Pairs, held: IntArray, tracks: IntArray) -> tuple[IntArray, IntArray]:
    """Return the held pairs of each of tracks (n,), and which of them each pair is for."""
    order = held[np.argsort(pairs.track[held], kind="stable")]
    sorted_tracks = pairs.track[order]
    start, stop = np.searchsorted(sorted_tracks, tracks), np.searchsorted(sorted_tracks, tracks, side="right")
    length = stop - start
    which = np.repeat(np.arange(len(tracks)), length)
    spot = np.arange(int(length.sum())) - np.repeat(np.cumsum(length) - length, length) + np.repeat(start, length)
    return order[spot], which


def _score(
    filter_: SwitchingFilter,
    bank: Bank,
    time_s: float,
    pairs: Pairs,
    rows: IntArray,
    side: IntArray,
    tracks: IntArray,
    rays: Rays,
    chances: Chances,
) -> FloatArray:
    """Return the log likelihood ratio (n,) of what each side uses to misses and false alarms, in its likelier mode."""
    total = np.zeros(len(tracks))
    part = pairs.take(rows)
    chance = chances.detection[rays.sensor[part.ray]]
    odds = np.log(chance / ((1.0 - chance) * 2.0 * np.pi * chances.false_per_sr)) - 2.0 * np.log(part.sigma_rad)
    np.add.at(total, side, odds)
    some, place = np.unique(side, return_inverse=True)
    sights = part.sights(part.seen, np.eye(2) / part.sigma_rad[:, None, None]).placed(place.astype(np.int64))
    here = bank.take(tracks[some])
    coasts = here.weight[:, 1] > here.weight[:, 0]
    gained = np.zeros(len(some))
    for motion, mean, root, mine in (
        (filter_.boost, here.boost_mean, here.boost_root, ~coasts),
        (filter_.coast, here.coast_mean, here.coast_root, coasts),
    ):
        if mine.any():
            gained = np.where(mine, filter_.taken_in(motion, mean, root, time_s, sights)[2], gained)
    total[some] += gained
    return total


def _applied(
    used: BoolArray, pairs: Pairs, trial: Exchange, gain: FloatArray, pulled: IntArray, whose: IntArray
) -> BoolArray:
    """Return which pairs are used once the best exchanges are made, each track in one of them at most."""
    busy: set[int] = set()
    after = used.copy()
    for number in np.argsort(-gain, kind="stable").tolist():
        pair = {int(trial.first[number]), int(trial.second[number])}
        if gain[number] < _LEAST_GAIN:
            break
        if pair & busy:
            continue
        busy |= pair
        after[np.isin(pairs.track, list(pair))] = False
        after[pulled[whose // 2 == number]] = True
    return after
