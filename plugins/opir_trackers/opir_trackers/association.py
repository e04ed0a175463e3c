"""Data association of lines of sight with tracks, nearest or joint: one line per track and scan, one track per line."""

from typing import NamedTuple

import numpy as np
from attrs import Factory, field, frozen

from opir_core.arrays import BoolArray, FloatArray, IndexArray, IntArray
from opir_core.estimation.lines_of_sight import AngleMeasurements, LinesOfSight
from opir_trackers.assignment import cheapest_assignment, components, distinct, marginals, ranks, unambiguous
from opir_trackers.gating import GatedPairs

#: Pairs with a lower association probability are left out of the combined measurement.
_LEAST_PROBABILITY = 1e-6

#: Pairs with a lower log likelihood ratio to miss and false alarm are left out of a joint association: 1.8 % at most.
_LEAST_LOG_RATIO = -4.0

#: Pairs with a higher association probability are assigned.
_CERTAIN = 0.9

_UNIT = np.eye(2)

#: Directions with less than this share of the information of a certain measurement are left out.
_LEAST_INFORMATION = 1e-3


#: Up to this many pairs are searched one by one for ambiguities.
_FEW_PAIRS = 128


class Association(NamedTuple):
    """Measurements of tracks, the track of each line of sight (m,), -1 for none, and the assigned pairs.

    `is_ambiguous` is False where no line had two candidate tracks and no track two lines of one scan.
    """

    measurements: AngleMeasurements
    owner: IntArray
    assigned: GatedPairs
    is_ambiguous: bool = True


def _log_odds(model: "AssociationModel") -> FloatArray:
    return np.log(
        model.detection_probability / ((1.0 - model.detection_probability) * 2.0 * np.pi * model.clutter_per_sr)
    )


@frozen
class AssociationModel:
    """Detection probability per look, by sensor, and clutter density per scan, 1/sr.

    `log_odds` are the logarithms of P_d over (1 - P_d) times the clutter in 2π sr, by sensor.
    """

    detection_probability: FloatArray
    clutter_per_sr: float
    log_odds: FloatArray = field(default=Factory(_log_odds, takes_self=True), init=False)

    def log_ratio(self, pairs: GatedPairs, lines: LinesOfSight) -> FloatArray:
        """Return the log likelihood ratio (n,) of pairs to a miss and a false alarm."""
        log: FloatArray = self.log_odds.take(lines.sensor.take(pairs.line)) - 0.5 * (pairs.distance + pairs.log_volume)
        return log


def scan_groups(pairs: GatedPairs, lines: LinesOfSight) -> IntArray:
    """Return the group (n,) of each pair's track, sensor and scan; a track takes at most one line per group."""
    scan = scan_numbers(lines.sensor, lines.scan)
    return ranks(pairs.track * (int(scan.max(initial=0)) + 1) + scan[pairs.line])


def ambiguous_tracks(pairs: GatedPairs, lines: LinesOfSight) -> IntArray:
    """Return the sorted tracks that share a line with another track or have several lines of one scan."""
    rivals = ~unambiguous(scan_groups(pairs, lines), pairs.line)
    return distinct(pairs.track[rivals])


def connected_tracks(pairs: GatedPairs, tracks: IntArray) -> BoolArray:
    """Return which tracks are among `tracks` or connected to them by shared lines, up to the last with a pair."""
    connected = np.zeros(int(max(pairs.track.max(initial=-1), tracks.max(initial=-1))) + 1, dtype=bool)
    connected[tracks] = True
    if len(tracks):
        group, count = components(pairs.track, pairs.line)
        touched = np.bincount(group, connected[pairs.track], count) > 0.0
        connected[pairs.track[touched[group]]] = True
    return connected


def scan_numbers(sensor: IndexArray, scan: IntArray) -> IntArray:
    """Return a number (n,), from 0, for each sensor's scan."""
    if not len(scan):
        return np.empty(0, dtype=np.int64)
    since = scan - scan.min()
    return ranks(sensor * (since.max() + 1) + since)


def is_unambiguous(pairs: GatedPairs, lines: LinesOfSight) -> bool:
    """Return whether a quick test shows that no line has two candidate tracks and no track two lines of a scan."""
    line, count = pairs.line.tolist(), len(lines.scan)
    if len(line) > _FEW_PAIRS or len(set(line)) < len(line):
        return False
    if count <= _FEW_PAIRS and len(set(zip(lines.sensor.tolist(), lines.scan.tolist(), strict=True))) == count:
        return True
    sensor, scan = lines.sensor.take(pairs.line).tolist(), lines.scan.take(pairs.line).tolist()
    return len(set(zip(pairs.track.tolist(), sensor, scan, strict=True))) == len(line)


def unassigned(count: int) -> IntArray:
    """Return owners (n,) of lines that are all unassigned: -1."""
    owner = np.empty(count, dtype=np.int64)
    owner.fill(-1)
    return owner


def associate_nearest(pairs: GatedPairs, lines: LinesOfSight, model: AssociationModel) -> Association:
    """Return the assignment of each scan by global nearest neighbour."""
    ratio = model.log_ratio(pairs, lines)
    if is_unambiguous(pairs, lines):
        return hard_association(pairs, lines, ratio > 0.0)._replace(is_ambiguous=False)
    return hard_association(pairs, lines, cheapest_assignment(scan_groups(pairs, lines), pairs.line, -ratio))


