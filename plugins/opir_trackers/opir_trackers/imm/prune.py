"""Prune: tracks that ended, are lost, follow a target that another one follows, or follow none.

Two tracks are duplicates if their states agree within their covariances and no recent scan detected
both: two targets are detected in one scan sooner or later, one target never twice.
"""

import numpy as np
from attrs import evolve

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.estimation import dot
from opir_core.geometry import WGS84, ecef_to_geodetic
from opir_core.interfaces import TRACK_ENDS
from opir_trackers.association import scan_numbers
from opir_trackers.filter.mode_mixing import SPEED_SIGMA_M_S, have_uncertain_velocity
from opir_trackers.imm import crowds as crowd
from opir_trackers.imm.models import TrackingModels
from opir_trackers.imm.state import EndedTracks, TrackerState
from opir_trackers.imm.track_management import ENOUGH_SCANS, SharedDetections
from opir_trackers.lines_of_sight import LinesOfSight
from opir_trackers.onset.brevity import are_brief
from opir_trackers.triangulation import LOWEST_M

#: Tracks within this distance, m, or within their covariances, are compared as possible duplicates.
_NEAR_M = 20e3

#: Gate of the squared Mahalanobis distance of position and velocity, 6 degrees of freedom, 99.99 %.
_DUPLICATE_GATE = 27.9

#: Upper bound on target speeds, m/s, nearly twice the escape velocity.
_FASTEST_M_S = 20e3

#: A track below the lowest height has come down; one that is still detected, if below by this many
#: standard deviations.
_SURE_SIGMAS = 3.0

#: Codes of ends.
IMPACT = TRACK_ENDS.index("impact")
LOST = TRACK_ENDS.index("lost")


def prune(
    models: TrackingModels, now: TrackerState, lines: LinesOfSight, owner: IntArray
) -> TrackerState:
    """Return the state without duplicate, lost and unconfirmed tracks, and those of false alarms.

    `owner` (m,) are the tracks of a slice's lines, -1 for none.
    """
    if not now.table.number.size:
        return now
    moments = models.moments(now.estimates)
    table = now.table
    silent = now.time_s - table.seen_s > models.config.silence_s
    drop = silent | (now.motion.is_decided & now.motion.are_noise)
    now, idle, down = _with_bounds(models, now, *moments)
    drop |= idle | down
    if table.number.size > 1:
        memory_s = models.memory_s
        now = evolve(
            now, sightings=now.sightings.after(table.number, owner, lines, now.time_s, memory_s)
        )
        drop |= _lesser(models, now, *moments)
    if np.count_nonzero(drop):
        gone = np.flatnonzero(drop & models.confirmed(now))
        brief = are_brief(now.motion, table.first_s, table.seen_s)[gone]
        end = np.where(down[gone] & ~brief, IMPACT, LOST).astype(np.uint8)
        ended = EndedTracks(now.estimates.take(gone), table.take(gone), now.motion.take(gone), end)
        now = evolve(
            now.without(drop), ended=ended.and_others(now.ended) if len(gone) else now.ended
        )
    if not now.crowds.are_there:
        return now
    return evolve(now, crowds=crowd.pruned(now.crowds, now.time_s, models.period_s))


def _with_bounds(
    models: TrackingModels, now: TrackerState, state: FloatArray, covariance: FloatArray
) -> tuple[TrackerState, BoolArray, BoolArray]:
    """Return the state with uncertain speeds and heights bounded, and which tracks are idle and
    which came down.
    """
    table = now.table
    needed = 3 * models.needed_scans
    uncertain = are_uncertain(covariance, models.config.lost_sigma_m)
    below_ground = are_below_ground(state[:, :3])
    fast_uncertain = (
        covariance[:, 3, 3] + covariance[:, 4, 4] + covariance[:, 5, 5] > SPEED_SIGMA_M_S**2
    )
    none = np.zeros(len(table), dtype=np.bool_)
    if table.hits.min() >= needed and not np.count_nonzero(
        uncertain | below_ground | fast_uncertain
    ):
        return now, none, none
    rows = fast_uncertain.nonzero()[0]
    rows = rows[have_uncertain_velocity(covariance[rows])] if len(rows) else rows
    if len(rows):
        now = evolve(now, estimates=models.filter.with_velocity_prior(now.estimates, rows))
    rows = (below_ground & (now.estimates.weight[:, 0] > 0.5)).nonzero()[0]
    if len(rows):
        now = evolve(now, estimates=models.filter.above_ground(now.estimates, rows))
    unseen = now.time_s - table.seen_s > models.longest(models.silence_limit_s, table)
    idle = (uncertain | (table.hits < needed)) & unseen
    return now, idle, below_ground & have_come_down(state[:, :3], covariance, unseen)


def _lesser(
    models: TrackingModels, now: TrackerState, state: FloatArray, covariance: FloatArray
) -> BoolArray:
    """Return which tracks follow a target that another one follows, or no target: lines of several
    moved them.
    """
    table = now.table
    added = models.shared_covariance(now, now.estimates, now.table)
    wider = covariance.copy() if added is None else covariance + added
    fast = ~(dot(state[:, 3:], state[:, 3:]) <= _FASTEST_M_S**2)
    # The covariance of a track that is nowhere may be nothing that can be solved with.
    wider[fast] = np.eye(6)
    are_fresh = table.begun_s == now.time_s
    seen = table.reports >= 0
    return fast | duplicates(table.number, state, wider, now.sightings, table.hits, seen, are_fresh)


