"""Numbers in events of `forge`: places on Earth or null, bearings below 360, zeros without a
sign.
"""

from typing import Any

import numpy as np
import pytest
from forge_events import ENCODER, EPOCH_US, SENSORS, events_of
from opir_testing import stub_estimates, stub_window

from opir_core.errors import ModelError, SinkError
from opir_core.geometry import geodetic_to_ecef
from opir_core.output import ForgeEncoder, rounded_bearing_deg, rounded_degrees
from opir_core.plugin import EncoderContext

#: Encodes where tracks put objects.
PLACED = ForgeEncoder(EncoderContext(sensors=SENSORS, epoch_us=EPOCH_US), has_positions=True)
#: Encodes points with their uncertainties.
FULL = ForgeEncoder(EncoderContext(sensors=SENSORS, epoch_us=EPOCH_US), has_tracks=True)


def test_until_a_track_is_estimated_its_fields_are_null() -> None:
    (event,) = events_of(stub_window(1))
    unknown = (
        "launch_point",
        "impact_point",
        "track_id",
        "snr",
    )
    assert [event[name] for name in unknown] == [None] * len(unknown)


def test_an_estimated_point_says_where_when_and_how_surely() -> None:
    estimates = stub_estimates(
        1,
        launch=[np.radians(34.73), np.radians(239.43), 10.25],
        launch_covariance=[[9e6, 0.0, 0.0], [0.0, 1e6, 0.0], [0.0, 0.0, 2.25]],
        impact=[np.radians(9.0), np.radians(167.7), np.nan],
    )
    window = stub_window(1, estimates=estimates, estimate=0, track=3)
    (short,) = events_of(window)
    assert short["launch_point"] == {"lat_deg": 34.73, "lon_deg": -120.57}
    assert short["impact_point"] == {"lat_deg": 9.0, "lon_deg": 167.7}
    (event,) = events_of(window, FULL)
    assert event["launch_point"] == {
        "lat_deg": 34.73,
        "lon_deg": -120.57,
        "time": "2026-04-01T12:00:10.250000Z",
        "ellipse": {
            "semi_major_m": 7343.240,
            "semi_minor_m": 2447.747,
            "bearing_deg": 90.0,
            "containment": 0.95,
        },
        "ellipse_50": {
            "semi_major_m": 3532.230,
            "semi_minor_m": 1177.410,
            "bearing_deg": 90.0,
            "containment": 0.5,
        },
        "ellipse_90": {
            "semi_major_m": 6437.898,
            "semi_minor_m": 2145.966,
            "bearing_deg": 90.0,
            "containment": 0.9,
        },
        "time_sigma_s": 1.5,
    }
    unknown = dict.fromkeys(("time", "ellipse", "ellipse_50", "ellipse_90", "time_sigma_s"))
    method = {"method": "posterior", "containment": None, "sigma_m": None}
    assert event["impact_point"] == {"lat_deg": 9.0, "lon_deg": 167.7} | unknown | method
    assert event["track_id"] == 3


@pytest.mark.parametrize("radii", [np.nan, [1.0, 2.0, 3.0]])
def test_impacts_by_the_papers_law_have_a_sigma(radii: Any) -> None:
    estimates = stub_estimates(
        2,
        impact=[np.radians(9.0), np.radians(167.7), 1200.0],
        impact_covariance=np.diag([9e8, 9e8, 25.0]),
        impact_sigmas=radii,
        impact_method=[1, 0],
    )
    paper, posterior = (
        event["impact_point"]
        for event in events_of(stub_window(2, estimates=estimates, estimate=[0, 1]), FULL)
    )
    figures = (
        "method",
        "containment",
        "sigma_m",
        "ellipse",
        "ellipse_50",
        "ellipse_90",
        "time_sigma_s",
    )
    assert [paper[name] for name in figures] == ["paper", None, 30_000.0, None, None, None, 5.0]
    assert [posterior[name] for name in figures[:3]] == ["posterior", 0.95, None]
    assert posterior["ellipse"]["semi_major_m"] > 0.0


def test_positions_are_propagated_to_the_detection() -> None:
    up = np.array([1.0, 0.0, 0.0])
    start = geodetic_to_ecef(0.0, 0.0, 100_000.0)
    estimates = stub_estimates(1, tick_s=5.0, state=np.concatenate([start, 2000.0 * up]))
    window = stub_window(2, first_scan=5, estimates=estimates, estimate=0)
    early_event, delayed = events_of(window, PLACED)
    assert events_of(window, FULL)[1]["altitude_m"] == delayed["altitude_m"]
    assert "altitude_m" not in events_of(window)[1]
    assert [early_event[name] for name in ("latitude_deg", "longitude_deg", "altitude_m")] == [
        0.0,
        0.0,
        100_000.0,
    ]
    assert delayed["altitude_m"] == pytest.approx(102_000.0, abs=1e-3)


def test_estimates_of_other_rows_do_not_matter() -> None:
    estimates = stub_estimates(2, launch=[[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]])
    first_value, none, second = events_of(stub_window(3, estimates=estimates, estimate=[0, -1, 1]))
    assert first_value["launch_point"]["lat_deg"] == pytest.approx(np.degrees(0.1), abs=5.1e-5)
    assert none["launch_point"] is None
    assert second["launch_point"]["lat_deg"] == pytest.approx(np.degrees(0.4), abs=5.1e-5)


