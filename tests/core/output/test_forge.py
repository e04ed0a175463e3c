"""The `forge` encoder: every event fits the schema and says what the columns say."""

import math
import subprocess
import sys
from typing import Any

import jsonschema
import numpy as np
import pytest
from attrs import evolve
from forge_events import ENCODER, EPOCH_US, SENSORS, events_of
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import arrays
from opir_testing import stub_estimates, stub_window

from examples import examples
from opir_core import DetectionTruth
from opir_core.errors import ModelError
from opir_core.geometry import azimuth_elevation_range_in_axes, local_axes
from opir_core.output import (
    SCHEMA_VERSION,
    ForgeEncoder,
    detection_schema,
    timestamp_text,
    unix_microseconds,
)
from opir_core.output.events.encoder_input import window_blocks
from opir_core.plugin import REPORTED_TYPES, Detections, EncoderContext, Tracks, Window
from opir_core.random_streams import uuid8_words, uuid_text

VALIDATOR = jsonschema.Draft202012Validator(
    detection_schema(is_closed=True), format_checker=jsonschema.Draft202012Validator.FORMAT_CHECKER
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
FIELDS = list(detection_schema()["required"])
POSITION = st.floats(-1e100, 1e100)
ANGLE = st.floats(-2 * np.pi, 2 * np.pi)


def column(
    values: st.SearchStrategy[Any], count: int, kind: Any = np.float64, shape: tuple[int, ...] = ()
) -> Any:
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
        impact_sigmas=draw(column(st.floats() | st.floats(0.0, 4.0), count, shape=(3,))),
    )


@st.composite
def unit_vectors(draw: st.DrawFn, count: int) -> np.ndarray:
    component = st.sampled_from([0.0, -0.0, 1.0, -1.0, 1e-12, 5e-324]) | st.floats(-1.0, 1.0)
    vectors = draw(column(component, count, shape=(3,)))
    length = np.linalg.norm(vectors, axis=1, keepdims=True)
    return np.where(length > 1e-100, vectors / np.maximum(length, 1e-100), [0.0, 0.0, -1.0])


@st.composite
def windows(draw: st.DrawFn) -> Window:
    """Any detections that an event can carry, the extremes included."""
    count = draw(st.integers(0, 8))
    columns = draw(estimates())
    sensor = draw(column(st.integers(0, len(SENSORS) - 1), count, np.int32))
    band_ends = np.array([1 << len(band_sensor.bands) for band_sensor in SENSORS])
    return stub_window(
        count,
        estimates=columns,
        sensor=sensor,
        time_ns=draw(column(st.integers(-(2**63) + 1, 2**63 - 1), count, np.int64)),
        **(
            {"reported_ns": draw(column(st.integers(0, 2**62), count, np.int64))}
            if draw(st.booleans())
            else {}
        ),
        detection_id=uuid8_words(
            draw(column(st.integers(0, 2**64 - 1), count, np.uint64, (2,))), np.arange(count)
        ),
        reported_type=draw(column(st.integers(0, 3), count, np.uint8)),
        bands=draw(column(st.integers(0, 255), count, np.int64)) % band_ends[sensor],
        confidence=draw(column(st.floats(0.0, 1.0), count)),
        line_of_sight_ecef=draw(unit_vectors(count)),
        sensor_ecef_m=draw(column(st.sampled_from([0.0, -4.2e7]) | POSITION, count, shape=(3,))),
        snr=draw(column(st.floats(), count)),
        track=draw(column(st.integers(-1, 2**63 - 1), count, np.int64)),
        estimate=draw(column(st.integers(-1, len(columns) - 1), count, np.int64)),
    )


@given(windows())
def test_every_event_fits_the_schema(window: Window) -> None:
    events = events_of(window)
    assert len(events) == len(window.detections)
    for event in events:
        VALIDATOR.validate(event)
        assert list(event) == FIELDS
        assert list(event)[:9] == PAPER_FIELDS


@given(windows())
def test_every_event_says_what_its_row_says(window: Window) -> None:
    for row, event in enumerate(events_of(window)):
        d = window.detections
        sensor = SENSORS[d.sensor[row]]
        assert event["detection_id"] == uuid_text(d.detection_id[row : row + 1])[0]
        assert (
            event["reported_at"]
            == timestamp_text(unix_microseconds(d.reported_ns[row : row + 1], EPOCH_US))[0]
        )
        assert (
            event["timestamp"]
            == timestamp_text(unix_microseconds(d.time_ns[row : row + 1], EPOCH_US))[0]
        )
        assert (event["sensor_id"], event["sensor_type"]) == (sensor.id, sensor.type)
        assert event["orbital_slot"] == sensor.orbital_slot_deg
        assert event["target_type"] == REPORTED_TYPES[d.reported_type[row]]
        assert event["confidence"] == pytest.approx(d.confidence[row], abs=5.1e-5)
        assert event["schema_version"] == SCHEMA_VERSION
        assert event["track_id"] == (None if d.track[row] < 0 else d.track[row])
        angles = azimuth_elevation_range_in_axes(
            d.line_of_sight_ecef[row], local_axes(d.sensor_ecef_m[row])
        )
        turned = abs(event["azimuth_deg"] - math.degrees(angles.azimuth_rad)) % 360.0
        assert min(turned, 360.0 - turned) <= 1e-9
        assert event["elevation_deg"] == pytest.approx(
            math.degrees(angles.elevation_rad), abs=5.1e-8
        )
        assert event["line_of_sight_sigma_urad"] == 20.0
        assert event["bands"] == [
            band.name for bit, band in enumerate(sensor.bands) if d.bands[row] >> bit & 1
        ]
        assert event["sensor_position_ecef_m"] == pytest.approx(
            d.sensor_ecef_m[row].tolist(), abs=5.1e-2, rel=1e-15
        )
        if math.isfinite(d.snr[row]):
            assert event["snr"] == pytest.approx(d.snr[row], abs=5.1e-3, rel=1e-15)
        else:
            assert event["snr"] is None


