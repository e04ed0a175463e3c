"""The encoders `forge-c2` and `udl`: every event fits its schema and says what the columns say, and
none is at 0, 0.
"""

import json
import math
from typing import Any

import jsonschema
import numpy as np
import pytest
from attrs import evolve
from command_line import run_command
from forge_events import refuse_constant
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import arrays
from opir_testing import stub_estimates, stub_sensor, stub_window

from examples import examples
from opir_core import Tracks, Window
from opir_core.errors import ModelError
from opir_core.geometry import ecef_to_geodetic, geodetic_to_ecef, grazing_height_m
from opir_core.output import timestamp_text, unix_microseconds
from opir_core.output.events.encoder_input import window_blocks
from opir_core.plugin import REPORTED_TYPES, Band, EncoderContext, EventEncoder, Host
from opir_core.random_streams import uuid_text

EPOCH_US = 1_775_044_800_000_000
SENSORS = (
    stub_sensor("SBIRS-GEO-1", -75.5, bands=(Band("SWIR", 2.6, 2.8), Band("MWIR", 4.2, 4.4))),
    stub_sensor('"quoted"\n\\ \u00c4\u2028', orbital_slot_deg=None, type="H\tEO", bands=()),
)
CONTEXT = EncoderContext(sensors=SENSORS, epoch_us=EPOCH_US)
MODELS = {name: Host.discover().component(EventEncoder, name) for name in ("forge-c2", "udl")}
C2, UDL = (model.build(model.config(), CONTEXT) for model in MODELS.values())
FORMATS = jsonschema.Draft202012Validator.FORMAT_CHECKER
SCHEMAS = {name: json.loads(model.schema()) for name, model in MODELS.items()}
VALIDATORS = {
    name: jsonschema.Draft202012Validator(schema, format_checker=FORMATS)
    for name, schema in SCHEMAS.items()
}
#: The stub's sensor stands over the equator at longitude 0, and looks straight down.
DOWN = np.array([-1.0, 0.0, 0.0])


def events_of(encoder: Any, window: Window) -> list[dict[str, Any]]:
    name = "forge-c2" if encoder is C2 else "udl"
    lines = encoder.encode(window)
    assert lines.endswith(b"\n") or not lines
    events = [json.loads(line, parse_constant=refuse_constant) for line in lines.split(b"\n")[:-1]]
    for event in events:
        VALIDATORS[name].validate(event)
    return events


@st.composite
def estimates(draw: st.DrawFn) -> Tracks:
    count = draw(st.integers(0, 4))

    def column(values: st.SearchStrategy[float], *shape: int) -> Any:
        return draw(arrays(np.float64, (count, *shape), elements=values))

    return stub_estimates(
        count,
        tick_s=column(st.floats() | st.floats(0.0, 1e3)),
        state=column(st.floats() | st.floats(-1e7, 1e7), 6),
        launch=column(st.floats() | st.floats(-7.0, 7.0), 3),
        launch_covariance=column(st.floats() | st.floats(-1e4, 1e8), 3, 3),
        impact=column(st.floats() | st.floats(-7.0, 7.0), 3),
        impact_covariance=column(st.floats() | st.floats(-1e4, 1e8), 3, 3),
        impact_sigmas=column(st.floats() | st.floats(0.0, 4.0), 3),
    )


@st.composite
def windows(draw: st.DrawFn) -> Window:
    count = draw(st.integers(0, 8))
    tracks = draw(estimates())
    sensor = draw(arrays(np.int32, count, elements=st.integers(0, 1)))
    aside = draw(
        arrays(np.float64, (count, 3), elements=st.floats(-0.3, 0.3) | st.floats(-3.0, 3.0))
    )
    looks = DOWN + aside
    length = np.linalg.norm(looks, axis=1, keepdims=True)
    return stub_window(
        count,
        estimates=tracks,
        sensor=sensor,
        reported_ns=draw(arrays(np.int64, count, elements=st.integers(0, 2**62))),
        bands=draw(arrays(np.uint8, count, elements=st.integers(0, 3))) * (sensor == 0),
        reported_type=draw(arrays(np.uint8, count, elements=st.integers(0, 3))),
        confidence=draw(arrays(np.float64, count, elements=st.floats(0.0, 1.0))),
        line_of_sight_ecef=np.where(length > 1e-3, looks / np.maximum(length, 1e-3), DOWN),
        snr=draw(arrays(np.float64, count, elements=st.floats())),
        track=draw(arrays(np.int64, count, elements=st.integers(-1, 2**63 - 1))),
        estimate=draw(arrays(np.int64, count, elements=st.integers(-1, len(tracks) - 1))),
    )


