"""Maps: caps, areas and regions on the sphere, against closed forms and pyproj, over the poles and
the antimeridian.
"""

import hashlib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import opir_report
import pytest
from hypothesis import example, given, strategies as st
from opir_report import coast_rings, equal_earth
from opir_report.maps.base_map import latitude_text, longitude_text
from opir_report.maps.clipping import clipped
from opir_report.maps.projections import (
    RegionProjection,
    WorldProjection,
    fitting_projection,
)
from opir_report.maps.spheres import EARTH_RADIUS_KM, area_sr, cap, refined, turns, unit_vectors
from opir_report.plots.impact import area_text
from opir_report.run_facts import containment_rings
from pyproj import Geod, Proj

from opir_core.plugin import ImpactRegion

#: Latitude and longitude, rad.
places = st.tuples(st.floats(-1.55, 1.55), st.floats(-3.14, 3.14)).map(np.array)
radii = st.floats(0.02, 1.4)


def winding(curve: np.ndarray, point: np.ndarray) -> int:
    """Return how often a closed curve goes round a point."""
    x, y = (curve - point).T
    angle = np.unwrap(np.arctan2(y, x))
    return round((angle[-1] - angle[0]) / (2.0 * np.pi))


def distance(place: np.ndarray, centre: np.ndarray) -> float:
    """Return the angle between two places, rad, by pyproj."""
    return Geod(a=1.0, b=1.0).inv(*np.degrees([*centre[::-1], *place[::-1]]))[2]


@given(places, radii)
def test_a_cap_has_its_area_and_its_inside_on_the_left(place: np.ndarray, radius: float) -> None:
    ring = cap(*place, radius, points=721)
    assert area_sr(ring) == pytest.approx(2.0 * np.pi * (1.0 - np.cos(radius)), rel=2e-3, abs=2e-5)


def test_only_rings_round_a_pole_turn() -> None:
    assert [turns(cap(latitude, 3.0, 0.3)) for latitude in (1.4, 0.0, -1.4)] == [1, 0, -1]


@given(places, places)
def test_refined_lines_follow_the_great_circle(start: np.ndarray, end: np.ndarray) -> None:
    line = np.stack([start, end])
    unit = unit_vectors(*refined(line, 0.05).T)
    ends = unit_vectors(*line.T)
    normal = np.cross(*ends)
    angle = float(np.arctan2(np.linalg.norm(normal), ends[0] @ ends[1]))
    if angle > 3.1:
        return
    assert np.abs(unit @ normal).max() < 1e-12
    steps = np.arccos(np.clip(np.sum(unit[1:] * unit[:-1], axis=1), -1.0, 1.0))
    assert steps.sum() == pytest.approx(angle, abs=1e-6)
    assert steps.max(initial=0.0) < 0.0501


@given(places, places)
def test_the_region_projection_is_that_of_proj(centre: np.ndarray, place: np.ndarray) -> None:
    latitude_deg, longitude_deg = np.degrees(centre)
    proj = Proj(proj="aeqd", R=1e3 * EARTH_RADIUS_KM, lat_0=latitude_deg, lon_0=longitude_deg)
    projection = RegionProjection(*centre)
    flat = projection.points(*place[:, None])
    if np.hypot(*flat[0]) > 3.1 * EARTH_RADIUS_KM:
        return
    expected = np.array(proj(*np.degrees(place[::-1]))) / 1e3
    np.testing.assert_allclose(flat[0], expected, rtol=0, atol=1e-3)
    inverse = unit_vectors(*projection.places(flat).T)
    np.testing.assert_allclose(inverse, unit_vectors(*place[:, None]), rtol=0, atol=1e-9)


def is_filled(
    projection: RegionProjection | WorldProjection, rings: list[np.ndarray], place: np.ndarray
) -> bool:
    """Whether a region is filled at a place on a map."""
    (point,) = projection.points(*place[:, None])
    return sum(winding(curve, point) for curve in projection.curves(rings)) != 0


@given(places, st.floats(0.02, 3.1), places, places)
def test_a_cap_is_filled_where_it_is_on_the_sphere(
    centre: np.ndarray, radius: float, place: np.ndarray, map_centre: np.ndarray
) -> None:
    ring = cap(*centre, radius, points=721)
    if abs(distance(place, centre) - radius) < 2e-3:
        return
    for projection in (WorldProjection(map_centre[1]), RegionProjection(*map_centre)):
        assert is_filled(projection, [ring], place) == (distance(place, centre) < radius)


@given(places, st.floats(0.1, 1.4), st.floats(1.5, 3.0), places, places)
@example(np.array([1.5, 0.0]), 0.3, 2.8, np.array([0.0, 1.0]), np.array([0.0, 0.0]))
def test_a_belt_round_the_earth_is_filled_between_its_rings(
    centre: np.ndarray,
    inner: float,
    outer: float,
    place: np.ndarray,
    map_centre: np.ndarray,
) -> None:
    rings = [cap(*centre, outer, points=721), cap(*centre, inner, points=721)[::-1]]
    radius = distance(place, centre)
    if min(abs(radius - inner), abs(radius - outer)) < 2e-3:
        return
    for projection in (WorldProjection(map_centre[1]), RegionProjection(*map_centre)):
        assert is_filled(projection, rings, place) == (inner < radius < outer)


@given(st.floats(-90.0, 90.0), st.floats(-180.0, 180.0))
def test_the_map_of_the_earth_is_equal_earth(latitude_deg: float, longitude_deg: float) -> None:
    flat = np.array(equal_earth(np.array(latitude_deg), np.array(longitude_deg)))
    expected = Proj(proj="eqearth", R=1.0)(longitude_deg, latitude_deg)
    np.testing.assert_allclose(flat, expected, rtol=0, atol=1e-9)


