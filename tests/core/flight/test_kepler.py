"""Two-body propagation: what it keeps, what it does to batches, and what it says when it cannot."""

import warnings

import numpy as np
import pytest
from hypothesis import given, strategies as st
from lone_rows import assert_rows_independent

from examples import examples
from opir_core.constants import EARTH_MU_M3_S2
from opir_core.flight import propagate_kepler
from opir_core.flight.universal_anomaly import solve_bracketed

pytestmark = pytest.mark.filterwarnings("error")


def mixed_states(count, seed=1):
    """Return states of every conic, at every distance, and durations of every size."""
    rng = np.random.default_rng(seed)
    position = rng.normal(size=(count, 3))
    position *= (10.0 ** rng.uniform(6.0, 9.0, count) / np.linalg.norm(position, axis=1))[:, None]
    direction = rng.normal(size=(count, 3))
    kinds = rng.integers(0, 3, count)
    direction[kinds == 0] = position[kinds == 0]
    direction[kinds == 1] += (
        1e6 * position[kinds == 1] * rng.choice([-1.0, 1.0], (count, 1))[kinds == 1]
    )
    direction /= np.linalg.norm(direction, axis=1)[:, None]
    escape = np.sqrt(2.0 * EARTH_MU_M3_S2 / np.linalg.norm(position, axis=1))
    speed = escape * np.where(rng.random(count) < 0.2, 1.0, rng.uniform(-3.0, 3.0, count))
    return (
        position,
        speed[:, None] * direction,
        10.0 ** rng.uniform(-6.0, 6.4, count) * rng.choice([-1.0, 1.0], count),
    )


def energies(position, velocity):
    """Return the kinetic and the potential energy a mass, J/kg."""
    radius = np.linalg.norm(position, axis=-1)
    return np.stack([np.sum(velocity**2, axis=-1) / 2.0, -EARTH_MU_M3_S2 / radius])


def test_energy_and_angular_momentum_are_kept():
    position, velocity, duration = mixed_states(4000)
    states = ((position, velocity), propagate_kepler(position, velocity, duration))
    start, end = (energies(*state) for state in states)
    # Energy is a difference: it is known only to the rounding of its terms at either end, or of the
    # way between.
    bar = 1e-11 * np.maximum(*(np.abs(terms).sum(axis=0) for terms in (start, end)))
    assert np.all(np.abs(end.sum(axis=0) - start.sum(axis=0)) <= bar)
    start, end = (np.cross(*state) for state in states)
    sizes = [np.linalg.norm(p, axis=1) * np.linalg.norm(v, axis=1) for p, v in states]
    assert np.all(np.linalg.norm(end - start, axis=1) <= 1e-11 * np.maximum(*sizes))


def test_a_ballistic_arc_there_and_back():
    rng = np.random.default_rng(3)
    position = np.array([6478e3, 0.0, 0.0])
    elevation = rng.uniform(0.3, 1.4, 1000)
    speed = rng.uniform(2e3, 7.2e3, 1000)
    velocity = np.stack([speed * np.sin(elevation), speed * np.cos(elevation), 0.0 * speed], axis=1)
    duration = 2.0 * velocity[:, 0] / 9.4
    end = propagate_kepler(position, velocity, duration)
    start_position, start_velocity = propagate_kepler(*end, -duration)
    assert np.max(np.abs(start_position - position)) <= 1e-7
    assert np.max(np.abs(start_velocity - velocity)) <= 1e-10


def test_no_time_changes_nothing():
    position, velocity, _ = mixed_states(500)
    for zero in (0.0, -0.0):
        end_position, end_velocity = propagate_kepler(position, velocity, zero)
        assert np.array_equal(end_position, position)
        np.testing.assert_allclose(end_velocity, velocity, rtol=3e-16, atol=0.0)


@pytest.mark.parametrize("size", [1, 2, 7, 1000, 8191, 8193])
def test_an_element_has_the_same_bits_in_any_company(size):
    rows = [slice(start, start + size) for start in (0, 13, max(8999 - size, 0))]
    assert_rows_independent(propagate_kepler, *mixed_states(9000), rows=rows)


def test_memory_order_and_broadcasting_change_nothing():
    position, velocity, duration = mixed_states(60)
    plain = propagate_kepler(position[:, None], velocity[:, None], duration)
    assert plain[0].shape == (60, 60, 3)
    strided = propagate_kepler(
        np.asfortranarray(position)[:, None], velocity[:, None], duration[None]
    )
    for a, b in zip(plain, strided, strict=True):
        assert np.array_equal(a, b)
    for i in range(0, 60, 7):
        assert np.array_equal(
            propagate_kepler(position[i], velocity[i], duration[i])[0], plain[0][i, i]
        )


def test_shapes():
    position, velocity = propagate_kepler([7e6, 0, 0], [0, 7e3, 0], 10)
    assert position.shape == velocity.shape == (3,)
    position, velocity = propagate_kepler(np.empty((0, 3)), np.empty((0, 3)), np.empty(0))
    assert position.shape == velocity.shape == (0, 3)


