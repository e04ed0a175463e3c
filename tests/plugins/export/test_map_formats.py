"""GeoJSON, KML and CZML, read back by other people's libraries; footprints against closed forms."""

import json
from collections import Counter
from datetime import datetime, timedelta
from pathlib import Path
from typing import Any

import geojson_validator
import numpy as np
import pytest
import shapely
from czml3 import Document
from exported_runs import exported, short_run
from fastkml import KML, Placemark
from opir_export.formats.geojson import area, cut_line, line
from opir_export.scenery.footprints import footprint
from pyproj import Transformer
from repository import EXAMPLES
from shapely.geometry import shape

import opir_core
from opir_core.geometry import Ellipsoid, elevation_rad, nadir_angle_rad

TO_ECEF = Transformer.from_crs("EPSG:4979", "EPSG:4978", always_xy=True)
RADIUS_M = 6371e3
SPHERE = Ellipsoid(RADIUS_M, 0.0)


@pytest.fixture(scope="module")
def run() -> opir_core.Run:
    return short_run()


@pytest.fixture(scope="module")
def features(run: opir_core.Run, tmp_path_factory: pytest.TempPathFactory) -> list[Any]:
    path = exported(run, "geojson", tmp_path_factory.mktemp("map") / "run.geojson")[0]
    document = json.loads(path.read_text(encoding="utf-8"))
    assert not geojson_validator.validate_structure(document)
    return document["features"]


def of_kind(features: list[Any], kind: str) -> list[Any]:
    return [feature for feature in features if feature["properties"]["kind"] == kind]


def at(latitude_deg: float, longitude_deg: float, radius_m: float) -> np.ndarray:
    latitude, longitude = np.radians([latitude_deg, longitude_deg])
    flat = np.cos(latitude)
    return radius_m * np.array(
        [flat * np.cos(longitude), flat * np.sin(longitude), np.sin(latitude)]
    )


def cylinder(points: np.ndarray) -> np.ndarray:
    """Return Lambert's cylindrical projection, which keeps areas, of longitudes and latitudes,
    degrees.
    """
    return np.stack([np.radians(points[:, 0]), np.sin(np.radians(points[:, 1]))], axis=1)


@pytest.mark.parametrize(
    ("latitude_deg", "longitude_deg", "radius_m", "half_angle_deg"),
    [
        pytest.param(0.0, 180.0, 42.164e6, 10.0, id="full disc from GEO over the antimeridian"),
        pytest.param(0.0, -135.0, 42.164e6, 90.0, id="full disc from GEO"),
        pytest.param(0.0, 179.0, 42.164e6, 5.0, id="cone across the antimeridian"),
        pytest.param(63.4, 100.0, 46e6, 12.0, id="disc with the north pole"),
        pytest.param(-63.4, -179.5, 46e6, 7.0, id="disc with the south pole"),
        pytest.param(10.0, 0.0, 42.164e6, 20.0, id="disc with the pole at its rim"),
        pytest.param(89.999, 0.0, 42.164e6, 3.0, id="cone about the pole"),
        pytest.param(-40.0, 20.0, 7.0e6, 30.0, id="low orbit"),
    ],
)
def test_footprints_on_a_sphere_have_the_area_of_their_caps(
    latitude_deg: float, longitude_deg: float, radius_m: float, half_angle_deg: float
) -> None:
    half_rad = np.radians(half_angle_deg)
    sine = radius_m / RADIUS_M * np.sin(half_rad)
    cap_rad = (
        np.arccos(RADIUS_M / radius_m)
        if half_angle_deg >= 90 or sine >= 1
        else np.arcsin(sine) - half_rad
    )
    ring = footprint(at(latitude_deg, longitude_deg, radius_m), half_rad, ellipsoid=SPHERE)
    outline = shape(area(ring))
    assert outline.is_valid
    minimum = outline.bounds[0]
    maximum = outline.bounds[2]
    assert minimum >= -180.0
    assert maximum <= 180.0
    solid_angle = shapely.transform(shapely.segmentize(outline, 0.1), cylinder).area
    assert solid_angle == pytest.approx(2.0 * np.pi * (1.0 - np.cos(cap_rad)), rel=1e-4)
    assert (
        outline.contains(shapely.Point(longitude_deg, latitude_deg)) or abs(longitude_deg) == 180.0
    )


