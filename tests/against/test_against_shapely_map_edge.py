"""Polygons cut at the edge of the map, against Shapely's intersection with a disk."""

from itertools import pairwise

import numpy as np
import pytest
from opir_forecast.map_edge import FARTHEST_M, LONGEST_EDGE_M, within_map
from shapely import Polygon, box, segmentize
from shapely.affinity import rotate, scale, translate
from shapely.geometry import MultiPolygon, Point
from shapely.geometry.polygon import orient
from shapely.ops import unary_union

EDGE = Point(0.0, 0.0).buffer(FARTHEST_M, quad_segs=2000)


def blob(rng):
    """Return an ellipse or a box, up to the size of the map, that may lie across its edge."""
    shape = Point(0.0, 0.0).buffer(1.0) if rng.random() < 0.5 else box(-1.0, -1.0, 1.0, 1.0)
    wide = scale(shape, *np.exp(rng.uniform(np.log(1e6), np.log(2.5e7), 2)))
    return translate(rotate(wide, rng.uniform(0.0, 180.0)), *rng.uniform(-2.2e7, 2.2e7, 2))


def region(rng):
    """Return the polygons of a random region, with holes."""
    filled = unary_union([blob(rng) for _ in range(rng.integers(1, 5))])
    shape = filled.difference(unary_union([blob(rng) for _ in range(rng.integers(0, 4))]))
    polygons = shape.geoms if isinstance(shape, MultiPolygon) else [shape]
    return [polygon for polygon in polygons if polygon.area > 1e9]


def as_rings(polygons, sign):
    rings = []
    edges = []
    for polygon in polygons:
        short = segmentize(orient(polygon, sign), LONGEST_EDGE_M)
        count = sum(map(len, rings))
        coordinates = [np.asarray(ring.coords) for ring in (short.exterior, *short.interiors)]
        edges.append([count, *(count + np.cumsum([len(ring) for ring in coordinates])).tolist()])
        rings += coordinates
    return np.concatenate([*rings, np.empty((0, 2))]), edges


@pytest.mark.slow
@pytest.mark.parametrize("sign", [1.0, -1.0], ids=["counter-clockwise", "clockwise"])
def test_cut_polygons_are_valid_and_cover_what_lies_within(sign):
    rng = np.random.default_rng(17)
    for _ in range(150):
        polygons = region(rng)
        points, edges = within_map(*as_rings(polygons, sign))
        cut = []
        for starts in edges:
            outer, *holes = [points[one:two] for one, two in pairwise(starts)]
            cut.append(Polygon(outer, holes))
        assert all(edge.is_valid for edge in cut)
        assert all(
            np.array_equal(points[one], points[two - 1])
            for edge in edges
            for one, two in pairwise(edge)
        )
        expected = unary_union(polygons).intersection(EDGE)
        # A chord of 100 km lies 62 m within the edge.
        assert (
            unary_union(cut).symmetric_difference(expected).area < 100.0 * 2.0 * np.pi * FARTHEST_M
        )


def test_what_lies_within_is_left_as_it_is():
    points, edges = as_rings([box(0.0, 0.0, 1e6, 1e6).difference(box(2e5, 2e5, 4e5, 4e5))], 1.0)
    rings, cuts = within_map(points, edges)
    assert rings is points
    assert cuts is edges


def test_all_of_the_map_is_its_edge_and_what_lies_beyond_is_nothing():
    points, edges = within_map(
        *as_rings([box(-3e7, -3e7, 3e7, 3e7), box(2.5e7, 0.0, 2.6e7, 1e6)], 1.0)
    )
    assert len(edges) == 1
    assert Polygon(points).area == pytest.approx(np.pi * FARTHEST_M**2, rel=1e-5)
    around = box(-4e7, -4e7, 4e7, 4e7).difference(box(-3e7, -3e7, 3e7, 3e7))
    assert within_map(*as_rings([around], 1.0))[1] == []
