"""The pairing of a crowd anew: which tracks it changes, the states that follow, and what stays
undecided.
"""

from typing import NamedTuple

import numpy as np
from attrs import evolve

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_trackers.assignment import ranks
from opir_trackers.configs import ImmConfig
from opir_trackers.filter.switching import ImmFilter
from opir_trackers.imm.crowds import Crowds, SensorView, directions_at
from opir_trackers.imm.focal_plane import FocalPlaneTracks
from opir_trackers.imm.mixtures import Mixtures, widened
from opir_trackers.imm.refiltering import refiltered
from opir_trackers.imm.state import TrackerState
from opir_trackers.lines_of_sight import earth_rotated
from opir_trackers.pairing import (
    RENEWED_S,
    Directions,
    Rivals,
    SetModel,
    are_open,
    cheapest_pairing,
    first_instants,
    intersections,
    normal_equations,
    rivals,
    set_sums,
)

#: Least probability of a rival that is part of a mixture.
_LEAST_DOUBT = 0.01

#: Directions that a focal-plane track needs before it is paired anew.
_LEAST_DIRECTIONS = 3

#: Baseline of the velocity of crossings, s.
_BASELINE_S = 2.0


class _Stretch(NamedTuple):
    """Kept directions and their focal-plane tracks (m,), and the normal equations of all of
    these.
    """

    kept: Directions
    row: IntArray
    table: FloatArray
    centre: FloatArray

    def of(self, rows: IntArray) -> "_Stretch":
        """Return that of some focal-plane tracks, ascending."""
        place = _places(rows, self.row)
        mine = np.flatnonzero(place >= 0)
        return _Stretch(self.kept.take(mine), place[mine], self.table[rows], self.centre)


def renewed(
    now: TrackerState, view: SensorView, filter_: ImmFilter, config: ImmConfig
) -> TrackerState:
    """Return the state with the crowd's focal-plane tracks paired anew, if that is due."""
    tracks = now.crowds.tracks
    if (
        now.time_s - now.crowds.paired_s < RENEWED_S - 1e-6
        or len(tracks) < 2
        or np.ptp(tracks.sensor) == 0
    ):
        return now
    stretch = _stretch(now.crowds)
    if not len(stretch.row):
        return now
    ready = _ready(tracks, stretch)
    ready = ready[are_open(stretch.table[ready], ranks(tracks.number[ready]))]
    table = stretch.table[ready]
    sensor = tracks.sensor[ready]
    if len(ready) < 2 or np.ptp(sensor) == 0:
        return evolve(
            now, crowds=evolve(now.crowds, mixtures=Mixtures.empty(), paired_s=now.time_s)
        )
    model = SetModel(stretch.centre, present=ranks(tracks.number[ready]))
    group = cheapest_pairing(table, sensor, model)
    number = tracks.number.copy()
    number[ready] = _numbers(group, tracks.take(ready))
    doubt = rivals(table, sensor, group, model, _LEAST_DOUBT)
    if not np.array_equal(number, tracks.number):
        now = _repaired(now, number, stretch, filter_, config, view.light_time)
    ready_tracks = evolve(tracks.take(ready), number=number[ready])
    mixtures = _mixtures(ready_tracks, group, doubt, now.time_s, view)
    return evolve(now, crowds=evolve(now.crowds, mixtures=mixtures, paired_s=now.time_s))


def _ready(tracks: FocalPlaneTracks, stretch: _Stretch) -> IntArray:
    """Return the focal-plane tracks of tracks all of which have enough kept directions."""
    few = np.count_nonzero(stretch.table[..., 11], axis=1) < _LEAST_DIRECTIONS
    return np.flatnonzero(~np.isin(tracks.number, tracks.number[few]))


def _stretch(crowds: Crowds) -> _Stretch:
    """Return the kept directions of the focal-plane tracks that there are."""
    tracks = crowds.tracks
    kept = crowds.kept
    sensors = int(max(tracks.sensor.max(), kept.sensor.max(initial=0))) + 1
    key = tracks.number * sensors + tracks.sensor
    sought = kept.number * sensors + kept.sensor
    order = np.argsort(key)
    row = order[np.minimum(np.searchsorted(key[order], sought), len(key) - 1)]
    here = np.flatnonzero(key[row] == sought)
    kept = kept.take(here)
    row = row[here]
    return _Stretch(kept, row, *normal_equations(kept, row, len(tracks), tracks.range_m[row]))


