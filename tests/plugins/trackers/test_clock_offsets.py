"""Clocks of sensors that are off: innovations do not show it, so positions are widened along the motion."""

from typing import Any

import numpy as np
import pytest
from attrs import evolve
from opir_trackers.sensors import Biases
from opir_trackers.triangulation import triangulated

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
    scene = {"scene": "clocks", "epoch": "2026-04-01T12:00:00Z", "duration_s": 240.0, "seed": 4, "sensors": SENSORS}
    return opir.compile_plan(opir.scene_from_mapping({**scene, "targets": [TARGET], "tracker": tracker}))


def test_against_triangulation_of_a_line_seen_too_late() -> None:
    """At scene time 0 Earth-fixed and inertial axes are the same."""
    sensors = plan(model="none").sensors
    place, velocity = np.array([-2.8e6, -4.5e6, 3.7e6]), np.array([-2000.0, -1000.0, 2500.0])
    origin = np.concatenate([sensor.orbit.position_ecef_m(np.zeros(1)) for sensor in sensors])
    shifts = []
    for late in range(2):
        seen = np.array([place + (SIGMA_S * velocity if number == late else 0.0) for number in range(2)])
        apart = seen - origin
        direction = apart / np.linalg.norm(apart, axis=1)[:, None]
        sigma = np.full(2, 2e-5)
        shifts.append(triangulated(np.zeros(2, dtype=np.int64), 1, origin, direction, sigma).position_m[0] - place)
    expected = sum(np.outer(shift, shift) for shift in shifts)
    both = np.ones((1, 2), dtype=np.bool_)
    found = Biases.of(sensors, SIGMA_S).of_clocks(place[None], velocity[None], 0.0, both)[0]
    assert found == pytest.approx(expected, rel=0.02, abs=0.01 * np.trace(expected))


@pytest.mark.slow
def test_states_are_held_with_a_clock_that_is_off_if_the_tracker_is_told() -> None:
    """The states of a run with one clock off by 0.3 s beside those of the same looks at their own times."""
    nees = {}
    for sigma_s in (0.0, SIGMA_S):
        settings = {"model": "imm", "clock_sigma_s": sigma_s, "cadence_s": 2.0, "regions_every_s": 600.0}
        run, tracker = opir.run_of_plan(plan(**settings)), plan(**settings).make_tracker()
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
    assert nees[0.0] > 2.0
    assert nees[SIGMA_S] < 1.0
