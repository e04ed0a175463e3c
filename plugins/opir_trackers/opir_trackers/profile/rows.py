"""What a profile fit remembers of detections: normal points, one a track, sensor and span of time.

A normal point is the mean of what directions differ by from a reference path, laid on the path at their mean time: what
the path bends by within the span is not lost, and a ray that strays from the others of its span counts as far as it may
be one of them (`robust_means`). (The name is that of satellite laser ranging.) As a track ages its normal points are
joined to longer ones, so that what is remembered stays bounded.

Means of lines of sight some of which do not belong: each counts as far as it may be one of the others.

A ray is its target's, with the error that it states, or it is a stray one, evenly spread over the gate through which
association took it. Mean, shares and the chance of strays are those at which the likelihood of that mixture is highest,
by expectation and maximisation from the median on (Dempster, Laird and Rubin, J. Roy. Stat. Soc. B 39, 1977, 1); what
the mean then tells is the observed information (Louis, J. Roy. Stat. Soc. B 44, 1982, 226).
"""

from collections.abc import Callable
from typing import NamedTuple

import numpy as np
from attrs import evolve, frozen

from opir_core.arrays import FloatArray, IndexArray, IntArray
from opir_core.estimation.lines_of_sight import LinesOfSight
from opir_core.geometry import local_axes
from opir_core.interfaces.columns import Columns

#: The gate's radius, standard deviations of a ray: strays are evenly spread over it.
GATE = 4.5

#: Before any ray is seen, strays are believed to be this share, as if so many rays had said so.
_SHARE, _BELIEVED = 0.01, 3.0

#: The share from which to set out.
_FIRST_SHARE = 0.05

#: Rays are expected where the path is so well known, standard deviations of a ray.
_NEAR = 0.7

#: What a median tells of what a mean does.
_MEDIAN_TOLD = 2.0 / np.pi

#: Turns of expectation and maximisation.
_TURNS = 6

#: Fewer rays than this do not tell which of them strays.
_FEWEST = 3

#: A ray counts at least this little, and a group tells at least this share of what its weights say.
_LEAST_WEIGHT, _LEAST_TOLD = 1e-6, 0.2


class Weights(NamedTuple):
    """What rays count in their group's mean, and what they add to what it tells of each angle, (n,), 1/rad²."""

    weight: FloatArray
    information: FloatArray


def weights_of(
    group: IntArray,
    owner: IntArray,
    seen: FloatArray,
    sigma_rad: FloatArray,
    is_expected: bool,
    stray: FloatArray | None = None,
) -> Weights:
    """Return the weights of rays (n,) at places (n, 2), rad, of groups that come sorted, from 0.

    Strays are as frequent as `stray` (n,) says; where that is not known, in all groups of an owner (n,) alike. Places
    that are counted from where rays are expected tell, if `is_expected`, that their mean is near: this guides what
    strays, and is no part of the mean.
    """
    whole = 1.0 / np.square(sigma_rad)
    count = np.bincount(group)
    few = (count < _FEWEST)[group]
    _, owner = np.unique(owner, return_inverse=True)
    rays = np.bincount(owner)
    mean, share = medians(group, seen), np.full(len(rays), _FIRST_SHARE)
    pull = _pull(group, mean, whole) if is_expected else np.zeros(len(count))
    mean /= (1.0 + pull / np.bincount(group, _MEDIAN_TOLD * whole))[:, None]
    for turn in range(_TURNS):
        square = np.sum(np.square(seen - mean[group]), axis=1) * whole
        chance, density = share[owner] if stray is None else stray, np.exp(-0.5 * square) / (2.0 * np.pi)
        own = np.where(few, 1.0, (1.0 - chance) * density / ((1.0 - chance) * density + chance / _AREA))
        own = np.maximum(own, _LEAST_WEIGHT)
        if turn + 1 < _TURNS:
            total = np.bincount(group, own * whole) + pull
            mean = np.stack([np.bincount(group, own * whole * seen[:, axis]) / total for axis in (0, 1)], axis=1)
            share = (np.bincount(owner, 1.0 - own) + _SHARE * _BELIEVED) / (rays + _BELIEVED)
    part = _part_told(group, own * whole, own, square, pull)[group]
    # Of few rays any may be a stray one: their mean is as uncertain as both kinds are together.
    mixed = 1.0 if stray is None else 1.0 + stray * (0.25 * GATE**2 - 1.0)
    return Weights(own * whole, np.where(few, whole / mixed, own * whole * part))


def _part_told(
    group: IntArray, weight: FloatArray, own: FloatArray, square: FloatArray, pull: FloatArray
) -> FloatArray:
    """Return which part of what weights of rays (n,) add up to their groups' means (g,) know."""
    # Of a ray that may be a stray one, the mean knows less: w - w (1 - w) r², averaged over both angles.
    told, most = np.bincount(group, weight * (1.0 - 0.5 * (1.0 - own) * square)), np.bincount(group, weight)
    part = np.maximum(told / most, _LEAST_TOLD)
    # Where a path guides the weights the mean goes along with it by a share, and tells so much less of it: of a place
    # known from means with shares b of what is known already, the variance is 1 / (1 - 2 b) of that which they say.
    along = (1.0 - part) * pull / (part * most + pull)
    known: FloatArray = part * np.square(1.0 - along)
    return known


