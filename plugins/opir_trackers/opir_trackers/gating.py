"""Gating of lines of sight by their Mahalanobis distance from predicted directions, with spatial
bins.

Directions are binned in cubes of about the gate's width, tracks with similar gates together, so the
cost grows with the number of gated pairs and not with tracks times lines.
"""

from typing import NamedTuple

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray, IntArray
from opir_core.constants import SPEED_OF_LIGHT_M_S
from opir_core.estimation import dot, matvec, tangent_axes
from opir_core.interfaces import Columns
from opir_trackers.assignment import group_sums
from opir_trackers.filter.estimates import PredictedMeasurements
from opir_trackers.lines_of_sight import (
    AngleMeasurements,
    LinesOfSight,
    both_earth_rotated,
    earth_rotated,
    emission_s,
    rotate_slightly,
)
from opir_trackers.triangulation import FAR_M

#: Bits of each of the three bin numbers in a key, which leaves room for 512 sensors; the finest
#: bins are 15 µrad wide.
_BITS = 18
_FINEST = 2.0 ** -(_BITS - 2)

#: Upper bound on the light time from a target to a sensor, s.
_LIGHT_TIME_S = 0.3

#: Candidates are searched at the middle of parts of the span no longer than this, s.
_PART_S = 0.5

#: Margin for the variation of the emission time about that middle, s.
_EMISSION_MARGIN_S = 0.01

#: Upper bound on the velocity of Earth-fixed points at the heights of targets, m/s.
_GROUND_M_S = 600.0

#: Up to this many pairs are searched one by one for ambiguities.
FEW_PAIRS = 128

#: Up to this many pairs of tracks and lines are all candidates: bins would take longer than gating
#: them.
_ALL_PAIRS = 512


@frozen(eq=False, repr=False)
class GatedPairs(Columns):
    """Gated pairs of a track and a line of sight, in the tangent plane of the predicted direction.

    `measured` (n, 2), rad, is the innovation, `distance` (n,) its squared Mahalanobis distance and
    `log_volume` (n,) the logarithm of the determinant of its covariance. Vectors are inertial, m.
    """

    track: IntArray
    line: IntArray
    time_s: FloatArray
    origin_m: FloatArray
    axes: FloatArray
    measured: FloatArray
    distance: FloatArray
    log_volume: FloatArray
    sigma_rad: FloatArray

    @classmethod
    def empty(cls) -> "GatedPairs":
        """Return no pairs."""
        whole = np.empty(0, dtype=np.int64)
        none = np.empty(0)
        vectors = np.empty((0, 3))
        return cls(
            whole, whole, none, vectors, np.empty((0, 3, 3)), vectors[:, :2], none, none, none
        )

    def measurements(self, measured: FloatArray, whitener: FloatArray) -> AngleMeasurements:
        """Return the pairs as measurements with other innovations and whiteners."""
        return AngleMeasurements(
            self.track, self.time_s, self.origin_m, self.axes, measured, whitener
        )


def candidates(
    predicted: PredictedMeasurements,
    lines: LinesOfSight,
    span_s: float,
    gate: float,
    light_time: bool,
) -> tuple[IntArray, IntArray]:
    """Return tracks and lines of pairs that may pass the gate, a superset of the gated pairs."""
    count = len(predicted.root)
    number = len(lines.time_s)
    if count * number <= _ALL_PAIRS:
        return divmod(np.arange(count * number), number or 1)
    sensor, which = np.unique(lines.sensor, return_inverse=True)
    parts = max(1, int(np.ceil(span_s / _PART_S)))
    part_s = float(span_s) / parts
    part = np.clip(
        ((lines.time_s - predicted.time_s + span_s) / part_s).astype(np.int64), 0, parts - 1
    )
    places = len(sensor) * parts
    track = np.repeat(np.arange(count), places)
    place = np.tile(np.arange(places), count)
    middle: FloatArray = (
        predicted.time_s - span_s + (place % parts + 0.5).astype(np.float64) * part_s
    )
    origin, sigma = _middles(lines, which, len(sensor))
    at = place // parts
    apart, range_m = _directions(predicted, track, origin[at], middle, light_time)
    reach = _reach(predicted, track, range_m, span_s, part_s, gate) + gate * sigma[at]
    reach += _parallax(lines, which, origin)[at] / range_m
    return _touching(track, place, apart, reach, which * parts + part, lines.direction_ecef)


