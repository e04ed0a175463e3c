"""What plots show is what the run says: counts, ground tracks, fields of view, impacts and
areas.
"""

import numpy as np
import pytest
from attrs import evolve
from matplotlib import pyplot
from matplotlib.axes import Axes
from opir_report import RunPlots
from opir_report.palette import SERIES, Hues
from opir_report.plots.flights import cap_radius_rad, fields_of_view, ground_tracks
from opir_report.plots.impact import impact_points
from opir_report.plots.timeline import detection_counts
from opir_report.run_facts import RunFacts, containment_rings
from reported_runs import empty_run, example_run, scored_run

from opir_core.geometry import ecef_to_geodetic, geodesic_inverse, geodetic_to_ecef
from opir_core.planning.visibility import visible_now


@pytest.fixture(autouse=True)
def closed_figures():
    pyplot.switch_backend("agg")
    yield
    pyplot.close("all")


def words_of(axes: Axes) -> str:
    return " ".join(text.get_text() for text in axes.texts)


def test_the_timeline_counts_every_detection_once() -> None:
    run = example_run("first_light")
    counts = detection_counts(RunFacts(run))
    for row in run.summary["sensors"]:
        own = counts.where(counts["sensor_id"] == row["sensor_id"])
        assert own["detections"].sum() == row["detections"] > 0
    first = counts.where(counts["target_id"] == "T1")["start_s"].min()
    width_s = float(np.median(counts["stop_s"] - counts["start_s"]))
    assert first <= run.summary["targets"][0]["first_detection_s"] < first + width_s


@pytest.mark.slow
def test_false_alarms_are_counted_without_a_target() -> None:
    run = example_run("photons")
    counts = detection_counts(RunFacts(run))
    noise = counts.where(counts["target_id"] == "")["detections"].sum()
    assert noise == sum(row["noise_detections"] for row in run.summary["sensors"])
    assert set(counts["target_id"].tolist()) - {"T1", "T2", ""}


def test_ground_tracks_begin_at_the_launch_and_end_at_the_impact() -> None:
    run = example_run("arctic_watch", tracker="none")
    tracks = ground_tracks(run.plan)
    for truth in run.plan.targets.truth():
        own = tracks.where(tracks["target_id"] == truth["id"])
        for row, point in ((0, truth["launch"]), (-1, truth["impact"])):
            lat_deg = own["latitude_deg"][row]
            lon_deg = own["longitude_deg"][row]
            apart = geodesic_inverse(
                *np.radians([[lat_deg], [lon_deg], [point["lat_deg"]], [point["lon_deg"]]])
            )
            assert apart.distance_m[0] < 1.0
        assert (
            own["time_s"][~own["is_burning"]].min()
            > truth["burnout_s"]
            == own["time_s"][own["is_burning"]].max()
        )


@pytest.mark.slow
def test_a_target_does_not_burn_between_its_burns() -> None:
    run = example_run("gravity_turn", duration_s=60)
    tracks = ground_tracks(run.plan)
    seen = 0
    for row, name in enumerate(run.target_ids):
        own = tracks.where(tracks["target_id"] == name)
        for start_s, stop_s in run.plan.targets.dark_gaps_s[row][
            np.isfinite(run.plan.targets.dark_gaps_s[row, :, 0])
        ]:
            inside = (own["time_s"] > start_s) & (own["time_s"] < stop_s)
            assert not own["is_burning"][inside].any()
            seen += int(np.count_nonzero(inside))
    assert seen


@pytest.mark.slow
def test_fields_of_view_end_where_the_ground_is_no_longer_visible() -> None:
    """Within a degree: the ellipsoid is up to 14 km lower than the sphere, and its vertical 0.2
    degrees off.
    """
    run = example_run("arctic_watch", tracker="none")
    for sensor, row in zip(run.sensors, range(len(run.sensors)), strict=True):
        views = fields_of_view(run.plan)
        position = sensor.orbit.position_ecef_m(np.array([10.0]))
        centre = ecef_to_geodetic(position)
        unit = position[0] / np.linalg.norm(position)
        for bearing in np.linspace(0.0, 6.0, 7):
            for offset_deg in (-1.0, 1.0):
                radius = np.radians(views["radius_deg"][row] + offset_deg)
                latitude, longitude = _moved(unit, bearing, radius)
                ground = geodetic_to_ecef(np.array([latitude]), np.array([longitude]), np.zeros(1))
                assert bool(visible_now(sensor, position, ground)[0]) == (offset_deg < 0.0)
        assert views["height_km"][row] == pytest.approx(1e-3 * centre.height_m[0], rel=1e-6)


def _moved(unit: np.ndarray, bearing: float, radius: float) -> tuple[float, float]:
    east = np.cross([0.0, 0.0, 1.0], unit)
    east /= np.linalg.norm(east)
    way = np.cos(bearing) * np.cross(unit, east) + np.sin(bearing) * east
    x, y, z = np.cos(radius) * unit + np.sin(radius) * way
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
    points = impact_points(RunFacts(run))
    track = run.summary["tracks"][0]["impact"]
    truth = run.plan.targets.truth()[0]["impact"]
    assert points["predicted_latitude_deg"][0] == pytest.approx(track["lat_deg"])
    assert points["predicted_longitude_deg"][0] == pytest.approx(track["lon_deg"])
    assert points["true_longitude_deg"][0] == pytest.approx(truth["lon_deg"])
    assert points["area_95_km2"][0] == pytest.approx(track["region_95_km2"])
    assert points["area_50_km2"][0] < points["area_90_km2"][0] < points["area_95_km2"][0]


@pytest.mark.slow
def test_without_regions_the_ellipses_are_drawn() -> None:
    run = scored_run()
    row = RunFacts(run).last_with_impact[0]
    nothing = np.empty(len(run.tracks), dtype=object)
    nothing.fill(())
    tracks = evolve(run.tracks, impact_regions=nothing)
    area_km2, (ring,) = containment_rings(tracks, row)[0.95]
    from opir_report.maps.spheres import EARTH_RADIUS_KM, area_sr

    assert area_sr(ring) * EARTH_RADIUS_KM**2 == pytest.approx(area_km2, rel=0.01)


@pytest.mark.slow
def test_each_plot_returns_the_axes_that_it_was_given() -> None:
    plots = RunPlots(scored_run())
    for name in ("map", "world", "timeline", "impact"):
        _, axes = pyplot.subplots()
        assert getattr(plots, name)(ax=axes) is axes
        assert isinstance(getattr(plots, name)(), Axes)


def test_where_there_is_nothing_the_plot_says_so() -> None:
    plots = RunPlots(empty_run())
    assert "no launches" in words_of(plots.map())
    assert "detected" in words_of(plots.timeline())
    assert "no impact" in words_of(plots.impact())
    assert plots.world().lines


def test_an_unknown_target_is_named_with_those_that_there_are() -> None:
    with pytest.raises(KeyError, match="no target 'T9'; it has T1"):
        RunPlots(scored_run()).impact("T9")


def test_few_targets_have_colours_of_their_own_and_many_those_of_their_types() -> None:
    few = Hues.of(["A", "B"], ["ICBM", "ICBM"])
    assert [hue.label for hue in few.legend] == ["A (ICBM)", "B (ICBM)"]
    assert few.of_target[0].colour != few.of_target[1].colour
    many = Hues.of([str(number) for number in range(9)], ["ICBM", "SRBM", "ICBM"] * 3)
    assert [hue.label for hue in many.legend] == ["ICBM", "SRBM"]
    assert many.of_target[0] == many.of_target[2] != many.of_target[1]
    assert len(set(SERIES)) == len(SERIES)
