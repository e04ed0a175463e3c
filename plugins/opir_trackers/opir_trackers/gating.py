"""Gating in line-of-sight space: which rays can belong to which tracks, found through bins of directions.

Directions are put into cubic bins of about the gate's width, tracks of like gates together, so that the cost grows with
the gated pairs and not with tracks times rays.
"""

from typing import NamedTuple

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray, IntArray
from opir_core.constants import SPEED_OF_LIGHT_M_S
from opir_core.estimation.lines_of_sight import (
    LinesOfSight,
    Sights,
    along,
    axes_across,
    both_turned,
    dot,
    emission_s,
    turn_slightly,
    turned,
)
from opir_core.interfaces.columns import Columns
from opir_trackers.filter.estimates import PredictedMeasurements

#: Bits of each of three bin numbers in a key, which leaves room for 512 sensors; the finest bins are 15 µrad wide.
_BITS = 18
_FINEST = 2.0 ** -(_BITS - 2)

#: Light takes no longer than this from a target to a sensor, s.
_LATE_S = 0.3

#: Looks are held against where a track is in the middle of parts of the span no longer than this, s.
_PART_S = 0.5

#: What is allowed for in time of emission over that middle, s.
_LEEWAY_S = 0.01

#: How fast the air turns with the Earth, at the heights of targets, m/s; an upper bound.
_GROUND_M_S = 600.0

#: Up to so many pairs of a track and a ray are looked at one and all.
_FEW_PAIRS = 128

#: Distance at which light time is first guessed, m.
_FIRST_RANGE_M = 3.6e7


@frozen(eq=False)
class GatedPairs(Columns):
    """Gated pairs of a track and a ray: where the ray passes the track, in the plane across the expected direction.

    `seen` (n, 2), rad, is measured less expected, `spread` (n, 2, 2) its covariance; `distance` (n,) its squared
    Mahalanobis length and `log_volume` (n,) the logarithm of det spread. Vectors are inertial, m.
    """

    track: IntArray
    ray: IntArray
    time_s: FloatArray
    origin_m: FloatArray
    axes: FloatArray
    seen: FloatArray
    spread: FloatArray
    distance: FloatArray
    log_volume: FloatArray
    sigma_rad: FloatArray

    def sights(self, seen: FloatArray, whitener: FloatArray) -> Sights:
        """Return the pairs as sights with other residuals and weights."""
        return Sights(self.track, self.time_s, self.origin_m, self.axes, seen, whitener)


def candidates(
    outlook: PredictedMeasurements, rays: LinesOfSight, span_s: float, gate: float, light_time: bool
) -> tuple[IntArray, IntArray]:
    """Return tracks and rays of pairs that may pass the gate (and some that do not): the bins of the two touch."""
    count, number = len(outlook.side), len(rays.time_s)
    if count == 1 and number <= _FEW_PAIRS:
        return np.zeros(number, dtype=np.int64), np.arange(number)
    if count * number <= _FEW_PAIRS:
        return divmod(np.arange(count * len(rays)), max(len(rays), 1))
    sensor, which = np.unique(rays.sensor, return_inverse=True)
    parts = max(1, int(np.ceil(span_s / _PART_S)))
    part_s = float(span_s) / parts
    part = np.clip(((rays.time_s - outlook.time_s + span_s) / part_s).astype(np.int64), 0, parts - 1)
    places = len(sensor) * parts
    track, place = np.repeat(np.arange(count), places), np.tile(np.arange(places), count)
    middle: FloatArray = outlook.time_s - span_s + (place % parts + 0.5).astype(np.float64) * part_s
    origin, sigma = _middles(rays, which, len(sensor))
    at = place // parts
    apart, range_m = _directions(outlook, track, origin[at], middle, light_time)
    reach = _reach(outlook, track, range_m, span_s, part_s, gate) + gate * sigma[at]
    reach += _parallax(rays, which, origin)[at] / range_m
    return _touching(track, place, apart, reach, which * parts + part, rays.direction_ecef)


