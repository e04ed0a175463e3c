"""Prune: tracks that ended, are lost, follow a target that another one follows, or follow none.

Two tracks are duplicates if their states agree within their covariances and no recent scan detected
both: two targets are detected in one scan sooner or later, one target never twice.
"""

from typing import Any

import numpy as np
from attrs import frozen
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
from opir_trackers.configs import ImmConfig
from opir_trackers.imm.models import TrackingModels
from opir_trackers.imm.state import ENOUGH_SCANS, EndedTracks, SharedDetections, TrackerState
from opir_trackers.onset.brevity import are_brief
from opir_trackers.parts import PartContext, Pruner, TrackPicture, require_shape
from opir_trackers.track_priors import needed_scans_of


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

    #: Existence of a track, by its associator, below which it follows no target.
    least_existence: float = 0.01


LAW = PruningLaw()

#: Codes of ends.
IMPACT = TRACK_ENDS.index("impact")
LOST = TRACK_ENDS.index("lost")
FLASH = TRACK_ENDS.index("flash")
UNRESOLVED = TRACK_ENDS.index("unresolved")


@frozen(eq=False)
class UnlikelyPruner(Pruner):
    """Ends tracks that are silent for too long, of false alarms, lost, down, or the lesser of two
    that follow one target.

    `needed` are the hits that a track needs to stay without detections.
    """

    settings: ImmConfig
    needed: int

    def ends(self, tracks: TrackPicture) -> IntArray:
        """Return codes (n,) into `TRACK_ENDS`: 0 for tracks that go on."""
        table = tracks.table
        motion = table.motion
        drop = tracks.silent_s > self.settings.silence_s
        drop |= motion.is_decided & motion.are_noise
        if tracks.existence is not None:
            drop |= tracks.existence < LAW.least_existence
        vague = are_uncertain(tracks.covariance, self.settings.lost_sigma_m)
        vague |= table.hits < self.needed
        fallen = are_below_ground(tracks.mean[:, :3])
        if True in (vague | fallen):
            unseen = tracks.silent_s > tracks.silence_limit_s
            drop |= vague & unseen
            fallen &= have_come_down(tracks.mean[:, :3], tracks.covariance, unseen)
            drop |= fallen
        lesser = _lesser(tracks) if table.number.size > 1 else drop
        ended = drop | lesser
        if True not in ended:
            return np.zeros(drop.shape, dtype=np.int64)
        # What another track follows too has not gone out.
        is_brief = drop & are_brief(motion, table.first_s, table.seen_s)
        of_brief = np.where(motion.are_none, FLASH, UNRESOLVED)
        return np.where(ended, np.where(is_brief, of_brief, np.where(fallen, IMPACT, LOST)), 0)


def unlikely_pruner(_config: Any, context: PartContext) -> UnlikelyPruner:
    """Return the pruner `unlikely`."""
    return UnlikelyPruner(context.settings, 3 * needed_scans_of(context.settings, context.tracker))


def prune(
    models: TrackingModels,
    state: TrackerState,
    lines: LinesOfSight,
    owner: IntArray,
    existence: FloatArray | None = None,
) -> TrackerState:
    """Return the state without the tracks that the pruner ends; the confirmed ones among them have
    ended.

    `owner` (m,) are the tracks of a slice's lines, -1 for none; `existence` is that of the
    association, of the tracks before new ones began.
    """
    table = state.table
    if not table.number.size:
        return state
    moments = models.moments(table.estimates)
    state = _bounded(models, state, *moments)
    if table.number.size > 1:
        detections = SharedDetections.of(table.number, owner, lines)
        first = state.next_number - int(np.count_nonzero(table.begun_s == state.time_s))
        sightings = state.sightings.after(detections, state.time_s, models.memory_s, first)
        state = state._replace(sightings=sightings)
    if existence is not None:
        existence = np.append(existence, np.ones(table.number.size - len(existence)))
    end = models.parts.pruner.ends(_picture(models, state, moments, existence))
    require_shape(
        models.parts.pruner,
        models.parts.owners["pruning"],
        f"codes 0 to {UNRESOLVED} of {table.number.size} tracks",
        is_right=end.shape == table.number.shape and end.dtype.kind in "iu",
    )
    return _without(models, state, end) if end.nonzero()[0].size else state