def _numbers(group: IntArray, tracks: FocalPlaneTracks) -> IntArray:
    """Return the track number (n,) of each focal-plane track by its set, -1 for those without.

    Large sets choose first: the number of their focal-plane track of the first sensor, else another
    of their own. A set that is left without is no track: what a swap has mixed over the stretch
    fits nothing, and is begun anew.
    """
    number = np.full(int(group.max()) + 1, -1, dtype=np.int64)
    taken = set()
    size = np.bincount(group)
    for row in np.lexsort((tracks.number, tracks.sensor, -size[group])).tolist():
        one = int(tracks.number[row])
        if number[group[row]] < 0 and one not in taken:
            number[group[row]] = one
            taken.add(one)
    return number[group]


def _repaired(
    now: TrackerState,
    number: IntArray,
    stretch: _Stretch,
    filter_: ImmFilter,
    config: ImmConfig,
    light_time: bool,
) -> TrackerState:
    """Return the state with focal-plane tracks given to the tracks `number` (n,), and the states
    that follow.
    """
    before = now.crowds.tracks.number
    changed = _changed(now.crowds.tracks, number)
    if np.count_nonzero(number < 0):
        left = np.flatnonzero(number >= 0)
        now = evolve(now, crowds=evolve(now.crowds, tracks=now.crowds.tracks.take(left)))
        stretch = stretch.of(left)
        number = number[left]
    tracks = now.crowds.tracks
    now = _with_rows(now, number, before)
    kept = evolve(stretch.kept, number=number[stretch.row])
    crowds = evolve(now.crowds, tracks=evolve(tracks, number=number), kept=kept)
    now = evolve(now, crowds=crowds)
    held_by, rows_of = np.unique(number, return_counts=True)
    now = _without_range(now, np.intersect1d(changed, held_by[rows_of == 1]))
    several = np.intersect1d(changed, held_by[rows_of > 1])
    return (
        _filtered_anew(now, several, number, stretch, filter_, config, light_time)
        if len(several)
        else now
    )


def _filtered_anew(
    now: TrackerState,
    several: IntArray,
    number: IntArray,
    stretch: _Stretch,
    filter_: ImmFilter,
    config: ImmConfig,
    light_time: bool,
) -> TrackerState:
    """Return the state with tracks `several` (k,) filtered anew, where their directions cross at a
    definite place.
    """
    kept = now.crowds.kept
    which = _places(several, number)
    held = np.flatnonzero(which >= 0)
    sums = np.zeros((len(several), *stretch.table.shape[1:]))
    np.add.at(sums, which[held], stretch.table[held])
    instants = np.unique(stretch.kept.time_s)
    first_s = instants[first_instants(sums)]
    sums[instants < first_s[:, None]] = 0.0
    fixed = np.flatnonzero(_are_fixed(sums))
    whose = _places(several[fixed], kept.number)
    mine = np.flatnonzero((whose >= 0) & (kept.time_s >= np.append(first_s[fixed], np.inf)[whose]))
    if not len(mine):
        return now
    some = np.isin(instants, kept.time_s[mine])
    rows = np.searchsorted(now.table.number, several[fixed])
    after = refiltered(
        filter_,
        config,
        kept.take(mine),
        whose[mine],
        sums[fixed][:, some],
        stretch.centre,
        now.estimates.take(rows),
        now.table.first_s[rows],
        now.time_s,
        light_time,
    )
    return evolve(now, estimates=now.estimates.put(rows, after))


def _places(some: IntArray, number: IntArray) -> IntArray:
    """Return the index of each number (n,) in `some`, ascending; -1 for none."""
    place = np.searchsorted(some, number)
    found: IntArray = np.where(np.append(some, -1)[place] == number, place, -1)
    return found


