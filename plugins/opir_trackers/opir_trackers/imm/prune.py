"""Prune: tracks that ended, are lost, follow a target that another one follows, or follow none.

Two tracks are duplicates if their states agree within their covariances and no recent scan detected
both: two targets are detected in one scan sooner or later, one target never twice.
"""

import numpy as np
from attrs import evolve, frozen
from opir_estimation import (
    LOWEST_M,
    SPEED_SIGMA_M_S,
    LinesOfSight,
    dot,
    have_uncertain_velocity,
    neighbour_pairs,
    scan_numbers,
)

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.geometry import WGS84, ecef_to_geodetic
from opir_core.interfaces import TRACK_ENDS
from opir_trackers.imm import crowds as crowd
from opir_trackers.imm.models import TrackingModels
from opir_trackers.imm.state import EndedTracks, TrackerState
from opir_trackers.imm.track_management import ENOUGH_SCANS, SharedDetections
from opir_trackers.onset.brevity import are_brief


@frozen
class PruningLaw:
    """Thresholds of duplicate, lost and fallen tracks."""

    #: Tracks within this distance, m, or within their covariances, are compared as possible
    #: duplicates.
    near_m: float = 20e3

    #: Gate of the squared Mahalanobis distance of position and velocity, 6 degrees of freedom,
    #: 99.99 %.
    duplicate_gate: float = 27.9

    #: Upper bound on target speeds, m/s, nearly twice the escape velocity.
    fastest_m_s: float = 20e3

    #: A track below the lowest height has come down; one that is still detected, if below by this
    #: many standard deviations.
    sure_sigmas: float = 3.0


LAW = PruningLaw()

#: Codes of ends.
IMPACT = TRACK_ENDS.index("impact")
LOST = TRACK_ENDS.index("lost")


def prune(
    models: TrackingModels, state: TrackerState, lines: LinesOfSight, owner: IntArray
) -> TrackerState:
    """Return the state without duplicate, lost and unconfirmed tracks, and those of false alarms.

    `owner` (m,) are the tracks of a slice's lines, -1 for none.
    """
    if not state.table.number.size:
        return state
    moments = models.moments(state.estimates)
    table = state.table
    drop = state.time_s - table.seen_s > models.config.silence_s
    drop |= state.motion.is_decided & state.motion.are_noise
    state, idle, fallen = _with_bounds(models, state, *moments)
    drop |= idle | fallen
    if table.number.size > 1:
        sightings = state.sightings.after(table.number, owner, lines, state.time_s, models.memory_s)
        state = evolve(state, sightings=sightings)
        drop |= _lesser(models, state, *moments)
    if np.count_nonzero(drop):
        state = _without(models, state, drop, fallen)
    if not state.crowds.are_there:
        return state
    return evolve(state, crowds=crowd.pruned(state.crowds, state.time_s, models.period_s))


def _without(
    models: TrackingModels, state: TrackerState, drop: BoolArray, fallen: BoolArray
) -> TrackerState:
    """Return the state without some tracks (n,); the confirmed ones among them have ended."""
    remaining = state.without(drop)
    rows = np.flatnonzero(drop & models.confirmed(state))
    if not len(rows):
        return remaining
    table = state.table.take(rows)
    motion = state.motion.take(rows)
    brief = are_brief(motion, table.first_s, table.seen_s)
    end = np.where(fallen[rows] & ~brief, IMPACT, LOST).astype(np.uint8)
    ended = EndedTracks(state.estimates.take(rows), table, motion, end)
    return evolve(remaining, ended=ended.and_others(state.ended))


def _with_bounds(
    models: TrackingModels, state: TrackerState, mean: FloatArray, covariance: FloatArray
) -> tuple[TrackerState, BoolArray, BoolArray]:
    """Return the state with uncertain speeds and heights bounded, and which tracks are idle and
    which came down.
    """
    table = state.table
    needed = 3 * models.needed_scans
    uncertain = are_uncertain(covariance, models.config.lost_sigma_m)
    below_ground = are_below_ground(mean[:, :3])
    variance = covariance[:, 3, 3] + covariance[:, 4, 4] + covariance[:, 5, 5]
    is_vague = variance > SPEED_SIGMA_M_S**2
    is_plain = not np.count_nonzero(uncertain | below_ground | is_vague)
    if is_plain and table.hits.min() >= needed:
        nowhere = np.zeros(len(table), dtype=np.bool_)
        return state, nowhere, nowhere
    rows = is_vague.nonzero()[0]
    rows = rows[have_uncertain_velocity(covariance[rows])] if len(rows) else rows
    if len(rows):
        state = evolve(state, estimates=models.filter.with_velocity_prior(state.estimates, rows))
    rows = (below_ground & (state.estimates.weight[:, 0] > 0.5)).nonzero()[0]
    if len(rows):
        state = evolve(state, estimates=models.filter.raised_above_ground(state.estimates, rows))
    unseen = state.time_s - table.seen_s > models.longest(models.silence_limit_s, table)
    idle = (uncertain | (table.hits < needed)) & unseen
    return state, idle, below_ground & have_come_down(mean[:, :3], covariance, unseen)