def test_no_coast_is_a_chord_across_an_azimuthal_map() -> None:
    for centre in ((-0.6, -1.2), (0.5, -2.0), (-1.2, 2.0)):
        curves = RegionProjection(*centre).curves(list(coast_rings()))
        assert (
            max(np.linalg.norm(np.diff(curve, axis=0), axis=1).max() for curve in curves)
            < 0.3 * EARTH_RADIUS_KM
        )


@given(places, st.floats(0.3, 3.0))
def test_rings_of_a_region_have_it_on_their_left(centre: np.ndarray, radius: float) -> None:
    edge = cap(*centre, radius)
    hole = cap(*centre, 0.5 * radius)
    expected = 2.0 * np.pi * (np.cos(0.5 * radius) - np.cos(radius))
    for sense in (1, -1):
        region = ImpactRegion(0.9, 1.0, ((edge[::sense], hole[::sense]),), centre=tuple(centre))
        (_, rings), *_ = containment_rings(SimpleNamespace(impact_regions=[(region,)]), 0).values()
        area = sum(area_sr(ring) for ring in rings) % (4.0 * np.pi)
        assert area == pytest.approx(expected, rel=3e-3, abs=1e-3)


def test_areas_are_in_words() -> None:
    areas = [
        area_text(value) for value in (0.123, 8.46, 1944.0, 12_345.0, 8_460_000.0, 141e6, np.nan)
    ]
    assert areas == [
        "0.12 km²",
        "8.5 km²",
        "1 900 km²",
        "12 000 km²",
        "8.5 million km²",
        "140 million km²",
        "-",
    ]


def test_places_beyond_a_horizon_are_on_a_map_of_the_whole_earth() -> None:
    assert isinstance(fitting_projection(cap(0.2, 0.3, 1.4)), RegionProjection)
    assert isinstance(fitting_projection(cap(0.2, 0.3, 1.6)[:120]), WorldProjection)


@given(places, radii, st.floats(-900.0, 900.0), st.floats(-450.0, 450.0))
def test_cut_curves_go_round_the_same_points(
    centre: np.ndarray, radius: float, x: float, y: float
) -> None:
    point = np.array([x, y])
    curve = RegionProjection(0.3, 0.2).curves([cap(*centre, radius)])[0]
    cut_curve = clipped(curve, (-1000.0, 1000.0), (-500.0, 500.0))
    if np.linalg.norm(curve - point, axis=1).min() < 5.0:
        return
    assert (winding(cut_curve, point) if len(cut_curve) else 0) == winding(curve, point)
    assert not len(cut_curve) or np.abs(cut_curve).max() <= 1040.0


def test_a_clipped_square_is_a_closed_square() -> None:
    square = np.array([[-2.0, -2.0], [2.0, -2.0], [2.0, 2.0], [-2.0, 2.0], [-2.0, -2.0]])
    clipped_curve = clipped(square, (-1.0, 1.0), (-1.0, 1.0))
    assert (clipped_curve[0] == clipped_curve[-1]).all()
    assert len(clipped_curve) == 5
    # A margin hides the edge of what is filled.
    assert np.all(np.abs(clipped_curve) == np.abs(clipped_curve[0]))
    assert 1.0 <= np.abs(clipped_curve[0, 0]) <= 1.1


def test_lines_over_the_antimeridian_reach_both_edges() -> None:
    line = np.radians([[10.0, 170.0], [10.0, -170.0]])
    segments = WorldProjection().lines(line)
    edge = equal_earth(np.array(10.0), np.array(180.0))[0]
    assert sorted(float(segment[0, 0]) for segment in segments) == pytest.approx(
        [-190 / 180 * edge, 170 / 180 * edge]
    )
    assert all(np.abs(np.diff(segment[:, 0])).max() < 0.05 for segment in segments)


#: Whether places are on land, by hand: their coordinates are those of any atlas.
ATLAS = {
    "Paris": (48.9, 2.4, True),
    "Quito": (-0.2, -78.5, True),
    "South Pole": (-89.0, 0.0, True),
    "Chukotka": (66.5, 179.0, True),
    "Pacific": (0.0, -160.0, False),
    "North Pole": (89.0, 0.0, False),
    "Caspian": (42.0, 50.5, False),
    "Atlantic": (30.0, -40.0, False),
}


@pytest.mark.parametrize("name", ATLAS)
def test_the_coast_encloses_land(name: str) -> None:
    *place_deg, is_land = ATLAS[name]
    place = np.radians(place_deg)
    for latitude_deg, longitude_deg in ((0.0, 0.0), (70.0, 170.0), (-40.0, -100.0)):
        longitude = np.radians(longitude_deg)
        region = RegionProjection(np.radians(latitude_deg), longitude)
        for projection in (region, WorldProjection(longitude)):
            assert is_filled(projection, list(coast_rings()), place) == is_land


def test_the_coast_is_the_pinned_file() -> None:
    folder = Path(opir_report.__file__).parent / "maps"
    digest = hashlib.sha256((folder / "coast.json").read_bytes()).hexdigest()
    assert digest in (folder / "coast.md").read_text(encoding="utf-8")


def test_coordinates_have_their_sides() -> None:
    assert [longitude_text(value) for value in (-190.0, -180.0, -60.0, 0.0, 7.5, 360.0)] == [
        *("170° E", "180°", "60° W", "0°", "7.5° E", "0°")
    ]
    assert [latitude_text(value) for value in (-30.0, 0.0, 60.0)] == ["30° S", "0°", "60° N"]
