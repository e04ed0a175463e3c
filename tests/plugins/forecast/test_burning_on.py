"""Burns flown on against SciPy's integrator, and what the thrust gains against the rocket
equation.
"""

import numpy as np
import pytest
from boost_law import MODEL, STAGES
from opir_forecast.burning_on import (
    STEPS,
    RemainingBurns,
    drawn_steering,
    flown_on,
)
from plain_boosts import MU, RADIUS_M, SPIN
from scipy.integrate import solve_ivp

COUNT = 30
STILL = np.zeros((STAGES, STEPS, COUNT, 2))
STEERING = drawn_steering(COUNT, MODEL.data, 9)


def states(rng: np.random.Generator) -> np.ndarray:
    """Return inertial states (COUNT, 6) over the equator, flying east, some 50 s after a launch."""
    zero = np.zeros(COUNT)
    place = np.stack([RADIUS_M + rng.uniform(8e3, 40e3, COUNT), zero, zero], axis=1)
    speed = rng.uniform(700.0, 2500.0, COUNT)
    angle = rng.uniform(0.5, 1.2, COUNT)
    velocity = np.stack([speed * np.sin(angle), speed * np.cos(angle), zero], axis=1)
    return np.concatenate([place, velocity + np.cross(SPIN, place)], axis=1)


def remaining_burns(rng: np.random.Generator) -> RemainingBurns:
    """Return one or two burns that remain, 50 s after the first ignition, with a dark gap between
    them.
    """
    burn = np.zeros((COUNT, STAGES))
    burn[:, 0] = rng.uniform(5.0, 60.0, COUNT)
    burn[::2, 1] = rng.uniform(30.0, 90.0, COUNT // 2)
    burns = burn > 0.0
    gap = np.where(burns, [0.0, 6.0, 0.0, 0.0], 0.0)
    start = np.cumsum(burn + gap, axis=1) - burn
    size = np.where(burns, rng.uniform(15.0, 40.0, burn.shape), 0.0)
    growth = np.where(burns, rng.uniform(0.1, 0.7, burn.shape) / np.maximum(burn, 1.0), 0.0)
    return RemainingBurns(start, burn, size, growth, np.full(COUNT, 50.0))


def rates(time_s: float, state: np.ndarray, burns: RemainingBurns, k: int) -> np.ndarray:
    """Return the rates of an inertial state, from the definition of the burns and of the
    steering.
    """
    size = sum(
        burns.acceleration_m_s2[k, s]
        / (1.0 - burns.growth_per_s[k, s] * (time_s - burns.start_s[k, s]))
        for s in range(STAGES)
        if burns.start_s[k, s] <= time_s < burns.start_s[k, s] + burns.burn_s[k, s]
    )
    place = state[:3]
    air = state[3:] - np.cross(SPIN, place)
    along = air / np.linalg.norm(air)
    side = np.cross(along, place)
    down = np.cross(along, side / np.linalg.norm(side))
    lead = STEERING.take(np.array([k])).leads(np.array([50.0 + time_s]))[0]
    push = size * (np.cos(lead) * along + np.sin(lead) * down)
    return np.concatenate([state[3:], -MU / np.linalg.norm(place) ** 3 * place + push])


@pytest.mark.slow
def test_burns_flown_on_are_those_of_another_integrator() -> None:
    rng = np.random.default_rng(3)
    starts = states(rng)
    burns = remaining_burns(rng)
    ends, times_s, least_m = flown_on(starts, burns, STEERING, STILL)
    errors = []
    for k, state in enumerate(starts):
        is_used = burns.burn_s[k] > 0.0
        edges = np.stack([burns.start_s, burns.start_s + burns.burn_s])[:, k, is_used]
        time_s = 0.0
        lowest_m = np.inf
        for edge in np.unique(edges[edges > 0.0]).tolist():
            leg = solve_ivp(
                rates, (time_s, edge), state, args=(burns, k), rtol=1e-8, atol=1e-3, max_step=5.0
            )
            state = leg.y[:, -1]
            time_s = edge
            lowest_m = min(lowest_m, np.linalg.norm(leg.y[:3], axis=0).min())
        assert times_s[k] == pytest.approx(time_s, abs=1e-9)
        assert least_m[k] > lowest_m - 1e3
        errors.append(np.linalg.norm(ends[k, 3:] - state[3:]))
    # Three steps a burn: a fraction of what the law of the burns leaves open.
    assert np.median(errors) < 2.0
    assert np.quantile(errors, 0.9) < 60.0


def test_a_burnt_out_vehicle_stays() -> None:
    nothing = np.zeros((COUNT, STAGES))
    burns = RemainingBurns(nothing, nothing, nothing, nothing, np.full(COUNT, 1e4))
    state = states(np.random.default_rng(1))
    end, time_s, _ = flown_on(state, burns, STEERING, STILL)
    assert np.array_equal(end, state)
    assert not time_s.any()


def test_the_thrust_gains_what_the_rocket_equation_says() -> None:
    burns = remaining_burns(np.random.default_rng(2))
    for k in range(COUNT):
        total = 0.0
        for s in np.flatnonzero(burns.burn_s[k]):
            times = np.linspace(0.0, burns.burn_s[k, s], 20001)
            total += np.trapezoid(
                burns.acceleration_m_s2[k, s] / (1.0 - burns.growth_per_s[k, s] * times), times
            )
        assert burns.ideal_speed_m_s[k] == pytest.approx(total, rel=1e-6)


def test_a_cut_off_ends_all_thrust_after_a_share_of_what_remains() -> None:
    burns = remaining_burns(np.random.default_rng(2))
    share = np.linspace(0.0, 1.0, COUNT)
    cut = burns.cut_off(share)
    assert cut.burn_s.sum(axis=1) == pytest.approx(share * burns.burn_s.sum(axis=1))
    later = cut.burn_s[:, 1] > 0.0
    assert np.array_equal(cut.burn_s[later, 0], burns.burn_s[later, 0])
