"""Track management: the track table, track deletion, and duplicate tracks of one target.

Two tracks are duplicates if their states agree within their covariances and no recent scan detected both: two targets
are detected in one scan sooner or later, one target never twice.
"""

from collections.abc import Sequence

import numpy as np
from attrs import frozen
from numpy.typing import ArrayLike

from opir_core.arrays import BoolArray, FloatArray, IndexArray, IntArray
from opir_core.estimation import dot
from opir_core.geometry import WGS84, ecef_to_geodetic
from opir_core.interfaces import Columns
from opir_core.plugin import Sensor
from opir_trackers.association import scan_numbers
from opir_trackers.imm.outliers import FRACTIONS
from opir_trackers.lines_of_sight import LinesOfSight
from opir_trackers.triangulation import LOWEST_M

#: Tracks within this distance, m, or within their covariances, are compared as possible duplicates.
_NEAR_M = 20e3

#: Gate of the squared Mahalanobis distance of position and velocity, 6 degrees of freedom, 99.99 %.
_DUPLICATE_GATE = 27.9

#: Least number of scans with a detection before two tracks count as duplicates.
_ENOUGH_SCANS = 4


@frozen(eq=False, repr=False)
class SharedDetections(Columns):
    """Recent detections by track number, sensor, scan and time: one row each."""

    number: IntArray
    sensor: IndexArray
    scan: IntArray
    time_s: FloatArray

    @classmethod
    def empty(cls) -> "SharedDetections":
        """Return an empty record."""
        none = np.empty(0, dtype=np.int64)
        return cls(none, none.astype(np.int32), none, np.empty(0))

    def after(
        self, number: IntArray, owner: IntArray, lines: LinesOfSight, time_s: float, memory_s: FloatArray
    ) -> "SharedDetections":
        """Return the detections of a slice that ends at `time_s`, and earlier ones within `memory_s` (sensors,).

        `owner` (m,) is the row, in `number`, of the track of each line, -1 for none.
        """
        mine = np.flatnonzero(owner >= 0)
        fresh = SharedDetections(number[owner[mine]], lines.sensor[mine], lines.scan[mine], lines.time_s[mine])
        old = np.flatnonzero(self.time_s > time_s - memory_s[self.sensor])
        return SharedDetections.concatenate([self.take(old), fresh]) if len(old) else fresh


def sighting_memory_s(period_s: FloatArray, slice_s: float, scans: int) -> FloatArray:
    """Return how long (sensors,) detections are kept: for `scans` scans of sensors with few scans per slice."""
    long_s: FloatArray = np.where(_ENOUGH_SCANS * period_s > slice_s, scans * period_s, 0.0)
    return long_s


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

    `state` (n, 6) and `covariance` (n, 6, 6) are in the inertial frame, m and m/s. Where more than two are near, those
    that are `fresh` (n,) are spared, whose first lines are of earlier slices, and those that no sensor sees both of, by
    `seen` (n, sensors): their pairing decides.
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
    """Return which pairs (k,) have others near, `beside` (n,) in all, and are fresh or seen by no common sensor."""
    one, other = alike.T
    crowded = np.maximum(beside[one], beside[other]) > 1
    spared: BoolArray = crowded & (fresh[one] | fresh[other] | ~np.any(seen[one] & seen[other], axis=1))
    return spared


def _near(position: FloatArray, sigma_m: FloatArray) -> IntArray:
    """Return the pairs (k, 2) of tracks that are near, or may be by their standard deviations (n,), in order."""
    from scipy.spatial import cKDTree

    tree = cKDTree(position)
    near = tree.query_pairs(_NEAR_M, output_type="ndarray")
    reach_m = np.sqrt(2.0 * _DUPLICATE_GATE) * sigma_m
    wide = np.flatnonzero(reach_m > _NEAR_M)
    if len(wide):
        # Of two tracks that are alike at such a distance the less certain one reaches the other.
        neighbours = tree.query_ball_point(position[wide], reach_m[wide], return_sorted=True)
        other = np.concatenate([np.array(rows, dtype=np.int64) for rows in neighbours])
        pairs = np.sort(np.stack([np.repeat(wide, [len(rows) for rows in neighbours]), other], axis=1), axis=1)
        near = np.unique(np.concatenate([near, pairs[pairs[:, 0] < pairs[:, 1]]]), axis=0)
    ordered: IntArray = near[np.lexsort((near[:, 1], near[:, 0]))]
    return ordered


