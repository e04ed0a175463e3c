"""Regions as GeoJSON keep RFC 7946 and their area and content: across the 180th meridian and around
the poles too.
"""

from itertools import pairwise
from typing import Any

import numpy as np
import pytest
from attrs import evolve
from hypothesis import given, settings, strategies as st
from opir_testing import stub_regions

from opir_core import ImpactRegion
from opir_core.arrays import FloatArray
from opir_core.output import geometry_of, region_texts
from opir_core.output.geojson import region_document, region_from_document

EARTH_RADIUS_KM = 6371.0088
PLACES = [
    (9.0, 167.7, 100.0, "Polygon"),
    (9.0, 179.8, 100.0, "MultiPolygon"),
    (-70.0, -180.0, 50.0, "MultiPolygon"),
    (89.9, 20.0, 300.0, "Polygon"),
    (-89.9, 180.0, 300.0, "Polygon"),
    (84.0, -150.0, 600.0, "MultiPolygon"),
]


def polygons_of(geometry: dict[str, Any]) -> list[list[FloatArray]]:
    """Return the polygons of a geometry: rings (k, 2) of longitude and latitude, degrees."""
    coordinates = geometry["coordinates"]
    polygons = [coordinates] if geometry["type"] == "Polygon" else coordinates
    return [[np.array(ring) for ring in polygon] for polygon in polygons]


def area_km2(ring: FloatArray) -> float:
    """Return the area on the sphere inside a ring of edges straight in longitude and latitude;
    negative if clockwise.

    By Green's theorem it is the integral of -sin(latitude) along the ring, which has a closed form
    on each edge.
    """
    (east, north) = np.radians(ring).T
    total = 0.0
    for (x0, y0), (x1, y1) in pairwise(zip(east.tolist(), north.tolist(), strict=True)):
        mean = np.sin(y0) if abs(y1 - y0) < 1e-9 else (np.cos(y0) - np.cos(y1)) / (y1 - y0)
        total -= (x1 - x0) * mean
    return float(total * EARTH_RADIUS_KM**2)


def winding(ring: FloatArray, point: tuple[float, float]) -> int:
    """Return how often a ring winds around a point, by the sum of the angles of its edges."""
    angle = np.unwrap(np.arctan2(ring[:, 1] - point[1], ring[:, 0] - point[0]))
    return round((angle[-1] - angle[0]) / (2.0 * np.pi))


def requires_of_rfc(geometry: dict[str, Any]) -> None:
    for outer, *holes in polygons_of(geometry):
        for ring in (outer, *holes):
            assert len(ring) >= 4
            assert ring[0].tolist() == ring[-1].tolist()
            assert np.abs(ring[:, 0]).max() <= 180.0
            assert np.abs(ring[:, 1]).max() <= 90.0
        assert area_km2(outer) > 0.0
        assert all(area_km2(hole) < 0.0 for hole in holes)


@pytest.mark.parametrize(("latitude_deg", "longitude_deg", "radius_km", "kind"), PLACES)
def test_a_circle_keeps_its_area_wherever_it_lies(
    latitude_deg: float, longitude_deg: float, radius_km: float, kind: str
) -> None:
    for region in stub_regions(latitude_deg, longitude_deg, radius_km, corners=720):
        geometry = geometry_of(region)
        requires_of_rfc(geometry)
        total = sum(area_km2(ring) for polygon in polygons_of(geometry) for ring in polygon)
        # A polygon of 720 corners in a circle has (2 pi / 720)² / 6 = 1.3e-5 less area.
        assert total == pytest.approx(region.area_km2, rel=3e-5)
    assert geometry["type"] == kind


WIDE = [
    (latitude_deg, longitude_deg, radius_km)
    for latitude_deg in (0.0, 40.0, -85.0)
    for longitude_deg in (0.0, 100.0, 180.0)
    for radius_km in (9_000.0, 12_000.0, 19_000.0)
]


@pytest.mark.parametrize(("latitude_deg", "longitude_deg", "radius_km"), WIDE)
def test_regions_of_more_than_a_hemisphere_keep_their_area(
    latitude_deg: float, longitude_deg: float, radius_km: float
) -> None:
    centre = np.radians([latitude_deg, longitude_deg]).tolist()
    region = evolve(
        stub_regions(latitude_deg, longitude_deg, radius_km, corners=1440)[2], centre=tuple(centre)
    )
    geometry = geometry_of(region)
    requires_of_rfc(geometry)
    total = sum(area_km2(ring) for polygon in polygons_of(geometry) for ring in polygon)
    assert total == pytest.approx(region.area_km2, rel=1e-4)


def ring_of(*corners: tuple[float, float]) -> FloatArray:
    """Return a closed ring of corners, east of the 180th meridian and north of the equator in
    tenths of a degree.
    """
    return np.radians([(0.1 * north, 180.0 + 0.1 * east) for east, north in (*corners, corners[0])])


