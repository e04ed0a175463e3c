"""The `forge` encoder: every event fits the schema and says what the columns say."""

import json
import math
import subprocess
import sys
from typing import Any

import jsonschema
import numpy as np
import pytest
from attrs import evolve
from hypothesis import given, settings
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from opir_core.errors import ModelError, SinkError
from opir_core.events import SCHEMA_VERSION, detection_schema
from opir_core.events.blocks import window_blocks
from opir_core.events.forge import ForgeEncoder
from opir_core.events.identifiers import uuid8_words, uuid_text
from opir_core.events.number_text import rounded_bearing_deg, rounded_degrees
from opir_core.events.timestamps import timestamp_text, unix_microseconds
from opir_core.geometry import azimuth_elevation_range_in_axes, geodetic_to_ecef, local_axes
from opir_core.protocols import Band, EncoderContext
from opir_core.records import Detections, DetectionTruth, Tracks, Window
from opir_core.scene import REPORTED_TYPES
from opir_core.testing import stub_sensor
from opir_core.testing.windows import stub_estimates, stub_window

EPOCH_US = 1_775_044_800_000_000
SENSORS = (
    stub_sensor("SBIRS-GEO-1", -75.5, bands=(Band("SWIR", 2.6, 2.8), Band("MWIR", 4.2, 4.4))),
    stub_sensor('"quoted"\n\\ \u00c4\u2028\U0001f680', orbital_slot_deg=None, type="H\tEO", bands=()),
    stub_sensor("LEO-1", orbital_slot_deg=None, bands=tuple(Band(f"B{n}", 1.0, 2.0) for n in range(8))),
)
ENCODER = ForgeEncoder(EncoderContext(sensors=SENSORS, epoch_us=EPOCH_US))
VALIDATOR = jsonschema.Draft202012Validator(
    detection_schema(), format_checker=jsonschema.Draft202012Validator.FORMAT_CHECKER
)
PAPER_FIELDS = [
    "detection_id",
    "timestamp",
    "sensor_id",
    "sensor_type",
    "orbital_slot",
    "target_type",
    "launch_point",
    "impact_point",
    "confidence",
]
POSITION = st.floats(-1e100, 1e100)
ANGLE = st.floats(-2 * np.pi, 2 * np.pi)


def refuse_constant(name: str) -> None:
    raise AssertionError(f"{name} is no JSON")


def events_of(window: Window, encoder: ForgeEncoder = ENCODER) -> list[dict[str, Any]]:
    lines = encoder.encode(window)
    assert lines.endswith(b"\n") or not lines
    return [json.loads(line, parse_constant=refuse_constant) for line in lines.split(b"\n")[:-1]]


def column(values: st.SearchStrategy[Any], count: int, kind: Any = np.float64, shape: tuple[int, ...] = ()) -> Any:
    return arrays(kind, (count, *shape), elements=values)


@st.composite
def estimates(draw: st.DrawFn) -> Tracks:
    count = draw(st.integers(0, 4))
    covariance = column(st.floats() | st.floats(-1e4, 1e8), count, shape=(3, 3))
    place = column(st.floats() | ANGLE, count, shape=(3,))
    return stub_estimates(
        count,
        tick_s=draw(column(st.floats() | st.floats(0.0, 1e3), count)),
        state=draw(column(st.floats() | st.floats(-1e8, 1e8), count, shape=(6,))),
        launch=draw(place),
        launch_covariance=draw(covariance),
        impact=draw(place),
        impact_covariance=draw(covariance),
    )


@st.composite
def unit_vectors(draw: st.DrawFn, count: int) -> np.ndarray:
    component = st.sampled_from([0.0, -0.0, 1.0, -1.0, 1e-12, 5e-324]) | st.floats(-1.0, 1.0)
    some = draw(column(component, count, shape=(3,)))
    length = np.linalg.norm(some, axis=1, keepdims=True)
    return np.where(length > 1e-100, some / np.maximum(length, 1e-100), [0.0, 0.0, -1.0])


