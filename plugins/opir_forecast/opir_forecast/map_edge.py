"""Rings of a map cut at its edge: beyond the antipode of the centre there is no more Earth.

Points beyond the edge that are moved onto it make rings that run along it there and back. So rings
are cut: chains remain that end on the edge, and each continues along the edge with the next one
(Weiler and Atherton, Computer Graphics 11(2), 1977, for a convex window).
"""

from collections.abc import Iterator
from itertools import pairwise

import numpy as np

from opir_core.arrays import BoolArray, FloatArray
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M

#: Longest edge of a region, m.
LONGEST_EDGE_M = 100e3

#: Distance from the centre of the map to its edge, m, 100 km short of the antipode: nearer to it
#: the rounding of coordinates in files, 0.1 m, turns a point of the map about its centre.
FARTHEST_M = np.pi * EARTH_EQUATORIAL_RADIUS_M - 100e3


def within_map(points: FloatArray, edges: list[list[int]]) -> tuple[FloatArray, list[list[int]]]:
    """Return points (k, 2), m, of the rings of polygons within the edge, and the ends of rings, by
    polygon.

    Arguments are alike. Rings are closed, and the first of a polygon is the outer one; its interior
    is on one side of all its rings.
    """
    if not len(points) or np.sum(points * points, axis=1).max() <= FARTHEST_M**2:
        return points, edges
    polygons = [
        polygon
        for ends in edges
        for polygon in _cut([points[start:end] for start, end in pairwise(ends)])
    ]
    cuts = []
    total = 0
    for polygon in polygons:
        ends = np.cumsum([total, *map(len, polygon)]).tolist()
        cuts.append(ends)
        total = ends[-1]
    rings = [ring for polygon in polygons for ring in polygon]
    return np.concatenate([*rings, np.empty((0, 2))]), cuts


def _cut(rings: list[FloatArray]) -> list[list[FloatArray]]:
    """Return a polygon as those that lie within the edge."""
    holes = []
    chains = []
    turns_about_centre = 0
    for number, ring in enumerate(rings):
        is_within = np.sum(ring[:-1] ** 2, axis=1) <= FARTHEST_M**2
        if is_within.all():
            if not number:
                return [rings]
            holes.append(ring)
        elif is_within.any():
            chains += _chains(ring[:-1], is_within)
        else:
            turns_about_centre += _holds(ring, np.zeros(2))
    way = _way(rings[0])
    outers = _joined(chains, way) if chains or not turns_about_centre % 2 else [_edge(way)]
    return [[outer, *(hole for hole in holes if _holds(outer, hole[0]))] for outer in outers]


def _way(ring: FloatArray) -> float:
    """Return 1 for a ring that turns counterclockwise, else -1."""
    return 1.0 if _signed_area(ring) > 0.0 else -1.0


def _edge(way: float) -> FloatArray:
    """Return the edge as a closed ring (k, 2)."""
    circle = _arc(0.0, way * 2.0 * np.pi)
    return np.concatenate([circle, circle[:1]])


def _chains(ring: FloatArray, is_within: BoolArray) -> list[FloatArray]:
    """Return the chains of an open ring within the edge, with their ends on it."""
    chains = []
    for entry in np.flatnonzero(is_within & ~np.roll(is_within, 1)):
        turned = np.roll(ring, -entry, axis=0)
        count = int(np.argmin(np.roll(is_within, -entry)))
        start = _on_edge(turned[0], turned[-1])
        end = _on_edge(turned[count - 1], turned[count])
        chains.append(np.concatenate([start[None], turned[:count], end[None]]))
    return chains


def _on_edge(inner: FloatArray, outer: FloatArray) -> FloatArray:
    """Return the point (2,) at which a short line from (2,) to (2,) crosses the edge."""
    inner_m = np.hypot(*inner)
    between = inner + (FARTHEST_M - inner_m) / (np.hypot(*outer) - inner_m) * (outer - inner)
    return between * (FARTHEST_M / np.hypot(*between))


def _joined(chains: list[FloatArray], way: float) -> list[FloatArray]:
    """Return chains as closed rings: each continues along the edge, counter-clockwise if `way` is
    1, with the next.
    """
    angles = np.array([np.arctan2(chain[[0, -1], 1], chain[[0, -1], 0]) for chain in chains])
    open_chains = set(range(len(chains)))
    rings = []
    while open_chains:
        start = min(open_chains)
        ring = []
        for number, arc in _ring_from(start, open_chains, angles, way):
            ring += [chains[number], arc]
        rings.append(np.concatenate([*ring, chains[start][:1]]))
    return rings


def _ring_from(
    number: int, open_chains: set[int], angles: FloatArray, way: float
) -> Iterator[tuple[int, FloatArray]]:
    """Yield the open chains of a ring from a number on, with the arc after each; they are closed."""
    while number in open_chains:
        open_chains.remove(number)
        end = angles[number, 1]
        turns = (way * (angles[:, 0] - end)) % (2.0 * np.pi)
        yield number, _arc(end, way * turns.min())
        number = int(np.argmin(turns))


def _arc(start: float, turn: float) -> FloatArray:
    """Return points (k, 2), m, around the edge, from an angle on for a turn, rad: lines between
    them touch the edge.

    A chain that is close to the edge would cross chords of it.
    """
    count = 1 + int(abs(turn) * FARTHEST_M / LONGEST_EDGE_M)
    half = 0.5 * turn / count
    angle = start + half * np.arange(1, 2 * count, 2)
    return FARTHEST_M / np.cos(half) * np.stack([np.cos(angle), np.sin(angle)], axis=1)


def _signed_area(ring: FloatArray) -> float:
    x, y = ring.T
    return 0.5 * float(np.sum(x[:-1] * y[1:] - x[1:] * y[:-1]))


def _holds(ring: FloatArray, point: FloatArray) -> bool:
    """Whether a point lies in a closed ring: a ray from it crosses the ring an odd number of
    times.
    """
    x, y = (ring - point).T
    rows = np.flatnonzero((y[:-1] > 0.0) != (y[1:] > 0.0))
    crossing = x[rows] - y[rows] * (x[rows + 1] - x[rows]) / (y[rows + 1] - y[rows])
    return bool(np.count_nonzero(crossing > 0.0) % 2)
