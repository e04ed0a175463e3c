"""Highest-density regions: areas of normal laws, shares of fresh points, several peaks, and places
on the globe.
"""

import numpy as np
import pytest
from opir_trackers.forecast.regions import LAW, map_area_m2, regions

from opir_core.geometry.sphere import AzimuthalEquidistant, unit_vectors

RADIUS_M = 6378137.0

#: Squared radii, standard deviations, of the ellipses of a normal law that hold 50, 90 and 95 %.
SQUARES = (1.386, 4.605, 5.991)


def points_about(place: tuple[float, float], plane_m: np.ndarray) -> np.ndarray:
    """Return latitudes and longitudes of points (n, 2), m east and north of a place."""
    return AzimuthalEquidistant.about(unit_vectors(np.array([place]))[0]).places(plane_m)


def normal(count: int, sigmas_m: tuple[float, float], seed: int = 1) -> np.ndarray:
    return np.random.default_rng(seed).normal(size=(count, 2)) * sigmas_m


@pytest.mark.slow
@pytest.mark.parametrize("sigmas_m", [(1e3, 1e3), (2e5, 1e4)])
def test_areas_of_a_normal_law_are_those_of_its_ellipses(sigmas_m: tuple[float, float]) -> None:
    points = points_about((0.5, 1.0), normal(4000, sigmas_m))
    for region, square in zip(regions(points, np.full(4000, 1 / 4000)), SQUARES, strict=True):
        # Kernels of 4000 points are a quarter of the standard deviation wide: variances larger by a
        # sixteenth.
        assert region.area_km2 == pytest.approx(
            np.pi * square * sigmas_m[0] * sigmas_m[1] * 1e-6, rel=0.15
        )


@pytest.mark.slow
@pytest.mark.parametrize("place", [(0.0, 0.0), (0.3, np.pi), (1.57, 0.5), (-1.2, -3.0)])
def test_fresh_points_are_inside_in_the_stated_shares_everywhere(
    place: tuple[float, float],
) -> None:
    given = regions(points_about(place, normal(2000, (3e5, 1e5))), np.full(2000, 1 / 2000))
    fresh = points_about(place, normal(2000, (3e5, 1e5), seed=2))
    for region in given:
        inside = sum(region.contains(*point) for point in fresh.tolist())
        # Five standard deviations of a count, and what the kernels widen.
        slack = 5.0 * np.sqrt(2000 * region.containment * (1 - region.containment))
        assert abs(inside - 2000 * region.containment) < slack + 0.03 * 2000


def test_weights_count_like_repeated_points() -> None:
    plane = normal(300, (1e4, 1e4))
    weight = np.repeat([3.0, 1.0], 150) / 600.0
    thrice = np.concatenate([plane[:150]] * 3 + [plane[150:]])
    one, other = (
        regions(points_about((0.2, 0.2), each), share)
        for each, share in ((plane, weight), (thrice, np.full(600, 1 / 600)))
    )
    # The kernels differ: four hundred and eighty points count as many as these weights.
    for each, same in zip(one, other, strict=True):
        assert each.area_km2 == pytest.approx(same.area_km2, rel=0.1)


def test_two_peaks_are_two_polygons() -> None:
    far = np.array([4e5, 0.0])
    plane = np.concatenate([normal(500, (1e4, 1e4)), normal(500, (1e4, 1e4), seed=3) + far])
    half = regions(points_about((0.1, -1.0), plane), np.full(1000, 1e-3))[0]
    assert len(half.polygons) == 2
    assert half.contains(*points_about((0.1, -1.0), np.array([[4e5, 0.0]]))[0])
    assert not half.contains(*points_about((0.1, -1.0), np.array([[2e5, 0.0]]))[0])


def test_regions_are_nested_and_rings_closed() -> None:
    rng = np.random.default_rng(5)
    plane = normal(256, (1e5, 2e4)) * np.exp(rng.normal(size=(256, 1)))
    found = regions(points_about((-0.7, 2.0), plane), np.full(256, 1 / 256))
    assert [region.containment for region in found] == [0.5, 0.9, 0.95]
    assert found[0].area_km2 < found[1].area_km2 < found[2].area_km2
    for region in found:
        for ring in (ring for polygon in region.polygons for ring in polygon):
            assert np.array_equal(ring[0], ring[-1])
            assert np.all(np.abs(ring[:, 0]) <= np.pi / 2)


def test_regions_wider_than_a_hemisphere_are_nested() -> None:
    rng = np.random.default_rng(7)
    far = rng.uniform(0.0, 1.2e7, 400)
    angle = rng.uniform(0.0, 2.0 * np.pi, 400)
    place = points_about((0.3, 0.5), np.stack([far * np.cos(angle), far * np.sin(angle)], axis=1))
    half, most, nearly_all = regions(place, np.full(400, 1 / 400))
    for point in place.tolist():
        assert most.contains(*point) >= half.contains(*point)
        assert nearly_all.contains(*point) >= most.contains(*point)


