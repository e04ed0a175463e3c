"""Propagation: what has to hold whatever the numbers."""

import numpy as np
import pytest
from free_flights import ALL_ZONALS, EXPONENTIAL, MODELS, flights
from hypothesis import given, strategies as st

from examples import examples
from opir_core.constants import EARTH_ROTATION_RAD_S
from opir_core.flight import Drag, Forces, propagate, propagate_kepler
from opir_core.flight.forces import ZonalField

pytestmark = pytest.mark.filterwarnings("error")


def energy(position, velocity, zonal):
    """Return the energy a mass, J/kg, by the zonal potential."""
    field = ZonalField()
    r = np.linalg.norm(position, axis=-1)
    s = position[..., 2] / r
    legendre = {"j2": (field.j2, 2, 1.5 * s**2 - 0.5), "j3": (field.j3, 3, 2.5 * s**3 - 1.5 * s)}
    legendre["j4"] = (field.j4, 4, 4.375 * s**4 - 3.75 * s**2 + 0.375)
    terms = sum(j * (field.radius_m / r) ** n * p for j, n, p in (legendre[name] for name in zonal))
    return 0.5 * (velocity**2).sum(axis=-1) - field.mu_m3_s2 / r * (1.0 - terms)


@pytest.mark.parametrize("forces", [Forces(), ALL_ZONALS], ids=["j2", "j2+j3+j4"])
@pytest.mark.parametrize("duration_s", [1500.0, 20000.0])
def test_energy_and_polar_angular_momentum_are_conserved(forces, duration_s):
    position, velocity = flights(20)
    if duration_s > 1500.0:
        around = np.cross(position, velocity)[:6]
        position = position[:6] * 1.2
        velocity = np.cross(around, position)
        velocity *= 7.2e3 / np.linalg.norm(velocity, axis=1, keepdims=True)
    end_position, end_velocity = propagate(position, velocity, duration_s, forces, tolerance_m=1e-6)
    before = energy(position, velocity, forces.zonal)
    after = energy(end_position, end_velocity, forces.zonal)
    np.testing.assert_allclose(after, before, rtol=1e-12 if duration_s <= 1500.0 else 1e-11)
    before = np.cross(position, velocity)[:, 2]
    after = np.cross(end_position, end_velocity)[:, 2]
    scale = np.linalg.norm(np.cross(position, velocity), axis=1)
    assert (np.abs(after - before) / scale).max() <= (1e-13 if duration_s <= 1500.0 else 5e-12)


@pytest.mark.slow
@pytest.mark.parametrize("tolerance_m", [1e-1, 1e-2, 1e-3, 1e-4, 1e-5])
@pytest.mark.parametrize("name", ["j2", "us76", "exp"])
def test_errors_stay_within_the_tolerance(name, tolerance_m):
    position, velocity = flights(200, seed=3)
    duration = np.where(name == "j2", 1500.0, 60.0)
    if name != "j2":
        # The last minute before the apogee's mirror image: through the air from 100 km down or so.
        position = position * (6371e3 + 100e3) / np.linalg.norm(position, axis=1, keepdims=True)
        velocity = -velocity
        duration = np.minimum(60.0, 60e3 / np.abs((position * velocity).sum(axis=1) / 6471e3))
    exact, _ = propagate(position, velocity, duration, MODELS[name], tolerance_m=1e-8)
    found, _ = propagate(position, velocity, duration, MODELS[name], tolerance_m=tolerance_m)
    assert np.linalg.norm(found - exact, axis=1).max() <= tolerance_m


@pytest.mark.parametrize("forces", MODELS.values(), ids=list(MODELS))
def test_there_and_back(forces):
    position, velocity = flights(30)
    there = propagate(position, velocity, 300.0, forces, tolerance_m=1e-6)
    back = propagate(*there, -300.0, forces, tolerance_m=1e-6)
    assert np.abs(back[0] - position).max() <= 1e-5
    assert np.abs(back[1] - velocity).max() <= 1e-7


@pytest.mark.parametrize("forces", MODELS.values(), ids=list(MODELS))
def test_two_halves_are_the_whole(forces):
    position, velocity = flights(30)
    whole = propagate(position, velocity, 600.0, forces, tolerance_m=1e-6)
    halves = propagate(
        *propagate(position, velocity, 300.0, forces, tolerance_m=1e-6),
        300.0,
        forces,
        tolerance_m=1e-6,
    )
    assert np.abs(whole[0] - halves[0]).max() <= 1e-5


@examples(8)
@given(st.data())
@pytest.mark.parametrize("name", list(MODELS))
def test_results_do_not_depend_on_the_company(name, data):
    """To the last bit: alone, in any subset, in any order, with any durations beside it."""
    count = 24
    position, velocity = flights(count, seed=7)
    duration = np.linspace(200.0, 1500.0, count)
    beta = np.geomspace(50.0, 2e4, count)
    everything = of(name, beta)
    whole = propagate(position, velocity, duration, everything)
    chosen = data.draw(st.lists(st.integers(0, count - 1), min_size=1, max_size=count, unique=True))
    some = propagate(position[chosen], velocity[chosen], duration[chosen], of(name, beta[chosen]))
    np.testing.assert_array_equal(some[0], whole[0][chosen])
    np.testing.assert_array_equal(some[1], whole[1][chosen])


def of(name, beta):
    drag = MODELS[name].drag
    return MODELS[name] if drag is None else Forces(drag=Drag(beta, drag.atmosphere))


