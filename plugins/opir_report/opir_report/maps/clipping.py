"""Curves in the plane: points added along them, and closed ones cut to a rectangle, which keeps
files small.
"""

import numpy as np

from opir_core.arrays import BoolArray, FloatArray


def clipped(curve: FloatArray, x: tuple[float, float], y: tuple[float, float]) -> FloatArray:
    """Return a closed curve (n, 2) cut to a rectangle, closed; empty where nothing is left.

    One side after another (Sutherland and Hodgman, Communications of the ACM 17 (1974), 32):
    winding numbers inside the rectangle stay the same.
    """
    for axis, (low, high) in enumerate((x, y)):
        # A little beyond the rectangle, where the cuts are not seen.
        margin = 0.02 * (high - low)
        for edge, sign in ((low - margin, 1.0), (high + margin, -1.0)):
            curve = _half_plane(curve, sign * (curve[:, axis] - edge))
            if not len(curve):
                return curve
    return curve


def dense(curve: FloatArray, step: float) -> FloatArray:
    """Return a curve (n, 2) with points along its straight edges, at most a step apart."""
    length = np.linalg.norm(np.diff(curve, axis=0), axis=1)
    steps = np.ceil(length / step).clip(1).astype(np.int64)
    places = np.append(0, np.cumsum(steps))
    fine = np.arange(places[-1] + 1)
    return np.stack([np.interp(fine, places, column) for column in curve.T], axis=1)


def _half_plane(curve: FloatArray, above: FloatArray) -> FloatArray:
    """Return the part of a closed curve (n, 2) with `above` (n,) not negative, closed along the
    edge.
    """
    inside: BoolArray = above >= 0.0
    if inside.all() or not len(curve):
        return curve
    if not inside.any():
        return curve[:0]
    start = np.flatnonzero(inside[:-1] != inside[1:])
    share = above[start] / (above[start] - above[start + 1])
    crossing = curve[start] + share[:, None] * (curve[start + 1] - curve[start])
    # Points stay in the order of the curve: its own at whole places, crossings between them.
    places = np.concatenate([np.flatnonzero(inside), start + 0.5])
    points = np.concatenate([curve[inside], crossing])[np.argsort(places, kind="stable")]
    return points if (points[0] == points[-1]).all() else np.concatenate([points, points[:1]])
