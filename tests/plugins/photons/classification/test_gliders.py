"""Events of gliders after their burn: the air keeps them hot; they are not called missiles, and
known for gliders by their light.
"""

import numpy as np
import pytest
from pyproj import Geod

import opir_core as opir
from opir_core.plugin import REPORTED_TYPES


@pytest.mark.slow
def test_few_events_of_gliding_targets_are_called_missiles_and_most_gliders():
    rng = np.random.default_rng(40961)
    geod = Geod(ellps="WGS84")
    called = 0
    known = 0
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
        likeliest = np.argmax(detections.hypothesis_log_probability[gliding], axis=1)
        known += np.count_nonzero(np.array(plan.hypothesis_names)[likeliest] == "HGV")
        events += len(types)
    assert events > 3000
    assert called < 0.02 * events
    # The slow end is as dim and as cool as a fire.
    assert known > 0.55 * events


def test_what_most_probably_glides_has_no_type_of_missiles():
    """Where types have no name for gliders; else they have their own."""
    scene = {
        "scene": "types",
        "epoch": "2026-03-01T12:00:00Z",
        "duration_s": 60,
        "seed": 1,
        "sensors": [{"model": "SBIRS-GEO", "id": "S", "orbital_slot_deg": 160.0}],
        "targets": [],
        "detection": {"model": "snr"},
        "classification": {"model": "spectral"},
        "outputs": [],
    }
    plan = opir.compile_plan(opir.scene_from_mapping(scene))
    names = plan.hypothesis_names
    chances = np.full((2, len(names)), 1e-6)
    chances[0, names.index("HGV")] = 0.6
    chances[0, names.index("ICBM")] = 0.4
    chances[1, names.index("HGV")] = 0.4
    chances[1, names.index("ICBM")] = 0.6
    classifier = plan.classifier
    paper = np.exp(classifier.over_types(np.log(chances), REPORTED_TYPES))
    unknown, irbm = (REPORTED_TYPES.index(name) for name in ("UNKNOWN", "IRBM"))
    assert paper[:, unknown] == pytest.approx([0.6, 0.0], abs=1e-4)
    assert paper[:, irbm] == pytest.approx([0.0, 0.4], abs=1e-4)
    by_class = np.exp(classifier.over_types(np.log(chances), ("HGV", "ICBM", "UNKNOWN")))
    assert by_class[:, 0] == pytest.approx([0.6, 0.4], abs=1e-4)