def _without_range(now: TrackerState, number: IntArray) -> TrackerState:
    """Return the state with the information from other sensors removed from tracks `number` (k,):
    range above all.
    """
    if not len(number):
        return now
    rows = np.searchsorted(now.table.number, number)
    lost = np.diag(np.square([_LOST_M] * 3 + [_LOST_M_S] * 3))
    return evolve(
        now,
        estimates=now.estimates.put(
            rows, widened(now.estimates.take(rows), lost[None].repeat(len(rows), 0))
        ),
    )


#: Standard deviations of position, m, and velocity, m/s, of a track that has lost its partners, as
#: of new tracks.
_LOST_M = 30e3
_LOST_M_S = 300.0


def _are_fixed(sums: FloatArray) -> BoolArray:
    """Return which sets, of sums of normal equations (n, instants, 12), have lines that cross at a
    definite place.
    """
    there = sums[..., 11] > 1.5
    mean = (sums[..., :6] * there[..., None]).sum(axis=1) / np.maximum(there.sum(axis=1), 1)[
        :, None
    ]
    least = np.linalg.eigvalsh(mean[:, _SQUARE].reshape(-1, 3, 3))[:, 0]
    return np.asarray(there.any(axis=1) & (least > _LEAST_FIX_M**-2))


#: The elements of a symmetric matrix (9) among its six.
_SQUARE = np.array([0, 1, 2, 1, 3, 4, 2, 4, 5])

#: A crossing of one instant is definite if its largest standard deviation is below this, m.
_LEAST_FIX_M = 10e3


def _changed(tracks: FocalPlaneTracks, number: IntArray) -> IntArray:
    """Return the sorted numbers of tracks that lost or gained a focal-plane track."""
    moved = np.flatnonzero(tracks.number != number)
    every = np.concatenate([number[moved], tracks.number[moved]])
    return np.intersect1d(every, number[number >= 0])


def _with_rows(now: TrackerState, number: IntArray, before: IntArray) -> TrackerState:
    """Return the state without tracks that no focal-plane track, now of tracks `number` (n,), has
    any more.

    `before` are the tracks that had any. Sensors report of a track what they reported of its
    focal-plane tracks.
    """
    tracks = now.crowds.tracks
    table = now.table
    reports = table.reports[np.searchsorted(table.number, tracks.number), tracks.sensor]
    kept = np.flatnonzero(np.isin(table.number, number) | ~np.isin(table.number, before))
    after = table.take(kept)
    row = np.searchsorted(after.number, number)
    seen = after.reports.copy()
    seen[np.unique(row)] = -1
    seen[row, tracks.sensor] = reports
    return evolve(
        now,
        table=evolve(after, reports=seen),
        estimates=now.estimates.take(kept),
        motion=now.motion.take(kept),
    )


def _mixtures(
    tracks: FocalPlaneTracks, group: IntArray, doubt: Rivals, time_s: float, view: SensorView
) -> Mixtures:
    """Return the mixtures of sets with rivals, by where they cross and how fast that moves."""
    if not len(doubt.set):
        return Mixtures.empty()
    every = np.arange(len(tracks))
    parts = [directions_at(tracks, every, time_s - back_s, view) for back_s in (_BASELINE_S, 0.0)]
    directions = Directions.concatenate(parts)
    table, centre = normal_equations(
        directions, np.tile(every, 2), len(tracks), np.tile(tracks.range_m, 2)
    )
    own = set_sums(table, group)[doubt.set]
    crossings = [
        intersections(each) + centre for each in (own, own - table[doubt.own] + table[doubt.other])
    ]
    met = np.flatnonzero((own[:, 0, 11] > 1.5) & (tracks.number[doubt.own] >= 0))
    apart = (crossings[1] - crossings[0])[met]
    inertial = [earth_rotated(apart[:, column], np.full(len(met), time_s)) for column in (0, 1)]
    moved = np.concatenate([inertial[1], (inertial[1] - inertial[0]) / _BASELINE_S], axis=1)
    which, place = np.unique(doubt.set[met], return_inverse=True)
    number = tracks.number[[int(np.argmax(group == one)) for one in which]] if len(which) else which
    order = np.argsort(number)
    return Mixtures.of(number, time_s, place, doubt.probability[met], moved).take(order)
