"""Events of gliders after their burn: the air keeps them hot, and they are not called missiles."""

import numpy as np
import pytest
from pyproj import Geod

import opir_core as opir


@pytest.mark.slow
def test_few_events_of_gliding_targets_are_called_missiles():
    rng = np.random.default_rng(811)
    geod = Geod(ellps="WGS84")
    called = 0
    events = 0
    for number in range(4):
        lat, lon = rng.uniform([-35.0, 130.0], [35.0, 175.0])
        aim_lon, aim_lat, _ = geod.fwd(lon, lat, rng.uniform(0, 360), rng.uniform(3e6, 7e6))
        scene = {
            "scene": "glide",
            "epoch": "2026-03-01T12:00:00Z",
            "duration_s": 2600,
            "seed": number,
            "sensors": [
                {
                    "model": "SBIRS-GEO",
                    "id": "S",
                    "orbital_slot_deg": 160.0,
                    "scan_period_ms": 1000,
                }
            ],
            "targets": [
                {
                    "id": "G",
                    "type": "HGV",
                    "launch": {"lat_deg": lat, "lon_deg": lon, "time_s": 10.0},
                    "aim": {"lat_deg": aim_lat, "lon_deg": aim_lon},
                }
            ],
            "detection": {"model": "snr"},
            "classification": {"model": "spectral"},
            "atmosphere": {"model": "lowtran"},
            "background": {"model": "earth"},
            "outputs": [],
        }
        plan = opir.compile_plan(opir.scene_from_mapping(scene))
        window = opir.Engine(plan).advance(plan.end_ns)
        detections = window.detections
        gliding = (window.truth.target == 0) & (detections.time_s > plan.targets.burnout_s[0] + 1.0)
        types = np.array(plan.reported_types)[detections.reported_type[gliding]]
        called += np.count_nonzero(types != "UNKNOWN")
        events += len(types)
    assert events > 3000
    assert called < 0.05 * events
