"""A sensor against two others that agree: what is said of it, and that they are believed."""

import numpy as np
import pytest
from opir_scoring.containments import nees
from opir_scoring.evidence import true_states_ecef

import opir_core as opir
from opir_core.output import deliver

END_S = 90.0

#: χ² of six degrees of freedom that is exceeded once in 1 000.
RARE = 22.5


def outcome(fault):
    """Return a run of three sensors, the first with a fault, and what is said of them."""
    scene = {
        "scene": "one against two",
        "epoch": "2026-04-01T12:00:00Z",
        "duration_s": END_S + 1.0,
        "seed": 5301,
        "sensors": [
            {"model": "SBIRS-GEO", "id": name, "orbital_slot_deg": slot, "scan_period_ms": 500}
            for name, slot in (("WEST", -150), ("MID", -110), ("EAST", -75))
        ],
        "targets": [
            {
                "id": "T",
                "type": "ICBM",
                "launch": {"lat_deg": 35, "lon_deg": -120, "time_s": 5},
                "aim": {"lat_deg": 8, "lon_deg": 167},
            }
        ],
        "tracker": "imm",
        "faults": [{"sensor": "WEST", "at_s": 0, **fault}],
    }
    plan = opir.compile_plan(opir.scene_from_mapping(scene))
    rows = deliver(plan).manifest["sensor_health"]
    return opir.run_of_plan(plan), {
        sensor.id: row["text"] for sensor, row in zip(plan.sensors, rows, strict=True)
    }


@pytest.mark.slow
@pytest.mark.parametrize(
    "fault",
    [{"fault": "noise", "factor": 1000}, {"fault": "bias", "east_urad": 5e3, "north_urad": 3e3}],
    ids=["noise", "bias"],
)
def test_a_sensor_far_from_what_it_states_is_named_and_two_others_are_believed(fault):
    run, health = outcome(fault)
    assert "contradicts the others: 0 of" in health["WEST"]
    assert "elsewhere" in health["WEST"]
    for name in ("MID", "EAST"):
        assert "contradicts" not in health[name]
    truth = true_states_ecef(run.plan, np.zeros(1, dtype=np.int32), np.array([END_S]))[0]
    tracks = run.tracks.take(np.flatnonzero(run.tracks.tick_s == END_S))
    error = tracks.state - truth
    nearest = int(np.argmin(np.sum(error[:, :3] ** 2, axis=1)))
    assert nees(error, tracks.state_covariance)[nearest] < RARE
    assert tracks.probability_launch[nearest] > 0.99


@pytest.mark.slow
def test_a_blind_sensor_is_named():
    _, health = outcome({"fault": "blind"})
    words = health["WEST"]
    assert "contradicts the others: 0 of" in words
    assert "elsewhere" not in words


@pytest.mark.slow
@pytest.mark.parametrize(
    "fault",
    [{"fault": "noise", "factor": 2}, {"fault": "noise", "factor": 0.001}, {"fault": "down"}],
    ids=["twice the noise", "a thousandth", "down"],
)
def test_a_sensor_that_sees_what_others_see_or_does_not_look_contradicts_nobody(fault):
    _, health = outcome(fault)
    assert "contradicts" not in " ".join(health.values())