def _middles(rays: LinesOfSight, which: IntArray, sensors: int) -> tuple[FloatArray, FloatArray]:
    """Return the mean place of each sensor and its largest error."""
    total = np.bincount(which, minlength=sensors)
    origin = np.stack([np.bincount(which, rays.origin_ecef_m[:, axis], sensors) / total for axis in range(3)], axis=1)
    sigma = np.zeros(sensors)
    np.maximum.at(sigma, which, rays.sigma_rad)
    return origin, sigma


def _parallax(rays: LinesOfSight, which: IntArray, origin: FloatArray) -> FloatArray:
    """Return how far each sensor strays from its mean place, m."""
    stray, apart = np.zeros(len(origin)), rays.origin_ecef_m - origin.take(which, axis=0)
    np.maximum.at(stray, which, np.sqrt(dot(apart, apart)))
    return stray


def _directions(
    outlook: PredictedMeasurements, track: IntArray, origin: FloatArray, time_s: FloatArray, light_time: bool
) -> tuple[FloatArray, FloatArray]:
    """Return ECEF unit vectors (n, 3) to tracks as seen at looks (n,), and the distances (n,)."""
    range_m = np.full(len(time_s), _FIRST_RANGE_M)
    for _ in range(2):
        left = emission_s(time_s, range_m, light_time)
        apart = turned(outlook.positions(track, left), -left) - origin
        range_m = np.sqrt(dot(apart, apart))
    return apart / range_m[:, None], range_m


def _reach(
    outlook: PredictedMeasurements, track: IntArray, range_m: FloatArray, span_s: float, part_s: float, gate: float
) -> FloatArray:
    """Return how far from its middle direction a track may be seen within a part of the span, rad."""
    # Over the ground, which itself turns by so much at most.
    speed = np.sqrt(np.sum(outlook.derivative[:, 1] ** 2, axis=1)) + _GROUND_M_S
    wide: FloatArray = (gate * outlook.reach_m(span_s + _LATE_S) + speed * (0.5 * part_s + _LEEWAY_S))[track] / range_m
    return wide


def _touching(
    track: IntArray, place: IntArray, middle: FloatArray, reach: FloatArray, which: IntArray, direction: FloatArray
) -> tuple[IntArray, IntArray]:
    octave, square = np.ceil(np.log2(np.clip(reach, _FINEST, 1.0))).astype(np.int64), reach * reach
    tracks, found = [], []
    for level in np.unique(octave):
        mine = np.flatnonzero(octave == level)
        keys = _keys(which, _bins(direction, level))
        order = np.argsort(keys, kind="stable")
        entry, spot = _met(keys[order], place[mine], _bins(middle[mine], level))
        entry, ray = mine[entry], order[spot]
        # Bins are up to twice as wide as the reach, and nine of them touch: most that meet there are too far apart.
        apart = direction.take(ray, axis=0)
        apart -= middle.take(entry, axis=0)
        near = (dot(apart, apart) <= square.take(entry)).nonzero()[0]
        tracks.append(track.take(entry.take(near)))
        found.append(ray.take(near))
    pair_track, pair_ray = np.concatenate([*tracks, _NONE]), np.concatenate([*found, _NONE])
    order = np.lexsort((pair_ray, pair_track))
    return pair_track[order], pair_ray[order]


_NONE = np.empty(0, dtype=np.int64)


def _bins(direction: FloatArray, level: int) -> IntArray:
    """Return bin numbers (n, 3), from 1, of bins of width 2**level."""
    return np.floor((direction + 1.0) * 2.0**-level).astype(np.int64) + 1


def _keys(place: IntArray, bins: IntArray) -> IntArray:
    return ((place << _BITS | bins[:, 0]) << _BITS | bins[:, 1]) << _BITS | bins[:, 2]