@pytest.mark.slow
@pytest.mark.parametrize("forces", MODELS.values(), ids=list(MODELS))
def test_few_arcs_are_many_to_the_last_bit(forces):
    """Few arcs are stepped in plain numbers, many in columns: the same operations in the same
    order.
    """
    position, velocity = flights(40, seed=9)
    for tolerance_m in (1e-2, 1e-6):
        whole = propagate(position, velocity, 1200.0, forces, tolerance_m=tolerance_m)
        for part in (slice(0, 1), slice(1, 3), slice(3, 11)):
            some = propagate(
                position[part], velocity[part], 1200.0, forces, tolerance_m=tolerance_m
            )
            np.testing.assert_array_equal(some[0], whole[0][part])
            np.testing.assert_array_equal(some[1], whole[1][part])


@pytest.mark.parametrize("name", ["j2", "us76"])
def test_results_do_not_depend_on_blocks_and_memory_layout(name):
    position, velocity = flights(2100, seed=8)
    whole = propagate(position, velocity, 700.0, MODELS[name], tolerance_m=0.1)
    fortran = propagate(
        np.asfortranarray(position), velocity[::-1][::-1], 700.0, MODELS[name], tolerance_m=0.1
    )
    shaped = propagate(
        position.reshape(3, 700, 3),
        velocity.reshape(3, 700, 3),
        700.0,
        MODELS[name],
        tolerance_m=0.1,
    )
    single = propagate(position[2050], velocity[2050], 700.0, MODELS[name], tolerance_m=0.1)
    np.testing.assert_array_equal(fortran[0], whole[0])
    np.testing.assert_array_equal(shaped[0].reshape(-1, 3), whole[0])
    np.testing.assert_array_equal(single[0], whole[0][2050])


@examples(4)
@given(st.floats(-np.pi, np.pi))
@pytest.mark.parametrize("name", list(MODELS))
def test_turning_everything_about_the_axis_changes_nothing(name, angle):
    position, velocity = flights(40)
    turn = np.array(
        [[np.cos(angle), -np.sin(angle), 0.0], [np.sin(angle), np.cos(angle), 0.0], [0.0, 0.0, 1.0]]
    ).T
    end, speed = propagate(position, velocity, 900.0, MODELS[name], tolerance_m=1e-6)
    turned, turned_speed = propagate(
        position @ turn, velocity @ turn, 900.0, MODELS[name], tolerance_m=1e-6
    )
    assert np.linalg.norm(turned - end @ turn, axis=1).max() <= 1e-9 * 6.4e6
    assert np.linalg.norm(turned_speed - speed @ turn, axis=1).max() <= 1e-9 * 7e3


def test_a_mirror_at_the_equator_changes_nothing_but_j3():
    position, velocity = flights(10)
    mirror = np.array([1.0, 1.0, -1.0])
    for forces, same in (
        (Forces(), True),
        (MODELS["us76"], True),
        (Forces(zonal=("j2", "j3")), False),
    ):
        end, _ = propagate(position, velocity, 900.0, forces)
        mirrored, _ = propagate(position * mirror, velocity * mirror, 900.0, forces)
        assert np.allclose(mirrored, end * mirror, rtol=0.0, atol=1e-6) == same


def test_air_that_turns_with_a_body_does_not_brake_it():
    """A body at rest over the ground, held up by nothing, meets no wind at first: it drops
    straight.
    """
    radius = 6378137.0 + 20e3
    position = np.array([radius, 0.0, 0.0])
    turning = np.array([0.0, radius * EARTH_ROTATION_RAD_S, 0.0])
    with_drag, _ = propagate(position, turning, 1.0, Forces(drag=Drag(1000.0)))
    without, _ = propagate(position, turning, 1.0)
    in_still_air, _ = propagate(
        position, turning, 1.0, Forces(drag=Drag(1000.0, air_rotation_rad_s=0.0))
    )
    assert abs(with_drag[1] - without[1]) < 1e-6
    assert without[1] - in_still_air[1] > 1e-3


def test_drag_goes_with_density_and_inverse_ballistic_coefficient():
    position = np.array([6378137.0 + 60e3, 0.0, 0.0])
    velocity = np.array([0.0, 3000.0, 0.0])
    still = Drag(1000.0, EXPONENTIAL, air_rotation_rad_s=0.0)
    _, speed = propagate(position, velocity, 1e-3, Forces(zonal=(), drag=still))
    expected = 1.225 * np.exp(-60e3 / 7200.0) * 3000.0**2 / (2.0 * 1000.0)
    assert abs((3000.0 - speed[1]) / 1e-3 / expected - 1.0) < 1e-3


@pytest.mark.parametrize("forces", ["kepler", Forces(zonal=())])
def test_kepler_is_solved_as_such(forces):
    position, velocity = flights(10)
    found = propagate(position, velocity, 900.0, forces)
    expected = propagate_kepler(position, velocity, 900.0)
    np.testing.assert_array_equal(found[0], expected[0])
    np.testing.assert_array_equal(found[1], expected[1])


def test_a_zonal_field_of_none_is_kepler():
    position, velocity = flights(50)
    none = Forces(gravity=ZonalField(j2=0.0))
    found, _ = propagate(position, velocity, 1500.0, none, tolerance_m=1e-6)
    assert (
        np.linalg.norm(found - propagate_kepler(position, velocity, 1500.0)[0], axis=1).max()
        <= 1e-6
    )
