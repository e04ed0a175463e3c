"""Events of the `forge` encoder, of three sensors whose names and bands are not easy to write."""

import json

from opir_testing import stub_sensor

from opir_core.interfaces.contexts import EncoderContext
from opir_core.interfaces.sensors import ReportingStage
from opir_core.output.events.forge import ForgeEncoder
from opir_core.plugin import Band

EPOCH_US = 1_775_044_800_000_000
SENSORS = (
    stub_sensor("SBIRS-GEO-1", -75.5, bands=(Band("SWIR", 2.6, 2.8), Band("MWIR", 4.2, 4.4))),
    stub_sensor(
        '"quoted"\n\\ \u00c4\u2028\U0001f680', orbital_slot_deg=None, type="H\tEO", bands=()
    ),
    stub_sensor(
        "LEO-1",
        orbital_slot_deg=None,
        bands=tuple(Band(f"B{n}", 1.0, 2.0) for n in range(8)),
        reporting=(ReportingStage("downlink", 1.0),),
    ),
)
ENCODER = ForgeEncoder(EncoderContext(sensors=SENSORS, epoch_us=EPOCH_US))


def refuse_constant(name):
    raise AssertionError(f"{name} is no JSON")


def events_of(window, encoder=ENCODER):
    lines = encoder.encode(window)
    assert lines.endswith(b"\n") or not lines
    return [json.loads(line, parse_constant=refuse_constant) for line in lines.split(b"\n")[:-1]]