@st.composite
def windows(draw: st.DrawFn) -> Window:
    """Any detections that an event can carry, the extremes included."""
    count = draw(st.integers(0, 8))
    known = draw(estimates())
    sensor = draw(column(st.integers(0, len(SENSORS) - 1), count, np.int32))
    band_ends = np.array([1 << len(each.bands) for each in SENSORS])
    return stub_window(
        count,
        estimates=known,
        sensor=sensor,
        time_ns=draw(column(st.integers(-(2**63) + 1, 2**63 - 1), count, np.int64)),
        detection_id=uuid8_words(draw(column(st.integers(0, 2**64 - 1), count, np.uint64, (2,))), np.arange(count)),
        reported_type=draw(column(st.integers(0, 3), count, np.uint8)),
        bands=draw(column(st.integers(0, 255), count, np.int64)) % band_ends[sensor],
        confidence=draw(column(st.floats(0.0, 1.0), count)),
        line_of_sight_ecef=draw(unit_vectors(count)),
        sensor_ecef_m=draw(column(st.sampled_from([0.0, -4.2e7]) | POSITION, count, shape=(3,))),
        snr=draw(column(st.floats(), count)),
        track=draw(column(st.integers(-1, 2**63 - 1), count, np.int64)),
        estimate=draw(column(st.integers(-1, len(known) - 1), count, np.int64)),
    )


@given(windows())
def test_every_event_fits_the_schema_and_keeps_the_order_of_fields(window: Window) -> None:
    events = events_of(window)
    assert len(events) == len(window.detections)
    for event in events:
        VALIDATOR.validate(event)
        assert list(event) == detection_schema()["required"]
        assert list(event)[:9] == PAPER_FIELDS


@given(windows())
def test_every_event_says_what_its_row_says(window: Window) -> None:
    for row, event in enumerate(events_of(window)):
        d = window.detections
        sensor = SENSORS[d.sensor[row]]
        assert event["detection_id"] == uuid_text(d.detection_id[row : row + 1])[0]
        assert event["timestamp"] == timestamp_text(unix_microseconds(d.time_ns[row : row + 1], EPOCH_US))[0]
        assert (event["sensor_id"], event["sensor_type"]) == (sensor.id, sensor.type)
        assert event["orbital_slot"] == sensor.orbital_slot_deg
        assert event["target_type"] == REPORTED_TYPES[d.reported_type[row]]
        assert event["confidence"] == pytest.approx(d.confidence[row], abs=5.1e-7)
        assert event["schema_version"] == SCHEMA_VERSION
        assert event["track_id"] == (None if d.track[row] < 0 else d.track[row])
        seen = azimuth_elevation_range_in_axes(d.line_of_sight_ecef[row], local_axes(d.sensor_ecef_m[row]))
        turned = abs(event["azimuth_deg"] - math.degrees(seen.azimuth_rad)) % 360.0
        assert min(turned, 360.0 - turned) <= 1e-9
        assert event["elevation_deg"] == pytest.approx(math.degrees(seen.elevation_rad), abs=5.1e-10)
        assert event["line_of_sight_sigma_urad"] == 20.0
        assert event["bands"] == [band.name for bit, band in enumerate(sensor.bands) if d.bands[row] >> bit & 1]
        assert event["sensor_position_ecef_m"] == pytest.approx(d.sensor_ecef_m[row].tolist(), abs=5.1e-4, rel=1e-15)
        if math.isfinite(d.snr[row]):
            assert event["snr"] == pytest.approx(d.snr[row], abs=5.1e-7, rel=1e-15)
        else:
            assert event["snr"] is None


@given(windows(), st.data())
def test_bytes_do_not_depend_on_how_detections_are_cut_into_windows(window: Window, data: st.DataObject) -> None:
    rows = data.draw(st.integers(1, 4))
    parts = [ENCODER.encode(part) for part in window_blocks(window, rows)]
    assert b"".join(parts) == ENCODER.encode(window)


def test_bytes_do_not_depend_on_the_cut_for_many_looks_of_moving_and_resting_sensors() -> None:
    window = raid(600)
    whole = ENCODER.encode(window)
    for rows in (1, 7, 128, 599):
        assert b"".join(ENCODER.encode(part) for part in window_blocks(window, rows)) == whole