#: A C open to the east, around the 180th meridian: cut there, it is two arms in the east and a back
#: in the west.
BAY = ring_of((-2, 0), (2, 0), (2, 1), (-1, 1), (-1, 2), (2, 2), (2, 3), (-2, 3))
SQUARE = ring_of((-2, 0), (2, 0), (2, 4), (-2, 4))
HOLE = ring_of((-1, 1), (1, 1), (1, 2), (-1, 2))
ASIDE = ring_of((-1.8, 1), (-1.2, 1), (-1.2, 2), (-1.8, 2))


@pytest.mark.parametrize(
    ("polygon", "parts"),
    [
        ((BAY,), [1, 1, 1]),
        ((SQUARE, HOLE), [1, 1]),
        ((SQUARE, ASIDE), [2, 1]),
        ((SQUARE, HOLE, ASIDE), [2, 1]),
    ],
)
def test_shapes_are_cut_at_the_180th_meridian(
    polygon: tuple[FloatArray, ...], parts: list[int]
) -> None:
    for oriented in (polygon, tuple(ring[::-1] for ring in polygon)):
        wrapped = tuple(
            np.stack([ring[:, 0], np.mod(ring[:, 1] + np.pi, 2.0 * np.pi) - np.pi], axis=1)
            for ring in oriented
        )
        region = ImpactRegion(containment=0.9, area_km2=1.0, polygons=(wrapped,))
        geometry = geometry_of(region)
        requires_of_rfc(geometry)
        shapes = polygons_of(geometry)
        assert [len(rings) for rings in shapes] == parts
        outer, *holes = (np.abs(area_km2(np.degrees(ring[:, ::-1]))) for ring in polygon)
        assert sum(area_km2(ring) for rings in shapes for ring in rings) == pytest.approx(
            outer - sum(holes), rel=1e-4
        )


@pytest.mark.slow
@settings(max_examples=60, deadline=None)
@given(st.data())
def test_points_of_the_region_are_inside_the_geometry(data: st.DataObject) -> None:
    latitude_deg = data.draw(st.floats(-89.9, 89.9))
    longitude_deg = data.draw(st.one_of(st.floats(-180.0, 180.0), st.floats(179.0, 181.0)))
    radius_km = data.draw(st.floats(1.0, 800.0))
    region = stub_regions(latitude_deg, longitude_deg, radius_km, corners=90)[2]
    geometry = geometry_of(region)
    requires_of_rfc(geometry)
    back = region_from_document(region_document(region))
    rng = np.random.default_rng(data.draw(st.integers(0, 2**32)))
    for distance, bearing in zip(
        rng.uniform(0.2, 1.8, 40), rng.uniform(0.0, 2.0 * np.pi, 40), strict=True
    ):
        if (
            abs(distance - 1.0) < 0.02
        ):  # between corners, great circles, chords in the plane and the circle differ
            continue
        ring = stub_regions(latitude_deg, longitude_deg, distance * radius_km)[2].polygons[0][0]
        north, east = ring[round(bearing / (2.0 * np.pi) * (len(ring) - 1))]
        is_inside = region.contains(north, east)
        point = float(np.degrees(east)), float(np.degrees(north))
        if 180.0 - abs(point[0]) < 1e-6:  # on the cut, the edge of both parts
            continue
        windings = [winding(ring, point) for rings in polygons_of(geometry) for ring in rings]
        assert is_inside == (distance < 1.0) == (sum(windings) == 1) == back.contains(north, east)


def test_rows_that_share_their_regions_share_the_text() -> None:
    regions = stub_regions(9.0, 167.7)
    column = np.empty(3, dtype=object)
    column[0] = regions
    column[1] = ()
    column[2] = regions
    text, empty, same_text = region_texts(column)
    assert text is same_text
    assert empty == b"[]"


def test_what_is_no_region_is_refused() -> None:
    document = region_document(stub_regions(9.0, 167.7)[0])
    ring = document["geometry"]["coordinates"][0]
    for geometry in ({"type": "Point"}, {"type": "Polygon", "coordinates": [ring[:-1]]}):
        with pytest.raises(ValueError, match=r"no region|a ring is"):
            region_from_document(document | {"geometry": geometry})
    with pytest.raises(KeyError):
        region_from_document({"containment": 0.5, "area_km2": 1.0})


@pytest.mark.parametrize(("west_deg", "parts"), [(10.0, 1), (179.8, 2)])
def test_a_triangle_is_a_ring(west_deg: float, parts: int) -> None:
    ring = np.radians([(0.0, west_deg), (0.0, west_deg + 0.5), (0.5, west_deg), (0.0, west_deg)])
    document = region_document(ImpactRegion(containment=0.5, area_km2=1.0, polygons=((ring,),)))
    shapes = polygons_of(document["geometry"])
    assert [len(rings) for rings in shapes] == [1] * parts
    assert sum(area_km2(rings[0]) for rings in shapes) == pytest.approx(
        area_km2(np.degrees(ring[:, ::-1])), rel=1e-4
    )
    assert len(region_from_document(document).polygons) == parts


def test_a_ring_without_area_is_left_out() -> None:
    region = stub_regions(9.0, 167.7)[0]
    point = np.tile(region.polygons[0][0][:1], (5, 1))
    assert geometry_of(evolve(region, polygons=((point,),)))["coordinates"] == []
