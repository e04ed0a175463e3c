"""Columns of numbers: as floats, and rows as slices to read them without copies."""

import numpy as np
from numpy.typing import ArrayLike

from opir_core.arrays import FloatArray, IntArray


def floats(values: ArrayLike) -> FloatArray:
    """Return values as an array of float64, without a copy where they are one."""
    return np.asarray(values, dtype=np.float64)


def as_slice_if_consecutive(rows: IntArray) -> "slice | IntArray":
    """Return increasing row numbers, as a slice where they are consecutive, to avoid copies."""
    is_run = len(rows) > 0 and int(rows[-1] - rows[0]) == len(rows) - 1
    return slice(int(rows[0]), int(rows[-1]) + 1) if is_run else rows
