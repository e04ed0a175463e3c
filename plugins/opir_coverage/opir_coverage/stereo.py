"""Stereo angle and dilution of precision of the lines of sight that meet at a point."""

import numpy as np
from numpy.typing import ArrayLike

from opir_core.arrays import BoolArray, FloatArray, IntArray


def stereo_angles_rad(direction: FloatArray, is_seen: BoolArray) -> FloatArray:
    """Return the best angles (n,) between two lines of sight at each point, rad, or nan.

    `direction` (S, n, 3) are unit vectors from points to sensors, `is_seen` (S, n) which of them
    count. Lines of sight are best at right angles; the angle is that of the lines, at most π/2.
    """
    best = np.full(is_seen.shape[1], -1.0)
    columns = _columns(direction)
    for first_sensor in range(len(is_seen)):
        for second_sensor in range(first_sensor + 1, len(is_seen)):
            rows = _slice_if_consecutive(
                np.flatnonzero(is_seen[first_sensor] & is_seen[second_sensor])
            )
            x, y, z = (
                component[first_sensor, rows] * component[second_sensor, rows]
                for component in columns
            )
            cosine = x + y + z
            best[rows] = np.maximum(best[rows], 1.0 - cosine * cosine)
    return np.arcsin(np.sqrt(np.where(best >= 0.0, best, np.nan)))


def dilution_m(direction: FloatArray, range_m: FloatArray, weight: ArrayLike) -> FloatArray:
    """Return the dilutions of precision (n,), m/rad: position sigma over that of a line of sight.

    They are √(tr J⁻¹) with J = Σ w (1 - u uᵀ) / r² over sensors at unit vectors u (S, n, 3) and
    ranges r (S, n), each of which measures two angles; `weight` (S, n) is 0 for one that does not
    see the point. nan where J is singular: one line of sight, or parallel ones.
    """
    share = np.asarray(weight, dtype=np.float64) / np.square(range_m)
    columns = _columns(direction)
    total, xx, yy, zz, xy, xz, yz = np.zeros((7, range_m.shape[1]))
    for number, weights in enumerate(share):
        x, y, z = (component[number] for component in columns)
        along = weights * x
        across = weights * y
        total += weights
        xx -= along * x
        yy -= across * y
        zz -= weights * z * z
        xy -= along * y
        xz -= along * z
        yz -= across * z
    for diagonal in (xx, yy, zz):
        diagonal += total
    minor = yy * zz - yz * yz
    minors = minor + (xx * zz - xz * xz) + (xx * yy - xy * xy)
    determinant = xx * minor - xy * (xy * zz - yz * xz) + xz * (xy * yz - yy * xz)
    with np.errstate(divide="ignore", invalid="ignore"):
        square = minors / determinant
        singular = determinant <= 1e-12 * total**3
        return np.sqrt(np.where(singular, np.nan, square))


def directions(point_m: FloatArray, sensor_m: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return unit vectors (S, n, 3) and distances (S, n), m, from points to sensors, ECEF, m."""
    ways = np.stack([sensor_m[..., axis] - point_m[:, axis] for axis in range(3)])
    distance = np.sqrt(ways[0] ** 2 + ways[1] ** 2 + ways[2] ** 2)
    ways /= distance
    return np.moveaxis(ways, 0, -1), distance


def _columns(direction: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the components (S, n) of vectors (S, n, 3), each contiguous."""
    x, y, z = (np.ascontiguousarray(direction[..., axis]) for axis in range(3))
    return x, y, z


def _slice_if_consecutive(rows: IntArray) -> IntArray | slice:
    """Return ascending rows, as a slice if they are consecutive, which copies nothing."""
    return (
        slice(rows[0], rows[-1] + 1) if len(rows) and rows[-1] - rows[0] + 1 == len(rows) else rows
    )
