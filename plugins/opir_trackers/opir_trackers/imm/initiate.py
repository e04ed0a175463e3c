"""Initiate: tracks from lines that no track has, of the last scans, and that none explains as
outliers.
"""

import numpy as np
from attrs import evolve

from opir_core.arrays import IntArray
from opir_trackers import initiation
from opir_trackers.association import associate_nearest, hard_measurements
from opir_trackers.filter.estimates import ModeEstimates
from opir_trackers.gating import candidates, gated
from opir_trackers.imm import crowds as crowd
from opir_trackers.imm.models import TrackingModels
from opir_trackers.imm.predict import Ahead
from opir_trackers.imm.state import TrackerState
from opir_trackers.imm.track_management import TrackTable
from opir_trackers.lines_of_sight import LinesOfSight
from opir_trackers.onset.motion_statistics import MotionStatistics
from opir_trackers.registration.innovations import OUTLIER_SIGMAS, explained_looks
from opir_trackers.track_priors import prior_estimates


def initiate(
    models: TrackingModels,
    now: TrackerState,
    ahead: Ahead,
    owner: IntArray,
    raw: LinesOfSight,
    reported: IntArray,
) -> TrackerState:
    """Return the state with tracks from unassigned lines, after a slice of which lines (m,) have
    tracks `owner`.

    `raw` are the slice's lines as they came, `reported` (m,) their types.
    """
    now, claimed = _with_explained(models, now, ahead, owner)
    now = _with_unclaimed(models, now, raw, claimed, reported, ahead.span_s)
    return _with_initiated(models, now)


def _with_explained(
    models: TrackingModels, now: TrackerState, ahead: Ahead, owner: IntArray
) -> tuple[TrackerState, IntArray]:
    """Return the state, and the owners (m,) of lines with 0 for those that a track explains as
    outliers.
    """
    if not len(now.table) or not np.count_nonzero(owner < 0):
        return now, owner
    free = np.flatnonzero(owner < 0)
    some = np.zeros(len(owner), dtype=np.bool_)
    path = models.path(now.estimates, now.time_s)
    left = ahead.lines.take(free)
    near = candidates(path, left, ahead.span_s, OUTLIER_SIGMAS, models.light_time)
    pairs = gated(path, left, *near, OUTLIER_SIGMAS, models.light_time)
    mine = np.flatnonzero(owner >= 0)
    known = now.registration.at(now.time_s)
    owned = (owner[mine], ahead.lines.take(mine))
    tracks = known.tracks.of(now.table.number)
    some[free], tracks = explained_looks(pairs, left, owned, tracks, models.config.gate_sigma)
    return evolve(now, registration=evolve(known, tracks=tracks)), np.where(some, 0, owner)


def _with_unclaimed(
    models: TrackingModels,
    now: TrackerState,
    lines: LinesOfSight,
    owner: IntArray,
    reported: IntArray,
    span_s: float,
) -> TrackerState:
    """Return the state with the unassigned lines added, and old ones removed."""
    is_free = owner < 0
    if not len(now.unclaimed.time_s) and not np.count_nonzero(is_free):
        return now
    free = np.flatnonzero(is_free)
    unclaimed = (
        LinesOfSight.concatenate([now.unclaimed, lines.take(free)]) if len(free) else now.unclaimed
    )
    types = np.concatenate([now.reported, reported[free]])
    recent_s = models.config.recent_scans * models.period_s[unclaimed.sensor] + span_s
    fresh = np.flatnonzero(now.time_s - unclaimed.time_s <= recent_s)
    return evolve(now, unclaimed=unclaimed.take(fresh), reported=types[fresh])


def _with_initiated(models: TrackingModels, now: TrackerState) -> TrackerState:
    """Return the state with tracks initiated from unassigned lines."""
    if len(now.unclaimed.time_s) < models.needed_scans:
        return now
    lines = models.corrected(now.registration, now.unclaimed)
    initiation_ = initiation.track_candidates(
        lines, models.needed_scans, now.registration.loose_rad
    )
    if not len(initiation_.begun):
        return now
    begun = initiation_.begun
    span = now.time_s - float(lines.time_s.min())
    first = prior_estimates(begun, now.time_s, models.config)
    pairs = models.gated_pairs(models.filter.predicted_measurements(first, now.time_s), lines, span)
    pairs = pairs.take(
        np.flatnonzero(initiation_.owned(pairs.track, pairs.line, lines.sensor[pairs.line]))
    )
    association = associate_nearest(pairs, lines, models.association)
    crossing = initiation.placed_at_crossings(begun, lines, association.owner)
    first = first if crossing is begun else prior_estimates(crossing, now.time_s, models.config)
    estimates = models.filter.updated(
        first, now.time_s, hard_measurements(association.assigned), span
    )
    return _with_new_tracks(models, now, first, estimates, association.owner)


def _with_new_tracks(
    models: TrackingModels,
    now: TrackerState,
    first: ModeEstimates,
    after: ModeEstimates,
    lines_of: IntArray,
) -> TrackerState:
    """Return the state with the new tracks that have enough lines, numbered in order."""
    hits = np.bincount(lines_of[lines_of >= 0], minlength=len(first))
    good = hits >= models.needed_scans
    row = np.append(np.where(good, np.cumsum(good) - 1, -1), -1)
    owner = row[lines_of]
    count = int(good.sum())
    number = np.arange(now.next_number, now.next_number + count)
    fresh = TrackTable.fresh(number, now.time_s, len(models.period_s))
    fresh = fresh.with_detections(owner, now.unclaimed.time_s, now.unclaimed.sensor, now.reported)
    lines = models.corrected(now.registration, now.unclaimed)
    motion = MotionStatistics.fresh(
        first.likelier_position_m[good], now.time_s, fresh.first_s, models.groups.prior
    )
    motion = motion.with_lines(owner, lines, models.groups.log_clutter)
    left = np.flatnonzero(owner < 0)
    then = evolve(
        now,
        estimates=ModeEstimates.concatenate([now.estimates, after.take(np.flatnonzero(good))]),
        table=TrackTable.concatenate([now.table, fresh]),
        unclaimed=now.unclaimed.take(left),
        reported=now.reported[left],
        next_number=now.next_number + count,
        motion=MotionStatistics.concatenate([now.motion, motion]),
    )
    return _with_neighbours(models, then, count)


def _with_neighbours(models: TrackingModels, now: TrackerState, fresh: int) -> TrackerState:
    """Return the state with the last `fresh` tracks, and those near them, in a crowd, where several
    are near.
    """
    seen = now.table.reports >= 0
    rows = (
        crowd.begun_near(now.estimates.likelier_position_m, fresh, seen)
        if fresh
        else np.empty(0, dtype=np.int64)
    )
    rows = rows[~now.crowds.holds(now.table.number[rows])]
    if not len(rows):
        return now
    path = models.path(now.estimates, now.time_s)
    view = models.view(now.registration)
    return evolve(now, crowds=crowd.joined(now.crowds, now.table.number, rows, path, seen, view))
