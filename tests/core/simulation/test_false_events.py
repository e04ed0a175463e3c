"""Detections of nothing that was launched, by cause: closed forms against runs, with intervals of
99.9 % each.
"""

from typing import Any

import numpy as np
import pytest
from opir_testing.contracts.detection import reported_chances
from scipy.stats import norm, poisson

import opir_core as opir
from opir_core import Engine, compile_plan
from opir_core.planning import Looks

DURATION_S = 300.0
RISK = 1e-3
REGION = {"south_deg": 20, "north_deg": 45, "west_deg": -121, "east_deg": -95}
SOURCES = [
    {"id": "fires", "model": "fires", "field": {"region": REGION, "per_million_km2": 8}},
    {
        "id": "flares",
        "model": "flares",
        "at": [{"lat_deg": 32, "lon_deg": -102}, {"lat_deg": 40, "lon_deg": -99}],
    },
    {
        "id": "meteor",
        "model": "bolides",
        "at": [{"lat_deg": 30.0, "lon_deg": -100.0, "start_s": 60.0}],
    },
]
SENSORS = (
    {"model": "DSP", "preset": "heritage", "scan_period_ms": 1000.0},
    {"model": "SBIRS-GEO", "scan_period_ms": 500.0},
    {"model": "NEXTGEN-GEO", "scan_period_ms": 500.0},
)
#: With frames subtracted, and single frames, which see steady fires.
TEMPORAL = ("difference", "none")


def planned(sensor: dict[str, Any], temporal: str, **changes: Any) -> Any:
    block = {"id": "S", "orbital_slot_deg": -100.0, **sensor}
    plane = block.get("focal_plane", {})
    if "preset" not in block:
        block["focal_plane"] = {**plane, "temporal_filter": temporal}
    scene = {
        "scene": "false events",
        "epoch": "2026-04-01T18:00:00Z",
        "duration_s": DURATION_S,
        "seed": 4,
        "sensors": [block],
        "targets": [],
        "detection": "snr",
        "classification": "paper",
        "background": "earth",
        "atmosphere": "lowtran",
        "outputs": [],
    }
    return compile_plan(opir.scene_from_mapping({**scene, **changes}))


@pytest.mark.slow
@pytest.mark.parametrize("temporal", TEMPORAL)
@pytest.mark.parametrize("sensor", SENSORS, ids=lambda sensor: sensor["model"])
def test_sources_are_reported_as_often_as_their_chances_say(
    sensor: dict[str, Any], temporal: str
) -> None:
    plan = planned(sensor, temporal, sources=SOURCES)
    looks = Looks.between(plan.pairs, 0, plan.end_ns)
    geometry = plan.look_geometry()
    visible = np.flatnonzero(geometry.visible(looks.pair, looks.scan))
    pair = looks.pair[visible]
    scan = looks.scan[visible]
    chances = plan.detection.probability(geometry.exposures(pair, scan))
    needed, scans = (np.full(len(pair), number) for number in plan.detection.confirmation[0])
    reported = reported_chances(chances, pair, scan, needed, scans)
    truth = Engine(plan).advance(plan.end_ns).truth.target
    count = int((truth >= 0).sum())
    mean = float(reported.sum())
    # Looks at one source share no noise, reports of confirmations do: their variance is at most M
    # times a Poisson one.
    assert abs(count - mean) <= norm.isf(RISK / 2) * np.sqrt(max(mean, 1.0) * needed[0]) + 1.0
    if temporal == "none" and "preset" not in sensor:
        assert mean > 50.0


@pytest.mark.slow
@pytest.mark.parametrize("cause", ["noise", "noise and clutter"])
@pytest.mark.parametrize("sensor", SENSORS, ids=lambda sensor: sensor["model"])
def test_noise_and_clutter_are_reported_at_their_stated_rate(
    sensor: dict[str, Any], cause: str
) -> None:
    sky = {"background": "none"} if cause == "noise" else {}
    plan = planned({**sensor, "threshold_sigma": 4.1}, "difference", **sky)
    window = Engine(plan).advance(plan.end_ns)
    assert (window.truth.target == -1).all()
    mean = float(plan.detection.rate_per_scan[0]) * plan.end_ns / plan.sensors[0].scan.period_ns
    least, upper = poisson.interval(1.0 - RISK, mean)
    assert mean > 20.0
    assert least <= len(window.detections) <= upper