@pytest.mark.parametrize(
    ("place", "expected"),
    [
        ([np.nan, 0.0, 0.0], None),
        ([0.0, np.inf, 0.0], None),
        ([1.6, 0.0, 0.0], None),
        ([0.0, np.pi, 0.0], -180.0),
        ([0.0, 7 * np.pi, 0.0], -180.0),
        ([0.0, -1e-17, 0.0], 0.0),
    ],
)
def test_a_place_is_on_earth_or_null(place: list[float], expected: float | None) -> None:
    (event,) = events_of(stub_window(1, estimates=stub_estimates(1, launch=place), estimate=0))
    point = event["launch_point"]
    assert (point and point["lon_deg"]) == expected


# The stub's sensor stands over the equator at longitude 0: up is x, east is y, north is z.
@pytest.mark.parametrize(
    ("east", "bearing"),
    [
        (0.0, b"0.0"),
        (-0.0, b"0.0"),
        (-5e-324, b"0.0"),
        (-1e-17, b"0.0"),
        (-1e-14, b"0.0"),
        (-8e-12, b"0.0"),
        (-9e-12, b"359.999999999"),
        (9e-12, b"1e-9"),
    ],
)
def test_north_is_0_and_never_360(east: float, bearing: bytes) -> None:
    line = ENCODER.encode(stub_window(1, line_of_sight_ecef=[0.0, east, 1.0]))
    assert b'"azimuth_deg":%b,' % bearing in line


@pytest.mark.parametrize("azimuth_rad", [2 * np.pi, -2 * np.pi, -1e-17, -0.0, 2 * np.pi - 1e-14])
def test_a_bearing_of_a_full_turn_rounds_to_0(azimuth_rad: float) -> None:
    for beside in (0.0, 1.0, -1.0):
        bearing_deg = rounded_bearing_deg(np.array([azimuth_rad, beside]))[0]
        assert bearing_deg == 0.0
        assert not np.signbit(bearing_deg)


@pytest.mark.parametrize("angle_rad", [-0.0, -1e-13])
def test_zero_has_no_sign(angle_rad: float) -> None:
    assert not np.signbit(rounded_degrees(np.array([angle_rad])))
    level = ENCODER.encode(stub_window(1, line_of_sight_ecef=[angle_rad, 0.0, 1.0], snr=angle_rad))
    assert b'"elevation_deg":0.0,' in level
    assert b'"snr":0.0,"sensor_position_ecef_m":' in level
    central = ENCODER.encode(stub_window(1, sensor_ecef_m=angle_rad))
    assert b'"sensor_position_ecef_m":[0.0,0.0,0.0]}' in central


@pytest.mark.parametrize(("up", "elevation_deg"), [(1.0, 90.0), (-1.0, -90.0)])
def test_straight_up_and_down_have_an_azimuth_too(up: float, elevation_deg: float) -> None:
    (event,) = events_of(stub_window(1, line_of_sight_ecef=[up, 0.0, -0.0]))
    assert (event["azimuth_deg"], event["elevation_deg"]) == (0.0, elevation_deg)


def test_rounding_leaves_the_length_of_a_unit_vector_lawful() -> None:
    event, turned_event = events_of(
        stub_window(2, line_of_sight_ecef=[[1.0 + 9e-7, 0.0, 0.0], [1.0 - 9e-7, 0.0, 0.0]])
    )
    assert event["elevation_deg"] == turned_event["elevation_deg"] == 90.0


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        (
            {"confidence": np.nan},
            r"confidence must be in \[0, 1\] \(the first is of sensor SBIRS-GEO-1 at 0.0 s\)",
        ),
        ({"confidence": [0.5, -1e-9, 2.0]}, "2 of 3 detections cannot be encoded: the confidence"),
        ({"line_of_sight_ecef": [np.nan, 0.0, 1.0]}, "the line of sight must be a unit vector"),
        ({"line_of_sight_ecef": [0.0, np.inf, 0.0]}, "the line of sight must be a unit vector"),
        ({"line_of_sight_ecef": [0.0, 0.0, -np.inf]}, "the line of sight must be a unit vector"),
        ({"line_of_sight_ecef": 0.0}, "the line of sight must be a unit vector"),
        ({"line_of_sight_ecef": 1e200}, "the line of sight must be a unit vector"),
        (
            {"line_of_sight_ecef": [1.0 + 1.1e-6, 0.0, 0.0]},
            "the line of sight must be a unit vector",
        ),
        (
            {"line_of_sight_ecef": [0.0, 1.0 - 1.1e-6, 0.0]},
            "the line of sight must be a unit vector",
        ),
        ({"sensor_ecef_m": [0.0, np.nan, 0.0]}, "position"),
        ({"sensor_ecef_m": [-np.inf, 0.0, np.inf]}, "position"),
        ({"sensor_ecef_m": [0.0, -1.1e100, 0.0]}, "position"),
        ({"sensor": 3}, "the sensor must be in 0 to 2"),
        ({"sensor": -1}, "of sensor number -1"),
        ({"reported_type": 4}, "reported type"),
        ({"bands": 4}, "bands"),
        ({"sensor": 1, "bands": 1}, "bands"),
        ({"estimate": 0}, "estimate"),
        ({"estimate": -2}, "estimate"),
    ],
)
def test_what_no_event_can_carry_is_refused(columns: dict[str, Any], message: str) -> None:
    with pytest.raises(ModelError, match=message):
        ENCODER.encode(stub_window(3, **columns))


def test_a_year_that_no_timestamp_can_say_is_refused() -> None:
    encoder = ForgeEncoder(EncoderContext(sensors=SENSORS, epoch_us=253_402_300_799_000_000))
    assert encoder.encode(stub_window(1))
    with pytest.raises(SinkError, match="1 of 2 times"):
        encoder.encode(stub_window(2))
