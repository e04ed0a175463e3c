"""Tracks in the focal planes of the sensors: the first level of association, for targets in a
crowd.

Where tracks share lines of sight, each sensor follows its targets by itself: angle, rate and
acceleration in a tangent plane, with white noise of the jerk. A line is weighted with its
association probability over all one-to-one hypotheses of its scan (JPDA: Fortmann, Bar-Shalom and
Scheffe, IEEE J. Oceanic Engineering 8(3), 1983). A wrong pairing with other sensors' tracks has no
effect on it.

The filter of states gets a few scans of such a track as one line of sight, the *equivalent* one:
what moves the estimate in the focal plane as the weighted lines do, with the same gain.
"""

from typing import NamedTuple

import numpy as np
from attrs import evolve, frozen
from opir_estimation import (
    LinesOfSight,
    belief_propagation,
    cheapest_assignment,
    dot,
    group_minima,
    group_sums,
    matvec,
    neighbour_pairs,
    ranks,
    scan_numbers,
    tangent_axes,
    unambiguous,
)

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.interfaces import Columns
from opir_trackers.association import AssociationModel


@frozen
class FocalPlaneLaw:
    """Motion and association in focal planes."""

    #: Process-noise density of the jerk across the line of sight, m/s³/√s: a stage that ignites
    #: changes the acceleration by some 20 m/s², which the track follows within 2 s; twice or half
    #: as much changes the purity by 0.02 (salvos of 20).
    jerk_noise_m_s3: float = 2.5

    #: Scans that begin within this time, s, are associated with the same predictions: with twice as
    #: much 5 % fewer of a salvo's launches are paired right.
    batch_s: float = 0.15

    #: Sweeps of belief propagation in a scan.
    sweeps: int = 10

    #: Expected number of lines of targets without a track within 2π σ² of a look in a crowd, over
    #: the odds of a detection: targets launch one by one. In wide crowds belief propagation is
    #: overconfident without it.
    newcomers: float = 0.01

    #: Least information of the equivalent line of a scan, as a share of that of one with the
    #: variance of its innovation.
    least_information: float = 0.02


LAW = FocalPlaneLaw()


