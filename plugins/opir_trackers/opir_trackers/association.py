"""Which rays belong to which tracks: nearest or joint, one ray a track and scan, one track a ray."""

from typing import NamedTuple

import numpy as np
from attrs import Factory, field, frozen

from opir_core.arrays import BoolArray, FloatArray, IndexArray, IntArray
from opir_core.estimation.lines_of_sight import LinesOfSight, Sights
from opir_trackers.assignment import components, different, lone, marginals, nearest, ranks
from opir_trackers.gating import GatedPairs

#: A pair that a joint association believes in less than this is left out of the track's sight.
_LEAST_BELIEF = 1e-6

#: Pairs this much less likely than a miss and a false alarm (log) are left out of a joint association: 1.8 % at most.
_LEAST_LOG_RATIO = -4.0

#: A pair that a joint association believes in more than this is the ray's and the track's.
_SURE = 0.9

_UNIT = np.eye(2)

#: A sight tells at least this share of what an undoubted one would, or it is left out.
_LEAST_TOLD = 1e-3


#: Up to so many pairs are looked through one by one for rivals.
_FEW = 128


class Associated(NamedTuple):
    """The sights of tracks, whose each ray (m,) is, -1 for nobody's, and the pairs in which a ray is a track's own.

    `contested` is False where no ray had two tracks to choose from and no track two rays of a scan.
    """

    sights: Sights
    owner: IntArray
    own: GatedPairs
    contested: bool = True


def _odds(chances: "Chances") -> FloatArray:
    return np.log(chances.detection / ((1.0 - chances.detection) * 2.0 * np.pi * chances.false_per_sr))


@frozen
class Chances:
    """What association takes for granted: chance of detection a look, by sensor, and false alarms a scan and sr.

    `odds` are the logarithms of the chance of a detection over that of a miss and a false alarm in 2π sr, by sensor.
    """

    detection: FloatArray
    false_per_sr: float
    odds: FloatArray = field(default=Factory(_odds, takes_self=True), init=False)

    def log_ratio(self, pairs: GatedPairs, rays: LinesOfSight) -> FloatArray:
        """Return the log likelihood (n,) that pairs belong together over that of a miss and a false alarm."""
        log: FloatArray = self.odds.take(rays.sensor.take(pairs.ray)) - 0.5 * (pairs.distance + pairs.log_volume)
        return log


def scan_groups(pairs: GatedPairs, rays: LinesOfSight) -> IntArray:
    """Return a number (n,) for each pair's track, sensor and scan: at most one ray of a group is the track's own."""
    scan = scan_numbers(rays.sensor, rays.scan)
    return ranks(pairs.track * (int(scan.max(initial=0)) + 1) + scan[pairs.ray])


def crowded(pairs: GatedPairs, rays: LinesOfSight) -> IntArray:
    """Return the tracks, in order, that share a ray with another or have several rays of one scan to choose from."""
    rivals = ~lone(scan_groups(pairs, rays), pairs.ray)
    return different(pairs.track[rivals])


def related(pairs: GatedPairs, tracks: IntArray) -> BoolArray:
    """Return which tracks, up to the last that has a pair, are some or share rays with them, directly or in turn."""
    found = np.zeros(int(max(pairs.track.max(initial=-1), tracks.max(initial=-1))) + 1, dtype=bool)
    found[tracks] = True
    if len(tracks):
        group, count = components(pairs.track, pairs.ray)
        touched = np.bincount(group, found[pairs.track], count) > 0.0
        found[pairs.track[touched[group]]] = True
    return found


def scan_numbers(sensor: IndexArray, scan: IntArray) -> IntArray:
    """Return a number (n,) for each sensor's scan, from 0."""
    if not len(scan):
        return np.empty(0, dtype=np.int64)
    since = scan - scan.min()
    return ranks(sensor * (since.max() + 1) + since)


