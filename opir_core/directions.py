"""Measured lines of sight: the true ones with the sensors' errors, as unit vectors."""

import numpy as np
from numpy.typing import NDArray

from opir_core.randomness import normal_pairs
from opir_core.records import Exposures, FloatArray
from opir_core.sites import Sites


def measured_lines_of_sight(
    sites: Sites, seen_as: Exposures, sigma_rad: FloatArray, words: NDArray[np.uint64]
) -> FloatArray:
    """Return unit vectors (n, 3) in ECEF with their errors: the sensor's bias, and two normal errors across each.

    `sigma_rad` (n,) is the spread of each along both axes; `words` (n,) are the dice, raw. The true direction is that
    to where the target was when the light left it.
    """
    first, second = normal_pairs(words)
    direction = _directions(seen_as)
    if sites.bias is not None:
        direction = sites.bias.applied(*direction, seen_as.sensor, seen_as.sensor_ecef_m)
    return _rows(*_tilted(*direction, first * sigma_rad, second * sigma_rad))


def _directions(seen_as: Exposures) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the components of the true unit vectors from sensor to target."""
    per_m = 1.0 / seen_as.range_m
    target_m, sensor_m = seen_as.target_ecef_m, seen_as.sensor_ecef_m
    x, y, z = ((target_m[:, axis] - sensor_m[:, axis]) * per_m for axis in range(3))
    return x, y, z


def _tilted(
    x: FloatArray, y: FloatArray, z: FloatArray, first_rad: FloatArray, second_rad: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return unit vectors moved by small angles along two directions across them.

    The two directions are those of growing longitude and latitude of the vector about the Earth's axis: a scene that is
    turned as a whole about that axis is measured alike. Along the axis, where there is no longitude, it counts as 0.
    """
    level = np.sqrt(x * x + y * y)
    on_axis = level == 0.0
    per_level = 1.0 / (level + on_axis)
    cosine, sine = x * per_level + on_axis, y * per_level
    outward = z * second_rad
    moved_x = x - sine * first_rad - cosine * outward
    moved_y = y + cosine * first_rad - sine * outward
    moved_z = z + level * second_rad
    per_length = 1.0 / np.sqrt(moved_x * moved_x + moved_y * moved_y + moved_z * moved_z)
    return moved_x * per_length, moved_y * per_length, moved_z * per_length


def _rows(x: FloatArray, y: FloatArray, z: FloatArray) -> FloatArray:
    rows = np.empty((len(x), 3))
    rows[:, 0], rows[:, 1], rows[:, 2] = x, y, z
    return rows
