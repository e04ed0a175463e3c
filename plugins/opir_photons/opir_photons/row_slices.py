"""Rows as slices, to read columns without copies."""

from opir_core.arrays import IntArray


def as_slice_if_consecutive(rows: IntArray) -> "slice | IntArray":
    """Return increasing row numbers, as a slice where they are consecutive, to avoid copies."""
    is_run = len(rows) > 0 and int(rows[-1] - rows[0]) == len(rows) - 1
    return slice(int(rows[0]), int(rows[-1]) + 1) if is_run else rows