def _never_seen_together(near: IntArray, number: IntArray, sightings: SharedDetections) -> BoolArray:
    """Return which pairs (k,) have enough scans with a detection, none of both."""
    row = np.searchsorted(number, sightings.number)
    here = np.flatnonzero(np.append(number, -1)[row] == sightings.number)
    scan = scan_numbers(sightings.sensor, sightings.scan)[here]
    seen = np.zeros((len(number), int(scan.max(initial=-1)) + 1), dtype=bool)
    seen[row[here], scan] = True
    one, other = seen[near[:, 0]], seen[near[:, 1]]
    apart: BoolArray = np.any(one & other, axis=1)
    enough: BoolArray = np.count_nonzero(one | other, axis=1) >= _ENOUGH_SCANS
    return np.logical_and(enough, ~apart)


#: A track is lost once the probability of that many consecutive misses is below this, for the type with the lowest
#: detection probability.
_LOST_CHANCE = 1e-4

#: Stated detection probabilities are clipped to these; the last is for sensors that state none.
_LEAST_STATED, _MOST_STATED, UNSTATED = 0.05, 0.98, 0.8

#: Upper bound on target speeds, m/s, nearly twice the escape velocity.
_FASTEST_M_S = 20e3

#: A track below the lowest height has come down; one that is still detected, if below by this many standard deviations.
_SURE_SIGMAS = 3.0


@frozen(eq=False, repr=False)
class TrackTable(Columns):
    """Properties of tracks besides their estimates, one row each.

    Number, start, first and last detection, and hit count. `outliers` (n, fractions) is the log likelihood of the
    outlier fractions (`outliers`); `reports` (n, sensors) are the types that each sensor last reported,
    codes into `REPORTED_TYPES`, -1 for none; `launch` (n, 3) and `launch_covariance` (n, 3, 3) are as in `Tracks`.
    """

    number: IntArray
    begun_s: FloatArray
    first_s: FloatArray
    seen_s: FloatArray
    hits: IntArray
    outliers: FloatArray
    reports: IntArray
    launch: FloatArray
    launch_covariance: FloatArray

    @classmethod
    def of(cls, sensors: int) -> "TrackTable":
        """Return the table of no tracks."""
        none = np.empty(0, dtype=np.int64)
        return cls.fresh(none, 0.0, sensors)

    @classmethod
    def fresh(cls, number: IntArray, now_s: float, sensors: int) -> "TrackTable":
        """Return the table of new tracks."""
        count = len(number)
        return cls(
            number=number,
            begun_s=np.full(count, now_s),
            first_s=np.full(count, np.inf),
            seen_s=np.full(count, -np.inf),
            hits=np.zeros(count, dtype=np.int64),
            outliers=np.zeros((count, len(FRACTIONS))),
            reports=np.full((count, sensors), -1, dtype=np.int64),
            launch=np.full((count, 3), np.nan),
            launch_covariance=np.full((count, 3, 3), np.nan),
        )

    def with_outliers(self, outliers: FloatArray) -> "TrackTable":
        """Return the table with other log likelihoods (n, fractions) of outlier fractions."""
        launches = self.launch, self.launch_covariance
        return TrackTable(
            self.number, self.begun_s, self.first_s, self.seen_s, self.hits, outliers, self.reports, *launches
        )

    def with_launches(self, launch: FloatArray, covariance: FloatArray) -> "TrackTable":
        """Return the table with other launches (n, 3) and covariances (n, 3, 3)."""
        seen = self.begun_s, self.first_s, self.seen_s
        return TrackTable(self.number, *seen, self.hits, self.outliers, self.reports, launch, covariance)

    def with_detections(
        self, owner: IntArray, time_s: FloatArray, sensor: IndexArray, reported: IntArray
    ) -> "TrackTable":
        """Return the table after lines (m,), in order of time, of rows `owner`, -1 for none."""
        known = owner >= 0
        if np.count_nonzero(known) < len(known):
            mine = np.flatnonzero(known)
            owner, time_s, sensor, reported = owner[mine], time_s[mine], sensor[mine], reported[mine]
        first_s, seen_s, reports = self.first_s, self.seen_s, self.reports
        if len(first_s) == 1 and len(owner):
            first_s, seen_s = np.minimum(first_s, time_s[0]), np.maximum(seen_s, time_s[-1])
            hits = self.hits + len(owner)
        else:
            first_s, seen_s = first_s.copy(), seen_s.copy()
            np.minimum.at(first_s, owner, time_s)
            np.maximum.at(seen_s, owner, time_s)
            hits = self.hits + np.bincount(owner, minlength=len(self))
        if np.count_nonzero(reports[owner, sensor] != reported):
            reports = reports.copy()
            reports[owner, sensor] = reported
        launches = self.launch, self.launch_covariance
        return TrackTable(self.number, self.begun_s, first_s, seen_s, hits, self.outliers, reports, *launches)


