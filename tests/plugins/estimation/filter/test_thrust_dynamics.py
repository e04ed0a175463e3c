"""Boost along the velocity: its equations, its slopes, and how honest a filter that takes it for
granted is.
"""

import numpy as np
import pytest
from opir_estimation import COAST, Motion, Thrust, taylor_positions, taylor_weights
from opir_estimation.filter.thrust import THRUST, across_share_at
from scipy.integrate import solve_ivp

from opir_core.constants import EARTH_ROTATION_RAD_S
from opir_core.flight.forces import Forces

SPIN = np.array([0.0, 0.0, EARTH_ROTATION_RAD_S])
TILT_S = 15.0


def motion(**settings: float) -> Thrust:
    given = {
        "tilt_rad": 0.07,
        "tilt_s": TILT_S,
        "noise_m_s2": 1.5,
        "growth_noise": 0.003,
        **settings,
    }
    return Thrust(forces=Forces(), **given)


def states(count: int, seed: int = 0) -> np.ndarray:
    """Return boosts of 200 to 3000 m/s over the turning Earth, their thrust within some degrees of
    the velocity.
    """
    rng = np.random.default_rng(seed)
    place = rng.normal(size=(count, 3))
    place *= 6.45e6 / np.linalg.norm(place, axis=1)[:, None]
    ahead = rng.normal(size=(count, 3))
    ahead /= np.linalg.norm(ahead, axis=1)[:, None]
    velocity = rng.uniform(200.0, 3000.0, (count, 1)) * ahead + np.cross(SPIN, place)
    force = rng.uniform(15.0, 60.0, (count, 1)) * (ahead + 0.07 * rng.normal(size=(count, 3)))
    return np.concatenate([place, velocity, force, rng.uniform(0.0, 0.02, (count, 1))], axis=1)


def rate(_time_s: float, state: np.ndarray) -> np.ndarray:
    """Return the rate of a state, in vectors: the force turns with the velocity and is pulled
    towards it.

    The relative growth of the force obeys the rocket equation of constant mass flow: its rate is
    its square.
    """
    place = state[:3]
    velocity = state[3:6]
    force = state[6:9]
    growth = state[9]
    fall = Motion(COAST, 0.0, Forces()).gravity(place[None])[0] + force
    air = velocity - np.cross(SPIN, place)
    speed = np.sqrt(air @ air + 1.0)
    unit = air / speed
    counts = air @ air / (air @ air + 100.0**2)
    push = fall - np.cross(SPIN, velocity)
    turn = (push - unit * (unit @ push)) * speed / (air @ air + 100.0**2)
    across = force - unit * (unit @ force)
    change = growth * force + (force @ unit) * turn - counts / TILT_S * across
    return np.concatenate([velocity, fall, change, [growth**2]])


@pytest.mark.parametrize(("step_s", "off"), [(1.0, 1e-3), (-1.0, 1e-3), (5.0, 0.3)])
def test_a_step_is_the_integral_of_the_rate(step_s: float, off: float) -> None:
    start = states(20)
    after = motion().propagated(start, np.full(20, step_s))
    for row in range(20):
        exact = solve_ivp(
            rate, (0.0, step_s), start[row], method="DOP853", rtol=1e-12, atol=1e-9
        ).y[:, -1]
        assert np.all(
            np.abs(after[row] - exact) < off * np.repeat([1.0, 1.0, 1.0, 1e-6], [3, 3, 3, 1])
        )


def test_transition_is_the_slope_of_the_motion() -> None:
    start = states(20)
    step = np.full(20, 1.0)
    moved = motion().propagated(start, step)
    matrix = motion().transition(0.5 * (start + moved), step)
    scale = np.repeat([10.0, 0.1, 0.01, 1e-4], [3, 3, 3, 1])
    for column in range(THRUST):
        shift = np.zeros(THRUST)
        shift[column] = scale[column]
        slope = (
            motion().propagated(start + shift, step) - motion().propagated(start - shift, step)
        ) / 2.0
        assert np.allclose(
            slope / scale, matrix[:, :, column] * scale[column] / scale, atol=0.02, rtol=1e-3
        )


def test_a_state_moves_the_same_to_the_last_bit_alone_and_among_others() -> None:
    start = states(40)
    steps = np.random.default_rng(1).uniform(-1.0, 2.0, 40)
    moved = motion().propagated(start, steps)
    path = motion().taylor(start)
    rates = motion().force_rate(start)
    for row in range(40):
        one = start[[row]]
        assert np.array_equal(motion().force_rate(one)[0], rates[row])
        assert np.array_equal(motion().taylor(one)[0], path[row])
        assert np.array_equal(motion().propagated(one, steps[[row]])[0], moved[row])


def test_the_path_of_a_slice_is_the_motion() -> None:
    start = states(20)
    since = np.full(20, -1.0)
    assert np.allclose(
        taylor_positions(motion().taylor(start), taylor_weights(since)),
        motion().propagated(start, since)[:, :3],
        atol=0.05,
    )


def test_the_noise_is_the_tilts_across_and_its_own_along_the_velocity() -> None:
    start = states(5)
    side = motion().noise_root(np.full(5, 0.5), start)
    covariance = (side @ side.transpose(0, 2, 1))[:, 6:9, 6:9] / 0.5
    air = start[:, 3:6] - np.cross(SPIN, start[:, :3])
    unit = air / np.linalg.norm(air, axis=1)[:, None]
    assert np.einsum("ni,nij,nj->n", unit, covariance, unit) == pytest.approx(
        np.full(5, 1.5**2), rel=1e-3
    )
    square = np.sum(start[:, 6:9] ** 2, axis=1)
    across = np.trace(covariance, axis1=1, axis2=2) - 1.5**2
    share = np.sqrt(2.0 / TILT_S) * np.tan(0.07) + 0.045 / (
        1.0 + (np.linalg.norm(air, axis=1) / 600.0) ** 4
    )
    assert across == pytest.approx(2.0 * share**2 * square, rel=1e-3)


def test_slow_boosts_may_turn_faster() -> None:
    """Under the tracker's law the noise is 0.053 of the force at 250 m/s, 0.01 beyond 1.4 km/s
    (`pitch_over.py`).
    """
    late = np.sqrt(2.0 / 30.0) * np.tan(np.radians(2.0))
    assert across_share_at(late, 250.0**2) == pytest.approx(0.053, rel=0.15)
    assert across_share_at(late, 1400.0**2) == pytest.approx(late, rel=0.2)


def test_left_alone_the_tilt_settles_at_its_standard_deviation() -> None:
    """The covariance of the force across a fast velocity, without looks, goes to (tan(tilt)
    |f|)².
    """
    one = motion()
    state = np.array([[6.45e6, 0.0, 0.0, 5000.0, 465.1 + 0.02, 0.0, 20.0, 0.0, 0.0, 0.0]])
    spread = np.zeros((1, 3, 3))
    for _ in range(200):
        matrix = one.transition(state, np.ones(1))[:, 6:9, 6:9]
        side = one.noise_root(np.ones(1), state)[:, 6:9]
        spread = matrix @ spread @ matrix.transpose(0, 2, 1) + side @ side.transpose(0, 2, 1)
    # Thrust turns the velocity, too: that a tilt makes the velocity follow it is 20/5000 a second
    # against 1/15.
    assert np.sqrt(spread[0, 2, 2]) == pytest.approx(20.0 * np.tan(0.07), rel=0.1)