def time_text(time_ns: int) -> str:
    """Return a scene time as the events have it."""
    return timestamp_text(unix_microseconds(np.array([time_ns]), EPOCH_US))[0]


@given(windows())
def test_flat_events_fit_their_schema_and_rows(window: Window) -> None:
    rows = np.flatnonzero(C2.encodable(window)) if len(window.detections) else []
    events = events_of(C2, window)
    assert len(events) == len(rows)
    d = window.detections
    for row, event in zip(rows, events, strict=True):
        assert list(event) == SCHEMAS["forge-c2"]["required"]
        assert event["event_id"] == uuid_text(d.detection_id[row : row + 1])[0]
        assert event["sensor_id"] == SENSORS[d.sensor[row]].id
        assert event["timestamp"] == time_text(d.time_ns[row])
        assert event["reported_at"] == time_text(d.reported_ns[row])
        assert event["confidence"] == pytest.approx(d.confidence[row], abs=5.1e-7)
        assert event["snr"] == (
            pytest.approx(d.snr[row], abs=5.1e-7, rel=1e-15) if math.isfinite(d.snr[row]) else None
        )


@given(windows())
def test_missile_tracks_fit_their_schema_and_rows(window: Window) -> None:
    events = events_of(UDL, window)
    d = window.detections
    assert len(events) == len(d)
    for row, event in enumerate(events):
        assert event["id"] == uuid_text(d.detection_id[row : row + 1])[0]
        assert event["ts"] == time_text(d.reported_ns[row])
        assert all(vector["epoch"] == time_text(d.time_ns[row]) for vector in event["vectors"])
        assert event["trkConf"] == pytest.approx(d.confidence[row], abs=5.1e-7)
        assert event.get("acftSubType", "UNKNOWN") == REPORTED_TYPES[d.reported_type[row]]
        assert event.get("trackId") == (None if d.track[row] < 0 else str(d.track[row]))
        assert all(
            vector["origSensorId"] == SENSORS[d.sensor[row]].id for vector in event["vectors"]
        )


@pytest.mark.parametrize("encoder", [C2, UDL])
@given(data=st.data())
@examples(40)
def test_bytes_do_not_depend_on_the_windows(encoder: Any, data: st.DataObject) -> None:
    window = data.draw(windows())
    pieces = [
        encoder.encode(piece) for piece in window_blocks(window, data.draw(st.integers(1, 4)))
    ]
    assert b"".join(pieces) == encoder.encode(window)


def looking(*directions: Any) -> Window:
    return stub_window(
        len(directions),
        line_of_sight_ecef=[
            np.divide(direction, np.linalg.norm(direction)) for direction in directions
        ],
    )


def test_without_a_track_an_event_is_on_the_ground() -> None:
    place = geodetic_to_ecef(np.radians(35.0), np.radians(-20.0), 0.0)
    sensor = stub_window(1).detections.sensor_ecef_m[0]
    (event,) = events_of(C2, looking(place - sensor))
    assert (event["latitude"], event["longitude"], event["altitude"]) == (35.0, -20.0, 0.0)
    (record,) = events_of(UDL, looking(place - sensor))
    (vector,) = record["vectors"]
    assert (vector["type"], vector["vectorLat"], vector["vectorLon"], vector["vectorAlt"]) == (
        "LOS",
        35.0,
        -20.0,
        0.0,
    )


def test_a_line_of_sight_that_misses_the_earth_has_no_flat_event() -> None:
    sensor = stub_window(1).detections.sensor_ecef_m[0]
    above_the_limb = np.array([0.0, 0.0, 6.6e6]) - sensor
    assert grazing_height_m(sensor, np.array([0.0, 0.0, 6.6e6]) * 2 - sensor) > 0.0
    window = looking(above_the_limb, DOWN, -DOWN)
    assert C2.encodable(window).tolist() == [False, True, False]
    assert len(events_of(C2, window)) == 1
    assert [len(record["vectors"]) for record in events_of(UDL, window)] == [0, 1, 0]


