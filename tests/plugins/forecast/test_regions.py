"""Highest-density regions: areas of normal laws, shares of other points, several peaks, and places
on the globe.
"""

from typing import Any

import numpy as np
import pytest
from opir_forecast.regions import map_area_m2, regions
from plain_boosts import RADIUS_M

from opir_core.geometry import AzimuthalEquidistant, unit_vectors
from opir_core.plugin import ImpactRegion

#: Squared radii, standard deviations, of the ellipses of a normal law that hold 50, 90 and 95 %.
SQUARES = (1.386, 4.605, 5.991)


def points_about(place: tuple[float, float], plane_m: np.ndarray) -> np.ndarray:
    """Return latitudes and longitudes of points (n, 2), m east and north of a place."""
    return AzimuthalEquidistant.about(unit_vectors(np.array([place]))[0]).places(plane_m)


def normal(count: int, sigmas_m: tuple[float, float], seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(count, 2)) * sigmas_m


def regions_of(place: np.ndarray, **settings: Any) -> tuple[ImpactRegion, ...]:
    """Return the regions of places (n, 2) of equal weight."""
    return regions(place, np.full(len(place), 1.0 / len(place)), **settings)


def around(rng: np.random.Generator, distance_m: np.ndarray) -> np.ndarray:
    """Return places (n, 2) in all directions at distances (n,)."""
    angle = rng.uniform(0.0, 2.0 * np.pi, len(distance_m))
    plane = distance_m[:, None] * np.stack([np.cos(angle), np.sin(angle)], axis=1)
    return points_about((0.3, 0.5), plane)


def share_inside(region: ImpactRegion, places: np.ndarray) -> float:
    return float(np.mean([region.contains(*place) for place in places.tolist()]))


@pytest.mark.slow
@pytest.mark.parametrize("sigmas_m", [(1e3, 1e3), (2e5, 1e4)])
def test_areas_of_a_normal_law_are_those_of_its_ellipses(sigmas_m: tuple[float, float]) -> None:
    result = regions_of(points_about((0.5, 1.0), normal(4000, sigmas_m)))
    # Kernels of 4000 points are a quarter of the standard deviation wide: variances larger by a
    # sixteenth.
    expected = np.pi * np.array(SQUARES) * sigmas_m[0] * sigmas_m[1] * 1e-6
    assert [region.area_km2 for region in result] == pytest.approx(expected, rel=0.15)


@pytest.mark.slow
@pytest.mark.parametrize("place", [(0.0, 0.0), (0.3, np.pi), (1.57, 0.5), (-1.2, -3.0)])
def test_other_points_are_inside_in_the_stated_shares_everywhere(
    place: tuple[float, float],
) -> None:
    points, other_points = (points_about(place, normal(2000, (3e5, 1e5), seed)) for seed in (1, 2))
    for region in regions_of(points):
        share = region.containment
        # Five standard deviations of a count, and the widening by the kernels.
        slack = 5.0 * np.sqrt(share * (1 - share) / 2000) + 0.03
        assert share_inside(region, other_points) == pytest.approx(share, abs=slack)


def test_weights_count_like_repeated_points() -> None:
    plane = normal(300, (1e4, 1e4))
    weight = np.repeat([3.0, 1.0], 150) / 600.0
    weighted = regions(points_about((0.2, 0.2), plane), weight)
    thrice = np.concatenate([plane[:150]] * 3 + [plane[150:]])
    repeated = regions_of(points_about((0.2, 0.2), thrice))
    # The kernels differ: four hundred and eighty points count as many as these weights.
    for region, expected in zip(weighted, repeated, strict=True):
        assert region.area_km2 == pytest.approx(expected.area_km2, rel=0.1)


def test_two_peaks_are_two_polygons() -> None:
    east = np.array([4e5, 0.0])
    plane = np.concatenate([normal(500, (1e4, 1e4)), normal(500, (1e4, 1e4), seed=3) + east])
    half = regions_of(points_about((0.1, -1.0), plane))[0]
    peak, middle = points_about((0.1, -1.0), np.array([east, 0.5 * east]))
    assert len(half.polygons) == 2
    assert half.contains(*peak)
    assert not half.contains(*middle)


def test_regions_are_nested_and_rings_closed() -> None:
    rng = np.random.default_rng(5)
    plane = normal(256, (1e5, 2e4)) * np.exp(rng.normal(size=(256, 1)))
    result = regions_of(points_about((-0.7, 2.0), plane))
    assert [region.containment for region in result] == [0.5, 0.9, 0.95]
    areas = [region.area_km2 for region in result]
    assert areas == sorted(set(areas))
    rings = [ring for region in result for polygon in region.polygons for ring in polygon]
    for ring in rings:
        assert np.array_equal(ring[0], ring[-1])
        assert np.all(np.abs(ring[:, 0]) <= np.pi / 2)


def test_regions_wider_than_a_hemisphere_are_nested() -> None:
    rng = np.random.default_rng(7)
    places = around(rng, rng.uniform(0.0, 1.2e7, 400))
    half, larger, largest = regions_of(places)
    for place in places.tolist():
        assert largest.contains(*place) >= larger.contains(*place) >= half.contains(*place)