@frozen(eq=False, repr=False)
class FocalPlaneTracks(Columns):
    """Tracks in focal planes: one row for each track and sensor.

    `axes` (n, 3, 3) are the rows of the tangent plane and its normal, in ECEF; `range_m` (n,) the
    approximate range; `mean` (n, 3, 2) angle, rate and acceleration in the plane, rad; `covariance`
    (n, 3, 3) that of each of the two axes; `time_s` (n,) their time; `contested_s` (n,) when the
    track was last contested, and `seen_s` (n,) had a line.
    """

    number: IntArray
    sensor: IntArray
    axes: FloatArray
    range_m: FloatArray
    mean: FloatArray
    covariance: FloatArray
    time_s: FloatArray
    contested_s: FloatArray
    seen_s: FloatArray

    @classmethod
    def empty(cls) -> "FocalPlaneTracks":
        """Return no tracks."""
        numbers = np.empty(0, dtype=np.int64)
        none = np.empty(0)
        square = np.empty((0, 3, 3))
        return cls(numbers, numbers, square, none, np.empty((0, 3, 2)), square, none, none, none)

    def predicted(self, time_s: FloatArray | float) -> "FocalPlaneTracks":
        """Return the tracks at times (n,) or a time."""
        when = np.broadcast_to(np.asarray(time_s, dtype=np.float64), self.time_s.shape).copy()
        step = when - self.time_s
        if not step.any():
            return self
        move = _transition(step)
        noise = np.square(LAW.jerk_noise_m_s3 / self.range_m)[:, None, None] * _noise(step)
        return evolve(
            self,
            mean=move @ self.mean,
            covariance=move @ self.covariance @ move.transpose(0, 2, 1) + noise,
            time_s=when,
        )

    def places(self, row: IntArray, time_s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return angles (m, 2) of rows (m,) at times (m,), and their variances (m,) on each
        axis.
        """
        step = time_s - self.time_s.take(row)
        half = 0.5 * step * step
        mean = self.mean.take(row, axis=0)
        place = mean[:, 0] + step[:, None] * mean[:, 1] + half[:, None] * mean[:, 2]
        return place, self._variances(row, step)

    def _variances(self, row: IntArray, step: FloatArray) -> FloatArray:
        """Return the variances (m,) of angles on each axis, of rows (m,) after steps (m,), s."""
        half = 0.5 * step * step
        xx, xv, xa, _, vv, va, _, _, aa = self.covariance.take(row, axis=0).reshape(-1, 9).T
        variance: FloatArray = xx + 2.0 * step * xv + 2.0 * half * (vv + xa)
        variance += 2.0 * step * half * va + half * half * aa
        noise = np.square(LAW.jerk_noise_m_s3 / self.range_m.take(row))
        variance += noise * np.abs(step) ** 5 / 20.0
        return variance

    @property
    def speeds(self) -> FloatArray:
        """Return the rates (n,) of angles, rad/s."""
        return np.sqrt(dot(self.mean[:, 1], self.mean[:, 1]))

    def directions(self, row: IntArray, place: FloatArray) -> FloatArray:
        """Return unit vectors (m, 3), in ECEF, of angles (m, 2) in the planes of rows (m,)."""
        local = np.concatenate([place, np.ones((len(row), 1))], axis=1)
        along = matvec(self.axes.take(row, axis=0).transpose(0, 2, 1), local)
        return along / np.sqrt(dot(along, along))[:, None]


def _transition(step: FloatArray) -> FloatArray:
    move = np.zeros((len(step), 3, 3))
    move[:, range(3), range(3)] = 1.0
    move[:, 0, 1] = move[:, 1, 2] = step
    move[:, 0, 2] = 0.5 * step * step
    return move


def _noise(step: FloatArray) -> FloatArray:
    """Return the covariances (n, 3, 3) of white jerk of unit density over steps (n,)."""
    power = [np.abs(step) ** number for number in range(6)]
    noise = np.empty((len(step), 3, 3))
    noise[:, 0, 0] = power[5] / 20.0
    noise[:, 1, 1] = power[3] / 3.0
    noise[:, 2, 2] = power[1]
    noise[:, 0, 1] = noise[:, 1, 0] = power[4] / 8.0
    noise[:, 0, 2] = noise[:, 2, 0] = power[3] / 6.0
    noise[:, 1, 2] = noise[:, 2, 1] = power[2] / 2.0
    return noise


class FocalPlanePairs(NamedTuple):
    """Gated pairs (m,) of a row and a line: angle off the prediction (m, 2), its variance and
    squared distance.
    """

    row: IntArray
    line: IntArray
    off: FloatArray
    variance: FloatArray
    distance: FloatArray

    def part(self, rows: IntArray) -> "FocalPlanePairs":
        """Return some pairs."""
        squares = self.variance.take(rows), self.distance.take(rows)
        return FocalPlanePairs(
            self.row.take(rows), self.line.take(rows), self.off.take(rows, axis=0), *squares
        )


def gated_pairs(
    tracks: FocalPlaneTracks, lines: LinesOfSight, row: IntArray, line: IntArray, gate: float
) -> FocalPlanePairs:
    """Return the pairs (m,) of rows and lines within the gate; the variance includes that of the
    line.
    """
    local = matvec(tracks.axes.take(row, axis=0), lines.direction_ecef.take(line, axis=0))
    place, variance = tracks.places(row, lines.time_s.take(line))
    off = local[:, :2] / local[:, 2:] - place
    variance += np.square(lines.sigma_rad.take(line))
    distance = dot(off, off) / variance
    inside = np.flatnonzero((distance <= gate * gate) & (local[:, 2] > 0.0))
    return FocalPlanePairs(row, line, off, variance, distance).part(inside)


def candidate_pairs(
    tracks: FocalPlaneTracks, lines: LinesOfSight, span_s: float, gate: float
) -> tuple[IntArray, IntArray]:
    """Return rows and lines (m,) of one sensor each that may pass the gate within a span after the
    tracks' time.
    """
    from scipy.spatial import cKDTree

    row = np.arange(len(tracks))
    if not len(row) or not len(lines):
        return row[:0], row[:0]
    middle = tracks.predicted(tracks.time_s + 0.5 * span_s)
    sigma = np.sqrt(tracks.predicted(tracks.time_s + span_s).covariance[:, 0, 0])
    reach = gate * (sigma + lines.sigma_rad.max()) + 0.5 * span_s * middle.speeds
    # Other sensors are far off along a fourth axis.
    separation = 8.0 * np.maximum(reach.max(), 1.0)
    place = np.column_stack([middle.directions(row, middle.mean[:, 0]), separation * tracks.sensor])
    tree = cKDTree(np.column_stack([lines.direction_ecef, separation * lines.sensor]))
    return neighbour_pairs(tree, place, 1.5 * reach)


class FocalPlaneUpdate(NamedTuple):
    """Rows after a slice, the row of each line (m,), -1 for none, and the equivalent lines and
    their rows.

    `pairs` are those within the gates of the rows as they were before.
    """

    tracks: FocalPlaneTracks
    owner: IntArray
    equivalent: LinesOfSight
    row: IntArray
    pairs: FocalPlanePairs


class _SliceUpdate(NamedTuple):
    """Rows after looks, the equivalent line of each row that has any, and its row (k,)."""

    tracks: FocalPlaneTracks
    equivalent: LinesOfSight
    row: IntArray


def updated(
    tracks: FocalPlaneTracks,
    lines: LinesOfSight,
    pairs: FocalPlanePairs,
    model: AssociationModel,
    gate: float,
) -> FocalPlaneUpdate:
    """Return the rows after the lines of a slice, of which `pairs` are within their gates.

    Rows that share lines take them scan by scan, the others all at once.
    """
    scan = scan_numbers(lines.sensor, lines.scan)
    shared = _are_shared(pairs, scan, len(tracks))
    owner = np.full(len(lines), -1, dtype=np.int64)
    lone = pairs.part(np.flatnonzero(~shared))
    lone = lone.part(np.flatnonzero(_log_ratio(model, lines, lone) > 0.0))
    owner[lone.line] = lone.row
    # In a slice a row moves little off its predicted path: its lines count as their mean, at the
    # mean of their times.
    weight = 1.0 / np.square(lines.sigma_rad[lone.line])
    looks = lone._replace(off=lone.off * weight[:, None])
    updates = [_after_looks(tracks, lines, looks, weight)]
    row = pairs.row[shared]
    line = pairs.line[shared]
    batch = _batches(scan, lines.time_s)[line]
    for number in np.unique(batch).tolist():
        members = np.flatnonzero(batch == number)
        tracks = updates[-1].tracks
        gated = gated_pairs(tracks, lines, row.take(members), line.take(members), gate)
        if len(gated.row):
            update, assigned = _after_batch(tracks, lines, gated, scan, model)
            owner[gated.line[assigned]] = gated.row[assigned]
            updates.append(update)
    tracks = _with_times_seen(updates[-1].tracks, owner, lines.time_s)
    equivalent = LinesOfSight.concatenate([update.equivalent for update in updates])
    rows = np.concatenate([update.row for update in updates])
    return FocalPlaneUpdate(tracks, owner, equivalent, rows, pairs)


def _are_shared(pairs: FocalPlanePairs, scan: IntArray, count: int) -> BoolArray:
    """Return which pairs (m,) are of rows that share a line or have several of one scan."""
    key = pairs.row * (int(scan.max(initial=0)) + 1) + scan[pairs.line]
    is_shared = np.zeros(count, dtype=bool)
    is_shared[pairs.row[~unambiguous(key, pairs.line)]] = True
    return is_shared[pairs.row]


def _with_times_seen(
    tracks: FocalPlaneTracks, owner: IntArray, time_s: FloatArray
) -> FocalPlaneTracks:
    """Return the rows with the times of their last lines (m,), of rows `owner`, -1 for none."""
    seen_s = tracks.seen_s.copy()
    owned = np.flatnonzero(owner >= 0)
    np.maximum.at(seen_s, owner[owned], time_s[owned])
    return evolve(tracks, seen_s=seen_s)


def _after_batch(
    tracks: FocalPlaneTracks,
    lines: LinesOfSight,
    pairs: FocalPlanePairs,
    scan: IntArray,
    model: AssociationModel,
) -> tuple[_SliceUpdate, IntArray]:
    """Return the rows after some scans, with equivalent lines of those with lines, and the assigned
    pairs.
    """
    log = _log_ratio(model, lines, pairs)
    look = ranks(pairs.row * (int(scan.max()) + 1) + scan[pairs.line])
    assigned = np.flatnonzero(cheapest_assignment(look, pairs.line, -log))
    looks, weight = _equivalent_looks(lines, pairs, look, _probabilities(lines, pairs, look, log))
    update = _after_looks(tracks, lines, looks, weight)
    rows = np.flatnonzero(np.isin(update.row, pairs.row[assigned]))
    return update._replace(equivalent=update.equivalent.take(rows), row=update.row[rows]), assigned


def _log_ratio(model: AssociationModel, lines: LinesOfSight, pairs: FocalPlanePairs) -> FloatArray:
    """Return the log likelihood ratios (m,) of pairs to a miss and a false alarm."""
    odds: FloatArray = model.log_odds.take(lines.sensor.take(pairs.line))
    return odds - 0.5 * pairs.distance - np.log(pairs.variance)


def _batches(scan: IntArray, time_s: FloatArray) -> IntArray:
    """Return for each line (m,) the number of the part of the slice in which its scan, by
    `scan_numbers`, begins.
    """
    first_s = group_minima(scan, time_s, int(scan.max(initial=-1)) + 1)
    return ((first_s - first_s.min(initial=np.inf)) / LAW.batch_s).astype(np.int64)[scan]


def _equivalent_looks(
    lines: LinesOfSight, pairs: FocalPlanePairs, look: IntArray, beta: FloatArray
) -> tuple[FocalPlanePairs, FloatArray]:
    """Return one pair for each look (k,), a row in a scan, by `look` (m,), and its weight, 1/rad².

    With this weight it has the same gain and leaves the same covariance as the pairs with
    probabilities `beta` (m,): where these are far apart it is negative. `off` (k, 2) is that weight
    times the angle, 1/rad.
    """
    hits = np.bincount(look)
    total = np.bincount(look, beta)
    off = group_sums(look, beta[:, None] * pairs.off)
    spread = 0.5 * (np.bincount(look, beta * dot(pairs.off, pairs.off)) - dot(off, off))
    innovation_variance = np.bincount(look, pairs.variance) / hits
    prior_variance = (
        innovation_variance - np.bincount(look, np.square(lines.sigma_rad[pairs.line])) / hits
    )
    information = total * innovation_variance - spread
    likeliest = np.lexsort((beta, look))[np.cumsum(hits) - 1]
    remainder = innovation_variance * innovation_variance - prior_variance * information
    looks = pairs.part(likeliest)._replace(off=off * (innovation_variance / remainder)[:, None])
    return looks, information / remainder


def _after_looks(
    tracks: FocalPlaneTracks, lines: LinesOfSight, pairs: FocalPlanePairs, weight: FloatArray
) -> _SliceUpdate:
    """Return the rows after looks (m,).

    `pairs` are as of `_equivalent_looks`, of which each row's count as one, at the mean of their
    times.
    """
    row, place = np.unique(pairs.row, return_inverse=True)
    noise = np.square(lines.sigma_rad[pairs.line])
    share = np.maximum(weight, LAW.least_information / noise)
    share = share / np.bincount(place, share)[place]
    looks = np.column_stack([lines.time_s[pairs.line], lines.origin_ecef_m[pairs.line]])
    looks = looks * share[:, None]
    sums = group_sums(place, np.column_stack([looks, pairs.off, weight]), len(row))
    prediction = tracks.take(row).predicted(sums[:, 0])
    newest = np.empty(len(row), dtype=np.int64)
    newest[place] = pairs.line
    return _SliceUpdate(
        _with_gain(tracks, row, prediction, sums),
        _equivalent_lines(lines.take(newest), prediction, sums),
        row,
    )


def _with_gain(
    tracks: FocalPlaneTracks, row: IntArray, prediction: FocalPlaneTracks, sums: FloatArray
) -> FocalPlaneTracks:
    """Return the tracks whose rows (k,), as predicted, are updated with looks.

    `sums` (k, 7) are mean times and origins, sums of weighted angles, and of weights.
    """
    pull = sums[:, 4:6]
    total = sums[:, 6]
    denominator = np.maximum(1.0 + prediction.covariance[:, 0, 0] * total, 0.5)
    gain = prediction.covariance[:, :, 0] / denominator[:, None]
    lost = (total[:, None] * gain)[:, :, None] * prediction.covariance[:, None, 0, :]
    mean = tracks.mean.copy()
    covariance = tracks.covariance.copy()
    time_s = tracks.time_s.copy()
    mean[row] = prediction.mean + gain[:, :, None] * pull[:, None, :]
    covariance[row] = prediction.covariance - lost
    time_s[row] = sums[:, 0]
    return evolve(tracks, mean=mean, covariance=covariance, time_s=time_s)


def _equivalent_lines(
    lines: LinesOfSight, prediction: FocalPlaneTracks, sums: FloatArray
) -> LinesOfSight:
    """Return the equivalent lines (k,) of rows as predicted, whose newest lines are given; `sums`
    are as of `_with_gain`.
    """
    total = sums[:, 6]
    # Light among that of others says at least that the row still burns.
    variance = prediction.covariance[:, 0, 0] + np.square(lines.sigma_rad)
    least = LAW.least_information / variance
    off = np.where(total > least, sums[:, 4:6].T / np.maximum(total, least), 0.0).T
    rows = np.arange(len(total))
    return evolve(
        lines,
        time_s=sums[:, 0],
        origin_ecef_m=sums[:, 1:4],
        direction_ecef=prediction.directions(rows, prediction.mean[:, 0] + off),
        sigma_rad=1.0 / np.sqrt(np.maximum(total, least)),
    )


def _probabilities(
    lines: LinesOfSight, pairs: FocalPlanePairs, look: IntArray, log: FloatArray
) -> FloatArray:
    """Return the association probabilities (m,) of pairs with log likelihood ratios, a row's in a
    scan by `look`.
    """
    ratio = np.exp(np.minimum(log, 300.0))
    beta = ratio / (1.0 + ratio)
    crowd = np.flatnonzero(~unambiguous(look, pairs.line))
    if len(crowd):
        sharp = np.square(lines.sigma_rad[pairs.line[crowd]]) / pairs.variance[crowd]
        ratio = np.minimum(
            ratio[crowd], sharp * np.exp(-0.5 * pairs.distance[crowd]) / LAW.newcomers
        )
        beta[crowd] = belief_propagation(look[crowd], pairs.line[crowd], ratio, LAW.sweeps)
    return beta


def begun(
    number: IntArray,
    sensor: IntArray,
    time_s: float,
    apart_m: tuple[FloatArray, FloatArray, FloatArray],
    roots_m: FloatArray,
    noise_rad: FloatArray,
) -> FocalPlaneTracks:
    """Return rows from states: vectors (n, 3) from the sensor to the track and its first two
    derivatives, in ECEF, m.

    `roots_m` (n, 3, 3, k) are the roots of the covariances of those three vectors; `noise_rad` (n,)
    is added to the error of the angle.
    """
    range_m = np.sqrt(dot(apart_m[0], apart_m[0]))
    axes = tangent_axes(apart_m[0] / range_m[:, None])
    mean = _plane_motion(axes, range_m, apart_m)
    side = (axes[:, None, :2] @ roots_m).reshape(len(number), 3, -1)
    covariance = side @ side.transpose(0, 2, 1) / (2.0 * range_m * range_m)[:, None, None]
    covariance[:, 0, 0] += np.square(noise_rad)
    times_s = [np.full(len(number), time_s) for _ in range(3)]
    return FocalPlaneTracks(number, sensor, axes, range_m, mean, covariance, *times_s)


def _plane_motion(
    axes: FloatArray, range_m: FloatArray, apart_m: tuple[FloatArray, FloatArray, FloatArray]
) -> FloatArray:
    """Return angles, rates and accelerations (n, 3, 2) in tangent planes, of vectors as `begun` has
    them.
    """
    # Derivatives of x / z in the plane; across it x is 0 at this moment.
    angle, rate, bend = (matvec(axes, vector) / range_m[:, None] for vector in apart_m)
    bend = bend[:, :2] - 2.0 * rate[:, 2:] * rate[:, :2]
    return np.stack([angle[:, :2], rate[:, :2], bend], axis=1)
