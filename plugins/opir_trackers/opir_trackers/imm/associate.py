"""Associate: the track of each line of a slice. Tracks that share lines follow them in the sensors'
focal planes.
"""

from typing import NamedTuple

import numpy as np

from opir_core.arrays import IndexArray, IntArray
from opir_trackers.association import ambiguous_tracks, associate_nearest, unassigned
from opir_trackers.gating import GatedPairs
from opir_trackers.imm import crowds as crowd
from opir_trackers.imm.crowds import CrowdPairs, Crowds, SensorView
from opir_trackers.imm.models import TrackingModels
from opir_trackers.imm.predict import Ahead, predict
from opir_trackers.imm.state import TrackerState
from opir_trackers.imm.track_management import TrackTable
from opir_trackers.lines_of_sight import LinesOfSight

_NOBODY = np.array([-1])
_NONE = np.empty(0, dtype=np.int64)


class Associated(NamedTuple):
    """The track row of each line (m,) of a slice, -1 for none, and what tracks are updated with.

    `pairs` are those within the gates of lone tracks, `assigned` those assigned, `used` these and
    the equivalent lines of crowds, `sensor` (k,) the sensors of the used ones. `shared` are lone
    tracks that share lines.
    """

    owner: IntArray
    pairs: GatedPairs
    assigned: GatedPairs
    used: GatedPairs
    sensor: IndexArray
    crowds: Crowds
    shared: IntArray


def associate(models: TrackingModels, now: TrackerState, ahead: Ahead) -> Associated:
    """Return the association of a slice's lines with the tracks that are predicted."""
    table = now.table
    lines = ahead.lines
    pairs = ahead.pairs
    near = ahead.near
    crowds = now.crowds
    if near is None and not pairs.track.size:
        return Associated(
            unassigned(len(lines)), pairs, pairs, pairs, lines.sensor[:0], crowds, _NONE
        )
    if near is None and table.number.size == 1:
        return _alone(models, ahead, crowds)
    view = models.view(now.registration)
    if table.number.size > 1:
        rows = crowd.contested_tracks(
            pairs.track, pairs.line, lines.sensor[pairs.line], table.reports >= 0
        )
        rows = rows[~crowds.holds(table.number[rows])]
        if len(rows):
            crowds = crowd.joined(crowds, table.number, rows, ahead.path, table.reports >= 0, view)
            near = crowd.paired(
                crowds.tracks, now.time_s, lines, ahead.span_s, models.config.gate_sigma
            )
    if near is None:
        return _alone(models, ahead, crowds)
    return _in_crowds(models, crowds, near, ahead, table, view)


def _alone(models: TrackingModels, ahead: Ahead, crowds: Crowds) -> Associated:
    """Return the association where no track is in a crowd."""
    pairs = ahead.pairs
    lines = ahead.lines
    found = associate_nearest(pairs, lines, models.association)
    shared = ambiguous_tracks(pairs, lines) if found.is_ambiguous else _NONE
    sensor = lines.sensor[found.assigned.line]
    return Associated(found.owner, pairs, found.assigned, found.assigned, sensor, crowds, shared)


def _in_crowds(
    models: TrackingModels,
    crowds: Crowds,
    near: CrowdPairs,
    ahead: Ahead,
    table: TrackTable,
    view: SensorView,
) -> Associated:
    """Return the association where some tracks are in crowds: these take their lines first."""
    lines = ahead.lines
    seen = table.reports >= 0
    update = crowd.updated_crowds(
        crowds, near, lines, ahead.end_s, models.association, models.config.gate_sigma, view
    )
    sharing = np.unique(
        ahead.pairs.track[np.isin(ahead.pairs.line, np.flatnonzero(update.number >= 0))]
    )
    follows = update.crowds.follows(table.number, seen.shape[1])
    taken = follows[ahead.pairs.track, lines.sensor[ahead.pairs.line]] | (
        update.number[ahead.pairs.line] >= 0
    )
    found = _alone(
        models, ahead._replace(pairs=ahead.pairs.take(np.flatnonzero(~taken))), update.crowds
    )
    # Those that join now were alone in this slice.
    sharing = sharing[~update.crowds.holds(table.number[sharing])]
    crowds = update.crowds
    if len(sharing):
        crowds = crowd.joined(crowds, table.number, sharing, ahead.path, seen, view)
    fresh = np.zeros(seen.shape, dtype=bool)
    fresh[found.assigned.track, found.sensor] = True
    fresh &= crowds.holds(table.number)[:, None] & ~crowds.follows(table.number, seen.shape[1])
    rows = np.flatnonzero(fresh.any(axis=1))
    if len(rows):
        crowds = crowd.joined(crowds, table.number, rows, ahead.path, fresh, view)
    theirs = crowd.equivalent_pairs(update, table.number, ahead.path, models.light_time)
    return found._replace(
        owner=np.where(
            update.number >= 0, np.searchsorted(table.number, update.number), found.owner
        ),
        used=GatedPairs.concatenate([found.used, theirs]),
        sensor=np.append(found.sensor, update.equivalent.sensor),
        crowds=crowds,
    )


def track_numbers(models: TrackingModels, now: TrackerState, lines: LinesOfSight) -> IntArray:
    """Return the track number (n,) of each line of sight of the next tick, -1 for none.

    Only lines of one sensor and one instant compete, so the result does not depend on how the scene
    is cut into calls.
    """
    if not len(now.estimates.weight) or not len(lines.time_s):
        return unassigned(len(lines.time_s))
    lines = models.corrected(now.registration, lines)
    ahead = predict(models, now, now.time_s + models.config.cadence_s, lines)
    pairs = ahead.pairs
    if ahead.near is not None:
        pairs = GatedPairs.concatenate(
            [pairs, crowd.label_pairs(ahead.near, now.table.number, lines)]
        )
    confirmed = models.confirmed(now)
    if np.count_nonzero(confirmed) < len(confirmed):
        pairs = pairs.take(np.flatnonzero(confirmed[pairs.track]))
    owner = associate_nearest(pairs, lines.of_instants(), models.association).owner
    return np.concatenate([now.table.number, _NOBODY])[owner]
