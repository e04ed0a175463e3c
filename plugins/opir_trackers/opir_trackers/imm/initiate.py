"""Initiate: tracks from lines that no track has, of the last scans, and that none explains as
outliers.
"""

import numpy as np
from attrs import evolve
from opir_estimation import (
    OUTLIER_SIGMAS,
    LinesOfSight,
    ModeEstimates,
    candidates,
    explained_looks,
    gated,
)

from opir_core.arrays import IntArray
from opir_trackers import initiation
from opir_trackers.association import associate_nearest, hard_measurements
from opir_trackers.imm import crowds as crowd
from opir_trackers.imm.models import TrackingModels
from opir_trackers.imm.predict import SlicePrediction
from opir_trackers.imm.state import TrackerState
from opir_trackers.imm.track_management import TrackTable
from opir_trackers.onset.motion_statistics import MotionStatistics
from opir_trackers.track_priors import prior_estimates


def initiate(
    models: TrackingModels,
    state: TrackerState,
    prediction: SlicePrediction,
    owner: IntArray,
    raw: LinesOfSight,
    reported: IntArray,
) -> TrackerState:
    """Return the state with tracks from unassigned lines, after a slice of which lines (m,) have
    tracks `owner`.

    `raw` are the slice's lines as they came, `reported` (m,) their types.
    """
    state, claimed = _with_explained(models, state, prediction, owner)
    state = _with_unclaimed(models, state, raw, claimed, reported, prediction.span_s)
    return _with_initiated(models, state)


def _with_explained(
    models: TrackingModels, state: TrackerState, prediction: SlicePrediction, owner: IntArray
) -> tuple[TrackerState, IntArray]:
    """Return the state, and the owners (m,) of lines with 0 for those that a track explains as
    outliers.
    """
    if not len(state.table) or not np.count_nonzero(owner < 0):
        return state, owner
    unowned = np.flatnonzero(owner < 0)
    path = models.path(state.estimates, state.time_s)
    lines = prediction.lines.take(unowned)
    gate = (OUTLIER_SIGMAS, models.light_time)
    pairs = gated(path, lines, *candidates(path, lines, prediction.span_s, *gate), *gate)
    rows = np.flatnonzero(owner >= 0)
    owned = (owner[rows], prediction.lines.take(rows))
    registration = state.registration.at(state.time_s)
    tracks = registration.tracks.of(state.table.number)
    explained, tracks = explained_looks(pairs, lines, owned, tracks, models.config.gate_sigma)
    claimed = owner.copy()
    claimed[unowned[explained]] = 0
    return evolve(state, registration=evolve(registration, tracks=tracks)), claimed


def _with_unclaimed(
    models: TrackingModels,
    state: TrackerState,
    lines: LinesOfSight,
    owner: IntArray,
    reported: IntArray,
    span_s: float,
) -> TrackerState:
    """Return the state with the unassigned lines added, and old ones removed."""
    is_free = owner < 0
    if not len(state.unclaimed.time_s) and not np.count_nonzero(is_free):
        return state
    free = np.flatnonzero(is_free)
    unclaimed = (
        LinesOfSight.concatenate([state.unclaimed, lines.take(free)])
        if len(free)
        else state.unclaimed
    )
    types = np.concatenate([state.reported, reported[free]])
    recent_s = models.config.recent_scans * models.period_s[unclaimed.sensor] + span_s
    recent = np.flatnonzero(state.time_s - unclaimed.time_s <= recent_s)
    return evolve(state, unclaimed=unclaimed.take(recent), reported=types[recent])


def _with_initiated(models: TrackingModels, state: TrackerState) -> TrackerState:
    """Return the state with tracks initiated from unassigned lines."""
    if len(state.unclaimed.time_s) < models.needed_scans:
        return state
    lines = models.corrected(state.registration, state.unclaimed)
    initiation_ = initiation.track_candidates(
        lines, models.needed_scans, state.registration.loose_rad
    )
    begun = initiation_.begun
    if not len(begun):
        return state
    span_s = state.time_s - float(lines.time_s.min())
    prior = prior_estimates(begun, state.time_s, models.config)
    path = models.filter.predicted_measurements(prior, state.time_s)
    pairs = models.gated_pairs(path, lines, span_s)
    owned = initiation_.owned(pairs.track, pairs.line, lines.sensor[pairs.line])
    association = associate_nearest(pairs.take(np.flatnonzero(owned)), lines, models.association)
    crossing = initiation.placed_at_crossings(begun, lines, association.owner)
    if crossing is not begun:
        prior = prior_estimates(crossing, state.time_s, models.config)
    looks = hard_measurements(association.assigned)
    estimates = models.filter.updated(prior, state.time_s, looks, span_s)
    return _with_new_tracks(models, state, prior, estimates, association.owner)


def _with_new_tracks(
    models: TrackingModels,
    state: TrackerState,
    prior: ModeEstimates,
    estimates: ModeEstimates,
    candidate_of: IntArray,
) -> TrackerState:
    """Return the state with the candidates that have enough lines as tracks, numbered in order."""
    hits = np.bincount(candidate_of[candidate_of >= 0], minlength=len(prior))
    is_track = hits >= models.needed_scans
    row = np.append(np.where(is_track, np.cumsum(is_track) - 1, -1), -1)
    owner = row[candidate_of]
    count = int(is_track.sum())
    table = _new_table(models, state, owner, count)
    position_m = prior.likelier_position_m[is_track]
    motion = MotionStatistics.fresh(position_m, state.time_s, table.first_s, models.groups.prior)
    lines = models.corrected(state.registration, state.unclaimed)
    motion = motion.with_lines(owner, lines, models.groups.log_clutter)
    remaining = np.flatnonzero(owner < 0)
    new_estimates = estimates.take(np.flatnonzero(is_track))
    next_state = evolve(
        state,
        estimates=ModeEstimates.concatenate([state.estimates, new_estimates]),
        table=TrackTable.concatenate([state.table, table]),
        unclaimed=state.unclaimed.take(remaining),
        reported=state.reported[remaining],
        next_number=state.next_number + count,
        motion=MotionStatistics.concatenate([state.motion, motion]),
    )
    return _with_neighbours(models, next_state, count)


def _new_table(
    models: TrackingModels, state: TrackerState, owner: IntArray, count: int
) -> TrackTable:
    """Return the table of new tracks, rows of which own unclaimed lines (m,)."""
    number = np.arange(state.next_number, state.next_number + count)
    table = TrackTable.fresh(number, state.time_s, len(models.period_s))
    lines = state.unclaimed
    return table.with_detections(owner, lines.time_s, lines.sensor, state.reported)


def _with_neighbours(models: TrackingModels, state: TrackerState, count: int) -> TrackerState:
    """Return the state with the last `count` tracks, and those near them, in a crowd, where several
    are near.
    """
    visible = state.table.reports >= 0
    rows = (
        crowd.begun_near(state.estimates.likelier_position_m, count, visible)
        if count
        else np.empty(0, dtype=np.int64)
    )
    rows = rows[~state.crowds.holds(state.table.number[rows])]
    if not len(rows):
        return state
    path = models.path(state.estimates, state.time_s)
    view = models.view(state.registration)
    return evolve(
        state, crowds=crowd.joined(state.crowds, state.table.number, rows, path, visible, view)
    )
