"""Outlines of regions with few points, against Shapely: boundary and area within 1 %, sides that
do not cross."""

import json
from typing import Any

import numpy as np
import pytest
import shapely
from numpy.typing import NDArray

from opir_core import ImpactRegion
from opir_core.geometry.sphere import AzimuthalEquidistant
from opir_core.output.geojson import region_from_document, region_text
from opir_core.output.region_outlines import FEW_POINTS, outlined


def ring_about(latitude: float, longitude: float, radius_m: NDArray[np.float64]) -> Any:
    """Return a ring about a place, degrees, with radii at equal steps of direction."""
    place = np.radians([latitude, longitude])
    up = np.array(
        [np.cos(place[0]) * np.cos(place[1]), np.cos(place[0]) * np.sin(place[1]), np.sin(place[0])]
    )
    turn = np.linspace(0.0, 2.0 * np.pi, len(radius_m), endpoint=False)
    points = radius_m[:, None] * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    chart = AzimuthalEquidistant.about(up)
    ring = chart.places(points)
    return np.concatenate([ring, ring[:1]]), (float(place[0]), float(place[1]))


def region_of(ring: Any, centre: Any) -> ImpactRegion:
    points = AzimuthalEquidistant.about(
        np.array(
            [
                np.cos(centre[0]) * np.cos(centre[1]),
                np.cos(centre[0]) * np.sin(centre[1]),
                np.sin(centre[0]),
            ]
        )
    ).points(ring)
    area_km2 = shapely.Polygon(points).area / 1e6
    return ImpactRegion(containment=0.9, area_km2=area_km2, polygons=((ring,),), centre=centre)


def polygon_of(region: ImpactRegion) -> Any:
    chart = region.chart()
    return shapely.union_all(
        [
            shapely.Polygon(chart.points(outer), [chart.points(hole) for hole in holes])
            for outer, *holes in region.polygons
        ]
    )


TURN = np.linspace(0.0, 2.0 * np.pi, 400, endpoint=False)
SHAPES = {
    "circle": np.ones(400),
    "ellipse": 1.0 / np.sqrt(np.cos(TURN) ** 2 + (4.0 * np.sin(TURN)) ** 2),
    "needle": 1.0 / np.sqrt(np.cos(TURN) ** 2 + (40.0 * np.sin(TURN)) ** 2),
    "star": 1.0 + 0.5 * np.cos(5.0 * TURN),
    "rough": 1.0 + 0.02 * np.random.default_rng(3).standard_normal(400),
}


@pytest.mark.parametrize("radius_m", [2e3, 1e5, 2e6])
@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("place", [(9.0, 167.7), (-52.0, 179.6), (70.0, 30.0)])
def test_outlines_stay_within_a_hundredth(
    place: tuple[float, float], shape: str, radius_m: float
) -> None:
    region = region_of(*ring_about(*place, radius_m * SHAPES[shape]))
    outline = outlined(region)
    before, after = polygon_of(region), polygon_of(outline)
    size_m = np.sqrt(before.area / np.pi)
    assert after.is_valid
    assert after.area == pytest.approx(before.area, rel=0.01)
    assert before.boundary.hausdorff_distance(after.boundary) <= 0.01 * size_m
    if shape != "rough":
        assert len(outline.polygons[0][0]) < {"circle": 36, "ellipse": 44}.get(shape, 120)
    # As it is written and read back, across the 180th meridian too.
    (document,) = json.loads(region_text([region]))
    geometry = shapely.geometry.shape(document["geometry"])
    assert geometry.is_valid
    read = polygon_of(region_from_document(document)).buffer(0.0)
    assert read.area == pytest.approx(before.area, rel=0.01)
    assert before.boundary.hausdorff_distance(read.boundary) <= 0.01 * size_m
    assert len(region_text([region])) < 25 * len(outline.polygons[0][0]) + 1400


def test_short_rings_stay() -> None:
    region = region_of(*ring_about(9.0, 167.7, np.full(FEW_POINTS - 1, 1e5)))
    assert outlined(region) is region
