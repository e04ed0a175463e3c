"""Maps: caps, areas and regions on the sphere, against closed forms and pyproj, over the poles and the antimeridian."""

import hashlib
from pathlib import Path

import numpy as np
import opir_report.maps.base_map
import pytest
from hypothesis import given, strategies as st
from opir_report.maps.base_map import coast_rings, latitude_text, longitude_text
from opir_report.maps.clipping import clipped
from opir_report.maps.projections import RegionProjection, WorldProjection
from opir_report.maps.spheres import EARTH_RADIUS_KM, area_sr, cap, oriented, refined, turns, unit_vectors
from pyproj import Geod, Proj

latitudes = st.floats(-1.55, 1.55)
longitudes = st.floats(-3.14, 3.14)
radii = st.floats(0.02, 1.4)


def winding(curve: np.ndarray, x: float, y: float) -> int:
    """Return how often a closed curve goes round a point."""
    angle = np.unwrap(np.arctan2(curve[:, 1] - y, curve[:, 0] - x))
    return round((angle[-1] - angle[0]) / (2.0 * np.pi))


@given(latitudes, longitudes, radii)
def test_a_cap_has_its_area_and_its_inside_on_the_left(latitude: float, longitude: float, radius: float) -> None:
    ring = cap(latitude, longitude, radius, points=721)
    assert area_sr(ring) == pytest.approx(2.0 * np.pi * (1.0 - np.cos(radius)), rel=2e-3, abs=2e-5)
    assert oriented(ring) is ring
    np.testing.assert_array_equal(oriented(ring[::-1]), ring)
    np.testing.assert_array_equal(oriented(ring, is_hole=True), ring[::-1])


def test_only_rings_round_a_pole_turn() -> None:
    assert [turns(cap(latitude, 3.0, 0.3)) for latitude in (1.4, 0.0, -1.4)] == [1, 0, -1]


@given(latitudes, longitudes, latitudes, longitudes)
def test_refined_lines_follow_the_great_circle(latitude: float, longitude: float, other: float, further: float) -> None:
    line = np.array([[latitude, longitude], [other, further]])
    fine = refined(line, 0.05)
    unit = unit_vectors(*fine.T)
    ends = unit_vectors(*line.T)
    apart = float(np.arctan2(np.linalg.norm(np.cross(*ends)), ends[0] @ ends[1]))
    if apart > 3.1:
        return
    normal = np.cross(*ends)
    assert np.abs(unit @ normal).max() < 1e-12
    steps = np.arccos(np.clip(np.sum(unit[1:] * unit[:-1], axis=1), -1.0, 1.0))
    assert steps.sum() == pytest.approx(apart, abs=1e-6)
    assert steps.max(initial=0.0) < 0.0501


@given(latitudes, longitudes, latitudes, longitudes)
def test_the_region_projection_is_that_of_proj(latitude: float, longitude: float, other: float, further: float) -> None:
    radius_m = 1e3 * EARTH_RADIUS_KM
    proj = Proj(proj="aeqd", R=radius_m, lat_0=np.degrees(latitude), lon_0=np.degrees(longitude))
    own = RegionProjection(latitude, longitude)
    flat = own.points(np.array([other]), np.array([further]))[0]
    if np.hypot(*flat) > 3.1 * EARTH_RADIUS_KM:
        return
    np.testing.assert_allclose(flat, np.array(proj(np.degrees(further), np.degrees(other))) / 1e3, rtol=0, atol=1e-3)
    back = unit_vectors(*own.places(flat[None]).T)[0]
    np.testing.assert_allclose(back, unit_vectors(np.array([other]), np.array([further]))[0], rtol=0, atol=1e-9)