@given(windows())
def test_no_flat_event_is_where_nothing_is_known(window: Window) -> None:
    """0 N 0 E is below the stub's sensor: only a look straight down, or an estimate there, may be
    there.
    """
    straight_down = (
        window.detections.line_of_sight_ecef[:, 0] < -1.0 + 1e-15
        if len(window.detections)
        else np.empty(0)
    )
    for event in events_of(C2, window):
        assert isinstance(event["latitude"], float)
        if (event["latitude"], event["longitude"]) == (0.0, 0.0):
            assert straight_down.any() or (window.detections.estimate >= 0).any()


@pytest.mark.parametrize("state", [np.nan, 0.0, 1e200, np.inf])
def test_an_invalid_estimate_gives_way_to_the_line_of_sight(state: float) -> None:
    tracks = stub_estimates(1, state=np.full(6, state))
    aside = np.array([-1.0, 0.05, 0.1]) / np.linalg.norm([-1.0, 0.05, 0.1])
    window = stub_window(1, estimates=tracks, estimate=0, track=1, line_of_sight_ecef=aside)
    (event,) = events_of(C2, window)
    assert event["altitude"] == 0.0
    assert event["latitude"] > 1.0
    (record,) = events_of(UDL, window)
    assert record["vectors"][0]["type"] == "LOS"


def test_estimates_are_carried_to_the_detections_time() -> None:
    start = geodetic_to_ecef(np.radians(28.5), np.radians(-80.6), 90_000.0)
    up = start / np.linalg.norm(start)
    tracks = stub_estimates(1, tick_s=5.0, state=np.concatenate([start, 2000.0 * up]))
    window = stub_window(10, first_scan=5, estimates=tracks, estimate=0, track=4)
    start_event, *_, end_event = events_of(C2, window)
    assert (start_event["latitude"], start_event["longitude"], start_event["altitude"]) == (
        28.5,
        -80.6,
        90_000.0,
    )
    end_place = ecef_to_geodetic(start + 9.0 * 2000.0 * up)
    assert end_event["altitude"] == pytest.approx(end_place.height_m, abs=1e-3)
    start_record, *_, end_record = events_of(UDL, window)
    assert (start_record["env"], end_record["env"]) == ("AIR", "SPACE")
    vector = end_record["vectors"][0]
    assert vector["pos"] == pytest.approx(((start + 9.0 * 2000.0 * up) * 1e-3).tolist(), abs=1e-6)
    assert vector["vel"] == pytest.approx((2.0 * up).tolist(), abs=1e-6)
    assert end_record["trackId"] == "4"


def test_a_missile_track_says_where_it_comes_down_and_how_surely() -> None:
    tracks = stub_estimates(
        1,
        launch=[np.radians(34.73), np.radians(239.43), 10.25],
        impact=[np.radians(9.0), np.radians(167.7), np.nan],
        impact_covariance=np.diag([9e6, 1e6, 1.0]),
    )
    (record,) = events_of(UDL, stub_window(1, estimates=tracks, estimate=0, track=3))
    assert record["dataMode"] == "SIMULATED"
    assert (record["launchLat"], record["launchLon"]) == (34.73, -120.57)
    assert record["launchTime"] == "2026-04-01T12:00:10.250000Z"
    assert "launchAouData" not in record
    assert (record["impactLat"], record["impactLon"]) == (9.0, 167.7)
    assert (record["impactAouType"], record["impactAouData"]) == (
        "ELLIPSE",
        [90.0, 7.34324, 2.447747],
    )
    assert record["containment"] == 95.0
    tracks = evolve(tracks, impact_sigmas=np.array([[1.0, 2.0, 3.0]]))
    (record,) = events_of(UDL, stub_window(1, estimates=tracks, estimate=0, track=3))
    assert record["impactAouData"] == [90.0, 9.0, 3.0]
    assert "impactTime" not in record
    (record,) = events_of(
        UDL,
        stub_window(1, estimates=evolve(tracks, impact_method=np.array([1])), estimate=0, track=7),
    )
    assert (record["impactLat"], record["impactLon"]) == (9.0, 167.7)
    assert not record.keys() & {"impactAouType", "impactAouData"}