def _met(keys: IntArray, place: IntArray, bins: IntArray) -> tuple[IntArray, IntArray]:
    """Return entries and rows of the sorted keys whose bins touch: for each of 9 columns of bins, a run of three."""
    starts, stops = [], []
    for dx in (-1, 0, 1):
        for dy in (-1, 0, 1):
            here = bins + np.array([dx, dy, 0])
            key = _keys(place, here)
            starts.append(np.searchsorted(keys, key - 1, side="left"))
            stops.append(np.searchsorted(keys, key + 1, side="right"))
    start, stop = np.concatenate(starts), np.concatenate(stops)
    length = stop - start
    entry = np.repeat(np.tile(np.arange(len(place)), 9), length)
    spot = np.arange(int(length.sum())) - np.repeat(np.cumsum(length) - length, length) + np.repeat(start, length)
    return entry, spot


def gated(
    outlook: PredictedMeasurements, rays: LinesOfSight, track: IntArray, ray: IntArray, gate: float, light_time: bool
) -> GatedPairs:
    """Return those of candidate pairs (n,) that are within `gate` standard deviations of each other."""
    whole = _paired(outlook, rays, track, ray, light_time)
    local = along(whole.axes, whole.direction)
    range_m, seen = whole.range_m, local[:, :2] / local[:, 2:]
    sigma = rays.sigma_rad.take(ray)
    ahead = local[:, 2] > 0.0
    if len(track) > _FEW_PAIRS:
        # Most candidates are farther off than any covariance could excuse, and need none.
        span = outlook.time_s - float(whole.time_s.min(initial=outlook.time_s))
        widest = np.square(outlook.reach_m(span)[track] / range_m) + np.square(sigma)
        ahead &= dot(seen, seen) <= gate * gate * widest
    if np.count_nonzero(ahead) < len(ahead):
        likely = np.flatnonzero(ahead)
        whole, track, ray = _Paired(*(part.take(likely, axis=0) for part in whole)), track[likely], ray[likely]
        range_m, seen, sigma = whole.range_m, seen[likely], sigma[likely]
    rows = whole.axes[:, :2] / range_m[:, None, None]
    spread = outlook.seen_covariances(track, whole.time_s, whole.weight, rows)
    if outlook.blur is not None:
        spread += (rows @ outlook.blur[track, rays.sensor[ray]]) @ rows.transpose(0, 2, 1)
    noise = sigma * sigma
    spread[:, 0, 0] += noise
    spread[:, 1, 1] += noise
    first, both, second = spread[:, 0, 0], spread[:, 0, 1], spread[:, 1, 1]
    determinant = first * second - both * both
    x, y = seen[:, 0], seen[:, 1]
    distance = (second * x * x - 2.0 * both * x * y + first * y * y) / determinant
    pairs = GatedPairs(
        track, ray, whole.time_s, whole.origin_m, whole.axes, seen, spread, distance, np.log(determinant), sigma
    )
    inside = distance <= gate * gate
    return pairs if np.count_nonzero(inside) == len(inside) else pairs.take(np.flatnonzero(inside))


class _Paired(NamedTuple):
    """Pairs (n,): when the light left, from where and in what direction it was seen then, inertial; distance and axes.

    `weight` (n, 5) are those of the track's derivatives then. The third axis is the direction in which the track is
    expected.
    """

    time_s: FloatArray
    weight: FloatArray
    origin_m: FloatArray
    direction: FloatArray
    range_m: FloatArray
    axes: FloatArray


def _paired(
    outlook: PredictedMeasurements, rays: LinesOfSight, track: IntArray, ray: IntArray, light_time: bool
) -> _Paired:
    guess = emission_s(rays.time_s, _FIRST_RANGE_M, light_time)
    both, time_s = both_turned(rays.origin_ecef_m, rays.direction_ecef, guess).take(ray, axis=1), guess.take(ray)
    if light_time:
        there = outlook.positions(track, time_s) - both[0]
        later = (_FIRST_RANGE_M - np.sqrt(dot(there, there))) / SPEED_OF_LIGHT_M_S
        turn_slightly(both, later)
        time_s += later
    origin, direction = both
    weight = outlook.weights(time_s)
    apart = outlook.followed(track, weight) - origin
    range_m = np.sqrt(dot(apart, apart))
    return _Paired(time_s, weight, origin, direction, range_m, axes_across(apart / range_m[:, None]))