def test_lines_of_sight_touch_the_ellipsoid_at_the_horizon() -> None:
    position = at(20.0, -179.0, 42.164e6)
    ring = footprint(position, np.radians(30.0))
    ground = np.stack(TO_ECEF.transform(*np.degrees(ring.T[::-1]), np.zeros(len(ring))), axis=1)
    latitude, longitude = ring.T
    up = np.stack(
        [
            np.cos(latitude) * np.cos(longitude),
            np.cos(latitude) * np.sin(longitude),
            np.sin(latitude),
        ],
        axis=1,
    )
    sight = position - ground
    elevation = np.arcsin(np.einsum("ki,ki->k", up, sight) / np.linalg.norm(sight, axis=1))
    assert np.abs(elevation).max() < 1e-6


def test_cone_and_least_elevation_bound_the_ellipsoid() -> None:
    position = at(-35.0, 60.0, 7.4e6)
    ring = footprint(position, np.radians(35.0))
    ground = np.stack(TO_ECEF.transform(*np.degrees(ring.T[::-1]), np.zeros(len(ring))), axis=1)
    assert np.degrees(nadir_angle_rad(position, ground)) == pytest.approx(35.0, abs=1e-7)
    ring = footprint(position, np.radians(89.0), np.radians(25.0))
    ground = np.stack(TO_ECEF.transform(*np.degrees(ring.T[::-1]), np.zeros(len(ring))), axis=1)
    assert np.degrees(elevation_rad(ground, position)) == pytest.approx(25.0, abs=1e-7)


def test_lines_are_cut_at_the_antimeridian_where_they_cross_it() -> None:
    there_and_back = np.array([[170.0, 0.0], [-170.0, 10.0], [-160.0, 12.0], [175.0, 19.0]])
    pieces = cut_line(there_and_back)
    assert [piece[[0, -1], 0].tolist() for piece in pieces] == [
        [170.0, 180.0],
        [-180.0, -180.0],
        [180.0, 175.0],
    ]
    assert pieces[0][-1, 1] == pieces[1][0, 1] == 5.0
    assert pieces[1][-1, 1] == pieces[2][0, 1] == pytest.approx(12.0 + 7.0 * 20.0 / 25.0)
    assert len(cut_line(np.array([[10.0, 0.0], [20.0, 5.0]]))) == 1


@pytest.mark.parametrize(
    ("longitudes_deg", "kind", "parts"),
    [
        ([-180.0, 179.9, 179.5], "LineString", 1),
        ([180.0, 179.9, 179.5], "LineString", 1),
        ([180.0, -179.9, -179.5], "LineString", 1),
        ([178.0, 179.0, 180.0], "LineString", 1),
        ([-178.0, -179.0, 180.0], "LineString", 1),
        ([-178.0, -179.0, -180.0], "LineString", 1),
        ([180.0, -180.0, 180.0], "LineString", 1),
        ([179.9999999, 180.0, 179.0], "MultiLineString", 2),
        ([179.0, 180.0, 179.0], "MultiLineString", 2),
        ([179.0, -180.0, -179.0, 180.0, 179.0], "MultiLineString", 3),
        ([179.0, -179.0], "MultiLineString", 2),
    ],
)
def test_lines_that_touch_the_antimeridian_are_valid(
    longitudes_deg: list[float], kind: str, parts: int
) -> None:
    places = np.stack(
        [longitudes_deg, np.arange(len(longitudes_deg)) * 1.0, np.zeros(len(longitudes_deg))],
        axis=1,
    )
    geometry = line(places)
    outline = shape(geometry)
    assert outline.is_valid
    assert (geometry["type"], len(getattr(outline, "geoms", [outline]))) == (kind, parts)
    assert not geojson_validator.validate_geometries(geometry)["invalid"]


@pytest.mark.parametrize("longitude_deg", [-180.0, 180.0, 179.9999999, 12.0])
def test_a_line_of_one_place_is_a_point(longitude_deg: float) -> None:
    geometry = line(np.array([[longitude_deg, 5.0, 0.0], [longitude_deg, 5.0, 900.0]]))
    assert geometry["type"] == "Point"
    assert shape(geometry).is_valid


