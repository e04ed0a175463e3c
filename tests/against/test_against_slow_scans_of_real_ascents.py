"""`imm` behind scanners of 10 s against real space launches, which are like fires for the first minute."""

from pathlib import Path

import numpy as np
import pytest

import opir_core as opir

ASCENTS = Path(__file__).parents[2] / "examples" / "ascents"
START_S, LATE_S = 30.0, 105.0
SENSOR = {"model": "DSP", "scan_period_ms": 10_000.0}


def run_of(flight: str, seed: int) -> opir.Run:
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
                "sensors": [{**SENSOR, "id": name, "orbital_slot_deg": slot} for name, slot in slots.items()],
                "targets": [{**target, "start_s": START_S}],
                "tracker": "imm",
            }
        )
    )


@pytest.mark.slow
@pytest.mark.parametrize(("flight", "seed"), [("crs8", 8), ("crs8", 50), ("fhdemo", 50), ("orbcomm2", 51)])
def test_what_is_taken_for_a_fire_is_followed_until_it_is_sure(flight: str, seed: int) -> None:
    run = run_of(flight, seed)
    late = (run.truth.target == 0) & (run.detections.time_s > START_S + LATE_S)
    number = np.unique(run.detections.track[late])
    assert len(number) == 1
    assert number[0] >= 0, "light that rises from where a fire was thought to burn has no track"
    mine = run.tracks.take(np.flatnonzero(run.tracks.track == number[0]))
    assert mine.probability_launch[np.searchsorted(mine.tick_s, START_S + 60.0)] < 0.5
    assert mine.probability_launch[-1] > 0.95
