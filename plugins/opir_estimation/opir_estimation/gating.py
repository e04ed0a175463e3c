"""Gating of lines of sight by their Mahalanobis distance from predicted directions, with spatial
bins.

Directions are binned in cubes of about the gate's width, tracks with similar gates together, so the
cost grows with the number of gated pairs and not with tracks times lines.
"""

from typing import Any, NamedTuple

import numpy as np
from attrs import Factory, field, frozen

from opir_core.arrays import BoolArray, FloatArray, IndexArray, IntArray
from opir_core.constants import SPEED_OF_LIGHT_M_S
from opir_core.interfaces import Columns
from opir_estimation.assignment import group_sums
from opir_estimation.directions import dot, matvec, tangent_axes
from opir_estimation.filter.estimates import PredictedMeasurements
from opir_estimation.lines_of_sight import (
    AngleMeasurements,
    LinesOfSight,
    both_earth_rotated,
    earth_rotated,
    emission_s,
    rotate_slightly,
)
from opir_estimation.triangulation import FAR_M

#: Bits of each of the three bin numbers in a key, which leaves room for 512 sensors; the finest
#: bins are 15 µrad wide.
_BITS = 18
_FINEST = 2.0 ** -(_BITS - 2)

#: Candidates are searched at the middle of parts of the span no longer than this, s.
_PART_S = 0.5

#: Up to this many pairs are searched one by one for ambiguities.
FEW_PAIRS = 128

#: Up to this many pairs of tracks and lines are all candidates: bins would take longer than gating
#: them.
_ALL_PAIRS = 512


def _circular_trace(pairs: "GatedPairs") -> FloatArray:
    trace: FloatArray = 2.0 * np.exp(0.5 * pairs.log_volume)
    return trace


