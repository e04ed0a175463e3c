"""Ghosts: two near tracks that each hold one sensor's lines of the other's target.

Assignments are made per sensor. Two tracks may agree with each sensor and yet follow no target: each lies where one
target's line from one sensor passes another target's line from a second. So for rivals (tracks that gate the same
lines) the lines of one sensor are swapped on trial, the lines of both are reassigned by the result, and the swap is
kept if it explains the slice better.
"""

from typing import NamedTuple

import numpy as np
from attrs import frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.estimation.lines_of_sight import AngleMeasurements, LinesOfSight
from opir_trackers.assignment import cheapest_assignment
from opir_trackers.association import AssociationModel, scan_groups
from opir_trackers.configs import GATE_SIGMAS
from opir_trackers.filter.estimates import ModeEstimates
from opir_trackers.filter.switching import ImmFilter
from opir_trackers.gating import GatedPairs, gated
from opir_trackers.triangulation import FAR_M

#: Rivals share at least this fraction of the lines of a sensor that one of them holds.
_LEAST_SHARED = 0.25

#: Tracks more accurate than this share of one look's error, at geostationary range, are not ghosts.
_FIRM = 0.5

#: A swap must increase the log likelihood by this much, so that noise causes no swaps back and forth.
_LEAST_GAIN = 1.0

#: A swap that decreases the log likelihood by more than this before reassignment is dropped.
_HOPELESS = 10.0


@frozen(eq=False)
class Slice:
    """The lines of a slice that ends at `time_s`, and the estimates before the update."""

    filter: ImmFilter
    model: AssociationModel
    light_time: bool
    estimates: ModeEstimates
    time_s: float
    lines: LinesOfSight


class Swaps(NamedTuple):
    """Trial swaps: two tracks (n,) each and the sensor whose lines they swap."""

    first: IntArray
    second: IntArray
    sensor: IntArray

    @property
    def tracks(self) -> IntArray:
        """Return the tracks of both sides (2 n,): side 2 k is the first of swap k."""
        return np.stack([self.first, self.second], axis=1).ravel()


def without_ghosts(known: Slice, pairs: GatedPairs, used: BoolArray) -> BoolArray:
    """Return which pairs (n,) are assigned after the swaps that explain a slice better.

    `used` marks the pairs of the initial assignment.
    """
    lines = known.lines
    loose = known.filter.predicted_measurements(known.estimates, known.time_s).position_bound_m(0.0)
    loose = loose > _FIRM * lines.sigma_rad.max(initial=0.0) * FAR_M
    if not loose.any():
        return used
    trial = _rivals(pairs, used, lines)
    trial = Swaps(*(column[loose[trial.first] | loose[trial.second]] for column in trial))
    if not len(trial.first):
        return used
    held = np.flatnonzero(used)
    swapped_rows, swapped_side = _swapped(pairs, held, lines, trial)
    kept, mine = _pairs_of_tracks(pairs, held, trial.tracks)
    before, after = (_score(known, pairs, *way, trial.tracks) for way in ((kept, mine), (swapped_rows, swapped_side)))
    hopeful = np.flatnonzero(after - before > -_HOPELESS)
    if not len(hopeful):
        return used
    some = Swaps(*(column[hopeful] for column in trial))
    before = _score(known, pairs, *_reassigned(known, pairs, used, *_of_swaps(kept, mine, hopeful), some), some.tracks)
    better, side = _reassigned(known, pairs, used, *_of_swaps(swapped_rows, swapped_side, hopeful), some)
    gain = _score(known, pairs, better, side, some.tracks) - before
    return _with_best_swaps(used, pairs, some, gain, better, side)