def _middles(lines: LinesOfSight, which: IntArray, sensors: int) -> tuple[FloatArray, FloatArray]:
    """Return the mean position of each sensor and its largest error."""
    total = np.bincount(which, minlength=sensors)
    origin = group_sums(which, lines.origin_ecef_m, sensors) / total[:, None]
    sigma = np.zeros(sensors)
    np.maximum.at(sigma, which, lines.sigma_rad)
    return origin, sigma


def _parallax(lines: LinesOfSight, which: IntArray, origin: FloatArray) -> FloatArray:
    """Return the largest distance of each sensor from its mean position, m."""
    distance_m = np.zeros(len(origin))
    apart = lines.origin_ecef_m - origin.take(which, axis=0)
    np.maximum.at(distance_m, which, np.sqrt(dot(apart, apart)))
    return distance_m


def _directions(
    predicted: PredictedMeasurements,
    track: IntArray,
    origin: FloatArray,
    time_s: FloatArray,
    light_time: bool,
) -> tuple[FloatArray, FloatArray]:
    """Return ECEF unit vectors (n, 3) to tracks at looks (n,), and ranges (n,)."""
    range_m = np.full(len(time_s), FAR_M)
    for _ in range(2):
        left = emission_s(time_s, range_m, light_time)
        apart = earth_rotated(predicted.positions(track, left), -left) - origin
        range_m = np.sqrt(dot(apart, apart))
    return apart / range_m[:, None], range_m


def _reach(
    predicted: PredictedMeasurements,
    track: IntArray,
    range_m: FloatArray,
    span_s: float,
    part_s: float,
    gate: float,
) -> FloatArray:
    """Return the largest angle, rad, between a track's middle direction and its gate within a part
    of the span.
    """
    # Over the ground, which itself turns by this at most.
    speed = np.sqrt(np.sum(predicted.derivative[:, 1] ** 2, axis=1)) + _GROUND_M_S
    wide: FloatArray = (
        gate * predicted.position_bound_m(span_s + _LIGHT_TIME_S)
        + speed * (0.5 * part_s + _EMISSION_MARGIN_S)
    )[track] / range_m
    return wide


def _touching(
    track: IntArray,
    place: IntArray,
    middle: FloatArray,
    reach: FloatArray,
    which: IntArray,
    direction: FloatArray,
) -> tuple[IntArray, IntArray]:
    """Return tracks and lines whose distance is within `reach`, found by bins, sorted."""
    octave = np.ceil(np.log2(np.clip(reach, _FINEST, 1.0))).astype(np.int64)
    square = reach * reach
    tracks = []
    line_rows = []
    for level in np.unique(octave):
        mine = np.flatnonzero(octave == level)
        keys = _keys(which, _bins(direction, level))
        order = np.argsort(keys, kind="stable")
        entry, cluster = _touching_rows(keys[order], place[mine], _bins(middle[mine], level))
        entry = mine[entry]
        line = order[cluster]
        # Bins are up to twice as wide as the reach, and nine of them touch: most that meet there
        # are too far apart.
        apart = direction.take(line, axis=0)
        apart -= middle.take(entry, axis=0)
        near = (dot(apart, apart) <= square.take(entry)).nonzero()[0]
        tracks.append(track.take(entry.take(near)))
        line_rows.append(line.take(near))
    pair_track = np.concatenate([*tracks, _NONE])
    pair_line = np.concatenate([*line_rows, _NONE])
    order = np.lexsort((pair_line, pair_track))
    return pair_track[order], pair_line[order]


_NONE = np.empty(0, dtype=np.int64)


def _bins(direction: FloatArray, level: int) -> IntArray:
    """Return bin numbers (n, 3), from 1, of bins of width 2**level."""
    return np.floor((direction + 1.0) * 2.0**-level).astype(np.int64) + 1


def _keys(place: IntArray, bins: IntArray) -> IntArray:
    """Return one key (n,) for each sensor part and bin."""
    return ((place << _BITS | bins[:, 0]) << _BITS | bins[:, 1]) << _BITS | bins[:, 2]


#: What the keys of a bin's 9 columns of neighbours differ by from its own: bins are numbered from
#: 1.
_COLUMNS = np.array([[(dx << 2 * _BITS) + (dy << _BITS)] for dx in (-1, 0, 1) for dy in (-1, 0, 1)])


