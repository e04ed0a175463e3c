"""Stereo angle and dilution of precision of the lines of sight that meet at a point."""

import numpy as np
from numpy.typing import ArrayLike

from opir_core.arrays import BoolArray, FloatArray
from opir_coverage.grid import SeenPoints


def stereo_angles_rad(direction: FloatArray, is_seen: BoolArray) -> FloatArray:
    """Return the best angles (n,) between two lines of sight at each point, rad, in (0, π/2]; nan below two.

    `direction` (S, n, 3) are unit vectors from points to sensors, `is_seen` (S, n) which of them count. Lines of sight
    are best at right angles; the angle is that of the lines, at most π/2.
    """
    best = np.full(is_seen.shape[1], -1.0)
    for one in range(len(is_seen)):
        for other in range(one + 1, len(is_seen)):
            rows = np.flatnonzero(is_seen[one] & is_seen[other])
            if len(rows):
                cosine = _dot(direction[one, rows], direction[other, rows])
                best[rows] = np.maximum(best[rows], 1.0 - cosine * cosine)
    return np.arcsin(np.sqrt(np.where(best >= 0.0, best, np.nan)))


def dilution_m(direction: FloatArray, range_m: FloatArray, weight: ArrayLike) -> FloatArray:
    """Return the dilutions of precision (n,): standard deviations of position over that of a line of sight, m/rad.

    √(tr J⁻¹) with J = Σ w (1 - u uᵀ) / r² over sensors at unit vectors u (S, n, 3) and ranges r (S, n), each of which
    measures two angles; `weight` (S, n) is 0 for one that does not see the point. nan where J is singular: one line of
    sight, or parallel ones.
    """
    share = np.asarray(weight, dtype=np.float64) / np.square(range_m)
    x, y, z = direction[..., 0], direction[..., 1], direction[..., 2]
    whole = share.sum(axis=0)
    xx, yy, zz = (whole - (share * each * each).sum(axis=0) for each in (x, y, z))
    xy, xz, yz = (-(share * one * other).sum(axis=0) for one, other in ((x, y), (x, z), (y, z)))
    minors = (yy * zz - yz * yz) + (xx * zz - xz * xz) + (xx * yy - xy * xy)
    determinant = xx * (yy * zz - yz * yz) - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz)
    with np.errstate(divide="ignore", invalid="ignore"):
        square = minors / determinant
        singular = determinant <= 1e-12 * whole**3
        return np.sqrt(np.where(singular, np.nan, square))


def directions(points: SeenPoints, sensor_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return unit vectors (S, n, 3) from points to sensors at (S, n, 3), ECEF, m, and their distances (S, n), m."""
    way = sensor_m - points.position_m[None]
    distance = np.sqrt(way[..., 0] ** 2 + way[..., 1] ** 2 + way[..., 2] ** 2)
    way /= distance[..., None]
    return way, distance


def _dot(one: FloatArray, other: FloatArray) -> FloatArray:
    return one[:, 0] * other[:, 0] + one[:, 1] * other[:, 1] + one[:, 2] * other[:, 2]