def _pull(group: IntArray, middle: FloatArray, whole: FloatArray) -> FloatArray:
    """Return what groups' expected places, the origin, count beside their rays: the less, the farther their medians."""
    count = np.bincount(group)
    one = np.bincount(group, whole) / count
    far = np.sum(middle * middle, axis=1) * one / (_NEAR**2 + 2.0 / count)
    found: FloatArray = one / _NEAR**2 / np.square(1.0 + 0.05 * far)
    return found


_AREA = np.pi * GATE**2


def medians(group: IntArray, seen: FloatArray) -> FloatArray:
    """Return the medians (groups, 2) of both columns; groups come sorted, from 0."""
    count = np.bincount(group)
    first = np.cumsum(count) - count
    found = np.empty((len(count), 2))
    for axis in range(2):
        ordered = seen[np.lexsort((seen[:, axis], group)), axis]
        found[:, axis] = 0.5 * (ordered[first + (count - 1) // 2] + ordered[first + count // 2])
    return found


def detrended(group: IntArray, seen: FloatArray, time_s: FloatArray) -> FloatArray:
    """Return places (n, 2) without what they drift by in their groups: the line through the medians of both halves."""
    count = np.bincount(group)
    order = np.lexsort((time_s, group))
    rank = np.empty(len(group), dtype=np.int64)
    rank[order] = np.arange(len(group)) - (np.cumsum(count) - count)[group[order]]
    late = rank >= (count[group] + 1) // 2
    many = count >= 2 * _FEWEST
    half = 2 * group + late
    known, place = np.unique(half, return_inverse=True)
    turn = np.argsort(place, kind="stable")
    middle, when = np.full((2 * len(count), 2), np.nan), np.full((2 * len(count), 2), np.nan)
    middle[known] = medians(place[turn], seen[turn])
    when[known] = medians(place[turn], np.stack([time_s, time_s], axis=1)[turn])
    span = when[1::2, :1] - when[::2, :1]
    slope = np.where((many & (span[:, 0] > 0.0))[:, None], (middle[1::2] - middle[::2]) / span, 0.0)
    level: FloatArray = seen - slope[group] * (time_s - when[2 * group, 0])[:, None]
    return level


#: Rays of a track and sensor within this time make one normal point, s.
SPAN_S = 1.0

#: Older than this, and later than this after a track's first, normal points are joined over the longer span, s.
_YOUNG_S, _EARLY_S, LONG_SPAN_S = 6.0, 15.0, 8.0


@frozen(eq=False)
class Rows(Columns):
    """Lines of sight: track (its number), mean time at which light left, sensor, where from, axes, error of the mean.

    `axes` (n, 3, 3) are rows across and along the mean direction, ECEF: the first as near to the sensor's east as it
    can be, the second to its north.
    """

    track: IntArray
    time_s: FloatArray
    sensor: IndexArray
    origin_ecef_m: FloatArray
    axes: FloatArray
    sigma_rad: FloatArray

    @classmethod
    def empty(cls) -> "Rows":
        """Return the record of no rows."""
        none = np.empty((0, 3))
        whole = np.empty(0, dtype=np.int64)
        return cls(whole, np.empty(0), np.empty(0, dtype=np.int32), none, np.empty((0, 3, 3)), np.empty(0))


#: Positions (m, 3) at which rows' tracks are expected.
Reference = Callable[[Rows], FloatArray]


def single(track: IntArray, rays: LinesOfSight) -> Rows:
    """Return rays (n,) of tracks by number (n,) as rows, in their order, as if light took no time."""
    return Rows(track, rays.time_s, rays.sensor, rays.origin_ecef_m, axes_about(rays), rays.sigma_rad)


def axes_about(rays: LinesOfSight) -> FloatArray:
    """Return axes (n, 3, 3) of rays: towards the east and the north of their sensors, and along."""
    return _axes(rays.origin_ecef_m, rays.direction_ecef)


def means(rows: Rows, stray: FloatArray | None = None) -> Rows:
    """Return the means of rays by track, sensor and second, of which no path is known: nearly straight ones.

    `stray` (n,) is the share of strays among each ray's track's, where that is known.
    """
    if not len(rows):
        return rows
    group, rows, order = _grouped(rows, np.floor(rows.time_s / SPAN_S).astype(np.int64))
    middle = _averaged(rows, group, rows.axes[:, 2], _all_of(rows))[0]
    local = np.sum(middle.axes[group] * rows.axes[:, None, 2], axis=2)
    level = detrended(group, local[:, :2] / local[:, 2:], rows.time_s)
    weights = weights_of(group, rows.track, level, rows.sigma_rad, False, None if stray is None else stray[order])
    return _averaged(rows, group, rows.axes[:, 2], weights)[0]


def normal_points(rows: Rows, reference: Reference, span: IntArray, stray: FloatArray | None = None) -> Rows:
    """Return normal points of rays by track, sensor and span (n,), on the paths that `reference` tells.

    `stray` (n,) is the share of strays among each ray's track's, where that is known.
    """
    return _on_paths(rows, reference, span, True, stray)


def _on_paths(
    rows: Rows, reference: Reference, span: IntArray, are_rays: bool, stray: FloatArray | None = None
) -> Rows:
    """Return normal points of rays, some of which may stray, or of normal points, which do not."""
    if not len(rows):
        return rows
    group, rows, order = _grouped(rows, span)
    axes, seen = _residuals(rows, reference(rows))
    weights = _all_of(rows)
    if are_rays:
        weights = weights_of(group, rows.track, seen, rows.sigma_rad, True, None if stray is None else stray[order])
    points, (east, north) = _averaged(rows, group, rows.axes[:, 2], weights, seen)
    axes, _ = _residuals(points, reference(points))
    direction = axes[:, 2] + east[:, None] * axes[:, 0] + north[:, None] * axes[:, 1]
    direction /= np.sqrt(np.sum(direction * direction, axis=1))[:, None]
    return evolve(points, axes=_axes(points.origin_ecef_m, direction))


def _all_of(rows: Rows) -> Weights:
    """Return the weights of rows none of which strays."""
    whole = 1.0 / np.square(rows.sigma_rad)
    return Weights(whole, whole)


def compressed(rows: Rows, tick_s: float, reference: Reference) -> Rows:
    """Return rows with those that are neither young nor of a track's first seconds joined over the longer span."""
    number, row = np.unique(rows.track, return_inverse=True)
    first = np.full(len(number), np.inf)
    np.minimum.at(first, row, rows.time_s)
    span = np.floor(rows.time_s / LONG_SPAN_S).astype(np.int64)
    old = (rows.time_s < tick_s - _YOUNG_S) & (span * LONG_SPAN_S > first[row] + _EARLY_S)
    old &= (span + 1) * LONG_SPAN_S < tick_s
    joined = _on_paths(rows.take(np.flatnonzero(old)), reference, span[old], False)
    return Rows.concatenate([rows.take(np.flatnonzero(~old)), joined])


def _grouped(rows: Rows, span: IntArray) -> tuple[IntArray, Rows, IntArray]:
    """Return which group (n,) each row belongs to, rows by track, sensor and span, and their order (n,)."""
    keys = np.stack([rows.track, rows.sensor.astype(np.int64), span])
    order = np.lexsort(keys[::-1])
    first = np.append(True, np.any(np.diff(keys[:, order], axis=1) != 0, axis=0))
    group: IntArray = np.cumsum(first) - 1
    return group, rows.take(order), order


def _averaged(
    rows: Rows, group: IntArray, direction: FloatArray, weights: Weights, seen: FloatArray | None = None
) -> tuple[Rows, tuple[FloatArray, ...]]:
    """Return the weighted means of groups of rows, and those of two more columns."""
    total = np.bincount(group, weights.weight)

    def mean(values: FloatArray) -> FloatArray:
        found: FloatArray = np.bincount(group, weights.weight * values) / total
        return found

    origin, along = (np.stack([mean(v[:, axis]) for axis in range(3)], axis=1) for v in (rows.origin_ecef_m, direction))
    along /= np.sqrt(np.sum(along * along, axis=1))[:, None]
    lead = np.flatnonzero(np.append(True, np.diff(group) != 0)[: len(group)])
    points = Rows(
        track=rows.track[lead],
        time_s=mean(rows.time_s),
        sensor=rows.sensor[lead],
        origin_ecef_m=origin,
        axes=_axes(origin, along),
        sigma_rad=1.0 / np.sqrt(np.bincount(group, weights.information)),
    )
    return points, () if seen is None else (mean(seen[:, 0]), mean(seen[:, 1]))


def _residuals(rows: Rows, position: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return axes (n, 3, 3) about the directions to positions, and the tangents (n, 2) at which rows stand in them."""
    line = position - rows.origin_ecef_m
    axes = _axes(rows.origin_ecef_m, line / np.sqrt(np.sum(line * line, axis=1))[:, None])
    local = np.sum(axes * rows.axes[:, None, 2], axis=2)
    return axes, local[:, :2] / local[:, 2:]


def _axes(origin: FloatArray, direction: FloatArray) -> FloatArray:
    """Return axes (n, 3, 3) about directions (n, 3): towards the east and the north of their origins, and along."""
    north = local_axes(origin)[:, 1]
    across = north - np.sum(north * direction, axis=1)[:, None] * direction
    # Straight along the north any axis will do.
    size = np.sqrt(np.sum(across * across, axis=1))[:, None]
    spare = np.cross(direction, np.eye(3)[np.argmin(np.abs(direction), axis=1)])
    spare /= np.sqrt(np.sum(spare * spare, axis=1))[:, None]
    across = np.where(size > 1e-6, across / np.maximum(size, 1e-6), spare)
    return np.stack([np.cross(across, direction), across, direction], axis=1)