def _picture(
    models: TrackingModels,
    state: TrackerState,
    moments: tuple[FloatArray, FloatArray],
    existence: FloatArray | None,
) -> TrackPicture:
    """Return the tracks, with moments of position and velocity, as parts see them."""
    table = state.table
    is_shared = table.number.size > 1
    return TrackPicture(
        time_s=state.time_s,
        table=table,
        mean=moments[0],
        covariance=moments[1],
        shared_covariance=models.shared_covariance(state, table) if is_shared else None,
        silent_s=models.silent_s(table, state.time_s),
        sensor_silence_s=models.silence_limit_s,
        sightings=state.sightings,
        existence=existence,
    )


def _without(models: TrackingModels, state: TrackerState, end: IntArray) -> TrackerState:
    """Return the state without tracks that ended by codes (n,); those that began in this slice
    have followed nothing.
    """
    drop = end > 0
    remaining = state.without(drop)
    is_old = state.table.begun_s < state.time_s
    rows = (drop & is_old & models.confirmed(state)).nonzero()[0]
    if not rows.size:
        return remaining
    ended = EndedTracks(state.table.take(rows), end[rows].astype(np.uint8))
    return remaining._replace(ended=ended.and_others(state.ended))


def _with_vague_velocity(covariance: FloatArray) -> IntArray:
    """Return the rows whose velocity has a larger variance in some direction than the prior."""
    variance = covariance[:, 3, 3] + covariance[:, 4, 4] + covariance[:, 5, 5]
    rows = (variance > SPEED_SIGMA_M_S**2).nonzero()[0]
    return rows[have_uncertain_velocity(covariance[rows])] if rows.size else rows


def _bounded(
    models: TrackingModels, state: TrackerState, mean: FloatArray, covariance: FloatArray
) -> TrackerState:
    """Return the state with uncertain speeds bounded, and burns above the ground."""
    estimates = state.table.estimates
    rows = _with_vague_velocity(covariance)
    if rows.size:
        estimates = models.filter.with_velocity_prior(estimates, rows)
    rows = (are_below_ground(mean[:, :3]) & (estimates.weight[:, 0] > 0.5)).nonzero()[0]
    if rows.size:
        estimates = models.filter.raised_above_ground(estimates, rows)
    if estimates is state.table.estimates:
        return state
    return state._replace(table=state.table.with_estimates(estimates))


def _lesser(tracks: TrackPicture) -> BoolArray:
    """Return which tracks follow a target that another one follows, or no target: lines of several
    moved them.
    """
    table = tracks.table
    mean = tracks.mean
    added = tracks.shared_covariance
    wider = tracks.covariance.copy() if added is None else tracks.covariance + added
    fast = ~(dot(mean[:, 3:], mean[:, 3:]) <= LAW.fastest_m_s**2)
    # The covariance of a track that is nowhere may be nothing that can be solved with.
    wider[fast] = np.eye(6)
    are_fresh = table.begun_s == tracks.time_s
    return fast | duplicates(
        table.number, mean, wider, tracks.sightings, table.hits, table.seen, are_fresh
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
    wide = (reach_m > LAW.near_m).nonzero()[0]
    if len(wide):
        # Of two tracks that are alike at such a distance the less certain one reaches the other.
        row, neighbour = neighbour_pairs(tree, position[wide], reach_m[wide])
        pairs = np.sort(np.stack([wide[row], neighbour], axis=1), axis=1)
        close = np.concatenate([close, pairs[pairs[:, 0] < pairs[:, 1]]])
    return np.unique(close, axis=0)


def _never_seen_together(
    pairs: IntArray, number: IntArray, sightings: SharedDetections
) -> BoolArray:
    """Return which pairs (k,) have enough scans with a detection, none of both."""
    row = np.searchsorted(number, sightings.number)
    tracked = (np.append(number, -1)[row] == sightings.number).nonzero()[0]
    scan = scan_numbers(sightings.sensor, sightings.scan)[tracked]
    detected = np.zeros((len(number), int(scan.max(initial=-1)) + 1), dtype=bool)
    detected[row[tracked], scan] = True
    row_detected = detected[pairs[:, 0]]
    other_detected = detected[pairs[:, 1]]
    detected_together = np.any(row_detected & other_detected, axis=1)
    enough: BoolArray = np.count_nonzero(row_detected | other_detected, axis=1) >= ENOUGH_SCANS
    return enough & ~detected_together


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
