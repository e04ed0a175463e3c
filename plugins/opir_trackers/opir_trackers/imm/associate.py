"""Associate: the track of each line of a slice. Tracks that share lines follow them in the sensors'
focal planes.
"""

from typing import NamedTuple

import numpy as np
from opir_estimation import GatedPairs, LinesOfSight

from opir_core.arrays import IndexArray, IntArray
from opir_trackers.association import ambiguous_tracks, associate_nearest, unassigned
from opir_trackers.imm import crowds as crowd
from opir_trackers.imm.crowds import CrowdPairs, Crowds, SensorView
from opir_trackers.imm.models import TrackingModels
from opir_trackers.imm.predict import SlicePrediction, predict
from opir_trackers.imm.state import TrackerState
from opir_trackers.imm.track_management import TrackTable

_NONE = np.empty(0, dtype=np.int64)


class Associated(NamedTuple):
    """The track row of each line (m,) of a slice, -1 for none, and what tracks are updated with.

    `pairs` are those within the gates of lone tracks, `assigned` those assigned, `updating` these
    and the equivalent lines of crowds, `sensor` (k,) the sensors of the latter. `shared` are lone
    tracks that share lines.
    """

    owner: IntArray
    pairs: GatedPairs
    assigned: GatedPairs
    updating: GatedPairs
    sensor: IndexArray
    crowds: Crowds
    shared: IntArray


def associate(
    models: TrackingModels, state: TrackerState, prediction: SlicePrediction
) -> Associated:
    """Return the association of a slice's lines with the tracks that are predicted."""
    table = state.table
    crowds = state.crowds
    crowd_pairs = prediction.crowd_pairs
    if crowd_pairs is None and not prediction.pairs.track.size:
        return _unassociated(prediction, crowds)
    if crowd_pairs is None and table.number.size == 1:
        return _outside_crowds(models, prediction, crowds)
    view = models.view(state.registration)
    seen = table.reports >= 0
    pairs = prediction.pairs
    sensor = prediction.lines.sensor[pairs.line]
    rows = crowd.contested_tracks(pairs.track, pairs.line, sensor, seen)
    rows = rows[~crowds.holds(table.number[rows])]
    if len(rows):
        crowds = crowd.joined(crowds, table.number, rows, prediction.path, seen, view)
        crowd_pairs = crowd.paired(
            crowds.tracks,
            state.time_s,
            prediction.lines,
            prediction.span_s,
            models.config.gate_sigma,
        )
    if crowd_pairs is None:
        return _outside_crowds(models, prediction, crowds)
    return _in_crowds(models, crowds, crowd_pairs, prediction, table, view)


def _unassociated(prediction: SlicePrediction, crowds: Crowds) -> Associated:
    """Return the association where no line has a track."""
    lines = prediction.lines
    owner = unassigned(len(lines))
    pairs = prediction.pairs
    return Associated(owner, pairs, pairs, pairs, lines.sensor[:0], crowds, _NONE)


def _outside_crowds(
    models: TrackingModels, prediction: SlicePrediction, crowds: Crowds
) -> Associated:
    """Return the association of tracks that are in no crowd."""
    pairs = prediction.pairs
    lines = prediction.lines
    association = associate_nearest(pairs, lines, models.association)
    assigned = association.assigned
    shared = ambiguous_tracks(pairs, lines) if association.is_ambiguous else _NONE
    sensor = lines.sensor[assigned.line]
    return Associated(association.owner, pairs, assigned, assigned, sensor, crowds, shared)


def _in_crowds(
    models: TrackingModels,
    crowds: Crowds,
    crowd_pairs: CrowdPairs,
    prediction: SlicePrediction,
    table: TrackTable,
    view: SensorView,
) -> Associated:
    """Return the association where some tracks are in crowds: these take their lines first."""
    lines = prediction.lines
    pairs = prediction.pairs
    gate = models.config.gate_sigma
    update = crowd.updated_crowds(
        crowds, crowd_pairs, lines, prediction.end_s, models.association, gate, view
    )
    has_owner = update.number >= 0
    follows = update.crowds.follows(table.number, table.reports.shape[1])
    is_taken = follows[pairs.track, lines.sensor[pairs.line]] | has_owner[pairs.line]
    outside = prediction._replace(pairs=pairs.take(np.flatnonzero(~is_taken)))
    association = _outside_crowds(models, outside, update.crowds)
    # Those that join now were alone in this slice.
    sharing = np.unique(pairs.track[np.isin(pairs.line, np.flatnonzero(has_owner))])
    crowds = _with_joining(association, sharing, prediction, table, view)
    equivalent = crowd.equivalent_pairs(update, table.number, prediction.path, models.light_time)
    rows = np.searchsorted(table.number, update.number)
    return association._replace(
        owner=np.where(has_owner, rows, association.owner),
        updating=GatedPairs.concatenate([association.updating, equivalent]),
        sensor=np.append(association.sensor, update.equivalent.sensor),
        crowds=crowds,
    )


def _with_joining(
    association: Associated,
    sharing: IntArray,
    prediction: SlicePrediction,
    table: TrackTable,
    view: SensorView,
) -> Crowds:
    """Return the crowds with the tracks `sharing` lines with them, and in the sensors that newly
    detected tracks of theirs.
    """
    crowds = association.crowds
    number = table.number
    seen = table.reports >= 0
    rows = sharing[~crowds.holds(number[sharing])]
    if len(rows):
        crowds = crowd.joined(crowds, number, rows, prediction.path, seen, view)
    detected = np.zeros(seen.shape, dtype=bool)
    detected[association.assigned.track, association.sensor] = True
    detected &= crowds.holds(number)[:, None] & ~crowds.follows(number, seen.shape[1])
    rows = np.flatnonzero(detected.any(axis=1))
    if len(rows):
        crowds = crowd.joined(crowds, number, rows, prediction.path, detected, view)
    return crowds


def track_numbers(models: TrackingModels, state: TrackerState, lines: LinesOfSight) -> IntArray:
    """Return the track number (n,) of each line of sight of the next tick, -1 for none.

    Only lines of one sensor and one instant compete, so the result does not depend on how the scene
    is cut into calls.
    """
    if not len(state.estimates.weight) or not len(lines.time_s):
        return unassigned(len(lines.time_s))
    lines = models.corrected(state.registration, lines)
    prediction = predict(models, state, state.time_s + models.config.cadence_s, lines)
    pairs = prediction.pairs
    if prediction.crowd_pairs is not None:
        labels = crowd.label_pairs(prediction.crowd_pairs, state.table.number, lines)
        pairs = GatedPairs.concatenate([pairs, labels])
    confirmed = models.confirmed(state)
    if np.count_nonzero(confirmed) < len(confirmed):
        pairs = pairs.take(np.flatnonzero(confirmed[pairs.track]))
    owner = associate_nearest(pairs, lines.of_instants(), models.association).owner
    return np.append(state.table.number, -1)[owner]
