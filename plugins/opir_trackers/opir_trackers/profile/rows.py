"""What a profile fit remembers of detections: normal points, one a track, sensor and span of time.

A normal point is the mean of what directions differ by from a reference path, laid on the path at their mean time: what
the path bends by within the span is not lost, and a ray that strays from the others of its span counts as far as it may
be one of them (`robust_means`). (The name is that of satellite laser ranging.) As a track ages its normal points are
joined to longer ones, so that what is remembered stays bounded.
"""

from collections.abc import Callable

import numpy as np
from attrs import evolve, frozen

from opir_core.arrays import FloatArray, IndexArray, IntArray
from opir_core.estimation.lines_of_sight import LinesOfSight
from opir_core.geometry import local_axes
from opir_core.interfaces.columns import Columns
from opir_trackers.profile.robust_means import Weights, detrended, weights_of

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