@given(latitudes, longitudes, radii, latitudes, longitudes, latitudes, longitudes)
def test_a_region_holds_on_the_map_what_it_holds_on_the_sphere(
    latitude: float, longitude: float, radius: float, there: float, east: float, centre: float, meridian: float
) -> None:
    ring = cap(latitude, longitude, radius, points=721)
    geod = Geod(a=1.0, b=1.0)
    distance = geod.inv(*np.degrees([longitude, latitude, east, there]))[2]
    if abs(distance - radius) < 2e-3:
        return
    world, region = WorldProjection(meridian), RegionProjection(centre, meridian)
    for projection in (world, region):
        x, y = projection.points(np.array([there]), np.array([east]))[0]
        around = sum(winding(curve, x, y) for curve in projection.rings(ring))
        assert (around != 0) == (distance < radius)


@given(latitudes, longitudes, radii, st.floats(-900.0, 900.0), st.floats(-450.0, 450.0))
def test_cut_curves_go_round_what_they_went_round(
    latitude: float, longitude: float, radius: float, x: float, y: float
) -> None:
    curve = RegionProjection(0.3, 0.2).rings(cap(latitude, longitude, radius))[-1]
    cut = clipped(curve, (-1000.0, 1000.0), (-500.0, 500.0))
    if np.linalg.norm(curve - np.array([x, y]), axis=1).min() < 5.0:
        return
    due = winding(curve, x, y)
    assert (winding(cut, x, y) if len(cut) else 0) == due
    assert not len(cut) or np.abs(cut).max() <= 1040.0


def test_a_clipped_square_is_a_closed_square() -> None:
    square = np.array([[-2.0, -2.0], [2.0, -2.0], [2.0, 2.0], [-2.0, 2.0], [-2.0, -2.0]])
    cut = clipped(square, (-1.0, 1.0), (-1.0, 1.0))
    assert (cut[0] == cut[-1]).all()
    assert len(cut) == 5
    # A margin hides the edge of what is filled.
    assert np.all(np.abs(cut) == np.abs(cut[0]))
    assert 1.0 <= np.abs(cut[0, 0]) <= 1.1


def test_lines_over_the_antimeridian_reach_both_edges_of_the_world() -> None:
    line = np.radians([[10.0, 170.0], [10.0, -170.0]])
    parts = WorldProjection().lines(line)
    assert len(parts) == 2
    assert sorted(round(float(part[0, 0])) for part in parts) == [-190, 170]
    assert all(np.abs(np.diff(part[:, 0])).max() < 2.0 for part in parts)


def test_the_coast_is_land_where_there_is_land() -> None:
    """Places by hand: their coordinates are those of any atlas."""
    places = {"Paris": (48.9, 2.4), "Quito": (-0.2, -78.5), "South Pole": (-89.0, 0.0), "Chukotka": (66.5, 179.0)}
    seas = {"Pacific": (0.0, -160.0), "North Pole": (89.0, 0.0), "Caspian": (42.0, 50.5), "Atlantic": (30.0, -40.0)}
    for centre in ((0.0, 0.0), (70.0, 170.0), (-40.0, -100.0)):
        for projection in (RegionProjection(*np.radians(centre)), WorldProjection(np.radians(centre[1]))):
            curves = [curve for ring in coast_rings() for curve in projection.rings(ring)]
            for known, is_land in ((places, True), (seas, False)):
                for name, place in known.items():
                    x, y = projection.points(*np.radians([place]).T)[0]
                    assert (sum(winding(curve, x, y) for curve in curves) != 0) == is_land, name


def test_the_coast_is_the_pinned_file() -> None:
    folder = Path(opir_report.maps.base_map.__file__).parent
    found = hashlib.sha256((folder / "coast.json").read_bytes()).hexdigest()
    assert found in (folder / "coast.md").read_text(encoding="utf-8")


def test_coordinates_have_their_sides() -> None:
    assert [longitude_text(each) for each in (-190.0, -180.0, -60.0, 0.0, 7.5, 360.0)] == [
        *("170° E", "180°", "60° W", "0°", "7.5° E", "0°")
    ]
    assert [latitude_text(each) for each in (-30.0, 0.0, 60.0)] == ["30° S", "0°", "60° N"]
