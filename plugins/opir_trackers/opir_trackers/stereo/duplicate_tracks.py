"""Doubles: two tracks that share the detections of one target.

Two tracks are one if their states agree within their covariances and if, of the scans that saw either lately, none saw
both: two targets are seen in one scan sooner or later, one target never twice.
"""

import numpy as np
from attrs import frozen

from opir_core.arrays import BoolArray, FloatArray, IndexArray, IntArray
from opir_core.estimation.lines_of_sight import LinesOfSight
from opir_core.interfaces.columns import Columns
from opir_trackers.association import scan_numbers

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
