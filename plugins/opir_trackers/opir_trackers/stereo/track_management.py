"""Which tracks live on: the roster of tracks, and which of them are lost or came to nothing.

Doubles: two tracks that share the detections of one target.

Two tracks are one if their states agree within their covariances and if, of the scans that saw either lately, none saw
both: two targets are seen in one scan sooner or later, one target never twice.
"""

from collections.abc import Sequence

import numpy as np
from attrs import frozen

from opir_core.arrays import BoolArray, FloatArray, IndexArray, IntArray
from opir_core.estimation.lines_of_sight import LinesOfSight, dot
from opir_core.geometry import ecef_to_geodetic
from opir_core.geometry.ellipsoid import WGS84
from opir_core.interfaces.columns import Columns
from opir_core.interfaces.protocols import Sensor
from opir_trackers.association import scan_numbers
from opir_trackers.stereo.measurement_weights import SHARES

#: Tracks nearer to each other than this are looked at as possible doubles, m, and wherever their covariances reach.
_NEAR_M = 20e3

#: Doubles differ in position and velocity by less than this squared Mahalanobis distance (6 degrees, 99.99 %).
_ALIKE = 27.9

#: How many scans have to speak before two tracks are judged to be one.
_ENOUGH_SCANS = 4


@frozen(eq=False)
class SharedDetections(Columns):
    """Which track, by number, was seen in which scan of which sensor, and when: one row each."""

    number: IntArray
    sensor: IndexArray
    scan: IntArray
    time_s: FloatArray

    @classmethod
    def empty(cls) -> "SharedDetections":
        """Return the record of no sightings."""
        none = np.empty(0, dtype=np.int64)
        return cls(none, none.astype(np.int32), none, np.empty(0))

    def after(
        self, number: IntArray, owner: IntArray, rays: LinesOfSight, time_s: float, memory_s: FloatArray
    ) -> "SharedDetections":
        """Return those of a slice that ends at `time_s`, and earlier ones as long as each sensor's are remembered.

        `owner` (m,) is the row, in `number`, of the track that each ray of the slice belongs to, -1 for none.
        """
        mine = np.flatnonzero(owner >= 0)
        fresh = SharedDetections(number[owner[mine]], rays.sensor[mine], rays.scan[mine], rays.time_s[mine])
        old = np.flatnonzero(self.time_s > time_s - memory_s[self.sensor])
        return SharedDetections.concatenate([self.take(old), fresh]) if len(old) else fresh


def remembered_s(period_s: FloatArray, slice_s: float, scans: int) -> FloatArray:
    """Return how long (sensors,) sightings are remembered: so many scans, of sensors that look seldom in a slice."""
    long_s: FloatArray = np.where(_ENOUGH_SCANS * period_s > slice_s, scans * period_s, 0.0)
    return long_s


def doubles(
    number: IntArray, state: FloatArray, covariance: FloatArray, sightings: SharedDetections, hits: IntArray
) -> BoolArray:
    """Return which tracks (n,), of rising numbers, are the lesser of two that follow one target.

    `state` (n, 6) and `covariance` (n, 6, 6) are in the inertial frame, m and m/s.
    """
    lesser = np.zeros(len(number), dtype=bool)
    if len(number) < 2:
        return lesser
    near = _near(state[:, :3], np.sqrt(np.trace(covariance[:, :3, :3], axis1=1, axis2=2)))
    near = near[_never_both(near, number, sightings)] if len(near) else near
    if not len(near):
        return lesser
    apart = state[near[:, 0]] - state[near[:, 1]]
    both = covariance[near[:, 0]] + covariance[near[:, 1]]
    distance = np.sum(apart * np.linalg.solve(both, apart[:, :, None])[:, :, 0], axis=1)
    for first, second in near[distance < _ALIKE].tolist():
        if not lesser[first] and not lesser[second]:
            lesser[second if (hits[first], second) >= (hits[second], first) else first] = True
    return lesser


