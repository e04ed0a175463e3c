"""A glider in the dark, against level flight that is integrated by SciPy."""

import numpy as np
import pytest
from opir_estimation import glided
from opir_scoring.containments import nees
from opir_scoring.evidence import true_states_ecef
from scipy.integrate import solve_ivp

import opir_core as opir

MU = 3.986004418e14
SPIN = np.array([0.0, 0.0, 7.292115e-5])
START = np.array([6378137.0 + 60e3, 0.0, 0.0, 0.0, 3200.0, 2400.0])


SCENE = {
    "scene": "glide",
    "epoch": "2026-04-01T12:00:00Z",
    "duration_s": 195,
    "seed": 6,
    "sensors": [
        {"model": "SBIRS-GEO", "id": "S1", "orbital_slot_deg": 95.0},
        {"model": "SBIRS-GEO", "id": "S2", "orbital_slot_deg": 160.0},
    ],
    "targets": [
        {
            "id": "T1",
            "type": "HGV",
            "launch": {"lat_deg": -20.0, "lon_deg": 130.0, "time_s": 10.0},
            "aim": {"lat_deg": -35.0, "lon_deg": 100.0},
        }
    ],
    "tracker": "imm",
}


def flown(until_s, lift, drag, start=START):
    """Return the ECEF state of a flight whose lift and drag are shares of the weight less the
    centrifugal force.
    """

    def rates(_time_s, state):
        place = state[:3]
        velocity = state[3:]
        radius = np.linalg.norm(place)
        inertial = velocity + np.cross(SPIN, place)
        weight = MU / radius**2 - inertial @ inertial / radius
        ahead = velocity / np.linalg.norm(velocity)
        up = place / radius - ahead * (place @ ahead) / radius
        turning = -2.0 * np.cross(SPIN, velocity) - np.cross(SPIN, np.cross(SPIN, place))
        push = weight * (lift * up / np.linalg.norm(up) - drag * ahead)
        return np.concatenate([velocity, -MU * place / radius**3 + turning + push])

    return solve_ivp(rates, (0.0, until_s), start, rtol=1e-9, atol=1e-3).y[:, -1]


#: A flight northeast from the equator, and one west at 45°.
STARTS = (START, np.array([4.5e6, 0.0, 4.57e6, 0.0, -3200.0, 500.0]))


@pytest.mark.parametrize("since_s", [1.0, 5.0, 20.0, 40.0])
@pytest.mark.parametrize("start", STARTS, ids=["northeast", "west"])
def test_an_equilibrium_glide_is_the_mean_of_gliders(since_s, start):
    falls = flown(since_s, 0.0, 0.0, start)
    glides = flown(since_s, 1.0, 0.45, start)
    state, covariance = glided(falls[None], 1e-6 * np.eye(6)[None], np.array([since_s]))
    off = np.abs(state[0] - glides)
    moved = np.linalg.norm((glides - falls).reshape(2, 3), axis=1)
    # Forces are those at the end of the fall, whose axes and weight change by 0.3 % a second.
    # Without the Earth's rotation the weight is off by 4 to 8 % from the start.
    assert np.all(off.reshape(2, 3).max(axis=1) < 0.003 * since_s * moved)
    assert np.linalg.eigvalsh(covariance[0]).min() > 0.0


def test_gliders_are_held_and_falls_are_not():
    """Ellipsoids of 95 %, of what pulls up, sinks and brakes."""
    since_s = 20.0
    state, covariance = glided(
        flown(since_s, 0.0, 0.0)[None], 25.0 * np.eye(6)[None], np.array([since_s])
    )

    def distance(true):
        return (true - state[0]) @ np.linalg.solve(covariance[0], true - state[0])

    assert all(
        distance(flown(since_s, lift, drag)) < 12.6
        for lift in (0.4, 1.0, 1.6)
        for drag in (0.25, 0.65)
    )
    assert distance(flown(since_s, 3.0, 0.45)) > 12.6


@pytest.mark.slow
def test_the_state_of_a_glider_is_held_after_its_burn():
    run = opir.simulate(opir.scene_from_mapping(SCENE))
    tracks = run.tracks
    burnout_s = run.plan.targets.burnout_s[0]
    late = tracks.take(
        np.flatnonzero((tracks.tick_s > burnout_s + 15.0) & (tracks.tick_s < burnout_s + 30.0))
    )
    assert len(late) > 10
    start = true_states_ecef(run.plan, np.zeros(1, dtype=np.int32), np.array([burnout_s - 1e-3]))[0]
    truth = np.array([flown(when_s - burnout_s, 1.0, 0.4, start) for when_s in late.tick_s])
    assert np.mean(nees(late.state - truth, late.state_covariance) < 12.6) > 0.9
    # It is not wide for nothing: a free fall is 2 km below after 20 s.
    assert np.sqrt(late.state_covariance[:, :3, :3].trace(axis1=1, axis2=2)).max() < 6e3