def duplicates(
    number: IntArray,
    state: FloatArray,
    covariance: FloatArray,
    sightings: SharedDetections,
    hits: IntArray,
    seen: BoolArray,
    fresh: BoolArray,
) -> BoolArray:
    """Return which tracks (n,), of ascending numbers, are the lesser of two that follow one target.

    `state` (n, 6) and `covariance` (n, 6, 6) are in the inertial frame, m and m/s. Where more than
    two are near, those that are `fresh` (n,) are spared, whose first lines are of earlier slices,
    and those that no sensor sees both of, by `seen` (n, sensors): their pairing decides.
    """
    lesser = np.zeros(len(number), dtype=bool)
    if len(number) < 2:
        return lesser
    near = _near(state[:, :3], np.sqrt(np.trace(covariance[:, :3, :3], axis1=1, axis2=2)))
    beside = np.bincount(near.ravel(), minlength=len(number))
    near = near[_never_seen_together(near, number, sightings)] if len(near) else near
    if not len(near):
        return lesser
    apart = state[near[:, 0]] - state[near[:, 1]]
    both = covariance[near[:, 0]] + covariance[near[:, 1]]
    distance = np.sum(apart * np.linalg.solve(both, apart[:, :, None])[:, :, 0], axis=1)
    alike = near[distance < _DUPLICATE_GATE]
    for first, second in alike[~_are_spared(alike, beside, seen, fresh)].tolist():
        if not lesser[first] and not lesser[second]:
            lesser[second if (hits[first], second) >= (hits[second], first) else first] = True
    return lesser


def _are_spared(alike: IntArray, beside: IntArray, seen: BoolArray, fresh: BoolArray) -> BoolArray:
    """Return which pairs (k,) have others near, `beside` (n,) in all, and are fresh or seen by no
    common sensor.
    """
    one, other = alike.T
    crowded = np.maximum(beside[one], beside[other]) > 1
    spared: BoolArray = crowded & (
        fresh[one] | fresh[other] | ~np.any(seen[one] & seen[other], axis=1)
    )
    return spared


def _near(position: FloatArray, sigma_m: FloatArray) -> IntArray:
    """Return the pairs (k, 2) of tracks that are near, or may be by their standard deviations (n,),
    in order.
    """
    from scipy.spatial import cKDTree

    tree = cKDTree(position)
    near = tree.query_pairs(_NEAR_M, output_type="ndarray")
    reach_m = np.sqrt(2.0 * _DUPLICATE_GATE) * sigma_m
    wide = np.flatnonzero(reach_m > _NEAR_M)
    if len(wide):
        # Of two tracks that are alike at such a distance the less certain one reaches the other.
        neighbours = tree.query_ball_point(position[wide], reach_m[wide], return_sorted=True)
        other = np.concatenate([np.array(rows, dtype=np.int64) for rows in neighbours])
        pairs = np.sort(
            np.stack([np.repeat(wide, [len(rows) for rows in neighbours]), other], axis=1), axis=1
        )
        near = np.unique(np.concatenate([near, pairs[pairs[:, 0] < pairs[:, 1]]]), axis=0)
    ordered: IntArray = near[np.lexsort((near[:, 1], near[:, 0]))]
    return ordered


def _never_seen_together(
    near: IntArray, number: IntArray, sightings: SharedDetections
) -> BoolArray:
    """Return which pairs (k,) have enough scans with a detection, none of both."""
    row = np.searchsorted(number, sightings.number)
    here = np.flatnonzero(np.append(number, -1)[row] == sightings.number)
    scan = scan_numbers(sightings.sensor, sightings.scan)[here]
    seen = np.zeros((len(number), int(scan.max(initial=-1)) + 1), dtype=bool)
    seen[row[here], scan] = True
    one = seen[near[:, 0]]
    other = seen[near[:, 1]]
    apart: BoolArray = np.any(one & other, axis=1)
    enough: BoolArray = np.count_nonzero(one | other, axis=1) >= ENOUGH_SCANS
    return np.logical_and(enough, ~apart)


def are_uncertain(covariance: FloatArray, sigma_m: float) -> BoolArray:
    """Return which covariances (n, 6, 6) exceed a standard deviation of the position, m.

    This deletes no track that is still detected. One sensor leaves the position along its line of
    sight open, by hundreds of kilometres in the end; a new track in its place would be assumed near
    the ground.
    """
    variance = covariance[:, 0, 0] + covariance[:, 1, 1] + covariance[:, 2, 2]
    vague: BoolArray = variance > sigma_m * sigma_m
    return vague


def are_below_ground(position: FloatArray) -> BoolArray:
    """Return which positions (n, 3) may be below the lowest height."""
    low: BoolArray = dot(position, position) < (WGS84.equatorial_radius_m + LOWEST_M) ** 2
    return low


def have_come_down(position: FloatArray, covariance: FloatArray, unseen: BoolArray) -> BoolArray:
    """Return which tracks (n,) came down; of those not `unseen` (n,), only significant ones.

    Along a single line of sight the estimate of a flying target may lie below the ground.
    """
    sigma = np.sqrt(covariance[:, 0, 0] + covariance[:, 1, 1] + covariance[:, 2, 2])
    lowest = LOWEST_M - np.where(unseen, 0.0, _SURE_SIGMAS * sigma)
    down: BoolArray = ecef_to_geodetic(position).height_m < lowest
    return down