def _touching_rows(keys: IntArray, place: IntArray, bins: IntArray) -> tuple[IntArray, IntArray]:
    """Return entries and rows of the sorted keys in touching bins: a run of three for each of 9
    columns.
    """
    key = (_keys(place, bins) + _COLUMNS).ravel()
    start = np.searchsorted(keys, key - 1, side="left")
    length = np.searchsorted(keys, key + 1, side="right") - start
    entry = np.repeat(np.tile(np.arange(len(place)), 9), length)
    cluster = (
        np.arange(int(length.sum()))
        - np.repeat(np.cumsum(length) - length, length)
        + np.repeat(start, length)
    )
    return entry, cluster


def gated(
    predicted: PredictedMeasurements,
    lines: LinesOfSight,
    track: IntArray,
    line: IntArray,
    gate: float,
    light_time: bool,
) -> GatedPairs:
    """Return those of candidate pairs (n,) within `gate` standard deviations."""
    whole = _pair_geometry(predicted, lines, track, line, light_time)
    local = matvec(whole.axes, whole.direction)
    range_m = whole.range_m
    measured = local[:, :2] / local[:, 2:]
    sigma = lines.sigma_rad.take(line)
    ahead = local[:, 2] > 0.0
    if len(track) > FEW_PAIRS:
        # Most candidates are farther off than any covariance could excuse, and need none.
        span = predicted.time_s - float(whole.time_s.min(initial=predicted.time_s))
        widest = np.square(predicted.position_bound_m(span)[track] / range_m) + np.square(sigma)
        ahead &= dot(measured, measured) <= gate * gate * widest
    if np.count_nonzero(ahead) < len(ahead):
        likely = np.flatnonzero(ahead)
        whole = _PairGeometry(*(part.take(likely, axis=0) for part in whole))
        track = track[likely]
        line = line[likely]
        range_m = whole.range_m
        measured = measured[likely]
        sigma = sigma[likely]
    rows = whole.axes[:, :2] / range_m[:, None, None]
    covariance = predicted.projected_covariances(track, whole.time_s, whole.weight, rows)
    if predicted.bias_covariance is not None:
        covariance += (
            rows @ predicted.bias_covariance[track, lines.sensor[line]]
        ) @ rows.transpose(0, 2, 1)
    noise = sigma * sigma
    covariance[:, 0, 0] += noise
    covariance[:, 1, 1] += noise
    first = covariance[:, 0, 0]
    both = covariance[:, 0, 1]
    second = covariance[:, 1, 1]
    determinant = first * second - both * both
    log_volume = np.log(determinant)
    x = measured[:, 0]
    y = measured[:, 1]
    distance = (second * x * x - 2.0 * both * x * y + first * y * y) / determinant
    geometry = whole.time_s, whole.origin_m, whole.axes
    pairs = GatedPairs(track, line, *geometry, measured, distance, log_volume, sigma)
    inside = distance <= gate * gate
    return pairs if np.count_nonzero(inside) == len(inside) else pairs.take(np.flatnonzero(inside))


class _PairGeometry(NamedTuple):
    """Emission time, origin and direction (inertial), range and axes of pairs (n,).

    `weight` (n, 5) are the Taylor weights of the track then. The third axis is the predicted
    direction.
    """

    time_s: FloatArray
    weight: FloatArray
    origin_m: FloatArray
    direction: FloatArray
    range_m: FloatArray
    axes: FloatArray


def _pair_geometry(
    predicted: PredictedMeasurements,
    lines: LinesOfSight,
    track: IntArray,
    line: IntArray,
    light_time: bool,
) -> _PairGeometry:
    """Return the geometry of pairs (n,), with light time."""
    guess = emission_s(lines.time_s, FAR_M, light_time)
    both = both_earth_rotated(lines.origin_ecef_m, lines.direction_ecef, guess).take(line, axis=1)
    time_s = guess.take(line)
    if light_time:
        there = predicted.positions(track, time_s) - both[0]
        later = (FAR_M - np.sqrt(dot(there, there))) / SPEED_OF_LIGHT_M_S
        rotate_slightly(both, later)
        time_s += later
    origin, direction = both
    weight = predicted.weights(time_s)
    apart = predicted.positions_with(track, weight) - origin
    range_m = np.sqrt(dot(apart, apart))
    return _PairGeometry(
        time_s, weight, origin, direction, range_m, tangent_axes(apart / range_m[:, None])
    )
