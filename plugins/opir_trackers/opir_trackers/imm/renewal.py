"""The pairing of a crowd anew: which tracks it changes, the states that follow, and what stays
undecided.
"""

from typing import NamedTuple

import numpy as np
from attrs import evolve, frozen
from opir_estimation import earth_rotated, ranks

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_trackers.imm.crowds import Crowds, SensorView, directions_at
from opir_trackers.imm.focal_plane import FocalPlaneTracks
from opir_trackers.imm.mixtures import Mixtures, widened
from opir_trackers.imm.refiltering import DirectionSums, Refiltering, refiltered
from opir_trackers.imm.state import TrackTable
from opir_trackers.pairing import (
    LAW as PAIRING,
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


@frozen
class RenewalLaw:
    """What is paired anew, and what follows."""

    #: Least probability of a rival that is part of a mixture.
    least_probability: float = 0.01

    #: Directions that a focal-plane track needs before it is paired anew.
    least_directions: int = 3

    #: Baseline of the velocity of crossings, s.
    baseline_s: float = 2.0

    #: Standard deviations of position, m, and velocity, m/s, of a track that has lost its partners,
    #: as of new tracks.
    lost_m: float = 30e3
    lost_m_s: float = 300.0

    #: A crossing of one instant is definite if its largest standard deviation is below this, m.
    least_fix_m: float = 10e3


LAW = RenewalLaw()


class _Stretch(NamedTuple):
    """Kept directions and their focal-plane tracks (m,), and the normal equations of all of
    these.
    """

    stored: Directions
    row: IntArray
    table: FloatArray
    centre: FloatArray

    def of(self, rows: IntArray) -> "_Stretch":
        """Return that of some focal-plane tracks, ascending."""
        place = _places(rows, self.row)
        direction_rows = np.flatnonzero(place >= 0)
        return _Stretch(
            self.stored.take(direction_rows), place[direction_rows], self.table[rows], self.centre
        )


class CrowdedTracks(NamedTuple):
    """The table of tracks at a time, s, and the crowds among them."""

    time_s: float
    table: TrackTable
    crowds: Crowds


def renewed(state: CrowdedTracks, view: SensorView, models: Refiltering) -> CrowdedTracks:
    """Return the tracks with the crowd's focal-plane tracks paired anew, if that is due."""
    tracks = state.crowds.tracks
    if state.time_s - state.crowds.paired_s < PAIRING.renewed_s - 1e-6 or not _are_several(tracks):
        return state
    stretch = _stretch(state.crowds)
    if not len(stretch.row):
        return state
    ready = _ready(tracks, stretch)
    mixtures = Mixtures.empty()
    if _are_several(tracks.take(ready)):
        state, mixtures = _paired(state, stretch, ready, view, models)
    crowds = evolve(state.crowds, mixtures=mixtures, paired_s=state.time_s)
    return state._replace(crowds=crowds)


def _are_several(tracks: FocalPlaneTracks) -> bool:
    """Whether there are focal-plane tracks of several sensors."""
    return len(tracks) > 1 and bool(np.ptp(tracks.sensor) > 0)


def _paired(
    state: CrowdedTracks,
    stretch: _Stretch,
    ready: IntArray,
    view: SensorView,
    models: Refiltering,
) -> tuple[CrowdedTracks, Mixtures]:
    """Return the state with the focal-plane tracks `ready` paired anew, and what stays
    undecided.
    """
    tracks = state.crowds.tracks
    table = stretch.table[ready]
    ready_tracks = tracks.take(ready)
    set_model = SetModel(stretch.centre, present=ranks(ready_tracks.number))
    group = cheapest_pairing(table, ready_tracks.sensor, set_model)
    number = tracks.number.copy()
    number[ready] = _numbers(group, ready_tracks)
    alternatives = rivals(table, ready_tracks.sensor, group, set_model, LAW.least_probability)
    if not np.array_equal(number, tracks.number):
        state = _repaired(state, number, stretch, models)
    ready_tracks = evolve(ready_tracks, number=number[ready])
    return state, _mixtures(ready_tracks, group, alternatives, state.time_s, view)


def _ready(tracks: FocalPlaneTracks, stretch: _Stretch) -> IntArray:
    """Return the focal-plane tracks to pair: of tracks all of which have enough kept directions,
    and whose pairing is open.
    """
    sparse = np.count_nonzero(stretch.table[..., 11], axis=1) < LAW.least_directions
    ready = np.flatnonzero(~np.isin(tracks.number, tracks.number[sparse]))
    return ready[are_open(stretch.table[ready], ranks(tracks.number[ready]))]


def _stretch(crowds: Crowds) -> _Stretch:
    """Return the kept directions of the focal-plane tracks that there are."""
    tracks = crowds.tracks
    stored = crowds.stored
    sensors = int(max(tracks.sensor.max(), stored.sensor.max(initial=0))) + 1
    key = tracks.number * sensors + tracks.sensor
    stored_key = stored.number * sensors + stored.sensor
    order = np.argsort(key)
    row = order[np.minimum(np.searchsorted(key[order], stored_key), len(key) - 1)]
    present = np.flatnonzero(key[row] == stored_key)
    stored = stored.take(present)
    row = row[present]
    return _Stretch(stored, row, *normal_equations(stored, row, len(tracks), tracks.range_m[row]))


def _numbers(group: IntArray, tracks: FocalPlaneTracks) -> IntArray:
    """Return the track number (n,) of each focal-plane track by its set, -1 for those without.

    Large sets choose first: the number of their focal-plane track of the first sensor, else another
    of their own. A set that is left without is no track: what a swap has mixed over the stretch
    fits nothing, and is begun anew.
    """
    number = np.full(int(group.max()) + 1, -1, dtype=np.int64)
    taken = set[int]()
    size = np.bincount(group)
    for row in np.lexsort((tracks.number, tracks.sensor, -size[group])).tolist():
        candidate = int(tracks.number[row])
        if number[group[row]] < 0 and candidate not in taken:
            number[group[row]] = candidate
            taken.add(candidate)
    return number[group]


def _repaired(
    state: CrowdedTracks, number: IntArray, stretch: _Stretch, models: Refiltering
) -> CrowdedTracks:
    """Return the state with focal-plane tracks given to the tracks `number` (n,), and the states
    that follow.
    """
    tracks = state.crowds.tracks
    state = _with_rows(state, number)
    changed = _changed(tracks, number)
    rows = np.flatnonzero(number >= 0)
    stretch = stretch.of(rows)
    number = number[rows]
    crowds = evolve(
        state.crowds,
        tracks=evolve(tracks.take(rows), number=number),
        stored=evolve(stretch.stored, number=number[stretch.row]),
    )
    state = state._replace(crowds=crowds)
    numbers, sensors = np.unique(number, return_counts=True)
    state = _without_range(state, np.intersect1d(changed, numbers[sensors == 1]))
    shared = np.intersect1d(changed, numbers[sensors > 1])
    return _filtered_anew(state, shared, stretch, models) if len(shared) else state


def _filtered_anew(
    state: CrowdedTracks, shared: IntArray, stretch: _Stretch, models: Refiltering
) -> CrowdedTracks:
    """Return the state with tracks `shared` (k,) by several sensors filtered anew, where their
    directions cross at a definite place.
    """
    stored = state.crowds.stored
    instants = np.unique(stretch.stored.time_s)
    set_of = _places(shared, state.crowds.tracks.number)
    paired = np.flatnonzero(set_of >= 0)
    sums = np.zeros((len(shared), *stretch.table.shape[1:]))
    np.add.at(sums, set_of[paired], stretch.table[paired])
    first_s = instants[first_instants(sums)]
    sums[instants < first_s[:, None]] = 0.0
    fixed = np.flatnonzero(_are_fixed(sums))
    track = _places(shared[fixed], stored.number)
    is_recent = stored.time_s >= np.append(first_s[fixed], np.inf)[track]
    directions = np.flatnonzero((track >= 0) & is_recent)
    if not len(directions):
        return state
    is_looked_at = np.isin(instants, stored.time_s[directions])
    rows = np.searchsorted(state.table.number, shared[fixed])
    crossings = DirectionSums(sums[fixed][:, is_looked_at], stretch.centre)
    estimates = refiltered(
        models,
        stored.take(directions),
        track[directions],
        crossings,
        state.table.estimates.take(rows),
        state.table.first_s[rows],
        state.time_s,
    )
    return state._replace(
        table=state.table.with_estimates(state.table.estimates.put(rows, estimates))
    )


def _places(numbers: IntArray, number: IntArray) -> IntArray:
    """Return the index of each number (n,) in `numbers`, ascending; -1 for none."""
    place = np.searchsorted(numbers, number)
    return np.where(np.append(numbers, -1)[place] == number, place, -1)


def _without_range(state: CrowdedTracks, number: IntArray) -> CrowdedTracks:
    """Return the state with the information from other sensors removed from tracks `number` (k,):
    range above all.
    """
    if not len(number):
        return state
    rows = np.searchsorted(state.table.number, number)
    lost = np.diag(np.square([LAW.lost_m] * 3 + [LAW.lost_m_s] * 3))
    estimates = widened(state.table.estimates.take(rows), lost[None].repeat(len(rows), 0))
    return state._replace(
        table=state.table.with_estimates(state.table.estimates.put(rows, estimates))
    )


def _are_fixed(sums: FloatArray) -> BoolArray:
    """Return which sets, of sums of normal equations (n, instants, 12), have lines that cross at a
    definite place.
    """
    crossing = sums[..., 11] > 1.5
    mean = (sums[..., :6] * crossing[..., None]).sum(axis=1) / np.maximum(crossing.sum(axis=1), 1)[
        :, None
    ]
    least = np.linalg.eigvalsh(mean[:, _SQUARE].reshape(-1, 3, 3))[:, 0]
    return crossing.any(axis=1) & (least > LAW.least_fix_m**-2)


#: The elements of a symmetric matrix (9) among its six.
_SQUARE = np.array([0, 1, 2, 1, 3, 4, 2, 4, 5])


def _changed(tracks: FocalPlaneTracks, number: IntArray) -> IntArray:
    """Return the sorted numbers of tracks that lost or gained a focal-plane track."""
    moved = np.flatnonzero(tracks.number != number)
    candidates = np.concatenate([number[moved], tracks.number[moved]])
    return np.intersect1d(candidates, number[number >= 0])


def _with_rows(state: CrowdedTracks, number: IntArray) -> CrowdedTracks:
    """Return the state without tracks that no focal-plane track, now of tracks `number` (n,) or -1
    for none, has any more.

    Sensors report of a track what they reported of its focal-plane tracks.
    """
    tracks = state.crowds.tracks
    table = state.table
    reports = table.reports[np.searchsorted(table.number, tracks.number), tracks.sensor]
    remaining = np.isin(table.number, number) | ~np.isin(table.number, tracks.number)
    rows = np.flatnonzero(remaining)
    table = table.take(rows)
    owned = number >= 0
    row = np.searchsorted(table.number, number[owned])
    new_reports = table.reports.copy()
    new_reports[np.unique(row)] = -1
    new_reports[row, tracks.sensor[owned]] = reports[owned]
    return state._replace(table=table.changed(reports=new_reports))


def _mixtures(
    tracks: FocalPlaneTracks, group: IntArray, doubt: Rivals, time_s: float, view: SensorView
) -> Mixtures:
    """Return the mixtures of sets with rivals, by where they cross and how fast that moves."""
    if not len(doubt.set):
        return Mixtures.empty()
    row = np.arange(len(tracks))
    baseline_s = (LAW.baseline_s, 0.0)
    directions = Directions.concatenate(
        [directions_at(tracks, row, time_s - back_s, view) for back_s in baseline_s]
    )
    table, centre = normal_equations(
        directions, np.tile(row, 2), len(tracks), np.tile(tracks.range_m, 2)
    )
    sums = set_sums(table, group)[doubt.set]
    rival_sums = sums - table[doubt.present] + table[doubt.rival]
    crossing = np.flatnonzero((sums[:, 0, 11] > 1.5) & (tracks.number[doubt.present] >= 0))
    offset = (intersections(rival_sums) + centre - (intersections(sums) + centre))[crossing]
    start, end = (
        earth_rotated(offset[:, column], np.full(len(crossing), time_s)) for column in (0, 1)
    )
    shift = np.concatenate([end, (end - start) / LAW.baseline_s], axis=1)
    sets, place = np.unique(doubt.set[crossing], return_inverse=True)
    number = tracks.number[np.unique(group, return_index=True)[1][sets]]
    order = np.argsort(number)
    return Mixtures.of(number, time_s, place, doubt.probability[crossing], shift).take(order)
