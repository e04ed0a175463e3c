"""Ghosts: two near tracks that each hold one sensor's rays of the other's target.

Assignments are made sensor by sensor. Two tracks may agree with each sensor's picture and yet follow no target: each
sits where one target's ray from one sensor passes another target's ray from a second. So for rivals (tracks that gate
the same rays) the rays of one sensor are exchanged on trial, the rays of both are assigned anew by what the exchange
led to, and whatever explains a whole slice better stays.
"""

from typing import NamedTuple

import numpy as np
from attrs import frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.estimation.lines_of_sight import LinesOfSight, Sights
from opir_trackers.assignment import nearest
from opir_trackers.association import Chances, scan_groups
from opir_trackers.filter.estimates import ModeEstimates
from opir_trackers.filter.switching import ImmFilter
from opir_trackers.gating import GatedPairs, gated

#: Rivals share at least this share of the rays that one of them holds of a sensor.
_LEAST_SHARED = 0.25

#: Tracks known better than this share of one look's error, at a geostationary range, are past being ghosts.
_FIRM, RANGE_M = 0.5, 3.6e7

#: An exchange has to explain the rays better by this much (log likelihood: odds of e), lest noise exchange to and fro.
_LEAST_GAIN = 1.0

#: One that explains them worse by more than this before they are assigned anew is not followed up.
_HOPELESS = 10.0

#: Rays are assigned anew within this many standard deviations.
_GATE = 4.5


@frozen(eq=False)
class Slice:
    """The rays of a slice that ends at `time_s`, and the estimates (a bank) before they are taken in."""

    filter: ImmFilter
    chances: Chances
    light_time: bool
    bank: ModeEstimates
    time_s: float
    rays: LinesOfSight


class Exchange(NamedTuple):
    """Trials: two tracks (n,) each and the sensor whose rays they exchange."""

    first: IntArray
    second: IntArray
    sensor: IntArray

    @property
    def tracks(self) -> IntArray:
        """Return the tracks of both sides (2 n,): side 2 k is the first of trial k."""
        return np.stack([self.first, self.second], axis=1).ravel()


def without_ghosts(known: Slice, pairs: GatedPairs, used: BoolArray) -> BoolArray:
    """Return which pairs (n,) are used after the exchanges of one sensor's rays that explain a slice better.

    `used` says which pairs an assignment chose.
    """
    rays = known.rays
    loose = known.filter.outlook(known.bank, known.time_s).reach_m(0.0)
    loose = loose > _FIRM * rays.sigma_rad.max(initial=0.0) * RANGE_M
    if not loose.any():
        return used
    trial = _rivals(pairs, used, rays)
    trial = Exchange(*(column[loose[trial.first] | loose[trial.second]] for column in trial))
    if not len(trial.first):
        return used
    held = np.flatnonzero(used)
    pulled, whose = _exchanged(pairs, held, rays, trial)
    kept, mine = _all_rays(pairs, held, trial.tracks)
    before, after = (_score(known, pairs, *way, trial.tracks) for way in ((kept, mine), (pulled, whose)))
    hopeful = np.flatnonzero(after - before > -_HOPELESS)
    if not len(hopeful):
        return used
    some = Exchange(*(column[hopeful] for column in trial))
    before = _score(known, pairs, *_anew(known, pairs, used, *_those(kept, mine, hopeful), some), some.tracks)
    better, side = _anew(known, pairs, used, *_those(pulled, whose, hopeful), some)
    gain = _score(known, pairs, better, side, some.tracks) - before
    return _applied(used, pairs, some, gain, better, side)