def _of_swaps(rows: IntArray, side: IntArray, trials: IntArray) -> tuple[IntArray, IntArray]:
    """Return the rows, and their sides, of some swaps, renumbered."""
    place = np.full(int(side.max(initial=0)) // 2 + 1, -1, dtype=np.int64)
    place[trials[trials < len(place)]] = np.flatnonzero(trials < len(place))
    mine = np.flatnonzero(place[side // 2] >= 0)
    return rows[mine], 2 * place[side[mine] // 2] + side[mine] % 2


def _reassigned(
    known: Slice, pairs: GatedPairs, used: BoolArray, rows: IntArray, side: IntArray, trial: Swaps
) -> tuple[IntArray, IntArray]:
    """Return pairs and sides after the lines of each swap are reassigned by the estimates from `rows`.

    Lines of other tracks are not used.
    """
    tracks = trial.tracks
    estimates = known.filter.updated(
        known.estimates.take(tracks), known.time_s, _measurements_of(pairs, rows, side), known.time_s - _first_s(known)
    )
    owner = np.full(len(known.lines), -1, dtype=np.int64)
    owner[pairs.line[used]] = pairs.track[used]
    row, which = _pairs_of_tracks(pairs, np.arange(len(pairs)), tracks)
    theirs = owner[pairs.line[row]]
    free = np.flatnonzero((theirs < 0) | (theirs == trial.first[which // 2]) | (theirs == trial.second[which // 2]))
    row, which = row[free], which[free]
    key = which * (len(known.lines) + 1) + pairs.line[row]
    near = gated(
        known.filter.predicted_measurements(estimates, known.time_s),
        known.lines,
        which,
        pairs.line[row],
        GATE_SIGMAS,
        known.light_time,
    )
    column = near.track // 2 * (len(known.lines) + 1) + near.line
    chosen = cheapest_assignment(scan_groups(near, known.lines), column, -known.model.log_ratio(near, known.lines))
    sought = near.track[chosen] * (len(known.lines) + 1) + near.line[chosen]
    order = np.argsort(key)
    return row[order[np.searchsorted(key, sought, sorter=order)]], near.track[chosen]


def _first_s(known: Slice) -> float:
    return float(known.lines.time_s.min(initial=known.time_s))


def _rivals(pairs: GatedPairs, used: BoolArray, lines: LinesOfSight) -> Swaps:
    """Return candidate swaps: neighbours in the lists of tracks that gate each assigned line."""
    order = np.lexsort((pairs.track, pairs.line))
    track, line = pairs.track[order], pairs.line[order]
    near = np.flatnonzero(line[1:] == line[:-1])
    sensor = lines.sensor[line[near]].astype(np.int64)
    trials, times = np.unique(np.stack([track[near], track[near + 1], sensor], axis=1), axis=0, return_counts=True)
    size = int(pairs.track.max(initial=0)) + 1
    seers = int(lines.sensor.max(initial=0)) + 1
    held = np.bincount(pairs.track[used] * seers + lines.sensor[pairs.line[used]], minlength=size * seers)
    enough = times >= _LEAST_SHARED * np.maximum(held[trials[:, 0] * seers + trials[:, 2]], 1)
    stereo = (held.reshape(size, seers) > 0).sum(axis=1)
    both = (stereo[trials[:, 0]] > 1) & (stereo[trials[:, 1]] > 1)
    return Swaps(*trials[enough & both].T)


def _swapped(pairs: GatedPairs, held: IntArray, lines: LinesOfSight, trial: Swaps) -> tuple[IntArray, IntArray]:
    """Return pairs and their side (twice the swap, plus one for the second track) after a swap."""
    size = len(lines) + 1
    key = pairs.track * size + pairs.line
    order = np.argsort(key)
    rows, sides = [], []
    for side, (one, other) in enumerate(((trial.first, trial.second), (trial.second, trial.first))):
        own, mine = _pairs_of_tracks(pairs, held, one)
        stays = lines.sensor[pairs.line[own]] != trial.sensor[mine]
        theirs, swap_row = _pairs_of_tracks(pairs, held, other)
        comes = lines.sensor[pairs.line[theirs]] == trial.sensor[swap_row]
        sought = one[swap_row[comes]] * size + pairs.line[theirs[comes]]
        place = order[np.minimum(np.searchsorted(key, sought, sorter=order), len(key) - 1)]
        gated = key[place] == sought
        rows += [own[stays], place[gated]]
        sides += [2 * mine[stays] + side, 2 * swap_row[comes][gated] + side]
    return np.concatenate(rows), np.concatenate(sides)


def _pairs_of_tracks(pairs: GatedPairs, held: IntArray, tracks: IntArray) -> tuple[IntArray, IntArray]:
    """Return the held pairs of each of tracks (n,), and the index of the track for each pair."""
    order = held[np.argsort(pairs.track[held], kind="stable")]
    sorted_tracks = pairs.track[order]
    start, stop = np.searchsorted(sorted_tracks, tracks), np.searchsorted(sorted_tracks, tracks, side="right")
    length = stop - start
    which = np.repeat(np.arange(len(tracks)), length)
    cluster = np.arange(int(length.sum())) - np.repeat(np.cumsum(length) - length, length) + np.repeat(start, length)
    return order[cluster], which


def _measurements_of(pairs: GatedPairs, rows: IntArray, side: IntArray) -> AngleMeasurements:
    """Return pairs as certain measurements of the tracks `root` (n,)."""
    part = pairs.take(rows)
    return part.measurements(part.measured, np.eye(2) / part.sigma_rad[:, None, None]).with_track(side)


def _score(known: Slice, pairs: GatedPairs, rows: IntArray, side: IntArray, tracks: IntArray) -> FloatArray:
    """Return the log likelihood ratio (swaps,) of both sides' pairs to misses and false alarms.

    Each track is in its likelier mode.
    """
    total = np.zeros(len(tracks))
    part = pairs.take(rows)
    chance = known.model.detection_probability[known.lines.sensor[part.line]]
    log_odds = np.log(chance / ((1.0 - chance) * 2.0 * np.pi * known.model.clutter_per_sr)) - 2.0 * np.log(
        part.sigma_rad
    )
    np.add.at(total, side, log_odds)
    some, place = np.unique(side, return_inverse=True)
    measurements = _measurements_of(pairs, rows, place.astype(np.int64))
    here = known.estimates.take(tracks[some])
    coasts = here.weight[:, 1] > here.weight[:, 0]
    gained = np.zeros(len(some))
    for motion, mean, root, mine in (
        (known.filter.boost, here.boost_mean, here.boost_root, ~coasts),
        (known.filter.coast, here.coast_mean, here.coast_root, coasts),
    ):
        if mine.any():
            gained = np.where(
                mine, known.filter.mode_updated(motion, mean, root, known.time_s, measurements)[2], gained
            )
    total[some] += gained
    both: FloatArray = total.reshape(-1, 2).sum(axis=1)
    return both


def _with_best_swaps(
    used: BoolArray, pairs: GatedPairs, trial: Swaps, gain: FloatArray, swapped_rows: IntArray, swapped_side: IntArray
) -> BoolArray:
    """Return which pairs are assigned after the best swaps, each track in at most one."""
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
        after[swapped_rows[swapped_side // 2 == number]] = True
    return after
