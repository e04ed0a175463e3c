"""Dense arcs: states at any time of a flight, from the steps of one integration."""

import numpy as np
import pytest
from free_flights import flights
from lone_rows import assert_rows_independent

from opir_core.flight import Drag, Forces, impact_states_eci, propagate
from opir_core.flight.dense_output import dense_arcs

pytestmark = pytest.mark.filterwarnings("error")

MODELS = {"kepler": "kepler", "j2": Forces(), "us76": Forces(drag=Drag(1500.0))}


def shots(count, seed=0):
    speed_m_s = 2000.0, 6500.0
    return flights(count, seed, angle_deg=(25.0, 60.0), speed_m_s=speed_m_s, height_m=(60e3, 250e3))


@pytest.mark.slow
@pytest.mark.parametrize("tolerance_m", [1e-1, 1e-3, 1e-5])
@pytest.mark.parametrize("name", list(MODELS))
def test_every_state_is_what_propagation_to_its_time_gives(name, tolerance_m):
    position, velocity = shots(20)
    duration = impact_states_eci(position, velocity, 0.0, MODELS[name], tolerance_m=1e-6).duration_s
    arcs = dense_arcs(position, velocity, duration, MODELS[name], tolerance_m=tolerance_m)
    time = duration[:, None] * np.linspace(0.0, 1.0, 41)
    states = arcs.state(np.arange(20)[:, None], time)
    starts = position[:, None], velocity[:, None]
    exact = propagate(*starts, time, MODELS[name], tolerance_m=1e-7)
    for column, exact_column in zip(states, exact, strict=True):
        assert np.linalg.norm(column - exact_column, axis=-1).max() <= tolerance_m


@pytest.mark.parametrize("name", list(MODELS))
def test_backwards(name):
    position, velocity = shots(5)
    arcs = dense_arcs(position * 1.2, velocity, -200.0, MODELS[name], tolerance_m=1e-4)
    exact, _ = propagate(position * 1.2, velocity, -150.0, MODELS[name], tolerance_m=1e-7)
    assert np.abs(arcs.state(np.arange(5), -150.0)[0] - exact).max() <= 1e-4


@pytest.mark.parametrize("name", list(MODELS))
def test_positions_and_velocities_are_continuous_and_agree(name):
    """The derivative of the positions, by central differences, is the velocities."""
    arcs = dense_arcs(*shots(4), 300.0, MODELS[name], tolerance_m=1e-6)
    time = np.linspace(1.0, 299.0, 2000)
    arc = np.arange(4)[:, None]
    start, end = (arcs.state(arc, time + step)[0] for step in (-0.05, 0.05))
    assert np.abs((end - start) / 0.1 - arcs.state(arc, time)[1]).max() <= 0.02


@pytest.mark.parametrize("name", list(MODELS))
def test_outside_its_duration_an_arc_has_no_state(name):
    arcs = dense_arcs(*shots(3), np.array([100.0, 200.0, -100.0]), MODELS[name])
    states = arcs.state([0, 0, 1, 1, 2, 2], [-1e-6, 100.001, 150.0, np.nan, -50.0, 1.0])
    for column in states:
        assert np.isnan(column).all(axis=1).tolist() == [True, True, False, True, False, True]
        assert np.isfinite(column[[2, 4]]).all()


def test_arcs_without_a_state_harm_no_other():
    position, velocity = shots(3)
    position[1] = np.nan
    arcs = dense_arcs(position, velocity, 100.0, MODELS["us76"])
    alone = dense_arcs(position[2], velocity[2], 100.0, MODELS["us76"])
    assert np.isnan(arcs.state(1, 50.0)[0]).all()
    np.testing.assert_array_equal(arcs.state(2, 50.0)[0], alone.state(0, 50.0)[0])


@pytest.mark.parametrize("name", ["j2", "us76"])
def test_queries_do_not_depend_on_their_company(name):
    arcs = dense_arcs(*shots(1100, seed=4), 60.0, MODELS[name], tolerance_m=0.1)
    random = np.random.default_rng(1)
    arc = random.integers(0, 1100, 3000)
    assert_rows_independent(
        arcs.state, arc, random.uniform(0.0, 60.0, 3000), rows=[slice(1000, 1003)]
    )


@pytest.mark.parametrize("number", [-1, 3])
@pytest.mark.parametrize("name", ["kepler", "j2"])
def test_unknown_arcs_are_refused(name, number):
    arcs = dense_arcs(*shots(3), 10.0, MODELS[name])
    with pytest.raises(IndexError):
        arcs.state(number, 1.0)


def test_no_arcs_at_all():
    arcs = dense_arcs(np.empty((0, 3)), np.empty((0, 3)), 10.0)
    assert arcs.state(np.empty(0, int), np.empty(0))[0].shape == (0, 3)
