"""Update: tracks after the lines of a slice, with doubt in outliers, and what they show of the
sensors.
"""

import numpy as np
from attrs import evolve

from opir_core.arrays import FloatArray, IntArray
from opir_core.estimation import matvec
from opir_trackers.association import hard_measurements, merged
from opir_trackers.filter.estimates import ModeEstimates, PredictedMeasurements
from opir_trackers.gating import FEW_PAIRS, GatedPairs
from opir_trackers.imm.associate import Associated
from opir_trackers.imm.crowds import corrected_crowds
from opir_trackers.imm.models import TrackingModels
from opir_trackers.imm.outliers import (
    FEW,
    OutlierFractions,
    SliceSpan,
    clean_log_likelihood,
    reweighted,
    suspect_tracks,
)
from opir_trackers.imm.predict import Ahead
from opir_trackers.imm.state import TrackerState
from opir_trackers.lines_of_sight import no_measurements
from opir_trackers.onset.motion_statistics import MotionStatistics
from opir_trackers.onset.posterior import DARK_S, GONE_SCANS
from opir_trackers.registration.registration import Followed, registered, shifted
from opir_trackers.registration.shared_errors import ERRORS


def update(
    models: TrackingModels, now: TrackerState, ahead: Ahead, found: Associated, reported: IntArray
) -> TrackerState:
    """Return the state after a slice's lines, of reported types (m,), as far as they have
    tracks.
    """
    if not now.table.number.size:
        return evolve(now, time_s=ahead.end_s)
    lines = ahead.lines
    table = now.table
    if not lines.scan.size:
        after = models.filter.updated(ahead.estimates, ahead.end_s, no_measurements(), ahead.span_s)
        after = models.filter.with_open_coast(after, ahead.estimates, now.estimates, ahead.span_s)
        return now.after(ahead.end_s, after, table)
    after, outliers = _with_outliers(
        models, _updated(models, ahead, found), ahead, found, table.outliers
    )
    after = models.filter.with_open_coast(after, ahead.estimates, now.estimates, ahead.span_s)
    then = now.after(
        ahead.end_s, after, table if outliers is None else table.with_outliers(outliers)
    )
    then = then if found.crowds is now.crowds else evolve(then, crowds=found.crowds)
    then = _registered(models, then, ahead, found)
    table = then.table.with_detections(found.owner, lines.time_s, lines.sensor, reported)
    motion = _lit_again(models, then, found.owner, lines.time_s)
    motion = motion.with_lines(found.owner, lines, models.groups.log_clutter)
    estimates = models.single.with_ascents(
        then.estimates, table, motion, then.table.seen_s, ahead.end_s
    )
    return then.after(ahead.end_s, estimates, table, motion)


def _lit_again(
    models: TrackingModels, now: TrackerState, owner: IntArray, time_s: FloatArray
) -> MotionStatistics:
    """Return the motion before lines of rows `owner` (m,) at times, begun anew where an undecided
    track was dark.

    What shines there again may be another source: two flashes would make one fast motion.
    """
    count = len(now.table)
    mine = owner >= 0
    first_s = np.full(count, np.inf)
    np.minimum.at(first_s, owner[mine], time_s[mine])
    silent_s = first_s - now.table.seen_s
    limit_s = np.maximum(DARK_S, GONE_SCANS * models.longest(models.period_s, now.table))
    is_seen = np.isfinite(first_s)
    rows = (is_seen & ~now.motion.is_decided & (silent_s > limit_s)).nonzero()[0]
    if not len(rows):
        return now.motion
    place = now.estimates.likelier_position_m[rows]
    fresh = MotionStatistics.fresh(place, now.time_s, first_s[rows], models.groups.prior)
    order = np.arange(count)
    order[rows] = count + np.arange(len(rows))
    return MotionStatistics.concatenate([now.motion, fresh]).take(order)


def _updated(models: TrackingModels, ahead: Ahead, found: Associated) -> ModeEstimates:
    """Return the estimates after pairs, many of which count as few; all their looks count as
    detections.

    Tracks that were silent, whose burns may begin at the first look, are updated with each look,
    and few tracks too.
    """
    estimates = ahead.estimates
    end_s = ahead.end_s
    span_s = ahead.span_s
    used = found.used
    if used.track.size <= FEW_PAIRS:
        return models.filter.updated(estimates, end_s, hard_measurements(used), span_s)
    raw = (estimates.detection_rate[:, 2] > span_s)[used.track]
    each = np.flatnonzero(raw)
    some = np.flatnonzero(~raw)
    few = merged(used.take(some), found.sensor[some], ahead.path)
    pairs = few if not len(each) else GatedPairs.concatenate([few, used.take(each)])
    after = models.filter.updated(estimates, end_s, hard_measurements(pairs), span_s)
    count = len(estimates)
    owner = found.owner
    more = np.bincount(owner[owner >= 0], minlength=count) - np.bincount(
        pairs.track, minlength=count
    )
    last_s = np.full(count, -np.inf)
    np.maximum.at(last_s, used.track, used.time_s)
    rate = after.detection_rate.copy()
    rate[:, 0] += more
    rate[:, 2] = np.minimum(rate[:, 2], end_s - last_s)
    return evolve(after, detection_rate=rate)


