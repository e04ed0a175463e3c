"""Counts, ground tracks, fields of view, impacts and areas of reports, against the run."""

import numpy as np
import pytest
from attrs import evolve
from matplotlib.axes import Axes
from opir_report import SERIES, RunPlots
from opir_report.palette import Hues
from opir_report.plots.flights import cap_radius_rad
from reported_runs import empty_run, example_run, report_data, scored_run

from opir_core.geometry import ecef_to_geodetic, geodesic_inverse, geodetic_to_ecef
from opir_core.planning import visible_now


def words_of(axes: Axes) -> str:
    return " ".join(text.get_text() for text in axes.texts)


def test_the_timeline_counts_every_detection_once() -> None:
    run = example_run("first_light")
    counts = report_data(run)["detections"]
    for row in run.summary["sensors"]:
        detections = counts["detections"][counts["sensor_id"] == row["sensor_id"]]
        assert detections.sum() == row["detections"] > 0
    start_s = counts["start_s"][counts["target_id"] == "T1"].min()
    width_s = float(np.median(counts["stop_s"] - counts["start_s"]))
    assert start_s <= run.summary["targets"][0]["first_detection_s"] < start_s + width_s


@pytest.mark.slow
def test_false_alarms_are_counted_without_a_target() -> None:
    run = example_run("photons")
    counts = report_data(run)["detections"]
    noise = counts["detections"][counts["target_id"] == ""].sum()
    assert noise == sum(row["noise_detections"] for row in run.summary["sensors"])
    assert set(counts["target_id"].tolist()) - {"T1", "T2", ""}


def test_ground_tracks_go_from_launch_to_impact() -> None:
    run = example_run("arctic_watch", tracker="none")
    tracks = RunPlots(run).ground_tracks
    for truth in run.plan.targets.truth():
        track = tracks.at("target_id", truth["id"])
        for row, point in ((0, truth["launch"]), (-1, truth["impact"])):
            places = (
                [track["latitude_deg"][row]],
                [track["longitude_deg"][row]],
                [point["lat_deg"]],
                [point["lon_deg"]],
            )
            assert geodesic_inverse(*np.radians(places)).distance_m[0] < 1.0
        burning = track["is_burning"]
        last_s = track["time_s"][burning].max()
        assert track["time_s"][~burning].min() > truth["burnout_s"] == last_s


@pytest.mark.slow
def test_a_target_does_not_burn_between_its_burns() -> None:
    run = example_run("gravity_turn", duration_s=60)
    tracks = RunPlots(run).ground_tracks
    points = 0
    for name, gaps_s in zip(run.target_ids, run.plan.targets.dark_gaps_s, strict=False):
        track = tracks.at("target_id", name)
        for start_s, stop_s in gaps_s[np.isfinite(gaps_s[:, 0])]:
            in_gap = (track["time_s"] > start_s) & (track["time_s"] < stop_s)
            assert not track["is_burning"][in_gap].any()
            points += int(np.count_nonzero(in_gap))
    assert points


@pytest.mark.slow
def test_fields_of_view_end_at_the_edge_of_visibility() -> None:
    """Within a degree: the ellipsoid is up to 14 km lower than the sphere, and its vertical 0.2
    degrees off.
    """
    run = example_run("arctic_watch", tracker="none")
    views = report_data(run)["satellites"]
    for sensor, view in zip(run.sensors, views, strict=True):
        position = sensor.orbit.position_ecef_m(np.array([10.0]))
        height_km = 1e-3 * ecef_to_geodetic(position).height_m[0]
        unit = position[0] / np.linalg.norm(position)
        for bearing in np.linspace(0.0, 6.0, 7):
            for offset_deg in (-1.0, 1.0):
                radius = np.radians(view["radius_deg"] + offset_deg)
                latitude, longitude = _displaced(unit, bearing, radius)
                ground = geodetic_to_ecef(np.array([latitude]), np.array([longitude]), np.zeros(1))
                assert bool(visible_now(sensor, position, ground)[0]) == (offset_deg < 0.0)
        assert view["height_km"] == pytest.approx(height_km, rel=1e-6)


def _displaced(unit: np.ndarray, bearing: float, radius: float) -> tuple[float, float]:
    east = np.cross([0.0, 0.0, 1.0], unit)
    east /= np.linalg.norm(east)
    direction = np.cos(bearing) * np.cross(unit, east) + np.sin(bearing) * east
    x, y, z = np.cos(radius) * unit + np.sin(radius) * direction
    # Geocentric latitude to geodetic, on the surface of WGS 84.
    return float(np.arctan2(z, np.hypot(x, y) * (1.0 - 0.00669438))), float(np.arctan2(y, x))


def test_a_narrow_field_of_regard_bounds_the_view() -> None:
    sensor = evolve(
        example_run("first_light").sensors[0], field_of_regard_half_angle_rad=np.radians(2.0)
    )
    # From geostationary radius 2 degrees off nadir: sin(2) times 6.6182 is sin(13.36), less the 2
    # degrees.
    assert np.degrees(cap_radius_rad(sensor, 42164.17e3)) == pytest.approx(11.36, abs=0.02)


@pytest.mark.slow
def test_impacts_and_areas_are_those_of_the_summary() -> None:
    run = scored_run()
    (point,) = report_data(run)["impacts"]
    track = run.summary["tracks"][0]["impact"]
    truth = run.plan.targets.truth()[0]["impact"]
    assert point["predicted_latitude_deg"] == pytest.approx(track["lat_deg"])
    assert point["predicted_longitude_deg"] == pytest.approx(track["lon_deg"])
    assert point["true_longitude_deg"] == pytest.approx(truth["lon_deg"])
    assert point["area_95_km2"] == pytest.approx(track["region_95_km2"])
    assert point["area_50_km2"] < point["area_90_km2"] < point["area_95_km2"]


@pytest.mark.slow
def test_without_regions_the_ellipses_are_drawn() -> None:
    from opir_report.maps.spheres import EARTH_RADIUS_KM, area_sr
    from opir_report.run_facts import RunFacts, containment_rings

    run = scored_run()
    regions = np.empty(len(run.tracks), dtype=object)
    regions.fill(())
    tracks = evolve(run.tracks, impact_regions=regions)
    area_km2, (ring,) = containment_rings(tracks, RunFacts(run).last_with_impact[0])[0.95]
    assert area_sr(ring) * EARTH_RADIUS_KM**2 == pytest.approx(area_km2, rel=0.01)


def test_an_empty_plot_says_why() -> None:
    plots = RunPlots(empty_run())
    assert "no launches" in words_of(plots.map())
    assert "detected" in words_of(plots.timeline())
    assert "no impact" in words_of(plots.impact())
    assert plots.world().lines


def test_an_unknown_target_is_named_with_those_of_the_run() -> None:
    with pytest.raises(KeyError, match="no target 'T9'; it has T1"):
        RunPlots(scored_run()).impact("T9")


def test_many_targets_have_the_colours_of_their_types() -> None:
    few = Hues.of(["A", "B"], ["ICBM", "ICBM"])
    assert [hue.label for hue in few.legend] == ["A (ICBM)", "B (ICBM)"]
    assert few.of_target[0].colour != few.of_target[1].colour
    many = Hues.of([str(number) for number in range(9)], ["ICBM", "SRBM", "ICBM"] * 3)
    assert [hue.label for hue in many.legend] == ["ICBM", "SRBM"]
    assert many.of_target[0] == many.of_target[2] != many.of_target[1]
    assert len(set(SERIES)) == len(SERIES)