def _near(position: FloatArray, sigma_m: FloatArray) -> IntArray:
    """Return the pairs (k, 2) of tracks that are near each other, or may be by their deviations (n,), in order."""
    from scipy.spatial import cKDTree

    tree = cKDTree(position)
    near = tree.query_pairs(_NEAR_M, output_type="ndarray")
    reach_m = np.sqrt(2.0 * _ALIKE) * sigma_m
    wide = np.flatnonzero(reach_m > _NEAR_M)
    if len(wide):
        # Of two tracks that are alike at such a distance the less certain one reaches the other.
        found = tree.query_ball_point(position[wide], reach_m[wide], return_sorted=True)
        other = np.concatenate([np.array(rows, dtype=np.int64) for rows in found])
        pairs = np.sort(np.stack([np.repeat(wide, [len(rows) for rows in found]), other], axis=1), axis=1)
        near = np.unique(np.concatenate([near, pairs[pairs[:, 0] < pairs[:, 1]]]), axis=0)
    ordered: IntArray = near[np.lexsort((near[:, 1], near[:, 0]))]
    return ordered


def _never_both(near: IntArray, number: IntArray, sightings: SharedDetections) -> BoolArray:
    """Return which pairs (k,) scans enough have spoken of, none of which saw both."""
    row = np.searchsorted(number, sightings.number)
    here = np.flatnonzero(np.append(number, -1)[row] == sightings.number)
    scan = scan_numbers(sightings.sensor, sightings.scan)[here]
    seen = np.zeros((len(number), int(scan.max(initial=-1)) + 1), dtype=bool)
    seen[row[here], scan] = True
    one, other = seen[near[:, 0]], seen[near[:, 1]]
    apart: BoolArray = np.any(one & other, axis=1)
    enough: BoolArray = np.count_nonzero(one | other, axis=1) >= _ENOUGH_SCANS
    return np.logical_and(enough, ~apart)


#: A track is lost once the chance that a sensor misses it in so many scans on end is less than this, by the type that
#: the sensor sees most seldom. What is believed of such chances lies within limits; some state none.
_LOST_CHANCE = 1e-4
_LEAST_STATED, _MOST_STATED, _UNSTATED = 0.05, 0.98, 0.8

#: No target comes near this speed, m/s, nearly twice that at which it would leave the Earth.
_FASTEST_M_S = 20e3

#: A track lower than this has come down, m; a track that is seen, if it is lower by so many standard deviations.
_LOWEST_M, _SURE_SIGMAS = -20e3, 3.0


@frozen(eq=False)
class TrackTable(Columns):
    """What is kept of tracks beside their estimates: number, when begun, first and last seen, how many rays, whence.

    `strays` (n, shares) is what the rays tell of the share of strays among them (`stray_rays`); `reports` (n, sensors)
    are the types that each sensor last reported, codes into `REPORTED_TYPES`, -1 for none; `launch` (n, 3) and
    `launch_covariance` (n, 3, 3) are as in `Tracks`.
    """

    number: IntArray
    begun_s: FloatArray
    first_s: FloatArray
    seen_s: FloatArray
    hits: IntArray
    strays: FloatArray
    reports: IntArray
    launch: FloatArray
    launch_covariance: FloatArray

    @classmethod
    def of(cls, sensors: int) -> "TrackTable":
        """Return the roster of no tracks."""
        none = np.empty(0, dtype=np.int64)
        return cls.fresh(none, 0.0, sensors)

    @classmethod
    def fresh(cls, number: IntArray, now_s: float, sensors: int) -> "TrackTable":
        """Return the roster of tracks just begun."""
        count = len(number)
        return cls(
            number=number,
            begun_s=np.full(count, now_s),
            first_s=np.full(count, np.inf),
            seen_s=np.full(count, -np.inf),
            hits=np.zeros(count, dtype=np.int64),
            strays=np.zeros((count, len(SHARES))),
            reports=np.full((count, sensors), -1, dtype=np.int64),
            launch=np.full((count, 3), np.nan),
            launch_covariance=np.full((count, 3, 3), np.nan),
        )

    def with_strays(self, strays: FloatArray) -> "TrackTable":
        """Return the roster with what rays tell (n, shares) of the shares of strays."""
        launches = self.launch, self.launch_covariance
        return TrackTable(
            self.number, self.begun_s, self.first_s, self.seen_s, self.hits, strays, self.reports, *launches
        )

    def with_launches(self, launch: FloatArray, covariance: FloatArray) -> "TrackTable":
        """Return the roster with other launches (n, 3) and covariances (n, 3, 3)."""
        seen = self.begun_s, self.first_s, self.seen_s
        return TrackTable(self.number, *seen, self.hits, self.strays, self.reports, launch, covariance)

    def seen(self, owner: IntArray, time_s: FloatArray, sensor: IndexArray, reported: IntArray) -> "TrackTable":
        """Return the roster after rays (m,) in order of time were given to rows `owner`, -1 for none."""
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
        return TrackTable(self.number, self.begun_s, first_s, seen_s, hits, self.strays, reports, *launches)