def uncontested(pairs: GatedPairs, rays: LinesOfSight) -> bool:
    """Return whether it is plain that no ray has two tracks to choose from and no track two rays of a scan."""
    ray, count = pairs.ray.tolist(), len(rays.scan)
    if len(ray) > _FEW or len(set(ray)) < len(ray):
        return False
    if count <= _FEW and len(set(zip(rays.sensor.tolist(), rays.scan.tolist(), strict=True))) == count:
        return True
    sensor, scan = rays.sensor.take(pairs.ray).tolist(), rays.scan.take(pairs.ray).tolist()
    return len(set(zip(pairs.track.tolist(), sensor, scan, strict=True))) == len(ray)


def nobody(count: int) -> IntArray:
    """Return the owners (n,) of rays that are nobody's."""
    owner = np.empty(count, dtype=np.int64)
    owner.fill(-1)
    return owner


def associate_nearest(pairs: GatedPairs, rays: LinesOfSight, chances: Chances) -> Associated:
    """Return each track's ray of each scan by global nearest neighbour."""
    ratio = chances.log_ratio(pairs, rays)
    if uncontested(pairs, rays):
        return as_owned(pairs, rays, ratio > 0.0)._replace(contested=False)
    return as_owned(pairs, rays, nearest(scan_groups(pairs, rays), pairs.ray, -ratio))


def as_owned(pairs: GatedPairs, rays: LinesOfSight, chosen: BoolArray) -> Associated:
    """Return undoubted sights of the pairs chosen."""
    used = pairs if np.count_nonzero(chosen) == len(chosen) else pairs.take(np.flatnonzero(chosen))
    owner = nobody(len(rays.scan))
    owner[used.ray] = used.track
    return Associated(plain(used), owner, used)


def plain(pairs: GatedPairs) -> Sights:
    """Return pairs as undoubted sights."""
    return pairs.sights(pairs.seen, _UNIT / pairs.sigma_rad[:, None, None])


def associate_joint(pairs: GatedPairs, rays: LinesOfSight, chances: Chances) -> Associated:
    """Return one sight for each track and scan that stands for all its rays, each as probable as it is.

    The joint probabilistic update of Fortmann, Bar-Shalom and Scheffe ("Sonar tracking of multiple targets using joint
    probabilistic data association", IEEE J. Oceanic Engineering 8(3), 1983) takes K M Kᵀ from the covariance, with
    M = (1 - β₀) S - Σ β ν νᵀ + ν̄ ν̄ᵀ. A plain update with residual S M⁻¹ ν̄ and noise S M⁻¹ S - H P Hᵀ does the same,
    and that is the sight: so any filter can take it in. Where the rays disagree so much that M is not positive, the
    sight tells nothing in that direction and is left out.
    """
    ratio = chances.log_ratio(pairs, rays)
    likely = np.flatnonzero(ratio > _LEAST_LOG_RATIO)
    pairs, ratio = pairs.take(likely), ratio[likely]
    group = scan_groups(pairs, rays)
    beta = marginals(group, pairs.ray, np.exp(np.minimum(ratio, 300.0)))
    chosen = np.flatnonzero(_believed(group, pairs.ray, beta, ratio))
    owner = nobody(len(rays))
    owner[pairs.ray[chosen]] = pairs.track[chosen]
    return Associated(_blended(pairs, group, beta), owner, pairs.take(chosen))


def _believed(group: IntArray, ray: IntArray, beta: FloatArray, ratio: FloatArray) -> BoolArray:
    """Return which pairs (n,) are used by the likeliest one-to-one explanation once those that are all but sure are."""
    chosen: BoolArray = beta > _SURE
    open_row = np.bincount(group[chosen], minlength=int(group.max(initial=-1)) + 1) == 0
    open_ray = np.bincount(ray[chosen], minlength=int(ray.max(initial=-1)) + 1) == 0
    rest = np.flatnonzero(open_row[group] & open_ray[ray])
    chosen[rest] = nearest(group[rest], ray[rest], -ratio[rest])
    return chosen