@pytest.mark.parametrize("seed", range(20))
def test_drawn_lines_about_the_antimeridian_are_valid(seed: int) -> None:
    rng = np.random.default_rng(seed)
    longitudes = rng.choice([-180.0, 180.0, 179.0, -179.0, 179.9999996, -179.9999996, 178.3], 12)
    geometry = line(np.stack([longitudes, rng.uniform(-5.0, 5.0, 12), np.zeros(12)], axis=1))
    assert shape(geometry).is_valid


def test_geojson_has_what_the_run_has(run: opir_core.Run, features: list[Any]) -> None:
    kinds = Counter(feature["properties"]["kind"] for feature in features)
    assert kinds["sensor"] == kinds["footprint"] == len(run.sensors)
    assert kinds["ground track"] == kinds["launch"] == kinds["impact"] == len(run.target_ids)
    reported = run.tracks.take(np.flatnonzero(run.tracks.tick_s == run.tracks.tick_s[-1]))
    assert kinds["predicted impact"] == np.isfinite(reported.impact).all(axis=1).sum() > 0
    for feature in features:
        outline = shape(feature["geometry"])
        assert outline.is_valid, feature["properties"]
        assert -180.0 <= outline.bounds[0] <= outline.bounds[2] <= 180.0


def test_launches_and_impacts_are_the_truth(run: opir_core.Run, features: list[Any]) -> None:
    truths = {truth["id"]: truth for truth in run.plan.targets.truth()}
    for kind in ("launch", "impact"):
        for feature in of_kind(features, kind):
            expected = truths[feature["properties"]["target_id"]][kind]
            assert feature["geometry"]["coordinates"] == pytest.approx(
                [expected["lon_deg"], expected["lat_deg"], 0.0], abs=1e-4
            )
    track = next(
        feature
        for feature in of_kind(features, "ground track")
        if feature["properties"]["target_id"] == "T1"
    )
    end_place = track["geometry"]["coordinates"][-1][-1]
    assert end_place[:2] == pytest.approx([167.7, 9.0], abs=1e-4)


def test_regions_and_satellites_are_those_of_the_run(
    run: opir_core.Run, features: list[Any]
) -> None:
    tracks = run.tracks
    regions_of = {
        track: tracks.impact_regions[np.flatnonzero(tracks.track == track)[-1]]
        for track in (0, 1, 2)
    }
    regions = of_kind(features, "impact region")
    assert len(regions) == sum(map(len, regions_of.values()))
    for feature in regions:
        properties = feature["properties"]
        flown_region = {
            region.containment: region for region in regions_of[properties["track_id"]]
        }[properties["containment"]]
        solid_angle = shapely.transform(
            shapely.segmentize(shape(feature["geometry"]), 0.1), cylinder
        ).area
        assert solid_angle * 6371.0088**2 == pytest.approx(flown_region.area_km2, rel=0.02)
    for feature, sensor in zip(of_kind(features, "sensor"), run.sensors, strict=True):
        position = TO_ECEF.transform(*feature["geometry"]["coordinates"])
        assert np.allclose(
            position, sensor.orbit.position_ecef_m(np.zeros(1))[0], atol=6.0
        )  # 1e-6 degrees


def test_kml_is_valid_and_read_back_with_times_and_places(
    run: opir_core.Run, tmp_path: Path
) -> None:
    path = exported(run, "kml", tmp_path / "run.kml", "step_s=20")[0]
    document = KML.parse(path).features[0]  # checks the schema too
    sensors, targets, predicted = document.features
    assert len(sensors.features) == 2 * len(run.sensors)
    flight = next(feature for feature in targets.features if feature.name == "T1")
    items = flight.kml_geometry.track_items
    epoch = datetime.fromisoformat(str(np.datetime64(run.plan.scene.epoch_us, "us")) + "+00:00")
    truth = run.plan.targets.truth()[0]
    assert abs(items[0].when.dt - epoch - timedelta(seconds=truth["ignition_s"])) < timedelta(
        microseconds=2
    )
    assert abs(
        items[-1].when.dt - epoch - timedelta(seconds=truth["impact"]["time_s"])
    ) < timedelta(microseconds=2)
    assert (items[-1].coord.x, items[-1].coord.y) == pytest.approx((167.7, 9.0), abs=1e-5)
    regions = [feature for feature in predicted.features if "%" in feature.name]
    tracks = run.tracks
    regions_of = [
        tracks.impact_regions[np.flatnonzero(tracks.track == track)[-1]]
        for track in np.unique(tracks.track)
    ]
    assert len(regions) == sum(map(len, regions_of)) > 0
    for region in regions:
        assert isinstance(region, Placemark)
        assert shape(region.geometry.__geo_interface__).is_valid
        assert abs(region.begin.dt - epoch - timedelta(seconds=90)) < timedelta(microseconds=2)