@given(windows(), st.data())
def test_bytes_do_not_depend_on_windows(window: Window, data: st.DataObject) -> None:
    rows = data.draw(st.integers(1, 4))
    pieces = [ENCODER.encode(window_block) for window_block in window_blocks(window, rows)]
    assert b"".join(pieces) == ENCODER.encode(window)


@pytest.mark.slow
def test_bytes_do_not_depend_on_windows_of_many_looks() -> None:
    window = raid(600)
    expected = ENCODER.encode(window)
    for rows in (1, 7, 128, 599):
        assert (
            b"".join(ENCODER.encode(window_block) for window_block in window_blocks(window, rows))
            == expected
        )


def raid(count: int) -> Window:
    random = np.random.default_rng(3)
    sensor = random.integers(0, 3, count)
    home = random.uniform(-4e7, 4e7, (3, 3))[sensor]
    direction = random.normal(size=(count, 3))
    moving = (sensor == 2)[:, np.newaxis] * random.uniform(-1e6, 1e6, (count, 3))
    track_estimates = stub_estimates(
        20,
        state=random.uniform(-1.0, 1.0, (20, 6)) * [7e6, 7e6, 7e6, 7e3, 7e3, 7e3],
        launch=random.uniform(-1.5, 1.5, (20, 3)),
        launch_covariance=[[4e6, 1e6, 0.0], [1e6, 9e6, 0.0], [0.0, 0.0, 4.0]],
    )
    return stub_window(
        count,
        estimates=track_estimates,
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
@examples(25)
def test_truth_does_not_reach_an_event(window: Window) -> None:
    names = {name for name in DetectionTruth.__slots__ if not name.startswith("_")}
    assert not names & set(detection_schema()["properties"])
    without_truth = evolve(window, truth=window.truth.take(slice(0, 0)))
    assert ENCODER.encode(without_truth) == ENCODER.encode(window)


def test_a_window_without_detections_is_no_bytes() -> None:
    assert ENCODER.encode(stub_window(0)) == b""


def test_without_sensors_there_is_nothing_to_encode() -> None:
    encoder = ForgeEncoder(EncoderContext(sensors=(), epoch_us=0))
    assert encoder.encode(stub_window(0)) == b""
    with pytest.raises(ModelError, match="the sensor must be"):
        encoder.encode(stub_window(1))


def test_columns_that_may_not_be_written_are_enough() -> None:
    window = stub_window(2)
    assert not window.detections.confidence.flags.writeable
    assert len(events_of(window)) == 2


def test_strided_columns_encode_like_their_copies() -> None:
    window = raid(101)
    reversed_rows = window.detections.take(slice(None, None, -2))
    copied = Detections(
        *(np.ascontiguousarray(getattr(reversed_rows, name)) for name in names_of(reversed_rows))
    )
    truth = window.truth.take(slice(0, 0))
    assert ENCODER.encode(evolve(window, detections=reversed_rows, truth=truth)) == ENCODER.encode(
        evolve(window, detections=copied, truth=truth)
    )


def names_of(detections: Detections) -> list[str]:
    return [attribute.name for attribute in type(detections).__attrs_attrs__]


def test_blocks_of_a_window_are_the_window() -> None:
    window = evolve(raid(10), tracks=stub_estimates(3))
    pieces = list(window_blocks(window, 4))
    assert (
        [len(block.detections) for block in pieces]
        == [4, 4, 2]
        == [len(block.truth) for block in pieces]
    )
    assert sum(block.looks for block in pieces) == window.looks
    assert sum(len(block.tracks) for block in pieces) == 3
    assert np.array_equal(
        np.concatenate([block.detections.scan for block in pieces]),
        window.detections.scan,
    )


def test_naming_the_encoder_imports_no_msgspec() -> None:
    program = (
        "import sys; from opir_core.builtin.plugin import ENCODERS, SINKS;"
        "import opir_core.random_streams.detection_ids;"
        "assert 'msgspec' not in sys.modules, 'named';"
        "from opir_core.interfaces.contexts import EncoderContext;"
        "ENCODERS[0].build(ENCODERS[0].config(), EncoderContext(sensors=(), epoch_us=0));"
        "assert 'msgspec' in sys.modules, 'built'"
    )
    done = subprocess.run(
        [sys.executable, "-c", program], capture_output=True, text=True, check=False
    )
    assert done.returncode == 0, done.stderr
