"""The motion statistics of tracks after the lines of a slice."""

import numpy as np
from opir_estimation import PredictedMeasurements, SharedLooks, group_minima
from opir_forecast import grounds

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_trackers.association import scan_groups
from opir_trackers.imm.models import TrackingModels
from opir_trackers.imm.predict import SlicePrediction
from opir_trackers.imm.state import TrackerState, TrackTable
from opir_trackers.onset.motion_priors import WIDE_M
from opir_trackers.onset.motion_statistics import LAUNCH, MotionStatistics
from opir_trackers.onset.posterior import (
    DARK_S,
    GONE_SCANS,
    LOG_CHANCE,
    LOG_DARK_LAUNCH,
    log_silence,
)
from opir_trackers.onset.shared_lines import OwnedLines, path_of_places, settled, shared_lines
from opir_trackers.parts import Association


def motion_after(
    models: TrackingModels,
    state: TrackerState,
    prediction: SlicePrediction,
    association: Association,
) -> MotionStatistics:
    """Return the motion statistics of the tracks after a slice's lines; `state` is that before the
    lines have been counted.
    """
    motion = _relit_motion(models, state, association.owner, prediction.lines.time_s)
    owned = _owned_lines(models, motion, prediction, association)
    motion = motion.with_lines(
        owned.owner, owned.lines, models.groups.log_clutter, owned.probability
    )
    return settled(motion, association.doubtful, state.table.first_s, prediction.end_s)


def _owned_lines(
    models: TrackingModels,
    motion: MotionStatistics,
    prediction: SlicePrediction,
    association: Association,
) -> OwnedLines:
    """Return the lines of a slice with their owners: where tracks share lines, what these say of
    each.
    """
    lines = prediction.lines
    owned = OwnedLines(lines, association.owner, np.ones(len(association.owner)))
    rows = association.doubtful
    if rows.size:
        rows = rows[motion.may_stand[rows]]
    if rows.size < 2:
        return owned
    kinds = np.array(grounds(models.config.hypotheses.inland_share))
    places = motion.take(rows).of_labels().inertial_places(kinds, WIDE_M, prediction.end_s)
    path = path_of_places(*places, prediction.end_s)
    looks = _shared_looks(models, path, prediction)
    return shared_lines(looks, path, rows, owned, light_time=models.light_time)


def _shared_looks(
    models: TrackingModels, path: PredictedMeasurements, prediction: SlicePrediction
) -> SharedLooks:
    """Return the looks of a slice at the places of a path."""
    lines = prediction.lines
    pairs = models.gated_pairs(path, lines, prediction.span_s)
    sensor = lines.sensor.take(pairs.line)
    return SharedLooks(
        pairs,
        scan_groups(pairs, lines),
        models.association.log_odds.take(sensor),
        sensor,
        models.groups.launches_per_ground_source,
    )


def _were_dark(models: TrackingModels, table: TrackTable, first_s: FloatArray) -> BoolArray:
    """Return which tracks (n,) had been dark for long at their first lines, inf without any: longer
    than the lines so far, by their rate, leave to chance.
    """
    shines = np.isfinite(first_s)
    # A clock that is off dates lines before those that were seen.
    silent_s = np.where(shines, np.maximum(models.silent_s(table, first_s), 0.0), 0.0)
    period_s = models.longest(models.period_s, table)
    lit_s = np.maximum(table.seen_s - table.motion.epoch_s, 0.0) + period_s
    is_surprise = log_silence(table.motion.lines, lit_s, silent_s) < LOG_CHANCE
    return (silent_s > GONE_SCANS * period_s) & (is_surprise | (silent_s > DARK_S))


def _relit_motion(
    models: TrackingModels, state: TrackerState, owner: IntArray, time_s: FloatArray
) -> MotionStatistics:
    """Return the motion before lines of rows `owner` (m,) at times, begun anew where an undecided
    track was dark.

    What shines there again may be another source: two flashes would make one fast motion. Where
    one was, the next is likelier than a launch that was hidden.
    """
    motion = state.table.motion
    if motion.is_decided.all():
        return motion
    owned = owner >= 0
    first_s = group_minima(owner[owned], time_s[owned], len(state.table))
    rows = (~motion.is_decided & _were_dark(models, state.table, first_s)).nonzero()[0]
    if not len(rows):
        return motion
    position_m = state.table.estimates.likelier_position_m[rows]
    begun = models.areas.begun(position_m, state.time_s, first_s[rows])
    begun.carried[motion.are_none[rows], LAUNCH] = LOG_DARK_LAUNCH
    return motion.with_rows(rows, begun)