def test_czml_is_read_back_with_positions_and_availability(
    run: opir_core.Run, tmp_path: Path
) -> None:
    path = exported(run, "czml", tmp_path / "run.czml", "regions=all")[0]
    packets = Document.model_validate(
        {"packets": json.loads(path.read_text(encoding="utf-8"))}
    ).packets
    by_id = {packet.id: packet for packet in packets}
    assert len(by_id) == len(packets)
    assert packets[0].id == "document"
    samples = np.array(by_id["target/T2"].position.cartesian.values).reshape(-1, 4)
    targets = run.plan.targets
    number = run.target_ids.index("T2")
    burning = samples[:, 0] + targets.ignition_s[number] <= targets.burnout_s[number]
    times = samples[burning, 0] + targets.ignition_s[number]
    expected = targets.position_ecef_m(np.full(len(times), number, dtype=np.int32), times)
    assert np.allclose(samples[burning, 1:], expected, atol=2e-3)
    still = by_id["sensor/DSP-1"].position.cartesian.values
    assert np.allclose(still, run.sensors[0].orbit.position_ecef_m(np.zeros(1))[0], atol=1e-3)
    regions = [packet for packet in packets if packet.polygon is not None]
    rows = run.tracks.impact_regions.tolist()
    assert len({packet.id for packet in regions}) >= len({id(row) for row in rows})
    assert by_id["target/T2"].availability.start < by_id["target/T2"].availability.end


def test_moving_sensors_have_tracks(tmp_path: Path) -> None:
    scene = opir_core.load_scene(
        EXAMPLES / "arctic_watch.yaml", overrides=["duration_s=120", "tracker=none"]
    )
    run = opir_core.simulate(scene)
    moving = [sensor for sensor in run.sensors if not sensor.orbit.is_stationary]
    assert moving
    path = exported(run, "geojson", tmp_path / "run.geojson", "regions=none", "footprints=false")[0]
    features = json.loads(path.read_text(encoding="utf-8"))["features"]
    assert len(of_kind(features, "satellite track")) == len(moving)
    assert not of_kind(features, "footprint")
    path = exported(run, "czml", tmp_path / "run.czml")[0]
    packets = {packet["id"]: packet for packet in json.loads(path.read_text(encoding="utf-8"))}
    samples = np.array(packets[f"sensor/{moving[0].id}"]["position"]["cartesian"]).reshape(-1, 4)
    assert np.allclose(samples[:, 1:], moving[0].orbit.position_ecef_m(samples[:, 0]), atol=1e-3)
    sensors = (
        KML.parse(exported(run, "kml", tmp_path / "run.kml")[0]).features[0].features[0].features
    )
    assert any(hasattr(feature.kml_geometry, "track_items") for feature in sensors)


@pytest.mark.parametrize(
    "longitudes_deg", [[-180.0, 178.0], [180.0, -178.0], [178.0, 180.0], [-178.0, -179.0, 180.0]]
)
def test_lines_that_end_on_the_180th_meridian_are_valid(
    longitudes_deg: list[float],
) -> None:
    places = np.array(
        [[longitude, -17.0 - 0.1 * row, 0.0] for row, longitude in enumerate(longitudes_deg)]
    )
    outline = shape(line(places))
    assert outline.is_valid
    assert outline.geom_type == "LineString"
    assert len(outline.coords) == len(longitudes_deg)
