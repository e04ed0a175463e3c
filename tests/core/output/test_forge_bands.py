"""The encoder `forge-bands`: the event of `forge`, and in it what each band of the sensor
measured.
"""

import json
import math
from typing import Any

import jsonschema
import numpy as np
import pytest
from attrs import evolve
from hypothesis import given, strategies as st
from hypothesis.extra.numpy import arrays
from opir_testing import stub_sensor, stub_window
from opir_testing.bench import encoder_of

import opir_core as opir
from opir_core import plan_windows
from opir_core.output import ForgeEncoder, detection_schema, number_texts
from opir_core.output.events.encoder_input import window_blocks
from opir_core.output.events.text import significant
from opir_core.plugin import Band, EncoderContext, Window

SENSORS = (
    stub_sensor("TWO", -75.5, bands=(Band("SWIR", 2.5, 3.0), Band('"M"', 4.2, 4.45))),
    stub_sensor("NONE", orbital_slot_deg=None, bands=()),
    stub_sensor("ONE", orbital_slot_deg=None, bands=(Band("LWIR", 8.0, 12.0),)),
)
CONTEXT = EncoderContext(sensors=SENSORS, epoch_us=1_775_044_800_000_000)
PLAIN = ForgeEncoder(CONTEXT)
WITH_BANDS = ForgeEncoder(CONTEXT, has_irradiances=True)
VALIDATOR = jsonschema.Draft202012Validator(detection_schema(is_closed=True))
FINITE = st.floats(allow_nan=False, allow_infinity=False)


@st.composite
def windows(draw: st.DrawFn) -> Window:
    """Any finite irradiances in the sensors' own bands, nan beyond them."""
    count = draw(st.integers(1, 8))
    sensor = draw(arrays(np.int32, count, elements=st.integers(0, len(SENSORS) - 1)))
    measured = draw(arrays(np.float64, (count, 2), elements=FINITE | st.floats(-1e-9, 1e-9)))
    widths = np.array([len(band_sensor.bands) for band_sensor in SENSORS])[sensor]
    measured[np.arange(2) >= widths[:, None]] = np.nan
    window = stub_window(count, sensor=sensor, bands=0)
    return evolve(window, detections=evolve(window.detections, band_irradiance_w_m2=measured))


@given(windows())
def test_an_event_says_what_each_band_of_its_sensor_measured(window: Window) -> None:
    lines = WITH_BANDS.encode(window).splitlines(keepends=True)
    for line, plain, sensor, measured in zip(
        lines,
        PLAIN.encode(window).splitlines(keepends=True),
        window.detections.sensor,
        window.detections.band_irradiance_w_m2,
        strict=True,
    ):
        event = json.loads(line)
        VALIDATOR.validate(event)
        reported = event.pop("band_irradiance_w_m2")
        assert list(reported) == [band.name for band in SENSORS[sensor].bands]
        assert list(reported.values()) == pytest.approx(
            measured[: len(reported)].tolist(), rel=5.000001e-6, abs=1e-290
        )
        assert event == json.loads(plain)


@given(windows(), st.integers(1, 4))
def test_bytes_do_not_depend_on_how_detections_are_cut(window: Window, rows: int) -> None:
    pieces = [WITH_BANDS.encode(window_block) for window_block in window_blocks(window, rows)]
    assert b"".join(pieces) == WITH_BANDS.encode(window)


@given(
    st.lists(
        FINITE.filter(lambda value: 1e-290 <= abs(value) <= 1e290) | st.floats(1e-20, 1e-6),
        min_size=1,
    ),
    st.data(),
)
def test_significant_digits_are_those_of_python(values: list[float], data: st.DataObject) -> None:
    digits = data.draw(st.integers(1, 15))
    expected = [float(f"{value:.{digits - 1}e}") for value in values]
    numbers = significant(np.array(values), digits).tolist()
    # At a tie the product with a power of ten may be rounded to the other side: off by one in the
    # last digit.
    last_digits = [10.0 ** (math.floor(math.log10(abs(value))) - digits + 1) for value in values]
    for number, expected_number, value, last_digit in zip(
        numbers, expected, values, last_digits, strict=True
    ):
        rounding = 3.0 * math.ulp(value)
        assert (
            number == pytest.approx(expected_number, rel=1e-15)
            or abs(abs(number - value) - 0.5 * last_digit) <= rounding
        )


def test_irradiances_are_written_short() -> None:
    values = np.array([1.23456789e-12, -9.999999e-13, 4e-19, 0.0, -0.0, 3.0, np.nan, 5e-324, 1e300])
    texts = [b"1.23457e-12", b"-1e-12", b"4e-19", b"0.0", b"0.0", b"3.0", b"null", b"0.0", b"1e300"]
    assert number_texts(significant(values, 6)) == texts


def test_a_band_that_measured_nothing_is_null() -> None:
    window = stub_window(1, bands=1)
    window = evolve(
        window,
        detections=evolve(window.detections, band_irradiance_w_m2=np.array([[1e-12, np.nan]])),
    )
    event = json.loads(WITH_BANDS.encode(window))
    assert event["band_irradiance_w_m2"] == {"SWIR": 1e-12, '"M"': None}
    VALIDATOR.validate(event)


def photons(*changes: str) -> opir.Plan:
    overrides = ["duration_s=75", "outputs=[]", "classification=paper", *changes]
    return opir.compile_plan(opir.load_scene("examples/photons.yaml", overrides=overrides))


def events_of(plan: Any, encoder: str) -> list[dict[str, Any]]:
    lines = b"".join(encoder_of(plan, encoder).encode(window) for window in plan_windows(plan))
    return [json.loads(line) for line in lines.splitlines()]


@pytest.mark.slow
def test_the_events_of_a_scene_have_what_its_columns_have() -> None:
    plan = photons("duration_s=70")
    events = events_of(plan, "forge-bands")
    detections = opir.simulate(plan.scene).detections
    assert len(events) == len(detections) > 100
    for event, measured, sensor in zip(
        events, detections.band_irradiance_w_m2.tolist(), detections.sensor, strict=True
    ):
        reported = event["band_irradiance_w_m2"]
        assert set(event) == {*detection_schema()["required"], "band_irradiance_w_m2"}
        assert list(reported) == [band.name for band in plan.sensors[sensor].bands]
        assert list(reported.values()) == pytest.approx(measured[: len(reported)], rel=5.1e-6)
        assert set(event["bands"]) <= set(reported)
    assert {len(event["band_irradiance_w_m2"]) for event in events} == {2, 3}


@pytest.mark.slow
def test_without_measured_light_no_event_has_irradiances() -> None:
    events = events_of(photons("detection=constant", "sources=[]"), "forge-bands")
    assert events
    assert not any("band_irradiance_w_m2" in event for event in events)
    plan = photons()
    assert not any("band_irradiance_w_m2" in event for event in events_of(plan, "forge"))
