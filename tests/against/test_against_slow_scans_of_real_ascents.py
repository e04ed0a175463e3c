"""`imm` with scanners of 10 s against real space launches, for the first minute likeliest ground
sources.
"""

from pathlib import Path

import numpy as np
import pytest

import opir_core as opir

ASCENTS = Path(__file__).parents[2] / "examples" / "ascents"
START_S = 30.0
LATE_S = 105.0
SENSOR = {"model": "DSP", "scan_period_ms": 10_000.0}


def run_of(flight, seed):
    """Return a run of an ascent before two scanners, until it is some 60 km high."""
    target = {"id": flight, "model": "table", "type": "SLV", "file": str(ASCENTS / f"{flight}.csv")}
    slots = {"WEST": -130.0, "EAST": -40.0}
    return opir.simulate(
        opir.scene_from_mapping(
            {
                "scene": "slow scans",
                "epoch": "2026-04-01T12:00:00Z",
                "duration_s": START_S + 140.0,
                "seed": seed,
                "sensors": [
                    {**SENSOR, "id": name, "orbital_slot_deg": slot} for name, slot in slots.items()
                ],
                "targets": [{**target, "start_s": START_S}],
                "tracker": "imm",
            }
        )
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    ("flight", "seed"),
    [("crs8", 8), ("crs8", 50), ("fhdemo", 50), ("orbcomm2", 51)],
)
def test_a_launch_that_looks_like_a_fire_keeps_its_track(flight, seed):
    run = run_of(flight, seed)
    settled = (run.truth.target == 0) & (run.detections.time_s > START_S + LATE_S)
    number = np.unique(run.detections.track[settled])
    assert len(number) == 1
    assert number[0] >= 0, "the launch has left the gate of a ground source"
    rows = run.tracks.take(np.flatnonzero(run.tracks.track == number[0]))
    assert rows.probability_launch[np.searchsorted(rows.tick_s, START_S + 60.0)] < 0.5
    assert rows.probability_launch[-1] > 0.95
