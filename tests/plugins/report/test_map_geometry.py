"""Maps: caps, areas and regions on the sphere, against closed forms and pyproj, over the poles and
the antimeridian.
"""

import hashlib
from pathlib import Path
from types import SimpleNamespace

import numpy as np
import opir_report.maps.base_map
import pytest
from hypothesis import example, given, strategies as st
from opir_report.maps.base_map import coast_rings, latitude_text, longitude_text
from opir_report.maps.clipping import clipped
from opir_report.maps.projections import (
    RegionProjection,
    WorldProjection,
    equal_earth,
    fitting_projection,
)
from opir_report.maps.spheres import EARTH_RADIUS_KM, area_sr, cap, refined, turns, unit_vectors
from opir_report.plots.impact import area_text
from opir_report.run_facts import containment_rings
from pyproj import Geod, Proj

from opir_core.plugin import ImpactRegion

latitudes = st.floats(-1.55, 1.55)
longitudes = st.floats(-3.14, 3.14)
radii = st.floats(0.02, 1.4)
wide_radii = st.floats(0.02, 3.1)


def winding(curve: np.ndarray, x: float, y: float) -> int:
    """Return how often a closed curve goes round a point."""
    angle = np.unwrap(np.arctan2(curve[:, 1] - y, curve[:, 0] - x))
    return round((angle[-1] - angle[0]) / (2.0 * np.pi))


@given(latitudes, longitudes, radii)
def test_a_cap_has_its_area_and_its_inside_on_the_left(
    latitude: float, longitude: float, radius: float
) -> None:
    ring = cap(latitude, longitude, radius, points=721)
    assert area_sr(ring) == pytest.approx(2.0 * np.pi * (1.0 - np.cos(radius)), rel=2e-3, abs=2e-5)


def test_only_rings_round_a_pole_turn() -> None:
    assert [turns(cap(latitude, 3.0, 0.3)) for latitude in (1.4, 0.0, -1.4)] == [1, 0, -1]


@given(latitudes, longitudes, latitudes, longitudes)
def test_refined_lines_follow_the_great_circle(
    latitude: float, longitude: float, other: float, further: float
) -> None:
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
def test_the_region_projection_is_that_of_proj(
    latitude: float, longitude: float, other: float, further: float
) -> None:
    radius_m = 1e3 * EARTH_RADIUS_KM
    proj = Proj(proj="aeqd", R=radius_m, lat_0=np.degrees(latitude), lon_0=np.degrees(longitude))
    own = RegionProjection(latitude, longitude)
    flat = own.points(np.array([other]), np.array([further]))[0]
    if np.hypot(*flat) > 3.1 * EARTH_RADIUS_KM:
        return
    np.testing.assert_allclose(
        flat, np.array(proj(np.degrees(further), np.degrees(other))) / 1e3, rtol=0, atol=1e-3
    )
    back = unit_vectors(*own.places(flat[None]).T)[0]
    np.testing.assert_allclose(
        back, unit_vectors(np.array([other]), np.array([further]))[0], rtol=0, atol=1e-9
    )


def filled_at(
    projection: RegionProjection | WorldProjection, rings: list[np.ndarray], place: np.ndarray
) -> bool:
    """Return whether a region is filled at a place on a map."""
    x, y = projection.points(place[:1], place[1:])[0]
    return sum(winding(curve, x, y) for curve in projection.curves(rings)) != 0


@given(latitudes, longitudes, wide_radii, latitudes, longitudes, latitudes, longitudes)
def test_a_region_holds_on_the_map_what_it_holds_on_the_sphere(
    latitude: float,
    longitude: float,
    radius: float,
    there: float,
    east: float,
    centre: float,
    meridian: float,
) -> None:
    ring = cap(latitude, longitude, radius, points=721)
    geod = Geod(a=1.0, b=1.0)
    distance = geod.inv(*np.degrees([longitude, latitude, east, there]))[2]
    if abs(distance - radius) < 2e-3:
        return
    for projection in (WorldProjection(meridian), RegionProjection(centre, meridian)):
        assert filled_at(projection, [ring], np.array([there, east])) == (distance < radius)


@given(
    latitudes,
    longitudes,
    st.floats(0.1, 1.4),
    st.floats(1.5, 3.0),
    latitudes,
    longitudes,
    latitudes,
    longitudes,
)
@example(1.5, 0.0, 0.3, 2.8, 0.0, 1.0, 0.0, 0.0)
def test_a_belt_round_the_earth_is_filled_between_its_rings(
    latitude: float,
    longitude: float,
    near: float,
    far: float,
    there: float,
    east: float,
    centre: float,
    meridian: float,
) -> None:
    rings = [
        cap(latitude, longitude, far, points=721),
        cap(latitude, longitude, near, points=721)[::-1],
    ]
    distance = Geod(a=1.0, b=1.0).inv(*np.degrees([longitude, latitude, east, there]))[2]
    if min(abs(distance - near), abs(distance - far)) < 2e-3:
        return
    for projection in (WorldProjection(meridian), RegionProjection(centre, meridian)):
        assert filled_at(projection, rings, np.array([there, east])) == (near < distance < far)