def test_intensity_and_frequency_are_those_of_the_bands() -> None:
    window = stub_window(3, bands=[2, 3, 0])
    measured = np.array([[1e-9, 2e-9], [np.nan, 5e-10], [np.nan, np.nan]])
    window = evolve(window, detections=evolve(window.detections, band_irradiance_w_m2=measured))
    events = events_of(C2, window)
    assert [event["intensity"] for event in events] == [pytest.approx(3e-9), 5e-10, None]
    assert events[0]["frequency"] == pytest.approx(299_792_458.0 / 4.3e-6, abs=1.0)
    assert events[1]["frequency"] == pytest.approx(299_792_458.0 / 2.7e-6, abs=1.0)
    assert events[2]["frequency"] is None


@pytest.mark.parametrize("encoder", [C2, UDL])
def test_what_no_event_can_carry_is_refused(encoder: Any) -> None:
    with pytest.raises(ModelError, match="the confidence must be"):
        encoder.encode(stub_window(1, confidence=np.nan))
    assert encoder.encode(stub_window(0)) == b""


def test_a_flat_event_as_bytes() -> None:
    line = C2.encode(stub_window(1, snr=12.5, confidence=0.75, line_of_sight_ecef=DOWN))
    assert line == (
        b'{"event_id":"a858e668-c86e-854e-9ed3-24bc9e33e1f7","timestamp":"2026-04-01T12:00:00.000000Z","sensor'
        b'_id":"SBIRS-GEO-1","sensor_type":"OPIR","latitude":0.0,"longitude":0.0,"altitude":0.0,"azimuth":0.0,'
        b'"elevation":-90.0,"signal_type":"IR","intensity":null,"frequency":111034243703704.0,"snr":12.5,"conf'
        b'idence":0.75,"reported_at":"2026-04-01T12:00:00.000000Z"}\n'
    )


def test_a_missile_track_as_bytes() -> None:
    tracks = stub_estimates(
        1,
        state=[6.5e6, 0.0, 0.0, 10.0, 20.0, 30.0],
        impact=[0.125, 0.25, 1200.0],
        impact_covariance=np.diag([4e6, 1e6, 1.0]),
    )
    line = UDL.encode(
        stub_window(
            1, estimates=tracks, estimate=0, track=7, reported_type=0, line_of_sight_ecef=DOWN
        )
    )
    assert line == (
        b'{"classificationMarking":"U","dataMode":"SIMULATED","source":"opir","msgType":"OPIR","id":"a858e668-'
        b'c86e-854e-9ed3-24bc9e33e1f7","ts":"2026-04-01T12:00:00.000000Z","objType":"MISSILE","acftSubType":"I'
        b'CBM","infoSource":"STUB","angElev":-90.0,"trkConf":0.5,"trackId":"7","impactLat":7.161972439,"impact'
        b'Lon":14.323944878,"impactTime":"2026-04-01T12:20:00.000000Z","impactAouType":"ELLIPSE","impactAouDat'
        b'a":[90.0,4.895494,2.447747],"containment":95.0,"env":"SPACE","vectors":[{"type":"STATE","origSensorI'
        b'd":"SBIRS-GEO-1","timeSource":"SCENE","epoch":"2026-04-01T12:00:00.000000Z","vectorLat":0.0,"vectorL'
        b'on":0.0,"vectorAlt":121.863,"referenceFrame":"ECEF","propagated":true,"pos":[6500.0,0.0,0.0],"vel":['
        b"0.01,0.02,0.03]}]}\n"
    )


@pytest.mark.parametrize("name", sorted(SCHEMAS))
def test_the_command_prints_the_schema(name: str, capsys: pytest.CaptureFixture[str]) -> None:
    run_command("schema {}", name)
    reported = json.loads(capsys.readouterr().out)
    assert reported == SCHEMAS[name]
    jsonschema.Draft202012Validator.check_schema(reported)
