"""Outlines of regions with few points: as many as keep boundary and area within 1 %.

A tracker's contours follow a grid, with hundreds of points; an ellipse needs 30.
"""

from collections.abc import Sequence
from math import asin, atan2, hypot, pi, remainder

import numpy as np
from attrs import evolve

from opir_core.arrays import FloatArray, IntArray
from opir_core.interfaces.impact_regions import ImpactRegion

#: Largest error of the area, as a share of it, and of the boundary, as a share of the radius of the
#: circle of the ring's area: less, as digits and edges take the rest.
AREA_ERROR = 0.01
BOUNDARY_ERROR = 0.006
#: Rings with at most as many points stay: their text is short, and what is read back is as written.
FEW_POINTS = 40
#: Halvings of the tolerance after which a ring stays as it is.
_HALVINGS = 6


def outlined(region: ImpactRegion) -> ImpactRegion:
    """Return a region with the same figures and map whose rings have few points.

    A ring that no fewer points represent stays: one that is thin everywhere, or touches itself.
    """
    if all(len(ring) <= FEW_POINTS for polygon in region.polygons for ring in polygon):
        return region
    chart = region.chart()
    polygons = tuple(
        tuple(
            ring if len(ring) <= FEW_POINTS else ring[_outline(chart.points(ring[:-1]))]
            for ring in polygon
        )
        for polygon in region.polygons
    )
    return evolve(region, polygons=polygons, centre=chart.centre)


def ring_radii_m(region: ImpactRegion) -> FloatArray:
    """Return the radii of the circles of the areas of a region's rings (n,), m."""
    chart = region.chart() if region.polygons else None
    rings = [ring for polygon in region.polygons for ring in polygon]
    areas_m2 = [_area_m2(chart.points(ring[:-1])) for ring in rings if chart]
    return np.sqrt(np.abs(np.array(areas_m2, dtype=np.float64)) / pi)


def _outline(plane: FloatArray) -> IntArray:
    """Return the rows of the points of a ring (n, 2), m, that its outline has, the first at both
    ends.
    """
    area_m2 = _area_m2(plane)
    radius_m = float(np.sqrt(abs(area_m2) / pi))
    # A corner far from the middle is on the outline whatever the tolerance.
    off = plane - plane.mean(axis=0)
    first = int(np.argmax(off[:, 0] * off[:, 0] + off[:, 1] * off[:, 1]))
    order = np.roll(np.arange(len(plane)), -first)
    points = plane[order]
    for halving in range(_HALVINGS):
        tolerance_m = BOUNDARY_ERROR * radius_m * 0.5**halving
        corners = _corners(points, tolerance_m)
        outline = points[corners[:-1]]
        error_m2 = abs(_area_m2(outline) - area_m2)
        if error_m2 <= AREA_ERROR * abs(area_m2) and not sides_cross([outline]):
            return order[np.array(corners) % len(order)]
    return np.append(order, order[0])


def _corners(points: FloatArray, tolerance_m: float) -> list[int]:
    """Return the corners of a closed line through some of the points (n, 2), from 0 to n.

    From each corner it goes on to the last point to which a straight line passes all points between
    within the tolerance: their discs, seen from the corner, have a direction in common (J. Sklansky
    and V. Gonzalez, Pattern Recognition 12, 1980).
    """
    x, y = np.concatenate([points, points[:1]]).T.tolist()
    corners = [0]
    while corners[-1] < len(points):
        corners.append(_next_corner(x, y, corners[-1], tolerance_m))
    return corners


def _next_corner(x: list[float], y: list[float], corner: int, tolerance_m: float) -> int:
    """Return the corner after another one of a line with points (n,) x and y."""
    east, north = x[corner], y[corner]
    middle = 0.0
    farthest_m = 0.0
    low, high = -2.0 * pi, 2.0 * pi
    stop = corner + 1
    for place in range(corner + 1, len(x)):
        across, up = x[place] - east, y[place] - north
        distance_m = hypot(across, up)
        if distance_m <= tolerance_m:
            continue
        direction = atan2(up, across)
        if low == -2.0 * pi:
            middle = direction
        turn = remainder(direction - middle, 2.0 * pi)
        # A line that turned back would leave its farthest point off the side.
        if distance_m >= farthest_m:
            farthest_m = distance_m
            if low <= turn <= high:
                stop = place
        half_width = asin(tolerance_m / distance_m)
        # Comparisons take half the time of `max` and `min`.
        if turn - half_width > low:
            low = turn - half_width
        if turn + half_width < high:
            high = turn + half_width
        if low > high:
            break
    return stop


def _area_m2(ring: FloatArray) -> float:
    """Return the area of an open ring (n, 2), positive if it is counter-clockwise."""
    x, y = ring.T
    next_x, next_y = np.concatenate([ring[1:], ring[:1]]).T
    return float(0.5 * np.sum(x * next_y - next_x * y))


def sides_cross(rings: Sequence[FloatArray]) -> bool:
    """Return whether sides of open rings (n, 2) cross or touch that are not neighbours in a ring."""
    if not rings:
        return False
    start = np.concatenate(rings)
    ring_ends = np.cumsum([len(ring) for ring in rings])
    following = np.arange(1, len(start) + 1)
    following[ring_ends - 1] = np.append(0, ring_ends[:-1])
    end = start[following]
    low, high = np.minimum(start, end), np.maximum(start, end)
    # Sides by their west ends: those that begin before another ends may cross it.
    order = np.argsort(low[:, 0], kind="stable")
    reach = np.searchsorted(low[order, 0], high[order, 0], side="right")
    counts = reach - np.arange(1, len(order) + 1)
    place = np.repeat(np.arange(len(order)), counts)
    first = order[place]
    second = order[
        place + 1 + np.arange(len(place)) - np.repeat(np.cumsum(counts) - counts, counts)
    ]
    apart = (following[first] != second) & (following[second] != first)
    near = apart & (low[first, 1] <= high[second, 1]) & (low[second, 1] <= high[first, 1])
    first, second = first[near], second[near]
    reaches = _sides(start[first], end[first], start[second], end[second]) <= 0.0
    first, second = first[reaches], second[reaches]
    return bool(np.any(_sides(start[second], end[second], start[first], end[first]) <= 0.0))


def _sides(start: FloatArray, end: FloatArray, first: FloatArray, second: FloatArray) -> FloatArray:
    """Return -1 where two points (n, 2) lie on both sides of a line (n, 2), 0 where one is on it,
    and else 1.
    """
    along = end - start
    of_first, of_second = (
        np.sign(along[:, 0] * (at - start)[:, 1] - along[:, 1] * (at - start)[:, 0])
        for at in (first, second)
    )
    return of_first * of_second
