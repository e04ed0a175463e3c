"""Dense arcs: states at any time of a flight, from the steps of one integration."""

import numpy as np
import pytest

from opir_core.flight import Drag, Forces, impact_states_eci, propagate
from opir_core.flight.dense_output import dense_arcs

pytestmark = pytest.mark.filterwarnings("error")

MODELS = {"kepler": "kepler", "j2": Forces(), "us76": Forces(drag=Drag(1500.0))}


def shots(count, seed=0):
    random = np.random.default_rng(seed)
    up = random.normal(size=(count, 3))
    up /= np.linalg.norm(up, axis=1, keepdims=True)
    along = np.cross(up, random.normal(size=(count, 3)))
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    angle = np.radians(random.uniform(25.0, 60.0, (count, 1)))
    speed = random.uniform(2000.0, 6500.0, (count, 1))
    height = random.uniform(60e3, 250e3, (count, 1))
    return up * (6371e3 + height), speed * (np.sin(angle) * up + np.cos(angle) * along)


@pytest.mark.slow
@pytest.mark.parametrize(
    "tolerance_m",
    [pytest.param(1e-1, marks=pytest.mark.slow), 1e-3, pytest.param(1e-5, marks=pytest.mark.slow)],
)
@pytest.mark.parametrize("name", list(MODELS))
def test_every_state_is_what_propagation_to_its_time_gives(name, tolerance_m):
    position, velocity = shots(20)
    duration = impact_states_eci(position, velocity, 0.0, MODELS[name], tolerance_m=1e-6).duration_s
    arcs = dense_arcs(position, velocity, duration, MODELS[name], tolerance_m=tolerance_m)
    time = duration[:, np.newaxis] * np.linspace(0.0, 1.0, 41)
    found, speed = arcs.state(np.arange(20)[:, np.newaxis], time)
    exact, exact_speed = propagate(
        position[:, np.newaxis], velocity[:, np.newaxis], time, MODELS[name], tolerance_m=1e-7
    )
    assert np.linalg.norm(found - exact, axis=-1).max() <= tolerance_m
    assert np.linalg.norm(speed - exact_speed, axis=-1).max() <= tolerance_m


@pytest.mark.parametrize("name", list(MODELS))
def test_backwards(name):
    position, velocity = shots(5)
    arcs = dense_arcs(position * 1.2, velocity, -200.0, MODELS[name], tolerance_m=1e-4)
    found, _ = arcs.state(np.arange(5), -150.0)
    exact, _ = propagate(position * 1.2, velocity, -150.0, MODELS[name], tolerance_m=1e-7)
    assert np.abs(found - exact).max() <= 1e-4


@pytest.mark.parametrize("name", list(MODELS))
def test_positions_and_velocities_are_continuous_and_agree(name):
    """The derivative of the positions, by central differences, is the velocities."""
    position, velocity = shots(4)
    arcs = dense_arcs(position, velocity, 300.0, MODELS[name], tolerance_m=1e-6)
    time = np.linspace(1.0, 299.0, 2000)
    arc = np.arange(4)[:, np.newaxis]
    after = arcs.state(arc, time + 0.05)[0]
    before = arcs.state(arc, time - 0.05)[0]
    speed = arcs.state(arc, time)[1]
    assert np.abs((after - before) / 0.1 - speed).max() <= 0.02


@pytest.mark.parametrize("name", list(MODELS))
def test_outside_its_duration_an_arc_has_no_state(name):
    position, velocity = shots(3)
    arcs = dense_arcs(position, velocity, np.array([100.0, 200.0, -100.0]), MODELS[name])
    found, speed = arcs.state([0, 0, 1, 1, 2, 2], [-1e-6, 100.001, 150.0, np.nan, -50.0, 1.0])
    np.testing.assert_array_equal(
        np.isnan(found).all(axis=1), [True, True, False, True, False, True]
    )
    np.testing.assert_array_equal(np.isnan(speed), np.isnan(found))


def test_arcs_without_a_state_harm_no_other():
    position, velocity = shots(3)
    position[1] = np.nan
    arcs = dense_arcs(position, velocity, 100.0, MODELS["us76"])
    alone = dense_arcs(position[2], velocity[2], 100.0, MODELS["us76"])
    assert np.isnan(arcs.state(1, 50.0)[0]).all()
    np.testing.assert_array_equal(arcs.state(2, 50.0)[0], alone.state(0, 50.0)[0])


@pytest.mark.parametrize("name", ["j2", "us76"])
def test_queries_do_not_depend_on_their_company(name):
    position, velocity = shots(1100, seed=4)
    arcs = dense_arcs(position, velocity, 60.0, MODELS[name], tolerance_m=0.1)
    random = np.random.default_rng(1)
    which = random.integers(0, 1100, 3000)
    time = random.uniform(0.0, 60.0, 3000)
    whole, _ = arcs.state(which, time)
    some, _ = arcs.state(which[1000:1003], time[1000:1003])
    np.testing.assert_array_equal(some, whole[1000:1003])


@pytest.mark.parametrize("number", [-1, 3])
@pytest.mark.parametrize("name", ["kepler", "j2"])
def test_unknown_arcs_are_refused(name, number):
    arcs = dense_arcs(*shots(3), 10.0, MODELS[name])
    with pytest.raises(IndexError):
        arcs.state(number, 1.0)


def test_no_arcs_at_all():
    arcs = dense_arcs(np.empty((0, 3)), np.empty((0, 3)), 10.0)
    assert arcs.state(np.empty(0, int), np.empty(0))[0].shape == (0, 3)
