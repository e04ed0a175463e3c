"""A short scene of two launches to be run live, and its events as bytes."""

from opir_core.interfaces.contexts import EncoderContext
from opir_core.output.events.forge import ForgeEncoder
from opir_core.planning.plan import compile_plan
from opir_core.simulation.engine import Engine

NS = 1_000_000_000
LATER = {
    "id": "LATER",
    "type": "IRBM",
    "launch": {"lat_deg": 22.0, "lon_deg": -160.0, "time_s": 31.7},
    "aim": {"lat_deg": 9.0, "lon_deg": 167.7},
}


DIRECTED = {
    "sensors": [
        {"constellation": "DSP"},
        {"model": "generic-pointed", "id": "NARROW", "orbital_slot_deg": -140.0},
    ],
    "director": {
        "model": "round-robin",
        "places_deg": [[34.73, -120.57], [11.0, 171.0]],
        "dwell_s": 30.0,
    },
}
IN_MODES = {
    "sensors": [
        {"constellation": "DSP"},
        {
            **DIRECTED["sensors"][1],
            "modes": {"sector": {"half_angle_deg": 3.0, "scan_period_ms": 700.0}},
        },
    ],
    "director": {**DIRECTED["director"], "mode": "sector"},
}


def mapping(**changes):
    scene = {
        "scene": "live",
        "epoch": "2026-04-01T12:00:00Z",
        "duration_s": 100,
        "seed": 3,
        "sensors": [{"constellation": "DSP"}, {"constellation": "SBIRS-GEO"}],
        "targets": [
            {
                "id": "T1",
                "type": "ICBM",
                "launch": {"lat_deg": 34.73, "lon_deg": -120.57, "time_s": 3.0},
                "aim": {"lat_deg": 9.0, "lon_deg": 167.7},
            },
            {
                "id": "T2",
                "type": "SRBM",
                "launch": {"lat_deg": 11.0, "lon_deg": 171.0, "time_s": 5.0},
                "aim": {"lat_deg": 9.0, "lon_deg": 167.7},
                "burn_time_s": 20.0,
            },
        ],
        "outputs": ["memory"],
    }
    return scene | changes


def lines(plan, *windows):
    encoder = ForgeEncoder(EncoderContext(sensors=plan.sensors, epoch_us=plan.scene.epoch_us))
    return b"".join(map(encoder.encode, windows))


def batch(scene, host, end_ns=100 * NS):
    plan = compile_plan(scene, host)
    return lines(plan, Engine(plan).advance(end_ns))