def _with_outliers(
    models: TrackingModels, after: ModeEstimates, ahead: Ahead, found: Associated, log: FloatArray
) -> tuple[ModeEstimates, FloatArray | None]:
    """Return estimates with outliers weighted down, but for tracks that share lines, and the log
    likelihoods.

    `log` (n, fractions) are those of the outlier fractions before; after None where all tracks have
    next to none.
    """
    fractions = OutlierFractions(log)
    span = SliceSpan(ahead.end_s, ahead.span_s, models.config.gate_sigma)
    share = fractions.share
    suspects = suspect_tracks(found.assigned, share)
    if suspects.size and found.shared.size:
        suspects = np.setdiff1d(suspects, found.shared, assume_unique=True)
    if not suspects.size:
        if not np.count_nonzero(share > FEW):
            return after, None
        return after, log + clean_log_likelihood(found.assigned, fractions, span.gate)
    outliers = clean_log_likelihood(found.assigned, fractions, span.gate)
    place = np.full(len(after), -1, dtype=np.int64)
    place[suspects] = np.arange(len(suspects))
    mine = found.assigned.take(np.flatnonzero(place[found.assigned.track] >= 0))
    mine = evolve(mine, track=place[mine.track])
    before = ahead.estimates.take(suspects)
    weighed = reweighted(
        models.filter, before, after.take(suspects), span, mine, fractions.take(suspects)
    )
    outliers[suspects] = weighed.outliers
    return after.put(suspects, weighed.estimates), fractions.after(outliers).log


def _registered(
    models: TrackingModels, now: TrackerState, ahead: Ahead, found: Associated
) -> TrackerState:
    """Return the state with the registration after a slice's pairs, and its tracks and crowds
    shifted by the change.

    Tracks that share a line with others do not count, nor those of crowds.
    """
    is_due = now.registration.is_due(now.time_s, len(now.table))
    if not is_due and not now.registration.has_outliers:
        return now
    assigned = _unshared(found.assigned, found.pairs)
    if not len(assigned):
        return now
    sensor = ahead.lines.sensor[assigned.line].astype(np.int64)
    if not is_due:
        return evolve(
            now,
            registration=now.registration.counted(
                now.time_s, now.table.number, assigned.track, sensor
            ),
        )
    before = evolve(now.registration.at(now.time_s), compared_s=now.time_s)
    vantages = models.vantages(before, now.time_s)
    tracks = Followed.of(now.table.number, models.moments(now.estimates), now.table.reports >= 0)
    left = _with_residuals(assigned, models.path(now.estimates, now.time_s))
    after = registered(before, left, sensor, tracks, vantages)
    change = after.known.mean - before.known.mean
    now = evolve(
        now, registration=after, estimates=shifted(now.estimates, change, tracks, vantages)
    )
    if not now.crowds.are_there or not change.any():
        return now
    return evolve(
        now, crowds=corrected_crowds(now.crowds, change.reshape(-1, ERRORS), models.view(after))
    )


def _with_residuals(assigned: GatedPairs, path: PredictedMeasurements) -> GatedPairs:
    """Return pairs with residuals about the updated tracks in place of innovations.

    A prediction may be tens of kilometres off along the line of the only sensor so far: misfits
    would not be linear.
    """
    local = matvec(
        assigned.axes, path.positions(assigned.track, assigned.time_s) - assigned.origin_m
    )
    return evolve(assigned, measured=assigned.measured - local[:, :2] / local[:, 2:])


def _unshared(assigned: GatedPairs, pairs: GatedPairs) -> GatedPairs:
    """Return the assigned pairs of tracks none of whose lines is in another's gate."""
    shared = np.bincount(pairs.line)[pairs.line] > 1 if len(pairs) else np.zeros(0, dtype=np.bool_)
    if not np.count_nonzero(shared):
        return assigned
    return assigned.take(np.flatnonzero(~np.isin(assigned.track, pairs.track[shared])))