def _blended(pairs: GatedPairs, group: IntArray, beta: FloatArray) -> Sights:
    count = int(group.max(initial=-1)) + 1
    lead = np.full(count, -1, dtype=np.int64)
    order = np.lexsort((-np.arange(len(beta)), beta))
    lead[group[order]] = order
    first = pairs.take(lead)
    belief: FloatArray = np.bincount(group, beta, count).astype(np.float64)
    mean = np.stack([np.bincount(group, beta * pairs.seen[:, axis], count) for axis in (0, 1)], axis=1).astype(
        np.float64
    )
    square = np.empty((count, 2, 2))
    for row, column in ((0, 0), (0, 1), (1, 1)):
        total = np.bincount(group, beta * pairs.seen[:, row] * pairs.seen[:, column], count)
        square[:, row, column] = square[:, column, row] = total - mean[:, row] * mean[:, column]
    told = belief[:, None, None] * first.spread - square
    return _as_sights(first, belief, mean, told)


def _as_sights(first: GatedPairs, belief: FloatArray, mean: FloatArray, told: FloatArray) -> Sights:
    """Return the sights whose plain update takes K `told` Kᵀ from the covariance and moves the mean by K `mean`.

    In the coordinates in which S is the identity: information I = M / (I - M + R) is worked out direction by direction
    of M, each bounded below, with R the noise of one ray.
    """
    root = _lower_root(first.spread)
    inverse = _lower_inverse(root)
    turned = inverse @ told @ inverse.transpose(0, 2, 1)
    middle = 0.5 * (turned[:, 0, 0] + turned[:, 1, 1])
    half = np.hypot(0.5 * (turned[:, 0, 0] - turned[:, 1, 1]), turned[:, 0, 1])
    useful = np.flatnonzero((middle - half > _LEAST_TOLD) & (belief > _LEAST_BELIEF))
    root, inverse, turned, middle, half = (part[useful] for part in (root, inverse, turned, middle, half))
    less, more = (1.0 / np.minimum(share, 1.0) for share in (middle - half, middle + half))
    slope = np.divide(more - less, 2.0 * half, out=np.zeros_like(half), where=half > 0.0)
    # The inverse of M, its eigenvalues cut at 1; S M⁻¹ S - H P Hᵀ is M⁻¹ - I + R here, never less than one ray's noise.
    over = slope[:, None, None] * turned + (0.5 * (less + more) - slope * middle)[:, None, None] * _UNIT
    effective = root @ (over - _UNIT) @ root.transpose(0, 2, 1)
    effective[:, [0, 1], [0, 1]] += np.square(first.sigma_rad[useful])[:, None]
    pulled = root @ (over @ (inverse @ mean[useful][:, :, None]))
    return first.take(useful).sights(pulled[:, :, 0], _lower_inverse(_lower_root(effective)))


def _lower_root(matrix: FloatArray) -> FloatArray:
    """Return the Cholesky factors (n, 2, 2) of positive definite matrices (n, 2, 2)."""
    root = np.zeros_like(matrix)
    root[:, 0, 0] = np.sqrt(matrix[:, 0, 0])
    root[:, 1, 0] = matrix[:, 1, 0] / root[:, 0, 0]
    root[:, 1, 1] = np.sqrt(matrix[:, 1, 1] - np.square(root[:, 1, 0]))
    return root


def _lower_inverse(root: FloatArray) -> FloatArray:
    """Return the inverses (n, 2, 2) of lower triangular matrices (n, 2, 2)."""
    inverse = np.zeros_like(root)
    inverse[:, 0, 0], inverse[:, 1, 1] = 1.0 / root[:, 0, 0], 1.0 / root[:, 1, 1]
    inverse[:, 1, 0] = -root[:, 1, 0] * inverse[:, 0, 0] * inverse[:, 1, 1]
    return inverse