@pytest.mark.slow
def test_areas_of_wide_regions_are_those_of_caps() -> None:
    """Points spread evenly over a cap of 80°: the region of nearly all has its area, 2 π R² (1 -
    cos 80°).
    """
    rng = np.random.default_rng(9)
    height = 1.0 - np.cos(np.radians(80.0))
    distance_m = RADIUS_M * np.arccos(1.0 - rng.uniform(0.0, 1.0, 3000) * height)
    nearly_all = regions_of(around(rng, distance_m))[2]
    cap_km2 = 2.0 * np.pi * RADIUS_M**2 * height * 1e-6
    assert nearly_all.area_km2 == pytest.approx(cap_km2, rel=0.15)


def test_regions_end_where_the_earth_does() -> None:
    """Points all round the Earth: no area beyond that of the Earth, and each region holds its share
    of them.
    """
    rng = np.random.default_rng(11)
    places = around(rng, RADIUS_M * np.arccos(rng.uniform(-1.0, 1.0, 400)))
    earth_km2 = 4.0 * np.pi * RADIUS_M**2 * 1e-6
    for region in regions_of(places):
        assert region.area_km2 <= 1.001 * earth_km2
        assert share_inside(region, places) >= region.containment - 0.03


def test_regions_of_few_points_hold_other_draws_of_the_law() -> None:
    rng = np.random.default_rng(21)
    shares = []
    for _ in range(60):
        points, truths = (rng.normal(size=(size, 2)) * [0.02, 0.01] for size in (30, 40))
        shares.append([share_inside(region, truths) for region in regions_of(points)])
    # Three standard errors of 60 sets of points. With points in their own kernels it would be 0.35,
    # 0.81 and 0.86.
    assert np.mean(shares, axis=0) == pytest.approx([0.5, 0.9, 0.95], abs=0.05)


@pytest.mark.parametrize("radius_deg", [0.01, 5.0, 60.0, 120.0])
def test_areas_of_circles_are_those_of_caps(radius_deg: float) -> None:
    turn = np.linspace(0.0, 2.0 * np.pi, 721)
    ring = np.radians(radius_deg) * RADIUS_M * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    cap_m2 = 2.0 * np.pi * RADIUS_M**2 * (1.0 - np.cos(np.radians(radius_deg)))
    assert map_area_m2(ring) == pytest.approx(cap_m2, rel=1e-4)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("spread_m", [0.0, 1e-6, 1.0, 30.0])
def test_points_closer_than_the_least_spread_have_regions_of_it(spread_m: float) -> None:
    result = regions_of(points_about((0.5, 1.0), normal(256, (spread_m, spread_m))))
    expected = np.pi * np.array(SQUARES) * (100.0**2 + spread_m**2) * 1e-6
    assert [region.area_km2 for region in result] == pytest.approx(expected, rel=0.15)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("weight", [1e-7, 1e-44, 1e-50, 5e-324, 0.0])
@pytest.mark.parametrize("origin", [None, (0.45, 0.9)])
def test_a_far_point_of_no_weight_changes_nothing(
    weight: float, origin: tuple[float, float] | None
) -> None:
    start = None if origin is None else np.array(origin)
    place = points_about((0.5, 1.0), normal(256, (1e4, 1e4)))
    shares = np.append(np.full(256, 1 / 256), weight)
    result = regions(np.concatenate([place, [[0.1, -1.0]]]), shares, origin=start)
    for region, expected in zip(result, regions_of(place, origin=start), strict=True):
        assert region.area_km2 == pytest.approx(expected.area_km2, rel=1e-6)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("remaining", [1e-3, 1e-6, 1e-7, 1e-11, 1e-30, 5e-324])
def test_a_point_of_nearly_all_weight_has_a_region(remaining: float) -> None:
    place = points_about((0.5, 1.0), normal(64, (1e4, 1e4)))
    weight = np.append(1.0, np.full(63, remaining))
    for region in regions(place, weight / weight.sum()):
        assert region.area_km2 > 1e-2
        assert region.contains(*place[0])


@pytest.mark.parametrize("beyond_m", [19.2e6, 19.9e6, np.pi * RADIUS_M])
def test_points_along_a_flight_beyond_its_end_have_regions(beyond_m: float) -> None:
    east, north = (normal(64, (1e4, 1e4), seed)[:, axis] for axis, seed in ((0, 1), (1, 3)))
    plane = np.stack([beyond_m + east - 1e4, north], axis=1)
    origin = (0.2, 0.1)
    for region in regions_of(points_about(origin, plane), origin=np.array(origin)):
        assert 0.0 < region.area_km2 < 1e6


@pytest.mark.parametrize("chance", [0.1, 0.14, 0.19, 0.3])
def test_an_improbable_glide_has_its_part_of_a_region(chance: float) -> None:
    """What is left out of 95 % are the rarest places: of a glide at most 5 % of all."""
    count = 192
    rng = np.random.default_rng(4)
    falls = normal(count, (20e3, 8e3)) + np.array([800e3, 0.0])
    glides, others = (
        np.stack([rng.uniform(5e5, 3e6, each), rng.uniform(-4e5, 4e5, each)], axis=1)
        for each in (count, 2000)
    )
    places = points_about((0.3, 0.2), np.concatenate([falls, glides]))
    weight = np.repeat([1.0 - chance, chance], count) / count
    region = regions(places, weight, origin=np.array([0.3, 0.2]))[2]
    held = share_inside(region, points_about((0.3, 0.2), others))
    assert held > (chance - 0.05) / chance - 0.05
