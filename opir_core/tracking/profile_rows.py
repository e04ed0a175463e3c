"""What a profile fit remembers of detections: one mean line of sight a track, sensor and second."""

import numpy as np
from attrs import frozen

from opir_core.columns import Columns
from opir_core.geometry import local_axes
from opir_core.records import FloatArray, IndexArray, IntArray
from opir_core.tracking.rays import Rays

#: Lines of sight of a track and sensor within this time are averaged, s. In a second a boost seen from 36 000 km bends
#: by 4e-7 rad, and the mean over it by a twelfth of that: far below what a mean of looks is good for.
SPAN_S = 1.0


@frozen(eq=False)
class Rows(Columns):
    """Mean lines of sight: track (its number), mean time of the looks, sensor, where from, axes, error of the mean.

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


def averaged(track: IntArray, rays: Rays) -> Rows:
    """Return the means of rays (n,), given to tracks by number (n,), by track, sensor and second; weights 1/σ²."""
    if not len(rays):
        return Rows.empty()
    second = np.floor(rays.time_s / SPAN_S).astype(np.int64)
    keys = np.stack([track, rays.sensor.astype(np.int64), second])
    order = np.lexsort(keys[::-1])
    first = np.append(True, np.any(np.diff(keys[:, order], axis=1) != 0, axis=0))
    group = np.cumsum(first) - 1
    weight = 1.0 / np.square(rays.sigma_rad[order])
    total = np.bincount(group, weight)

    def mean(values: FloatArray) -> FloatArray:
        found: FloatArray = np.bincount(group, weight * values[order]) / total
        return found

    origin, direction = (
        np.stack([mean(vectors[:, axis]) for axis in range(3)], axis=1)
        for vectors in (rays.origin_ecef_m, rays.direction_ecef)
    )
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    lead = order[first]
    return Rows(
        track=track[lead],
        time_s=mean(rays.time_s),
        sensor=rays.sensor[lead],
        origin_ecef_m=origin,
        axes=_axes(origin, direction),
        sigma_rad=1.0 / np.sqrt(total),
    )


def single(track: int, rays: Rays) -> Rows:
    """Return rays (n,) as rows of one track, each by itself, in their order."""
    return Rows(
        track=np.full(len(rays), track, dtype=np.int64),
        time_s=rays.time_s,
        sensor=rays.sensor,
        origin_ecef_m=rays.origin_ecef_m,
        axes=_axes(rays.origin_ecef_m, rays.direction_ecef),
        sigma_rad=rays.sigma_rad,
    )


def _axes(origin: FloatArray, direction: FloatArray) -> FloatArray:
    """Return axes (n, 3, 3) about directions (n, 3): towards the east and the north of their origins, and along."""
    north = local_axes(origin)[:, 1]
    across = north - np.sum(north * direction, axis=1)[:, None] * direction
    # Straight along the north any axis will do.
    size = np.linalg.norm(across, axis=1)[:, None]
    spare = np.cross(direction, np.eye(3)[np.argmin(np.abs(direction), axis=1)])
    across = np.where(size > 1e-6, across / np.maximum(size, 1e-6), spare / np.linalg.norm(spare, axis=1)[:, None])
    return np.stack([np.cross(across, direction), across, direction], axis=1)
