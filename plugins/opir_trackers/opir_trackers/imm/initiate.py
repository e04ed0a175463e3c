"""Initiate: tracks from lines that no track has, of the last scans, and that none explains as
outliers.
"""

from typing import Any

import numpy as np
from attrs import evolve, frozen
from opir_estimation import (
    OUTLIER_SIGMAS,
    LinesOfSight,
    ModeEstimates,
    candidates,
    explained_looks,
    gated,
)

from opir_core.arrays import FloatArray, IntArray
from opir_trackers import initiation
from opir_trackers.association import associate_nearest, hard_measurements
from opir_trackers.imm.models import TrackingModels
from opir_trackers.imm.predict import SlicePrediction
from opir_trackers.imm.state import SharedDetections, TrackerState, TrackTable
from opir_trackers.initiation import Initiation
from opir_trackers.onset.motion_statistics import MotionStatistics
from opir_trackers.parts import Initiator, PartContext, require_shape
from opir_trackers.track_priors import needed_scans_of, prior_estimates


@frozen(eq=False)
class MOfNInitiator(Initiator):
    """Clusters of lines with detections in `needed_scans` (M) of the last scans (N)."""

    needed_scans: int

    def candidates(self, lines: LinesOfSight, bias_sigma_rad: FloatArray) -> Initiation:
        """Return the candidates of unassigned lines (m,) of the last scans."""
        return initiation.track_candidates(lines, self.needed_scans, bias_sigma_rad)


def m_of_n_initiator(_config: Any, context: PartContext) -> MOfNInitiator:
    """Return the initiator `m-of-n`."""
    return MOfNInitiator(needed_scans_of(context.settings, context.tracker))


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
    is_free = owner < 0
    if True not in is_free:
        if not state.unclaimed.scan.size:
            return state
        return _with_initiated(models, _forgotten(models, state, prediction.span_s))
    state, claimed = _with_explained(models, state, prediction, owner)
    state = _with_unclaimed(models, state, raw, claimed, reported, prediction.span_s)
    return _with_initiated(models, state)


def _with_explained(
    models: TrackingModels, state: TrackerState, prediction: SlicePrediction, owner: IntArray
) -> tuple[TrackerState, IntArray]:
    """Return the state, and the owners (m,) of lines with 0 for those that a track explains as
    outliers.
    """
    if not len(state.table):
        return state, owner
    unowned = (owner < 0).nonzero()[0]
    path = models.path(state.table.estimates, state.time_s)
    lines = prediction.lines.take(unowned)
    gate = (OUTLIER_SIGMAS, models.light_time)
    pairs = gated(path, lines, *candidates(path, lines, prediction.span_s, *gate), *gate)
    rows = (owner >= 0).nonzero()[0]
    owned = (owner[rows], prediction.lines.take(rows))
    registration = state.registration.at(state.time_s)
    tracks = registration.tracks.of(state.table.number)
    explained, tracks = explained_looks(pairs, lines, owned, tracks, models.config.gate_sigma)
    claimed = owner.copy()
    claimed[unowned[explained.line]] = 0
    registration = evolve(registration, tracks=tracks)
    sensor = lines.sensor[explained.line].astype(np.int64)
    registration = registration.after_explained(explained, sensor, prediction.registration)
    return state._replace(registration=registration), claimed


def _with_unclaimed(
    models: TrackingModels,
    state: TrackerState,
    lines: LinesOfSight,
    owner: IntArray,
    reported: IntArray,
    span_s: float,
) -> TrackerState:
    """Return the state with the unassigned lines added, and old ones removed."""
    free = (owner < 0).nonzero()[0]
    unclaimed = LinesOfSight.concatenate([state.unclaimed, lines.take(free)])
    types = np.concatenate([state.reported, reported[free]])
    return _forgotten(models, state._replace(unclaimed=unclaimed, reported=types), span_s)


def _forgotten(models: TrackingModels, state: TrackerState, span_s: float) -> TrackerState:
    """Return the state without the unassigned lines of old scans."""
    unclaimed = state.unclaimed
    recent_s = models.config.recent_scans * models.period_s[unclaimed.sensor] + span_s
    recent = (state.time_s - unclaimed.time_s <= recent_s).nonzero()[0]
    return state._replace(unclaimed=unclaimed.take(recent), reported=state.reported[recent])


def _with_initiated(models: TrackingModels, state: TrackerState) -> TrackerState:
    """Return the state with tracks initiated from unassigned lines."""
    if len(state.unclaimed.time_s) < models.needed_scans:
        return state
    lines = models.corrected(state.registration, state.unclaimed)
    initiation_ = models.parts.initiator.candidates(lines, state.registration.loose_rad)
    require_shape(
        models.parts.initiator,
        models.parts.owners["initiation"],
        f"an Initiation of {len(lines)} lines",
        is_right=initiation_.place.shape == lines.scan.shape,
    )
    begun = initiation_.begun
    if not len(begun):
        return state
    span_s = state.time_s - float(lines.time_s.min())
    prior = prior_estimates(begun, state.time_s, models.config)
    path = models.filter.predicted_measurements(prior, state.time_s)
    pairs = models.gated_pairs(path, lines, span_s)
    owned = initiation_.owned(pairs.track, pairs.line, lines.sensor[pairs.line])
    association = associate_nearest(pairs.take(owned.nonzero()[0]), lines, models.association)
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
    table = _new_table(
        models,
        state,
        owner,
        prior.take(is_track.nonzero()[0]),
        estimates.take(is_track.nonzero()[0]),
    )
    remaining = (owner < 0).nonzero()[0]
    first = SharedDetections.of(table.number, owner, state.unclaimed)
    return state._replace(
        table=TrackTable.concatenate([state.table, table]),
        sightings=SharedDetections.concatenate([state.sightings, first]),
        unclaimed=state.unclaimed.take(remaining),
        reported=state.reported[remaining],
        next_number=state.next_number + len(table),
    )


def _new_table(
    models: TrackingModels,
    state: TrackerState,
    owner: IntArray,
    prior: ModeEstimates,
    estimates: ModeEstimates,
) -> TrackTable:
    """Return the table of new tracks with estimates, rows of which own unclaimed lines (m,)."""
    count = len(prior)
    number = np.arange(state.next_number, state.next_number + count)
    motion = MotionStatistics.empty()
    table = TrackTable.fresh(number, state.time_s, len(models.period_s), estimates, motion)
    unclaimed = state.unclaimed
    table = table.with_detections(owner, unclaimed.time_s, unclaimed.sensor, state.reported)
    position_m = prior.likelier_position_m
    motion = models.areas.begun(position_m, state.time_s, table.first_s)
    lines = models.corrected(state.registration, unclaimed)
    return table.changed(motion=motion.with_lines(owner, lines, models.groups.log_clutter))
