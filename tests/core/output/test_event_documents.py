"""The pages on the event document what the encoder writes."""

import json
import re
from typing import Any

import jsonschema
import numpy as np
import pytest
from opir_testing import stub_estimates, stub_sensor, stub_window
from repository import ROOT

from opir_core.geometry import geodetic_to_ecef
from opir_core.output import ForgeEncoder, detection_schema
from opir_core.plugin import Band, EncoderContext
from opir_core.random_streams import id_key, uuid8_words

REFERENCE = ROOT / "docs" / "reference"
PAGE = (REFERENCE / "detection-event.md").read_text(encoding="utf-8")
EXTENSIONS = (REFERENCE / "event-extensions.md").read_text(encoding="utf-8")
SCHEMA = detection_schema()


def documented_event() -> dict[str, Any]:
    (block,) = re.findall(r"^```json\n(.*?)^```$", PAGE, re.MULTILINE | re.DOTALL)
    event: dict[str, Any] = json.loads(block)
    return event


def made_event() -> dict[str, Any]:
    """Return the page's event: a detection from 75° W, 60.05 s into the scene, of a track that
    knows both points.
    """
    bands = (Band("SWIR", 2.6, 2.8), Band("MWIR", 4.2, 4.4))
    sensor = stub_sensor("SBIRS-GEO-1", -75.0, type="SBIRS-GEO", bands=bands)
    place = sensor.orbit.position_ecef_m(np.array([60.05]))
    target = geodetic_to_ecef(np.radians(28.5), np.radians(-80.6), 40_000.0)
    offset = target - place
    estimates = stub_estimates(
        1,
        tick_s=60.0,
        state=np.concatenate([target - 0.05 * target / 6.4e3, target / 6.4e3]),
        launch=[np.radians(28.45), np.radians(-80.53), 10.0],
        launch_covariance=[[4e6, 1.5e6, 0.0], [1.5e6, 2e6, 0.0], [0.0, 0.0, 0.25]],
        impact=[np.radians(-7.9), np.radians(-14.4), np.nan],
        impact_covariance=[[9e8, -2e8, 0.0], [-2e8, 1.6e9, 0.0], [0.0, 0.0, np.nan]],
    )
    window = stub_window(
        1,
        estimates=estimates,
        time_ns=60_050_000_000,
        detection_id=uuid8_words(np.array([id_key("page")], dtype=np.uint64), np.array([600])),
        reported_type=0,
        bands=3,
        confidence=0.874,
        line_of_sight_ecef=offset / np.linalg.norm(offset),
        sensor_ecef_m=place,
        snr=12.5,
        track=1,
        estimate=0,
    )
    encoder = ForgeEncoder(EncoderContext(sensors=(sensor,), epoch_us=1_775_044_800_000_000))
    event: dict[str, Any] = json.loads(encoder.encode(window))
    return event


def documented_fields(text: str) -> list[str]:
    return re.findall(r"^\| `(\w+)` \|", text, re.MULTILINE)


def section(page: str, start: str, end: str) -> str:
    return page[page.index(start) : page.index(end)]


def test_the_page_s_event_is_what_the_encoder_makes() -> None:
    assert documented_event() == made_event(), json.dumps(made_event(), indent=2)
    assert list(documented_event()) == list(made_event())
    jsonschema.validate(documented_event(), SCHEMA)


@pytest.mark.parametrize(
    ("text", "part"),
    [
        (section(PAGE, "## Fields", "## Directions"), SCHEMA),
        (section(PAGE, "## Points", "An impact point also has"), SCHEMA["$defs"]["point"]),
        (section(PAGE, "## Points", "The ellipses are centred"), SCHEMA["$defs"]["impact"]),
        (section(PAGE, "The ellipses are centred", "## Identifiers"), SCHEMA["$defs"]["ellipse"]),
        (section(EXTENSIONS, "## Track state", "## Measured irradiance"), SCHEMA["$defs"]["state"]),
    ],
    ids=["event", "point", "impact", "ellipse", "state"],
)
def test_the_page_documents_every_field_in_order(text: str, part: dict[str, Any]) -> None:
    assert documented_fields(text) == list(part["properties"])