def _those(rows: IntArray, side: IntArray, trials: IntArray) -> tuple[IntArray, IntArray]:
    """Return the rows, and their sides, of some trials, which are numbered anew."""
    place = np.full(int(side.max(initial=0)) // 2 + 1, -1, dtype=np.int64)
    place[trials[trials < len(place)]] = np.flatnonzero(trials < len(place))
    mine = np.flatnonzero(place[side // 2] >= 0)
    return rows[mine], 2 * place[side[mine] // 2] + side[mine] % 2


def _anew(
    known: Slice, pairs: GatedPairs, used: BoolArray, rows: IntArray, side: IntArray, trial: Exchange
) -> tuple[IntArray, IntArray]:
    """Return pairs and sides after the rays of each trial are assigned anew by the estimates that `rows` lead to.

    Rays that other tracks use are left to them.
    """
    tracks = trial.tracks
    bank = known.filter.updated(
        known.bank.take(tracks), known.time_s, _sights(pairs, rows, side), known.time_s - _first_s(known)
    )
    owner = np.full(len(known.rays), -1, dtype=np.int64)
    owner[pairs.ray[used]] = pairs.track[used]
    row, which = _all_rays(pairs, np.arange(len(pairs)), tracks)
    theirs = owner[pairs.ray[row]]
    free = np.flatnonzero((theirs < 0) | (theirs == trial.first[which // 2]) | (theirs == trial.second[which // 2]))
    row, which = row[free], which[free]
    key = which * (len(known.rays) + 1) + pairs.ray[row]
    near = gated(known.filter.outlook(bank, known.time_s), known.rays, which, pairs.ray[row], _GATE, known.light_time)
    column = near.track // 2 * (len(known.rays) + 1) + near.ray
    chosen = nearest(scan_groups(near, known.rays), column, -known.chances.log_ratio(near, known.rays))
    sought = near.track[chosen] * (len(known.rays) + 1) + near.ray[chosen]
    order = np.argsort(key)
    return row[order[np.searchsorted(key, sought, sorter=order)]], near.track[chosen]


def _first_s(known: Slice) -> float:
    return float(known.rays.time_s.min(initial=known.time_s))


def _rivals(pairs: GatedPairs, used: BoolArray, rays: LinesOfSight) -> Exchange:
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


def _exchanged(pairs: GatedPairs, held: IntArray, rays: LinesOfSight, trial: Exchange) -> tuple[IntArray, IntArray]:
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


def _all_rays(pairs: GatedPairs, held: IntArray, tracks: IntArray) -> tuple[IntArray, IntArray]:
    """Return the held pairs of each of tracks (n,), and which of them each pair is for."""
    order = held[np.argsort(pairs.track[held], kind="stable")]
    sorted_tracks = pairs.track[order]
    start, stop = np.searchsorted(sorted_tracks, tracks), np.searchsorted(sorted_tracks, tracks, side="right")
    length = stop - start
    which = np.repeat(np.arange(len(tracks)), length)
    spot = np.arange(int(length.sum())) - np.repeat(np.cumsum(length) - length, length) + np.repeat(start, length)
    return order[spot], which


def _sights(pairs: GatedPairs, rows: IntArray, side: IntArray) -> Sights:
    """Return undoubted sights of pairs, of the tracks in whose stead `side` (n,) stands."""
    part = pairs.take(rows)
    return part.sights(part.seen, np.eye(2) / part.sigma_rad[:, None, None]).placed(side)


def _score(known: Slice, pairs: GatedPairs, rows: IntArray, side: IntArray, tracks: IntArray) -> FloatArray:
    """Return the log likelihood ratio (trials,) of what both sides use to misses and false alarms.

    Each track is taken in its likelier mode.
    """
    total = np.zeros(len(tracks))
    part = pairs.take(rows)
    chance = known.chances.detection[known.rays.sensor[part.ray]]
    odds = np.log(chance / ((1.0 - chance) * 2.0 * np.pi * known.chances.false_per_sr)) - 2.0 * np.log(part.sigma_rad)
    np.add.at(total, side, odds)
    some, place = np.unique(side, return_inverse=True)
    sights = _sights(pairs, rows, place.astype(np.int64))
    here = known.bank.take(tracks[some])
    coasts = here.weight[:, 1] > here.weight[:, 0]
    gained = np.zeros(len(some))
    for motion, mean, root, mine in (
        (known.filter.boost, here.boost_mean, here.boost_root, ~coasts),
        (known.filter.coast, here.coast_mean, here.coast_root, coasts),
    ):
        if mine.any():
            gained = np.where(mine, known.filter.taken_in(motion, mean, root, known.time_s, sights)[2], gained)
    total[some] += gained
    both: FloatArray = total.reshape(-1, 2).sum(axis=1)
    return both


def _applied(
    used: BoolArray, pairs: GatedPairs, trial: Exchange, gain: FloatArray, pulled: IntArray, whose: IntArray
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