@given(st.floats(-90.0, 90.0), st.floats(-180.0, 180.0))
def test_the_map_of_the_earth_is_equal_earth(latitude_deg: float, longitude_deg: float) -> None:
    own = np.array(equal_earth(np.array(latitude_deg), np.array(longitude_deg)))
    np.testing.assert_allclose(
        own, Proj(proj="eqearth", R=1.0)(longitude_deg, latitude_deg), rtol=0, atol=1e-9
    )


def test_no_coast_is_a_chord_across_an_azimuthal_map() -> None:
    for centre in ((-0.6, -1.2), (0.5, -2.0), (-1.2, 2.0)):
        curves = RegionProjection(*centre).curves(list(coast_rings()))
        assert (
            max(np.linalg.norm(np.diff(curve, axis=0), axis=1).max() for curve in curves)
            < 0.3 * EARTH_RADIUS_KM
        )


@given(latitudes, longitudes, st.floats(0.3, 3.0))
def test_rings_of_a_region_have_it_on_their_left(
    latitude: float, longitude: float, radius: float
) -> None:
    outer = cap(latitude, longitude, radius)
    hole = cap(latitude, longitude, 0.5 * radius)
    for turned in (1, -1):
        region = ImpactRegion(
            0.9, 1.0, ((outer[::turned], hole[::turned]),), centre=(latitude, longitude)
        )
        (_, rings), *_ = containment_rings(SimpleNamespace(impact_regions=[(region,)]), 0).values()
        due = 2.0 * np.pi * (np.cos(0.5 * radius) - np.cos(radius))
        assert sum(area_sr(ring) for ring in rings) % (4.0 * np.pi) == pytest.approx(
            due, rel=3e-3, abs=1e-3
        )


def test_areas_are_in_words() -> None:
    areas = [
        area_text(each) for each in (0.123, 8.46, 1944.0, 12_345.0, 8_460_000.0, 141e6, np.nan)
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


@given(latitudes, longitudes, radii, st.floats(-900.0, 900.0), st.floats(-450.0, 450.0))
def test_cut_curves_go_round_what_they_went_round(
    latitude: float, longitude: float, radius: float, x: float, y: float
) -> None:
    curve = RegionProjection(0.3, 0.2).curves([cap(latitude, longitude, radius)])[0]
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
    east = equal_earth(np.array(10.0), np.array(180.0))[0]
    assert sorted(float(part[0, 0]) for part in parts) == pytest.approx(
        [-190 / 180 * east, 170 / 180 * east]
    )
    assert all(np.abs(np.diff(part[:, 0])).max() < 0.05 for part in parts)


def test_the_coast_is_land_where_there_is_land() -> None:
    """Places by hand: their coordinates are those of any atlas."""
    places = {
        "Paris": (48.9, 2.4),
        "Quito": (-0.2, -78.5),
        "South Pole": (-89.0, 0.0),
        "Chukotka": (66.5, 179.0),
    }
    seas = {
        "Pacific": (0.0, -160.0),
        "North Pole": (89.0, 0.0),
        "Caspian": (42.0, 50.5),
        "Atlantic": (30.0, -40.0),
    }
    for centre in ((0.0, 0.0), (70.0, 170.0), (-40.0, -100.0)):
        for projection in (
            RegionProjection(*np.radians(centre)),
            WorldProjection(np.radians(centre[1])),
        ):
            for known, is_land in ((places, True), (seas, False)):
                for name, place in known.items():
                    assert (
                        filled_at(projection, list(coast_rings()), np.radians(place)) == is_land
                    ), name


def test_the_coast_is_the_pinned_file() -> None:
    folder = Path(opir_report.maps.base_map.__file__).parent
    found = hashlib.sha256((folder / "coast.json").read_bytes()).hexdigest()
    assert found in (folder / "coast.md").read_text(encoding="utf-8")


def test_coordinates_have_their_sides() -> None:
    assert [longitude_text(each) for each in (-190.0, -180.0, -60.0, 0.0, 7.5, 360.0)] == [
        *("170° E", "180°", "60° W", "0°", "7.5° E", "0°")
    ]
    assert [latitude_text(each) for each in (-30.0, 0.0, 60.0)] == ["30° S", "0°", "60° N"]
