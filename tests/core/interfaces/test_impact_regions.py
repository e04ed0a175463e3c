"""Regions contain what lies inside their rings: circles on the sphere, at poles and at the 180th
meridian too.
"""

import numpy as np
import pytest
from attrs import evolve
from opir_testing import stub_regions

from opir_core import ImpactRegion
from opir_core.arrays import FloatArray


def around(place: tuple[float, float], angle_rad: float, bearing_rad: FloatArray) -> FloatArray:
    """Return points (k, 2) at an angular distance and bearings from a place (latitude, longitude),
    spherical law.
    """
    latitude, longitude = place
    sine = np.sin(latitude) * np.cos(angle_rad) + np.cos(latitude) * np.sin(angle_rad) * np.cos(
        bearing_rad
    )
    east = np.sin(bearing_rad) * np.sin(angle_rad) * np.cos(latitude)
    turn = np.arctan2(east, np.cos(angle_rad) - np.sin(latitude) * sine)
    turned = longitude + turn
    return np.stack([np.arcsin(sine), np.arctan2(np.sin(turned), np.cos(turned))], axis=1)


def ring(place: tuple[float, float], angle_rad: float) -> FloatArray:
    """Return a closed ring of 360 points about a place."""
    return around(place, angle_rad, np.linspace(0.0, 2.0 * np.pi, 361))


PLACES = [(0.0, 0.0), (0.6, np.pi), (-0.4, -3.1), (1.5707, 0.3), (-1.55, 2.0)]
SIZES_RAD = [1e-4, 0.05, 1.0]


@pytest.mark.parametrize("place", PLACES)
@pytest.mark.parametrize("size_rad", SIZES_RAD)
def test_a_circle_with_a_hole_contains_what_is_between(
    place: tuple[float, float], size_rad: float
) -> None:
    region = ImpactRegion(0.5, 1.0, ((ring(place, size_rad), ring(place, 0.4 * size_rad)),))
    for share, inside in (
        (0.02, False),
        (0.38, False),
        (0.42, True),
        (0.98, True),
        (1.02, False),
        (2.5, False),
    ):
        points = around(place, share * size_rad, np.linspace(0.1, 6.1, 7))
        assert [region.contains(*point) for point in points.tolist()] == [inside] * 7


def test_regions_of_two_polygons_contain_both() -> None:
    region = ImpactRegion(0.5, 1.0, ((ring((0.2, 3.0), 0.05),), (ring((0.2, -3.0), 0.05),)))
    assert region.contains(0.2, 3.01)
    assert region.contains(0.2, -3.01)
    assert not region.contains(0.2, np.pi)


def test_no_polygon_contains_nothing() -> None:
    assert not ImpactRegion(0.5, 0.0, ()).contains(0.0, 0.0)


def test_regions_are_equal_when_every_point_is() -> None:
    region = stub_regions(9.0, 167.7)[2]
    same_region = stub_regions(9.0, 167.7)[2]
    assert region == same_region
    assert hash(region) == hash(same_region)
    moved = same_region.polygons[0][0].copy()
    moved[3, 1] += 1e-9
    assert region != evolve(same_region, polygons=((moved,),))
    assert region != evolve(same_region, containment=0.9)
    assert region != same_region.polygons
