"""Burns flown on against SciPy's integrator, and what the thrust gains against the rocket
equation.
"""

import numpy as np
import pytest
from opir_trackers.forecast import burning_on
from opir_trackers.forecast.burning_on import RemainingBurns, Steering, drawn_steering
from opir_trackers.forecast.vehicles import STAGES, vehicle_model
from scipy.integrate import solve_ivp

from opir_core.constants import EARTH_ROTATION_RAD_S

RADIUS_M = 6378137.0
MU = 3.986004418e14
SPIN = np.array([0.0, 0.0, EARTH_ROTATION_RAD_S])
COUNT = 30
STILL = np.zeros((STAGES, burning_on.STEPS, COUNT, 2))


def states(rng: np.random.Generator) -> np.ndarray:
    """Return inertial states (COUNT, 6) over the equator, flying east, some 50 s after a launch."""
    place = np.zeros((COUNT, 3))
    place[:, 0] = RADIUS_M + rng.uniform(8e3, 40e3, COUNT)
    speed = rng.uniform(700.0, 2500.0, COUNT)
    angle = rng.uniform(0.5, 1.2, COUNT)
    velocity = np.stack([speed * np.sin(angle), speed * np.cos(angle), np.zeros(COUNT)], axis=1)
    return np.concatenate([place, velocity + np.cross(SPIN, place)], axis=1)


def burns_and_steering(rng: np.random.Generator) -> tuple[RemainingBurns, Steering]:
    """Return one or two burns that remain, 50 s after the first ignition, with a dark gap between
    them.
    """
    burn = np.zeros((COUNT, STAGES))
    burn[:, 0] = rng.uniform(5.0, 60.0, COUNT)
    burn[::2, 1] = rng.uniform(30.0, 90.0, COUNT // 2)
    gap = np.where(burn > 0.0, [0.0, 6.0, 0.0, 0.0], 0.0)
    start = np.cumsum(burn + gap, axis=1) - burn
    size = np.where(burn > 0.0, rng.uniform(15.0, 40.0, burn.shape), 0.0)
    growth = np.where(burn > 0.0, rng.uniform(0.1, 0.7, burn.shape) / np.maximum(burn, 1.0), 0.0)
    burns = RemainingBurns(start, burn, size, growth, np.full(COUNT, 50.0))
    return burns, drawn_steering(COUNT, vehicle_model().data, 9)


def rates(
    time_s: float, state: np.ndarray, burns: RemainingBurns, steering: Steering, k: int
) -> np.ndarray:
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
    air = state[3:] - np.cross(SPIN, state[:3])
    ahead = air / np.linalg.norm(air)
    side = np.cross(ahead, place)
    down = np.cross(ahead, side / np.linalg.norm(side))
    lead = steering.take(np.array([k])).leads(np.array([50.0 + time_s]))[0]
    push = size * (np.cos(lead) * ahead + np.sin(lead) * down)
    return np.concatenate([state[3:], -MU / np.linalg.norm(place) ** 3 * place + push])


@pytest.mark.slow
def test_burns_flown_on_are_those_of_another_integrator() -> None:
    rng = np.random.default_rng(3)
    start = states(rng)
    (burns, steering) = burns_and_steering(rng)
    after, later, least = burning_on.flown_on(start, burns, steering, STILL)
    errors = []
    for k in range(COUNT):
        used = burns.burn_s[k] > 0.0
        edges = np.sort(
            np.concatenate([burns.start_s[k, used], (burns.start_s + burns.burn_s)[k, used]])
        )
        now = 0.0
        state = start[k]
        low = np.inf
        for edge in edges[edges > 0.0].tolist():
            leg = solve_ivp(
                rates,
                (now, edge),
                state,
                args=(burns, steering, k),
                rtol=1e-8,
                atol=1e-3,
                max_step=5.0,
            )
            state = leg.y[:, -1]
            now = edge
            low = min(low, np.linalg.norm(leg.y[:3], axis=0).min())
        assert later[k] == pytest.approx(now, abs=1e-9)
        assert least[k] > low - 1e3
        errors.append(np.linalg.norm(after[k, 3:] - state[3:]))
    # Three steps a burn: a fraction of what the law of the burns leaves open.
    assert np.median(errors) < 2.0
    assert np.quantile(errors, 0.9) < 60.0


def test_what_has_burnt_out_stays() -> None:
    nothing = np.zeros((COUNT, STAGES))
    burns = RemainingBurns(nothing, nothing, nothing, nothing, np.full(COUNT, 1e4))
    state = states(np.random.default_rng(1))
    after, later, _ = burning_on.flown_on(
        state, burns, drawn_steering(COUNT, vehicle_model().data, 9), STILL
    )
    assert np.array_equal(after, state)
    assert not later.any()


def test_the_thrust_gains_what_the_rocket_equation_says() -> None:
    burns, _ = burns_and_steering(np.random.default_rng(2))
    for k in range(COUNT):
        total = 0.0
        for s in np.flatnonzero(burns.burn_s[k]):
            times = np.linspace(0.0, burns.burn_s[k, s], 20001)
            total += np.trapezoid(
                burns.acceleration_m_s2[k, s] / (1.0 - burns.growth_per_s[k, s] * times), times
            )
        assert burns.ideal_speed_m_s[k] == pytest.approx(total, rel=1e-6)


def test_a_cut_off_ends_all_thrust_after_a_share_of_what_remains() -> None:
    burns, _ = burns_and_steering(np.random.default_rng(2))
    share = np.linspace(0.0, 1.0, COUNT)
    cut = burns.cut_off(share)
    assert cut.burn_s.sum(axis=1) == pytest.approx(share * burns.burn_s.sum(axis=1))
    later = cut.burn_s[:, 1] > 0.0
    assert np.array_equal(cut.burn_s[later, 0], burns.burn_s[later, 0])