def patience_s(sensors: Sequence[Sensor], scans: int) -> FloatArray:
    """Return how long (sensors,) a track that a sensor sees may go unseen by chance: so many scans at least."""
    seldom = [min(sensor.detection_probability.values(), default=_UNSTATED) for sensor in sensors]
    chance = np.clip(np.array(seldom, dtype=np.float64), _LEAST_STATED, _MOST_STATED)
    period_s = np.array([sensor.scan.period_ns * 1e-9 for sensor in sensors])
    return np.asarray(np.maximum(scans, np.log(_LOST_CHANCE) / np.log1p(-chance)) * period_s)


def idle(roster: TrackTable, vague: BoolArray, needed: int, unseen: BoolArray) -> BoolArray:
    """Return which tracks (n,), of those `unseen` lately (n,), had too few rays before, or are vague (n,)."""
    gone: BoolArray = (vague | (roster.hits < needed)) & unseen
    return gone


def are_vague(covariance: FloatArray, sigma_m: float) -> BoolArray:
    """Return which covariances (n, 6, 6) leave their tracks nowhere in particular.

    That ends no track that goes on being seen. One sensor alone leaves a target open along its lines of sight, by
    hundreds of kilometres in the end; a track begun in its place would take it to be near the ground.
    """
    variance = covariance[:, 0, 0] + covariance[:, 1, 1] + covariance[:, 2, 2]
    vague: BoolArray = variance > sigma_m * sigma_m
    return vague


def are_low(position: FloatArray) -> BoolArray:
    """Return which positions (n, 3) may be that of a track that came down."""
    low: BoolArray = dot(position, position) < (WGS84.equatorial_radius_m + _LOWEST_M) ** 2
    return low


def are_too_fast(velocity: FloatArray) -> BoolArray:
    """Return which tracks, of inertial velocities (n, 3), m/s, follow no target: rays of several pulled them apart."""
    fast: BoolArray = ~(dot(velocity, velocity) <= _FASTEST_M_S**2)
    return fast


def came_down(position: FloatArray, covariance: FloatArray, unseen: BoolArray) -> BoolArray:
    """Return which tracks (n,) came down; of those that were not `unseen` lately (n,), only those that are sure of it.

    Along the line of sight of one sensor a target's estimate may lie below the ground, while it is seen to fly.
    """
    sigma = np.sqrt(covariance[:, 0, 0] + covariance[:, 1, 1] + covariance[:, 2, 2])
    lowest = _LOWEST_M - np.where(unseen, 0.0, _SURE_SIGMAS * sigma)
    down: BoolArray = ecef_to_geodetic(position).height_m < lowest
    return down