@frozen(eq=False, repr=False)
class GatedPairs(Columns):
    """Gated pairs of a track and a line of sight, in the tangent plane of the predicted direction.

    `measured` (n, 2), rad, is the innovation, `distance` (n,) its squared Mahalanobis distance and
    `log_volume` (n,) the logarithm of the determinant of its covariance, `trace` (n,) the trace,
    rad², by default that of a circle. Vectors are inertial, m.
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
    trace: FloatArray = field(default=Factory(_circular_trace, takes_self=True))

    @classmethod
    def empty(cls) -> "GatedPairs":
        """Return no pairs."""
        numbers = np.empty(0, dtype=np.int64)
        none = np.empty(0)
        vectors = np.empty((0, 3))
        return cls(
            numbers, numbers, none, vectors, np.empty((0, 3, 3)), vectors[:, :2], none, none, none
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
    sensor, sensor_row = np.unique(lines.sensor, return_inverse=True)
    parts = max(1, int(np.ceil(span_s / _PART_S)))
    part_s = float(span_s) / parts
    since_start_s = lines.time_s - predicted.time_s + span_s
    part = np.clip((since_start_s / part_s).astype(np.int64), 0, parts - 1)
    places = len(sensor) * parts
    track = np.repeat(np.arange(count), places)
    place = np.tile(np.arange(places), count)
    middle_s: FloatArray = (
        predicted.time_s - span_s + (place % parts + 0.5).astype(np.float64) * part_s
    )
    origin, sigma = _middles(lines, sensor_row, len(sensor))
    at = place // parts
    unit, range_m = _directions(predicted, track, origin[at], middle_s, light_time)
    reach = _reach(predicted, track, range_m, span_s, part_s, gate) + gate * sigma[at]
    reach += _parallax(lines, sensor_row, origin)[at] / range_m
    entries = _Entries(track, place, unit, reach)
    return _touching(entries, sensor_row * parts + part, lines.direction_ecef)


class _Entries(NamedTuple):
    """Tracks in parts of the span (n,): the number of sensor and part, direction (n, 3), and the
    largest angle within reach, rad.
    """

    track: IntArray
    place: IntArray
    unit: FloatArray
    reach: FloatArray


def neighbour_pairs(tree: Any, place: FloatArray, reach: FloatArray) -> tuple[IntArray, IntArray]:
    """Return the rows (m,) of places (n, d), and of the points of a k-d tree within their reach
    (n,).
    """
    groups = tree.query_ball_point(place, reach, return_sorted=True)
    neighbour = np.concatenate([np.array(group, dtype=np.int64) for group in groups])
    return np.repeat(np.arange(len(place)), list(map(len, groups))), neighbour


def _middles(
    lines: LinesOfSight, sensor_row: IntArray, sensors: int
) -> tuple[FloatArray, FloatArray]:
    """Return the mean position of each sensor and its largest error."""
    total = np.bincount(sensor_row, minlength=sensors)
    origin = group_sums(sensor_row, lines.origin_ecef_m, sensors) / total[:, None]
    sigma = np.zeros(sensors)
    np.maximum.at(sigma, sensor_row, lines.sigma_rad)
    return origin, sigma


def _parallax(lines: LinesOfSight, sensor_row: IntArray, origin: FloatArray) -> FloatArray:
    """Return the largest distance of each sensor from its mean position, m."""
    distance_m = np.zeros(len(origin))
    offset = lines.origin_ecef_m - origin.take(sensor_row, axis=0)
    np.maximum.at(distance_m, sensor_row, np.sqrt(dot(offset, offset)))
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
        emitted_s = emission_s(time_s, range_m, light_time)
        offset = earth_rotated(predicted.positions(track, emitted_s), -emitted_s) - origin
        range_m = np.sqrt(dot(offset, offset))
    return offset / range_m[:, None], range_m


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
    # Light takes at most 0.3 s, and its time varies by less than 0.01 s about the middle. Over the
    # ground, which itself turns by 600 m/s at most at the heights of targets.
    speed = np.sqrt(np.sum(predicted.derivative[:, 1] ** 2, axis=1)) + 600.0
    bound_m = gate * predicted.position_bound_m(span_s + 0.3)
    return (bound_m + speed * (0.5 * part_s + 0.01))[track] / range_m


def _touching(
    entries: _Entries, line_place: IntArray, direction: FloatArray
) -> tuple[IntArray, IntArray]:
    """Return tracks and lines whose distance is within reach, found by bins, sorted."""
    octave = np.ceil(np.log2(np.clip(entries.reach, _FINEST, 1.0))).astype(np.int64)
    square = entries.reach * entries.reach
    tracks = [np.empty(0, dtype=np.int64)]
    line_rows = [np.empty(0, dtype=np.int64)]
    for level in np.unique(octave):
        rows = (octave == level).nonzero()[0]
        keys = _keys(line_place, _bins(direction, level))
        order = np.argsort(keys, kind="stable")
        bins = _bins(entries.unit[rows], level)
        entry, cluster = _touching_rows(keys[order], entries.place[rows], bins)
        entry = rows[entry]
        line = order[cluster]
        # Bins are up to twice as wide as the reach, and nine of them touch: most that meet there
        # are too far apart.
        offset = direction.take(line, axis=0)
        offset -= entries.unit.take(entry, axis=0)
        inside = (dot(offset, offset) <= square.take(entry)).nonzero()[0]
        tracks.append(entries.track.take(entry.take(inside)))
        line_rows.append(line.take(inside))
    pair_track = np.concatenate(tracks)
    pair_line = np.concatenate(line_rows)
    order = np.lexsort((pair_line, pair_track))
    return pair_track[order], pair_line[order]


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
    geometry = _pair_geometry(predicted, lines, track, line, light_time)
    local = matvec(geometry.axes, geometry.direction)
    measured = local[:, :2] / local[:, 2:]
    sigma = lines.sigma_rad.take(line)
    is_likely = local[:, 2] > 0.0
    if len(track) > FEW_PAIRS:
        is_likely &= _are_near(predicted, geometry, track, measured, sigma, gate)
    if False in is_likely:
        rows = is_likely.nonzero()[0]
        geometry = _PairGeometry(*(column.take(rows, axis=0) for column in geometry))
        track = track[rows]
        line = line[rows]
        measured = measured[rows]
        sigma = sigma[rows]
    sensor = lines.sensor.take(line)
    covariance = _innovation_covariances(predicted, geometry, track, sensor, sigma)
    distance, determinant = squared_distances(measured, covariance)
    pairs = GatedPairs(
        track,
        line,
        geometry.time_s,
        geometry.origin_m,
        geometry.axes,
        measured,
        distance,
        np.log(determinant),
        sigma,
        covariance[:, 0, 0] + covariance[:, 1, 1],
    )
    inside = distance <= gate * gate
    return pairs.take(inside.nonzero()[0]) if False in inside else pairs


def _are_near(
    predicted: PredictedMeasurements,
    geometry: "_PairGeometry",
    track: IntArray,
    measured: FloatArray,
    sigma: FloatArray,
    gate: float,
) -> BoolArray:
    """Return which pairs (n,) are within the gate of a bound on the covariance: most candidates are
    farther off, and need none.
    """
    span_s = predicted.time_s - float(geometry.time_s.min(initial=predicted.time_s))
    bound = predicted.position_bound_m(span_s)[track] / geometry.range_m
    return dot(measured, measured) <= gate * gate * (np.square(bound) + np.square(sigma))


def _innovation_covariances(
    predicted: PredictedMeasurements,
    geometry: "_PairGeometry",
    track: IntArray,
    sensor: IndexArray,
    sigma: FloatArray,
) -> FloatArray:
    """Return the covariances (n, 2, 2) of innovations: of predictions, of biases, and noise."""
    rows = geometry.axes[:, :2] / geometry.range_m[:, None, None]
    covariance = predicted.projected_covariances(track, geometry.time_s, geometry.weight, rows)
    if predicted.bias_covariance is not None:
        bias = predicted.bias_covariance[track, sensor]
        covariance += (rows @ bias) @ rows.mT
    noise = sigma * sigma
    covariance[:, 0, 0] += noise
    covariance[:, 1, 1] += noise
    return covariance


def squared_distances(
    measured: FloatArray, covariance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return squared Mahalanobis distances (n,) and the determinants (n,) of covariances."""
    xx = covariance[:, 0, 0]
    xy = covariance[:, 0, 1]
    yy = covariance[:, 1, 1]
    determinant = xx * yy - xy * xy
    x = measured[:, 0]
    y = measured[:, 1]
    return (yy * x * x - 2.0 * xy * x * y + xx * y * y) / determinant, determinant


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
    vectors = both_earth_rotated(lines.origin_ecef_m, lines.direction_ecef, guess).take(
        line, axis=1
    )
    time_s = guess.take(line)
    if light_time:
        offset_ = predicted.positions(track, time_s) - vectors[0]
        later = (FAR_M - np.sqrt(dot(offset_, offset_))) / SPEED_OF_LIGHT_M_S
        rotate_slightly(vectors, later)
        time_s += later
    origin, direction = vectors
    weight = predicted.weights(time_s)
    offset = predicted.positions_with(track, weight) - origin
    range_m = np.sqrt(dot(offset, offset))
    return _PairGeometry(
        time_s, weight, origin, direction, range_m, tangent_axes(offset / range_m[:, None])
    )
