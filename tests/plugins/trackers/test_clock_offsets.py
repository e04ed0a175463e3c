"""Clocks of sensors that are off, stated or not: two sensors show their difference, and positions
are widened along the motion by what they do not show.
"""

from typing import Any

import numpy as np
import pytest
from attrs import evolve

import opir_core as opir

SENSORS = [
    {"model": "SBIRS-GEO", "id": "WEST", "orbital_slot_deg": -150.0},
    {"model": "SBIRS-GEO", "id": "EAST", "orbital_slot_deg": -90.0},
]
TARGET = {
    "id": "T",
    "type": "ICBM",
    "launch": {"lat_deg": 34.73, "lon_deg": -120.57, "time_s": 2.0},
    "aim": {"lat_deg": 9.0, "lon_deg": 167.7},
}
SIGMA_S = 0.25


def plan(**tracker: Any) -> opir.Plan:
    scene = {
        "scene": "clocks",
        "epoch": "2026-04-01T12:00:00Z",
        "duration_s": 240.0,
        "seed": 4,
        "sensors": SENSORS,
    }
    return opir.compile_plan(
        opir.scene_from_mapping({**scene, "targets": [TARGET], "tracker": tracker})
    )


@pytest.mark.slow
def test_states_are_held_with_a_clock_that_is_off() -> None:
    """The states of a run with one clock off by 0.3 s beside those of the same looks at their own
    times.

    The difference of both clocks shows as the target speeds up; their sum is not observable.
    """
    nees = {}
    clocks = {}
    for sigma_s in (0.0, SIGMA_S):
        settings = {
            "model": "imm",
            "clock_sigma_s": sigma_s,
            "cadence_s": 2.0,
            "forecast": "none",
        }
        run = opir.run_of_plan(plan(**settings))
        tracker = plan(**settings).make_tracker()
        off_ns = np.where(run.detections.sensor == 0, np.int64(3e8), np.int64(0))
        late = evolve(run.detections, time_ns=run.detections.time_ns + off_ns)
        late = late.take(np.argsort(late.time_ns, kind="stable"))
        errors = []
        for tick_s in np.arange(2.0, 240.0, 2.0):
            here = (late.time_ns >= (tick_s - 2.0) * 1e9) & (late.time_ns < tick_s * 1e9)
            tracks = tracker.step(tick_s, late.take(np.flatnonzero(here)))
            right = run.tracks.take(np.flatnonzero(run.tracks.tick_s == tick_s))
            if tick_s > 180.0:
                off = tracks.state[0, :3] - right.state[0, :3]
                errors.append(off @ np.linalg.solve(tracks.state_covariance[0, :3, :3], off) / 3.0)
        nees[sigma_s] = np.mean(errors)
        clocks[sigma_s] = tracker.sensor_health().clock_s
    # Both have the noise of the same looks, so that the difference is less than either error.
    assert all(0.1 < value < 1.0 for value in nees.values())
    for clock_s in clocks.values():
        assert clock_s[0] - clock_s[1] == pytest.approx(0.3, abs=0.08)