def hard_association(pairs: GatedPairs, lines: LinesOfSight, chosen: BoolArray) -> Association:
    """Return an association of the chosen pairs, with probability 1."""
    used = pairs if np.count_nonzero(chosen) == len(chosen) else pairs.take(np.flatnonzero(chosen))
    owner = unassigned(len(lines.scan))
    owner[used.line] = used.track
    return Association(hard_measurements(used), owner, used)


def hard_measurements(pairs: GatedPairs) -> AngleMeasurements:
    """Return pairs as measurements with association probability 1."""
    return pairs.measurements(pairs.measured, _UNIT / pairs.sigma_rad[:, None, None])


def associate_joint(pairs: GatedPairs, lines: LinesOfSight, model: AssociationModel) -> Association:
    """Return one combined measurement per track and scan, weighted by association probabilities (JPDA).

    The joint probabilistic update of Fortmann, Bar-Shalom and Scheffe ("Sonar tracking of multiple targets using joint
    probabilistic data association", IEEE J. Oceanic Engineering 8(3), 1983) reduces the covariance by K M Kᵀ with M =
    (1 - β₀) S - Σ β ν νᵀ + ν̄ ν̄ᵀ. A plain Kalman update with residual S M⁻¹ ν̄ and noise S M⁻¹ S - H P Hᵀ is
    equivalent; this is the measurement returned, so any filter can use it. Directions in which M is not positive carry
    no information and are left out.
    """
    ratio = model.log_ratio(pairs, lines)
    likely = np.flatnonzero(ratio > _LEAST_LOG_RATIO)
    pairs, ratio = pairs.take(likely), ratio[likely]
    group = scan_groups(pairs, lines)
    beta = marginals(group, pairs.line, np.exp(np.minimum(ratio, 300.0)))
    chosen = np.flatnonzero(_likeliest_pairs(group, pairs.line, beta, ratio))
    owner = unassigned(len(lines))
    owner[pairs.line[chosen]] = pairs.track[chosen]
    return Association(_soft_measurements(pairs, group, beta), owner, pairs.take(chosen))


def _likeliest_pairs(group: IntArray, line: IntArray, beta: FloatArray, ratio: FloatArray) -> BoolArray:
    """Return which pairs (n,) the likeliest one-to-one hypothesis uses, given those that are nearly certain."""
    chosen: BoolArray = beta > _CERTAIN
    open_row = np.bincount(group[chosen], minlength=int(group.max(initial=-1)) + 1) == 0
    open_ray = np.bincount(line[chosen], minlength=int(line.max(initial=-1)) + 1) == 0
    rest = np.flatnonzero(open_row[group] & open_ray[line])
    chosen[rest] = cheapest_assignment(group[rest], line[rest], -ratio[rest])
    return chosen


def _soft_measurements(pairs: GatedPairs, group: IntArray, beta: FloatArray) -> AngleMeasurements:
    """Return the combined measurement of each group of pairs with probabilities `beta` (n,)."""
    count = int(group.max(initial=-1)) + 1
    lead = np.full(count, -1, dtype=np.int64)
    order = np.lexsort((-np.arange(len(beta)), beta))
    lead[group[order]] = order
    first = pairs.take(lead)
    probability: FloatArray = np.bincount(group, beta, count).astype(np.float64)
    mean = np.stack([np.bincount(group, beta * pairs.measured[:, axis], count) for axis in (0, 1)], axis=1).astype(
        np.float64
    )
    square = np.empty((count, 2, 2))
    for row, column in ((0, 0), (0, 1), (1, 1)):
        total = np.bincount(group, beta * pairs.measured[:, row] * pairs.measured[:, column], count)
        square[:, row, column] = square[:, column, row] = total - mean[:, row] * mean[:, column]
    reduction = probability[:, None, None] * first.innovation_covariance - square
    return _equivalent_measurements(first, probability, mean, reduction)


def _equivalent_measurements(
    first: GatedPairs, probability: FloatArray, mean: FloatArray, reduction: FloatArray
) -> AngleMeasurements:
    """Return the measurements whose Kalman update reduces P by K `reduction` Kᵀ and moves the mean by K `mean`.

    In coordinates in which S is the identity, the information I = M / (I - M + R) is computed per eigenvector of M,
    each bounded below, with R the noise of one line of sight.
    """
    root = _lower_root(first.innovation_covariance)
    inverse = _lower_inverse(root)
    turned = inverse @ reduction @ inverse.transpose(0, 2, 1)
    middle = 0.5 * (turned[:, 0, 0] + turned[:, 1, 1])
    half = np.hypot(0.5 * (turned[:, 0, 0] - turned[:, 1, 1]), turned[:, 0, 1])
    useful = np.flatnonzero((middle - half > _LEAST_INFORMATION) & (probability > _LEAST_PROBABILITY))
    root, inverse, turned, middle, half = (part[useful] for part in (root, inverse, turned, middle, half))
    less, more = (1.0 / np.minimum(share, 1.0) for share in (middle - half, middle + half))
    slope = np.divide(more - less, 2.0 * half, out=np.zeros_like(half), where=half > 0.0)
    # The inverse of M, its eigenvalues cut at 1; S M⁻¹ S - H P Hᵀ is M⁻¹ - I + R here, at least the noise of one line.
    over = slope[:, None, None] * turned + (0.5 * (less + more) - slope * middle)[:, None, None] * _UNIT
    effective = root @ (over - _UNIT) @ root.transpose(0, 2, 1)
    effective[:, [0, 1], [0, 1]] += np.square(first.sigma_rad[useful])[:, None]
    pulled = root @ (over @ (inverse @ mean[useful][:, :, None]))
    return first.take(useful).measurements(pulled[:, :, 0], _lower_inverse(_lower_root(effective)))


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
