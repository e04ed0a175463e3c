"""The event's JSON Schema: lawful itself, strict, and never apart from what the encoder writes."""

import json
import re
from typing import Any

import jsonschema
import pytest
from opir_testing import stub_estimates, stub_sensor, stub_window

from opir_core.estimation import CONTAINMENT
from opir_core.output import SCHEMA_VERSION, ForgeEncoder, detection_schema
from opir_core.output.events import schema_text
from opir_core.output.events.estimates import (
    OTHER_CONTAINMENTS,
    EstimatedPoint,
    ImpactPoint,
    Place,
    TrackState,
    UncertaintyEllipse,
)
from opir_core.plugin import REPORTED_TYPES, EncoderContext
from opir_core.scene import core_target_classes

SCHEMA = detection_schema(is_closed=True)


def sample_event() -> dict[str, Any]:
    encoder = ForgeEncoder(EncoderContext(sensors=(stub_sensor(),), epoch_us=0))
    estimates = stub_estimates(
        1,
        launch=[0.1, 0.2, 0.3],
        launch_covariance=[[2.0, 1.0, 0.0], [1.0, 2.0, 0.0], [0.0, 0.0, 1.0]],
        state=7e6,
    )
    event: dict[str, Any] = json.loads(
        encoder.encode(stub_window(1, estimates=estimates, estimate=0, track=1, snr=9.0))
    )
    return event


def is_valid(event: dict[str, Any]) -> bool:
    return bool(jsonschema.Draft202012Validator(SCHEMA).is_valid(event))


def test_the_schema_is_a_schema() -> None:
    jsonschema.Draft202012Validator.check_schema(SCHEMA)
    assert json.loads(schema_text("detection")) == detection_schema()
    assert SCHEMA["$id"].endswith(f":{SCHEMA_VERSION}")


def test_schema_and_encoder_have_the_same_fields() -> None:
    fields = list(SCHEMA["properties"])
    # These are only there if the classifier gives probabilities, or if the encoder reports
    # irradiances or track states, or in scenes with links: test_spectral_classifier.py,
    # test_forge_bands.py, test_forge_tracks.py, test_links.py.
    of_tracks = {"burnout", *(name for name in fields if name.startswith("track_"))} - {"track_id"}
    assert len(of_tracks) == 10
    of_tracks |= {"latitude_deg", "longitude_deg", "altitude_m"}
    for name in ("path", "type_probability", "band_irradiance_w_m2", *of_tracks):
        fields.remove(name)
    assert list(sample_event()) == SCHEMA["required"] == fields


@pytest.mark.parametrize(
    ("name", "struct"),
    [
        ("point", EstimatedPoint),
        ("impact", ImpactPoint),
        ("ellipse", UncertaintyEllipse),
        ("state", TrackState),
    ],
)
def test_schema_and_encoder_name_the_same_fields_of_parts(name: str, struct: Any) -> None:
    piece = SCHEMA["$defs"][name]
    assert list(struct.__struct_fields__) == list(piece["properties"])
    # Of points most encoders write the place alone.
    required = Place if issubclass(struct, Place) else struct
    assert list(required.__struct_fields__) == piece["required"]


def test_schema_and_encoder_have_the_same_constants() -> None:
    names = re.compile(SCHEMA["properties"]["target_type"]["pattern"])
    assert all(names.fullmatch(name) for name in (*REPORTED_TYPES, *core_target_classes()))
    assert sample_event()["schema_version"] == SCHEMA_VERSION == ForgeEncoder.schema_version
    assert SCHEMA["$defs"]["ellipse"]["properties"]["containment"]["enum"] == [
        CONTAINMENT,
        *OTHER_CONTAINMENTS,
    ]


@pytest.mark.parametrize("name", SCHEMA["required"])
def test_an_event_without_one_of_its_fields_is_refused(name: str) -> None:
    event = sample_event()
    assert is_valid(event)
    del event[name]
    assert not is_valid(event)


@pytest.mark.parametrize("name", SCHEMA["required"])
def test_a_field_of_the_wrong_type_is_refused(name: str) -> None:
    assert not is_valid(sample_event() | {name: {"wrong": "type"}})


@pytest.mark.parametrize(
    "name", ["target_id", "range_m", "emission_time_s", "probability", "true_type"]
)
def test_an_event_with_truth_in_it_is_refused(name: str) -> None:
    assert not is_valid(sample_event() | {name: 1.0})


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("detection_id", "342bacf7-1e58-4022-85f7-24a2841f5be4"),
        ("timestamp", "2026-04-01T12:00:00Z"),
        ("timestamp", "2026-04-01T12:00:00.000000+00:00"),
        ("target_type", "CRUISE MISSILE"),
        ("confidence", 1.1),
        ("azimuth_deg", 360.0),
        ("elevation_deg", -90.1),
        ("track_id", -1),
        ("track_id", 1.5),
        ("longitude_deg", 180.0),
        ("schema_version", "1.0"),
        ("sensor_position_ecef_m", [0.0, 0.0]),
        ("launch_point", {"lat_deg": 0.0}),
    ],
)
def test_a_value_outside_its_domain_is_refused(name: str, value: Any) -> None:
    assert not is_valid(sample_event() | {name: value})