@pytest.mark.slow
def test_areas_of_wide_regions_are_those_of_caps() -> None:
    """Points spread evenly over a cap of 80°: the region of nearly all has its area, 2 π R² (1 -
    cos 80°).
    """
    rng = np.random.default_rng(9)
    far = RADIUS_M * np.arccos(1.0 - rng.uniform(0.0, 1.0, 3000) * (1.0 - np.cos(np.radians(80.0))))
    angle = rng.uniform(0.0, 2.0 * np.pi, 3000)
    place = points_about((0.3, 0.5), np.stack([far * np.cos(angle), far * np.sin(angle)], axis=1))
    nearly_all = regions(place, np.full(3000, 1 / 3000))[2]
    cap_km2 = 2.0 * np.pi * RADIUS_M**2 * (1.0 - np.cos(np.radians(80.0))) * 1e-6
    assert nearly_all.area_km2 == pytest.approx(cap_km2, rel=0.15)


def test_regions_end_where_the_earth_does() -> None:
    """Points all round the Earth: no area beyond that of the Earth, and each region holds its share
    of them.
    """
    rng = np.random.default_rng(11)
    far = RADIUS_M * np.arccos(rng.uniform(-1.0, 1.0, 400))
    angle = rng.uniform(0.0, 2.0 * np.pi, 400)
    place = points_about((0.3, 0.5), np.stack([far * np.cos(angle), far * np.sin(angle)], axis=1))
    earth_km2 = 4.0 * np.pi * RADIUS_M**2 * 1e-6
    for region in regions(place, np.full(400, 1 / 400)):
        assert region.area_km2 <= 1.001 * earth_km2
        assert (
            sum(region.contains(*point) for point in place.tolist())
            >= (region.containment - 0.03) * 400
        )


def test_regions_of_few_points_hold_what_is_none_of_them() -> None:
    rng = np.random.default_rng(21)
    held = []
    for _ in range(60):
        points, truths = (rng.normal(size=(size, 2)) * [0.02, 0.01] for size in (30, 40))
        found = regions(points, np.full(30, 1.0 / 30.0))
        held.append([[region.contains(*truth) for region in found] for truth in truths])
    share = np.mean(held, axis=(0, 1))
    # Three standard errors of 60 sets of points. With points in their own kernels it would be 0.35,
    # 0.81 and 0.86.
    assert share == pytest.approx([0.5, 0.9, 0.95], abs=0.05)


@pytest.mark.parametrize("radius_deg", [0.01, 5.0, 60.0, 120.0])
def test_areas_of_circles_are_those_of_caps(radius_deg: float) -> None:
    turn = np.linspace(0.0, 2.0 * np.pi, 721)
    ring = np.radians(radius_deg) * RADIUS_M * np.stack([np.cos(turn), np.sin(turn)], axis=1)
    cap_m2 = 2.0 * np.pi * RADIUS_M**2 * (1.0 - np.cos(np.radians(radius_deg)))
    assert map_area_m2(ring) == pytest.approx(cap_m2, rel=1e-4)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("spread_m", [0.0, 1e-6, 1.0, 30.0])
def test_points_closer_than_the_least_spread_have_regions_of_it(spread_m: float) -> None:
    plane = normal(256, (spread_m, spread_m))
    for region, square in zip(
        regions(points_about((0.5, 1.0), plane), np.full(256, 1 / 256)), SQUARES, strict=True
    ):
        assert region.area_km2 == pytest.approx(
            np.pi * square * (LAW.least_m**2 + spread_m**2) * 1e-6, rel=0.15
        )


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("weight", [1e-7, 1e-44, 1e-50, 5e-324, 0.0])
@pytest.mark.parametrize("origin", [None, (0.45, 0.9)])
def test_a_far_point_of_no_weight_changes_nothing(
    weight: float, origin: tuple[float, float] | None
) -> None:
    place = points_about((0.5, 1.0), normal(256, (1e4, 1e4)))
    far = np.concatenate([place, [[0.1, -1.0]]])
    shares = np.append(np.full(256, 1 / 256), weight)
    start = None if origin is None else np.array(origin)
    for region, same in zip(
        regions(far, shares, origin=start), regions(place, shares[:-1], origin=start), strict=True
    ):
        assert region.area_km2 == pytest.approx(same.area_km2, rel=1e-6)


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("rest", [1e-3, 1e-6, 1e-7, 1e-11, 1e-30, 5e-324])
def test_a_point_of_nearly_all_weight_has_a_region(rest: float) -> None:
    place = points_about((0.5, 1.0), normal(64, (1e4, 1e4)))
    weight = np.full(64, rest)
    weight[0] = 1.0
    for region in regions(place, weight / weight.sum()):
        assert region.area_km2 > 1e-2
        assert region.contains(*place[0])


@pytest.mark.parametrize("beyond_m", [19.2e6, 19.9e6, np.pi * RADIUS_M])
def test_points_along_a_flight_that_come_down_beyond_its_end_have_regions(beyond_m: float) -> None:
    plane = np.stack(
        [beyond_m + normal(64, (1e4, 1e4))[:, 0] - 1e4, normal(64, (1e4, 1e4), seed=3)[:, 1]],
        axis=1,
    )
    for region in regions(
        points_about((0.2, 0.1), plane), np.full(64, 1 / 64), origin=np.array([0.2, 0.1])
    ):
        assert 0.0 < region.area_km2 < 1e6