def raid(count: int) -> Window:
    random = np.random.default_rng(3)
    sensor = random.integers(0, 3, count)
    home = random.uniform(-4e7, 4e7, (3, 3))[sensor]
    direction = random.normal(size=(count, 3))
    moving = (sensor == 2)[:, np.newaxis] * random.uniform(-1e6, 1e6, (count, 3))
    known = stub_estimates(
        20,
        state=random.uniform(-1.0, 1.0, (20, 6)) * [7e6, 7e6, 7e6, 7e3, 7e3, 7e3],
        launch=random.uniform(-1.5, 1.5, (20, 3)),
        launch_covariance=[[4e6, 1e6, 0.0], [1e6, 9e6, 0.0], [0.0, 0.0, 4.0]],
    )
    return stub_window(
        count,
        estimates=known,
        sensor=sensor,
        bands=0,
        line_of_sight_ecef=direction / np.linalg.norm(direction, axis=1, keepdims=True),
        confidence=random.random(count),
        snr=random.uniform(0, 100, count),
        sensor_ecef_m=home + moving,
        track=random.integers(-1, 20, count),
        estimate=random.integers(-1, 20, count),
    )


@given(windows())
@settings(max_examples=25)
def test_truth_does_not_reach_an_event(window: Window) -> None:
    names = {name for name in DetectionTruth.__slots__ if not name.startswith("_")}
    assert not names & set(detection_schema()["properties"])
    other = evolve(window, truth=window.truth.take(slice(0, 0)))
    assert ENCODER.encode(other) == ENCODER.encode(window)


def test_a_window_without_detections_is_no_bytes() -> None:
    assert ENCODER.encode(stub_window(0)) == b""


def test_without_sensors_there_is_nothing_to_encode() -> None:
    encoder = ForgeEncoder(EncoderContext(sensors=(), epoch_us=0))
    assert encoder.encode(stub_window(0)) == b""
    with pytest.raises(ModelError, match="the sensor must be"):
        encoder.encode(stub_window(1))


def test_until_a_track_is_estimated_its_fields_are_null() -> None:
    (event,) = events_of(stub_window(1))
    unknown = ("launch_point", "impact_point", "track_id", "latitude_deg", "longitude_deg", "altitude_m", "snr")
    assert [event[name] for name in unknown] == [None] * len(unknown)


def test_an_estimated_point_says_where_when_and_how_surely() -> None:
    known = stub_estimates(
        1,
        launch=[np.radians(34.73), np.radians(239.43), 10.25],
        launch_covariance=[[9e6, 0.0, 0.0], [0.0, 1e6, 0.0], [0.0, 0.0, 2.25]],
        impact=[np.radians(9.0), np.radians(167.7), np.nan],
    )
    (event,) = events_of(stub_window(1, estimates=known, estimate=0, track=3))
    assert event["launch_point"] == {
        "lat_deg": 34.73,
        "lon_deg": -120.57,
        "time": "2026-04-01T12:00:10.250000Z",
        "ellipse": {"semi_major_m": 7343.240, "semi_minor_m": 2447.747, "bearing_deg": 90.0, "containment": 0.95},
        "ellipse_50": {"semi_major_m": 3532.230, "semi_minor_m": 1177.410, "bearing_deg": 90.0, "containment": 0.5},
        "ellipse_90": {"semi_major_m": 6437.898, "semi_minor_m": 2145.966, "bearing_deg": 90.0, "containment": 0.9},
        "time_sigma_s": 1.5,
    }
    unknown = dict.fromkeys(("time", "ellipse", "ellipse_50", "ellipse_90", "time_sigma_s"))
    assert event["impact_point"] == {"lat_deg": 9.0, "lon_deg": 167.7} | unknown
    assert event["track_id"] == 3


def test_the_track_s_place_is_carried_to_the_time_of_the_detection() -> None:
    up = np.array([1.0, 0.0, 0.0])
    start = geodetic_to_ecef(0.0, 0.0, 100_000.0)
    known = stub_estimates(1, tick_s=5.0, state=np.concatenate([start, 2000.0 * up]))
    early, late = events_of(stub_window(2, first_scan=5, estimates=known, estimate=0))
    assert [early[name] for name in ("latitude_deg", "longitude_deg", "altitude_m")] == [0.0, 0.0, 100_000.0]
    assert late["altitude_m"] == pytest.approx(102_000.0, abs=1e-3)