def test_many_turns_come_round():
    radius = 7e6
    turns = 100_000
    speed = np.sqrt(EARTH_MU_M3_S2 / radius)
    period = 2.0 * np.pi * radius / speed
    end, _ = propagate_kepler([radius, 0, 0], [0, speed, 0], turns * period)
    assert np.linalg.norm(end - [radius, 0, 0]) <= 10.0 * turns * 2.0 * np.pi * radius * 2.2e-16


def test_a_straight_fall_turns_back_in_the_centre():
    """From rest, the centre is reached after half the period and the start again after the
    whole.
    """
    radius = 8e6
    period = 2.0 * np.pi * np.sqrt((radius / 2.0) ** 3 / EARTH_MU_M3_S2)
    times = np.array([0.3, 0.45, 0.55, 0.7, 1.0]) * period
    position, velocity = propagate_kepler([radius, 0, 0], [0, 0, 0], times)
    assert np.all(position[:, 1:] == 0.0)
    assert np.all(velocity[:2, 0] < 0.0)
    assert np.all(velocity[2:4, 0] > 0.0)
    np.testing.assert_allclose(position[[0, 1], 0], position[[3, 2], 0], rtol=1e-11)
    np.testing.assert_allclose(position[4, 0], radius, rtol=1e-14)


def test_a_straight_fall_is_the_limit_of_thin_ellipses():
    radius = 8e6
    time = 1700.0
    straight, _ = propagate_kepler([radius, 0, 0], [-500.0, 0, 0], time)
    for sideways in (1e-3, 1e-6, 1e-9):
        thin, _ = propagate_kepler([radius, 0, 0], [-500.0, sideways, 0], time)
        assert np.linalg.norm(thin - straight) <= 1e5 * sideways + 1e-6


FALL = [7e6, 0, 0], [0, 7e3, 0], 10.0


@pytest.mark.parametrize(
    "start",
    [
        ([np.nan, 0, 0], *FALL[1:]),
        ([np.inf, 0, 0], *FALL[1:]),
        (FALL[0], [np.nan, 7e3, 0], 10.0),
        (FALL[0], [np.inf, 7e3, 0], 10.0),
        (*FALL[:2], np.nan),
        (*FALL[:2], np.inf),
        ([0, 0, 0], *FALL[1:]),
        ([1e200, 0, 0], *FALL[1:]),
        ([1e-200, 0, 0], *FALL[1:]),
        (*FALL[:2], 1e22),
    ],
)
def test_arcs_without_an_end_are_nan(start):
    assert np.isnan(propagate_kepler(*start)).all()
    assert np.isfinite(propagate_kepler(*FALL)).all()


def test_a_bad_element_does_not_touch_its_neighbours():
    position, velocity, duration = mixed_states(300)
    sound = propagate_kepler(position, velocity, duration)
    position[100] = np.nan
    duration[200] = np.inf
    position[150] = 0.0
    faulty = [100, 150, 200]
    for column, sound_column in zip(
        propagate_kepler(position, velocity, duration), sound, strict=True
    ):
        assert np.isnan(column[faulty]).all()
        remaining = (np.delete(rows, faulty, axis=0) for rows in (column, sound_column))
        assert np.array_equal(*remaining)


@pytest.mark.slow
@examples(300)
@given(
    *[st.lists(st.floats(allow_nan=False, allow_infinity=False), min_size=3, max_size=3)] * 2,
    st.floats(),
)
def test_any_doubles_give_a_state_or_nan(position, velocity, duration):
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        end = np.array(propagate_kepler(position, velocity, duration))
    assert np.isfinite(end).all() or np.isnan(end).all()
    distance = max(np.max(np.abs(position)), 1e-300)
    if 1e3 < distance < 1e12 and np.max(np.abs(velocity)) < 1e8 and abs(duration) < 1e10:
        assert np.isfinite(end).all()


def test_everything_converges_in_the_sure_pass(monkeypatch):
    """Solved by the bracketed method alone, every arc ends where the quick pass ends."""
    position, velocity, duration = mixed_states(3000, seed=4)
    quick, _ = propagate_kepler(position, velocity, duration)
    monkeypatch.setattr("opir_core.flight.kepler.solve_fast", solve_bracketed)
    sure, _ = propagate_kepler(position, velocity, duration)
    nudged, _ = propagate_kepler(position, velocity, duration * (1.0 + 1e-15))
    bar = 1e-12 * np.linalg.norm(quick, axis=1) + 100.0 * np.linalg.norm(nudged - sure, axis=1)
    assert np.all(np.linalg.norm(sure - quick, axis=1) <= bar)


@pytest.mark.parametrize("mu", [0.0, -1.0, np.nan, np.inf])
def test_mu_must_be_positive(mu):
    with pytest.raises(ValueError, match="mu_m3_s2 must be positive"):
        propagate_kepler([7e6, 0, 0], [0, 7e3, 0], 1.0, mu)


def test_vectors_must_have_three_components():
    with pytest.raises(ValueError, match="last axis of 3"):
        propagate_kepler([7e6, 0], [0, 7e3], 1.0)
    with pytest.raises(ValueError, match="last axis of 3"):
        propagate_kepler(7e6, [0, 7e3, 0], 1.0)