def clipped(stated: ArrayLike) -> FloatArray:
    """Return stated detection probabilities (n,), neither certain nor hopeless."""
    return np.clip(np.asarray(stated, dtype=np.float64), _LEAST_STATED, _MOST_STATED)


def longest_silence_s(sensors: Sequence[Sensor], scans: int) -> FloatArray:
    """Return the longest time (sensors,) without detection that is probable for a track in view."""
    seldom = [min(sensor.detection_probability.values(), default=UNSTATED) for sensor in sensors]
    chance = clipped(seldom)
    period_s = np.array([sensor.scan.period_ns * 1e-9 for sensor in sensors])
    return np.asarray(np.maximum(scans, np.log(_LOST_CHANCE) / np.log1p(-chance)) * period_s)


def are_idle(table: TrackTable, vague: BoolArray, needed: int, unseen: BoolArray) -> BoolArray:
    """Return which tracks (n,), of those `unseen` (n,), are unconfirmed or uncertain (n,)."""
    gone: BoolArray = (vague | (table.hits < needed)) & unseen
    return gone


def are_uncertain(covariance: FloatArray, sigma_m: float) -> BoolArray:
    """Return which covariances (n, 6, 6) exceed a standard deviation of the position, m.

    This deletes no track that is still detected. One sensor leaves the position along its line of sight open, by
    hundreds of kilometres in the end; a new track in its place would be assumed near the ground.
    """
    variance = covariance[:, 0, 0] + covariance[:, 1, 1] + covariance[:, 2, 2]
    vague: BoolArray = variance > sigma_m * sigma_m
    return vague


def are_below_ground(position: FloatArray) -> BoolArray:
    """Return which positions (n, 3) may be below the lowest height."""
    low: BoolArray = dot(position, position) < (WGS84.equatorial_radius_m + LOWEST_M) ** 2
    return low


def are_too_fast(velocity: FloatArray) -> BoolArray:
    """Return which tracks, of inertial velocities (n, 3), m/s, follow no target: lines of several moved them."""
    fast: BoolArray = ~(dot(velocity, velocity) <= _FASTEST_M_S**2)
    return fast


def have_come_down(position: FloatArray, covariance: FloatArray, unseen: BoolArray) -> BoolArray:
    """Return which tracks (n,) came down; of those not `unseen` (n,), only significant ones.

    Along a single line of sight the estimate of a flying target may lie below the ground.
    """
    sigma = np.sqrt(covariance[:, 0, 0] + covariance[:, 1, 1] + covariance[:, 2, 2])
    lowest = LOWEST_M - np.where(unseen, 0.0, _SURE_SIGMAS * sigma)
    down: BoolArray = ecef_to_geodetic(position).height_m < lowest
    return down
