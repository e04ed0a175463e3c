"""Outages in a burn: nobody looked, so it burns on by its prior, and is found again where it is."""

from typing import Any

import numpy as np
import pytest
from attrs import evolve
from opir_scoring.evidence import true_states_ecef
from scipy.stats import chi2

import opir_core as opir
from opir_core.flight import propagate_kepler
from opir_core.geometry import eci_to_ecef

COUNT = 4
OUTAGE_S = (70.0, 85.0)
BURN_MEAN_S = 150.0
SPIN = np.array([0.0, 0.0, 7.292115e-5])

#: Launches from the west coast of America and the Pacific, towards the west.
PLACES = ((33.0, -119.0), (41.0, -124.0), (28.0, -115.0), (36.0, -122.0))


def scene(seed: int, watched_s: dict[str, Any]) -> opir.Scene:
    targets = [
        {
            "id": f"T{number}",
            "type": "ICBM",
            "launch": {"lat_deg": lat, "lon_deg": lon, "time_s": 5.0 + 2.0 * number},
            "aim": {"lat_deg": 8.0, "lon_deg": 167.0},
        }
        for number, (lat, lon) in enumerate(PLACES)
    ]
    sensors = [
        {"model": "SBIRS-GEO", "id": name, "orbital_slot_deg": slot, "scan_period_ms": 1000}
        for name, slot in (("WEST", -135.0), ("EAST", -75.0))
    ]
    mapping = {
        "scene": "outage",
        "epoch": "2026-04-01T12:00:00Z",
        "duration_s": 100.0,
        "seed": seed,
        "sensors": sensors,
        "targets": targets,
        "tracker": "imm",
        "watched_s": watched_s,
    }
    return opir.scene_from_mapping(mapping)


def errors(run: opir.Run, time_s: float) -> np.ndarray:
    """Return the squared errors (n,) of the tracks' states, in their covariances, at a tick."""
    tracks = run.tracks
    targets = np.arange(COUNT)
    truth = [
        run.plan.targets.position_ecef_m(targets, np.full(COUNT, time_s + step))
        for step in (-0.05, 0.0, 0.05)
    ]
    states = np.concatenate([truth[1], (truth[2] - truth[0]) / 0.1], axis=1)
    found = []
    for row in np.flatnonzero(tracks.tick_s == time_s).tolist():
        error = tracks.state[row] - states
        nearest = error[np.square(error[:, :3]).sum(axis=1).argmin()]
        found.append(nearest @ np.linalg.solve(tracks.state_covariance[row], nearest))
    return np.array(found)


def burning(run: opir.Run, time_s: float) -> np.ndarray:
    return run.tracks.probability_burning[run.tracks.tick_s == time_s]


@pytest.mark.slow
@pytest.mark.parametrize("seed", [531, 532])
def test_an_outage_of_all_sensors_is_no_burnout(seed: int) -> None:
    start_s, end_s = OUTAGE_S
    spans = [[0.0, start_s], [end_s, 100.0]]
    run = opir.simulate(scene(seed, {"WEST": spans, "EAST": spans}))
    expected = np.exp(-(end_s - start_s) / BURN_MEAN_S)
    np.testing.assert_allclose(burning(run, end_s), expected, atol=0.03)
    assert (burning(run, end_s + 3.0) > 0.95).all()
    assert (burning(run, 95.0) > 0.99).all()
    for time_s in (start_s, 78.0, end_s, 86.0, 88.0, 95.0):
        states = errors(run, time_s)
        assert len(states) == COUNT
        # Of six numbers each; one of a thousand sums is above.
        assert states.sum() < chi2.ppf(0.999, 6 * COUNT), time_s


@pytest.mark.slow
def test_one_sensor_that_stops_leaves_the_other_to_tell_the_burn() -> None:
    run = opir.simulate(scene(533, {"EAST": [[0.0, OUTAGE_S[0]]]}))
    assert (burning(run, 100.0) > 0.99).all()
    assert errors(run, 85.0).sum() < chi2.ppf(0.999, 6 * COUNT)


@pytest.mark.slow
@pytest.mark.parametrize("shift_s", [-1.5, 1.0])
def test_a_burnout_near_the_end_of_an_outage_is_found_and_held(shift_s: float) -> None:
    """One look in two seconds misses; the last light, or the end of the outage, is 4 s ago."""
    flight = scene(534, {})
    targets = flight.targets[:1]
    burnout_s = float(opir.compile_plan(evolve(flight, targets=targets)).targets.end_s[0])
    end_s = burnout_s + shift_s
    spans = ((0.0, end_s - 10.0), (end_s, burnout_s + 10.0))
    late = evolve(
        flight,
        targets=targets,
        duration_s=float(np.ceil(burnout_s + 10.0)),
        watched_s={"WEST": spans, "EAST": spans},
    )
    run = opir.run_of_plan(opir.compile_plan(late))
    found_s = np.ceil(max(burnout_s, end_s) + 4.0)
    assert (burning(run, found_s) < 0.5).all()
    tracks = run.tracks.take(np.flatnonzero(run.tracks.tick_s == found_s))
    assert len(tracks) == 1
    truth = true_states_ecef(run.plan, np.zeros(1, dtype=np.int32), np.array([burnout_s - 1e-3]))
    place, velocity = truth[:, :3], truth[:, 3:]
    since_s = np.array([found_s - burnout_s])
    inertial = propagate_kepler(place, velocity + np.cross(SPIN, place), since_s)
    place, velocity = (eci_to_ecef(vector, since_s) for vector in inertial)
    error = tracks.state[0] - np.hstack([place, velocity - np.cross(SPIN, place)])[0]
    squared = error @ np.linalg.solve(tracks.state_covariance[0], error)
    assert squared < chi2.ppf(0.999, 6)
