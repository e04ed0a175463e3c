"""Registration in the tick of `imm`: corrects lines of sight, judges the sensors by innovations, shifts tracks."""

import numpy as np
from attrs import evolve

from opir_core.arrays import FloatArray, IntArray
from opir_core.estimation import matvec
from opir_trackers.filter.estimates import ModeEstimates, PredictedMeasurements
from opir_trackers.gating import GatedPairs, candidates, gated
from opir_trackers.imm.associate_and_update import AssociateAndUpdate
from opir_trackers.imm.crowds import corrected_crowds
from opir_trackers.imm.state import TrackerState
from opir_trackers.imm.track_management import TrackTable
from opir_trackers.lines_of_sight import LinesOfSight
from opir_trackers.registration.innovations import OUTLIER_SIGMAS, explained_looks
from opir_trackers.registration.registration import Followed, Registration, registered, shifted
from opir_trackers.registration.shared_errors import ERRORS


def registered_state(
    association: AssociateAndUpdate,
    now: TrackerState,
    assigned: GatedPairs,
    lines: LinesOfSight,
    pairs: GatedPairs | None = None,
) -> TrackerState:
    """Return the state with the registration after a slice's pairs, and its tracks and crowds shifted by the change.

    Tracks that share a line with others in `pairs` do not count, nor those of crowds, which are not in `assigned`.
    """
    if not now.registration.is_due(now.time_s, len(now.table)):
        return now
    assigned = assigned if pairs is None else _unshared(assigned, pairs)
    if not len(assigned):
        return now
    before = evolve(now.registration.at(now.time_s), compared_s=now.time_s)
    vantages = association.vantages(before, now.time_s)
    moments, seen = association.moments(now.estimates), now.table.reports >= 0
    tracks = Followed.of(now.table.number, moments, seen)
    left = _with_residuals(assigned, association.predicted_measurements(now.estimates, now.time_s))
    after = registered(before, left, lines.sensor[assigned.line].astype(np.int64), tracks, vantages)
    change = after.known.mean - before.known.mean
    now = evolve(now, registration=after, estimates=shifted(now.estimates, change, tracks, vantages))
    if not now.crowds.are_there or not change.any():
        return now
    view = association.view(after)
    return evolve(now, crowds=corrected_crowds(now.crowds, change.reshape(-1, ERRORS), view))


def _with_residuals(assigned: GatedPairs, path: PredictedMeasurements) -> GatedPairs:
    """Return pairs with residuals about the updated tracks in place of innovations.

    A prediction may be tens of kilometres off along the line of the only sensor so far: misfits would not be linear.
    """
    local = matvec(assigned.axes, path.positions(assigned.track, assigned.time_s) - assigned.origin_m)
    return evolve(assigned, measured=assigned.measured - local[:, :2] / local[:, 2:])


def _unshared(assigned: GatedPairs, pairs: GatedPairs) -> GatedPairs:
    """Return the assigned pairs of tracks none of whose lines is in another's gate."""
    shared = np.bincount(pairs.line)[pairs.line] > 1 if len(pairs) else np.zeros(0, dtype=np.bool_)
    if not np.count_nonzero(shared):
        return assigned
    return assigned.take(np.flatnonzero(~np.isin(assigned.track, pairs.track[shared])))


def with_explained(
    association: AssociateAndUpdate, now: TrackerState, lines: LinesOfSight, owner: IntArray, span: float
) -> tuple[TrackerState, IntArray]:
    """Return the state, and the owners (m,) of lines with 0 for those that a track explains as outliers."""
    if not len(now.table) or not np.count_nonzero(owner < 0):
        return now, owner
    free, some = np.flatnonzero(owner < 0), np.zeros(len(owner), dtype=np.bool_)
    path, left = association.predicted_measurements(now.estimates, now.time_s), lines.take(free)
    near = candidates(path, left, span, OUTLIER_SIGMAS, association.light_time)
    pairs = gated(path, left, *near, OUTLIER_SIGMAS, association.light_time)
    mine = np.flatnonzero(owner >= 0)
    known, owned = now.registration.at(now.time_s), (owner[mine], lines.take(mine))
    tracks = known.tracks.of(now.table.number)
    some[free], tracks = explained_looks(pairs, left, owned, tracks, association.config.gate_sigma)
    return evolve(now, registration=evolve(known, tracks=tracks)), np.where(some, 0, owner)


def shared_covariance(
    association: AssociateAndUpdate, now: TrackerState, estimates: ModeEstimates, table: TrackTable
) -> FloatArray | None:
    """Return the covariances (n, 6, 6) of tracks due to the errors that sensors share; None for none."""
    if not now.registration.has_errors:
        return None
    vantages = association.vantages(now.registration, now.time_s)
    return now.registration.covariance(estimates.likelier_state, table.reports >= 0, vantages)