def test_estimates_of_other_rows_do_not_matter() -> None:
    known = stub_estimates(2, launch=[[0.1, 0.2, 0.3], [0.4, 0.5, 0.6]])
    first, none, second = events_of(stub_window(3, estimates=known, estimate=[0, -1, 1]))
    assert first["launch_point"]["lat_deg"] == pytest.approx(np.degrees(0.1), abs=1e-9)
    assert none["launch_point"] is None
    assert second["launch_point"]["lat_deg"] == pytest.approx(np.degrees(0.4), abs=1e-9)


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
    assert b'"sensor_position_ecef_m":[0.0,0.0,0.0],' in central


@pytest.mark.parametrize(("up", "elevation_deg"), [(1.0, 90.0), (-1.0, -90.0)])
def test_straight_up_and_down_have_an_azimuth_too(up: float, elevation_deg: float) -> None:
    (event,) = events_of(stub_window(1, line_of_sight_ecef=[up, 0.0, -0.0]))
    assert (event["azimuth_deg"], event["elevation_deg"]) == (0.0, elevation_deg)


def test_rounding_leaves_the_length_of_a_unit_vector_lawful() -> None:
    one, other = events_of(stub_window(2, line_of_sight_ecef=[[1.0 + 9e-7, 0.0, 0.0], [1.0 - 9e-7, 0.0, 0.0]]))
    assert one["elevation_deg"] == other["elevation_deg"] == 90.0


@pytest.mark.parametrize(
    ("columns", "message"),
    [
        ({"confidence": np.nan}, r"confidence must be in \[0, 1\] \(the first is of sensor SBIRS-GEO-1 at 0.0 s\)"),
        ({"confidence": [0.5, -1e-9, 2.0]}, "2 of 3 detections cannot be encoded: the confidence"),
        ({"line_of_sight_ecef": [np.nan, 0.0, 1.0]}, "the line of sight must be a unit vector"),
        ({"line_of_sight_ecef": [0.0, np.inf, 0.0]}, "the line of sight must be a unit vector"),
        ({"line_of_sight_ecef": [0.0, 0.0, -np.inf]}, "the line of sight must be a unit vector"),
        ({"line_of_sight_ecef": 0.0}, "the line of sight must be a unit vector"),
        ({"line_of_sight_ecef": 1e200}, "the line of sight must be a unit vector"),
        ({"line_of_sight_ecef": [1.0 + 1.1e-6, 0.0, 0.0]}, "the line of sight must be a unit vector"),
        ({"line_of_sight_ecef": [0.0, 1.0 - 1.1e-6, 0.0]}, "the line of sight must be a unit vector"),
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


def test_columns_that_may_not_be_written_are_enough() -> None:
    window = stub_window(2)
    assert not window.detections.confidence.flags.writeable
    assert len(events_of(window)) == 2


def test_strided_columns_encode_like_their_copies() -> None:
    window = raid(101)
    reversed_rows = window.detections.take(slice(None, None, -2))
    copied = Detections(*(np.ascontiguousarray(getattr(reversed_rows, name)) for name in names_of(reversed_rows)))
    truth = window.truth.take(slice(0, 0))
    assert ENCODER.encode(evolve(window, detections=reversed_rows, truth=truth)) == ENCODER.encode(
        evolve(window, detections=copied, truth=truth)
    )


def names_of(detections: Detections) -> list[str]:
    return [attribute.name for attribute in type(detections).__attrs_attrs__]


def test_blocks_of_a_window_are_the_window() -> None:
    window = evolve(raid(10), tracks=stub_estimates(3))
    parts = list(window_blocks(window, 4))
    assert [len(part.detections) for part in parts] == [4, 4, 2] == [len(part.truth) for part in parts]
    assert sum(part.looks for part in parts) == window.looks
    assert sum(len(part.tracks) for part in parts) == 3
    assert np.array_equal(np.concatenate([part.detections.scan for part in parts]), window.detections.scan)


def test_naming_the_encoder_imports_no_msgspec() -> None:
    program = (
        "import sys; from opir_core.builtin.encoders import ENCODERS; from opir_core.builtin.sinks import SINKS;"
        "import opir_core.events.identifiers, opir_core.events.timestamps;"
        "assert 'msgspec' not in sys.modules, 'named';"
        "from opir_core.protocols import EncoderContext;"
        "ENCODERS[0].build(ENCODERS[0].config(), EncoderContext(sensors=(), epoch_us=0));"
        "assert 'msgspec' in sys.modules, 'built'"
    )
    done = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True, check=False)
    assert done.returncode == 0, done.stderr
