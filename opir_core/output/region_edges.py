"""Edges of regions with points where they are long in longitude or cross the 180th meridian.

Edges are straight in the map of their region, not in longitude and latitude.
"""

import numpy as np

from opir_core.arrays import FloatArray, IntArray
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M
from opir_core.geometry.sphere import AzimuthalEquidistant

#: Longest step in longitude along an edge, degrees: edges of regions are straight in their own map,
#: those of GeoJSON in longitude and latitude.
STEP_DEG = 1.0

#: Longest step in longitude whose sense is beyond doubt, degrees.
_WIDEST_DEG = 90.0
#: Halvings that find a place on an edge, and divisions into as many parts: to 6e-8 of the edge.
_HALVINGS = 40
_DIVISIONS = 4
_PARTS = 64


def refined(
    ring: FloatArray, plane: FloatArray, chart: AzimuthalEquidistant, step_deg: float
) -> FloatArray:
    """Return a closed ring as longitude and latitude, degrees, with points on edges that are long
    in longitude.

    An edge that crosses the 180th meridian has a point on it, so that both sides of a cut share it.
    """
    divisions = _divisions(ring, plane, step_deg)
    edge = np.repeat(np.arange(len(divisions)), divisions)
    share = (np.arange(len(edge)) - (np.cumsum(divisions) - divisions)[edge]) / divisions[edge]
    # An edge that passes close to a pole turns around it within one step.
    for _ in range(_HALVINGS):
        points = np.degrees(ring[edge, ::-1])
        added = np.flatnonzero(share)
        points[added] = _along(plane, edge[added], share[added], chart)
        end_share = np.where(np.append(edge[1:], -1) == edge, np.append(share[1:], 1.0), 1.0)
        turn = np.abs(np.diff(points[:, 0], append=points[0, 0]))
        wide = np.flatnonzero(np.minimum(turn, 360.0 - turn) > _WIDEST_DEG)
        if not len(wide):
            break
        edge = np.insert(edge, wide + 1, edge[wide])
        share = np.insert(share, wide + 1, 0.5 * (share + end_share)[wide])
    is_jump = (turn > 180.0) & (np.abs(points[:, 0]) < 180.0)
    jumps = np.flatnonzero(is_jump)
    closed = np.concatenate([points, points[:1]])
    if not jumps.size:
        return closed
    crossings = _crossings(
        plane, edge[jumps], (share[jumps], end_share[jumps]), np.sign(points[jumps, 0]), chart
    )
    return np.insert(closed, jumps + 1, crossings, axis=0)


def _divisions(ring: FloatArray, plane: FloatArray, step_deg: float) -> IntArray:
    """Return into how many steps the edges (n - 1,) of a closed ring are divided."""
    step = np.abs(np.degrees(np.diff(ring[:, 1])))
    far = np.sqrt(np.add.reduce(plane * plane, axis=1)) / EARTH_EQUATORIAL_RADIUS_M
    stretch = np.sqrt(np.abs(np.sinc(np.maximum(far[:-1], far[1:]) / np.pi)))
    most_deg = np.maximum(step_deg * stretch, min(step_deg, 2.0 * STEP_DEG))
    return np.ceil(np.minimum(step, 360.0 - step) / most_deg - 1e-6).clip(1).astype(np.int64)


def _crossings(
    plane: FloatArray,
    edge: IntArray,
    between: tuple[FloatArray, FloatArray],
    side: FloatArray,
    chart: AzimuthalEquidistant,
) -> FloatArray:
    """Return the points (n, 2) at which edges, between two shares, cross the 180th meridian.

    `side` is the sign of the longitude at the first share.
    """
    crossings = _along(plane, edge, _crossed(plane, edge, between, side, chart), chart)
    crossings[:, 0] = 180.0 * side
    return crossings


def _crossed(
    plane: FloatArray,
    edge: IntArray,
    between: tuple[FloatArray, FloatArray],
    side: FloatArray,
    chart: AzimuthalEquidistant,
) -> FloatArray:
    """Return the shares (n,) of edges, between two, at which they leave a side (the sign of the
    longitude).
    """
    low, high = between
    division_shares = np.linspace(0.0, 1.0, _PARTS + 1)
    repeated_edge = np.repeat(edge, _PARTS)
    row = np.arange(len(edge))
    for _ in range(_DIVISIONS):
        ends = low[:, None] + (high - low)[:, None] * division_shares
        longitude = _along(plane, repeated_edge, ends[:, 1:].ravel(), chart)[:, 0]
        is_over = np.sign(longitude).reshape(-1, _PARTS) != side[:, None]
        is_over[:, -1] = True
        division = np.argmax(is_over, axis=1)
        low = ends[row, division]
        high = ends[row, division + 1]
    return high


def _along(
    plane: FloatArray, edge: IntArray, share: FloatArray, chart: AzimuthalEquidistant
) -> FloatArray:
    """Return points on edges of a ring, at shares of their length, as longitude and latitude,
    degrees.
    """
    between = (1.0 - share)[:, np.newaxis] * plane[edge] + share[:, np.newaxis] * plane[edge + 1]
    degrees: FloatArray = np.degrees(chart.places(between)[:, ::-1])
    return degrees
