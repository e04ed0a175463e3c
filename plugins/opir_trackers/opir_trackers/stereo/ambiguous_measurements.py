"""Rays that several tracks may have, weighed by the whole of what is known of each track and not by one slice.

Two targets nearer to each other than a look's error are not told apart by giving each ray to one of them: each would
get the rays on its own side, and the two would be driven apart. So a contested ray counts for each track it may belong
to by how probable that is, and what is probable is asked again once the tracks are where that puts them: expectation
and maximisation (Dempster, Laird and Rubin, J. Royal Statistical Society B 39(1), 1977; Streit and Luginbuhl,
"Probabilistic multi-hypothesis tracking", 1995), with one ray a track and scan. Every turn raises the likelihood of all
rays, summed over all their explanations.
"""

import numpy as np
from attrs import evolve, frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.estimation.lines_of_sight import Sights, along, dot
from opir_core.interfaces.columns import Columns
from opir_trackers.assignment import ranks
from opir_trackers.joint_association import marginals
from opir_trackers.predicted_measurements import PredictedMeasurements

#: A ray that is less probably a track's than this, by its rivals for the ray alone, is none of its.
_LEAST_SHARE = 5e-3

#: A line of sight that is probably nobody's still tells this share of a ray.
LEAST_WEIGHT = 1e-6


@frozen(eq=False)
class AmbiguousMeasurements(Columns):
    """Rays that may be part of lines of sight, one row each: which line of sight, which ray and which scan it is of.

    `seen` (n, 2), rad, is where the ray is in the plane of the line of sight; `odds` (n,) the log likelihood that a ray
    on a track is the track's over that of a miss and a false alarm, by solid angle in units of its variance; `weight`
    (n,) how probably it is, as last asked; `end_s` (n,) when the slice of the ray ended.
    """

    sight: IntArray
    ray: IntArray
    scan: IntArray
    seen: FloatArray
    sigma_rad: FloatArray
    odds: FloatArray
    weight: FloatArray
    end_s: FloatArray

    @classmethod
    def empty(cls) -> "AmbiguousMeasurements":
        """Return the record of no rays."""
        whole, none = np.empty(0, dtype=np.int64), np.empty(0)
        return cls(whole, whole, whole, np.empty((0, 2)), none, none, none, none)

    def weighed(self, track: IntArray, seen: FloatArray) -> "AmbiguousMeasurements":
        """Return the rays with how probably each is the track's, one ray a track and scan, and one track a ray.

        `track` (m,) are the tracks of the lines of sight, `seen` (m, 2) is where they are expected to be seen.
        """
        apart = self.seen - seen.take(self.sight, axis=0)
        log = self.odds - 0.5 * dot(apart, apart) / np.square(self.sigma_rad)
        ratio = np.exp(np.minimum(log, 300.0))
        likely = np.flatnonzero(ratio > _LEAST_SHARE * (1.0 + np.bincount(self.ray, ratio)[self.ray]))
        scan = ranks(track[self.sight[likely]] * (int(self.scan.max(initial=0)) + 1) + self.scan[likely])
        weight = np.zeros(len(self))
        weight[likely] = marginals(scan, self.ray[likely], ratio[likely])
        return evolve(self, weight=weight)

    def gathered(self, sights: Sights) -> tuple[Sights, IntArray]:
        """Return lines of sight with the means of the rays in them, each as sure as they are, and which those are."""
        sharp = np.maximum(self.weight, LEAST_WEIGHT) / np.square(self.sigma_rad)
        total = np.bincount(self.sight, sharp, len(sights))
        mine = np.flatnonzero(total)
        seen, whitener = sights.seen.copy(), sights.whitener.copy()
        for axis in (0, 1):
            seen[mine, axis] = np.bincount(self.sight, sharp * self.seen[:, axis], len(sights))[mine] / total[mine]
        whitener[mine] = np.sqrt(total[mine])[:, None, None] * np.eye(2)
        return evolve(sights, seen=seen, whitener=whitener), mine

    def without(self, gone: BoolArray, sight: IntArray) -> "AmbiguousMeasurements":
        """Return what is left once lines of sight (m,) are gone, others now being numbered `sight` (m,).

        A ray that was theirs with some probability is the less others'.
        """
        left = gone[self.sight]
        size = int(self.ray.max(initial=-1)) + 1
        theirs = np.bincount(self.ray[left], self.weight[left], size)
        odds = self.odds + np.log(np.maximum(1.0 - theirs[self.ray], LEAST_WEIGHT))
        return evolve(self, odds=odds, sight=sight[self.sight]).take(np.flatnonzero(~left))


def expected(path: PredictedMeasurements, sights: Sights) -> FloatArray:
    """Return where (n, 2) lines of sight would be, each in its own plane, if tracks were where they are taken to be."""
    local = along(sights.axes, path.positions(sights.track, sights.time_s) - sights.origin_m)
    seen: FloatArray = local[:, :2] / local[:, 2:]
    return seen