def _lesser(
    models: TrackingModels, state: TrackerState, mean: FloatArray, covariance: FloatArray
) -> BoolArray:
    """Return which tracks follow a target that another one follows, or no target: lines of several
    moved them.
    """
    table = state.table
    added = models.shared_covariance(state, state.estimates, state.table)
    wider = covariance.copy() if added is None else covariance + added
    fast = ~(dot(mean[:, 3:], mean[:, 3:]) <= LAW.fastest_m_s**2)
    # The covariance of a track that is nowhere may be nothing that can be solved with.
    wider[fast] = np.eye(6)
    are_fresh = table.begun_s == state.time_s
    visible = table.reports >= 0
    return fast | duplicates(
        table.number, mean, wider, state.sightings, table.hits, visible, are_fresh
    )


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
    pairs = _near(state[:, :3], np.sqrt(np.trace(covariance[:, :3, :3], axis1=1, axis2=2)))
    neighbours = np.bincount(pairs.ravel(), minlength=len(number))
    pairs = pairs[_never_seen_together(pairs, number, sightings)] if len(pairs) else pairs
    if not len(pairs):
        return lesser
    row, other_row = pairs.T
    difference = state[row] - state[other_row]
    joint = covariance[row] + covariance[other_row]
    distance = np.sum(difference * np.linalg.solve(joint, difference[:, :, None])[:, :, 0], axis=1)
    pairs = pairs[distance < LAW.duplicate_gate]
    pairs = pairs[~_are_spared(pairs, neighbours, seen, fresh)]
    for older, newer in pairs.tolist():
        if not lesser[older] and not lesser[newer]:
            lesser[newer if (hits[older], newer) >= (hits[newer], older) else older] = True
    return lesser


def _are_spared(
    pairs: IntArray, beside: IntArray, visible: BoolArray, is_new: BoolArray
) -> BoolArray:
    """Return which pairs (k,) have others near, `beside` (n,) in all, and are fresh or seen by no
    common sensor.
    """
    row, other_row = pairs.T
    crowded = np.maximum(beside[row], beside[other_row]) > 1
    return crowded & (
        is_new[row] | is_new[other_row] | ~np.any(visible[row] & visible[other_row], axis=1)
    )


def _near(position: FloatArray, sigma_m: FloatArray) -> IntArray:
    """Return the pairs (k, 2) of tracks that are near, or may be by their standard deviations (n,),
    in order.
    """
    from scipy.spatial import cKDTree

    tree = cKDTree(position)
    close = tree.query_pairs(LAW.near_m, output_type="ndarray")
    reach_m = np.sqrt(2.0 * LAW.duplicate_gate) * sigma_m
    wide = np.flatnonzero(reach_m > LAW.near_m)
    if len(wide):
        # Of two tracks that are alike at such a distance the less certain one reaches the other.
        row, neighbour = neighbour_pairs(tree, position[wide], reach_m[wide])
        pairs = np.sort(np.stack([wide[row], neighbour], axis=1), axis=1)
        close = np.unique(np.concatenate([close, pairs[pairs[:, 0] < pairs[:, 1]]]), axis=0)
    return close[np.lexsort((close[:, 1], close[:, 0]))]


def _never_seen_together(
    pairs: IntArray, number: IntArray, sightings: SharedDetections
) -> BoolArray:
    """Return which pairs (k,) have enough scans with a detection, none of both."""
    row = np.searchsorted(number, sightings.number)
    tracked = np.flatnonzero(np.append(number, -1)[row] == sightings.number)
    scan = scan_numbers(sightings.sensor, sightings.scan)[tracked]
    detected = np.zeros((len(number), int(scan.max(initial=-1)) + 1), dtype=bool)
    detected[row[tracked], scan] = True
    row_detected = detected[pairs[:, 0]]
    other_detected = detected[pairs[:, 1]]
    detected_together: BoolArray = np.any(row_detected & other_detected, axis=1)
    enough: BoolArray = np.count_nonzero(row_detected | other_detected, axis=1) >= ENOUGH_SCANS
    return np.logical_and(enough, ~detected_together)


def are_uncertain(covariance: FloatArray, sigma_m: float) -> BoolArray:
    """Return which covariances (n, 6, 6) exceed a standard deviation of the position, m.

    This deletes no track that is still detected. One sensor leaves the position along its line of
    sight open, by hundreds of kilometres in the end; a new track in its place would be assumed near
    the ground.
    """
    variance = covariance[:, 0, 0] + covariance[:, 1, 1] + covariance[:, 2, 2]
    return variance > sigma_m * sigma_m


def are_below_ground(position: FloatArray) -> BoolArray:
    """Return which positions (n, 3) may be below the lowest height."""
    return dot(position, position) < (WGS84.equatorial_radius_m + LOWEST_M) ** 2


def have_come_down(position: FloatArray, covariance: FloatArray, unseen: BoolArray) -> BoolArray:
    """Return which tracks (n,) came down; of those not `unseen` (n,), only significant ones.

    Along a single line of sight the estimate of a flying target may lie below the ground.
    """
    sigma = np.sqrt(covariance[:, 0, 0] + covariance[:, 1, 1] + covariance[:, 2, 2])
    lowest = LOWEST_M - np.where(unseen, 0.0, LAW.sure_sigmas * sigma)
    return ecef_to_geodetic(position).height_m < lowest
