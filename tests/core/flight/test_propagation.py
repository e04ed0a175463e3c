"""Propagation: what has to hold whatever the numbers."""

import numpy as np
import pytest
from attrs import evolve
from free_flights import ALL_ZONALS, EXPONENTIAL, MODELS, flights
from hypothesis import given, strategies as st
from lone_rows import assert_rows_independent

from examples import examples
from opir_core.constants import EARTH_ROTATION_RAD_S
from opir_core.flight import Drag, Forces, propagate, propagate_kepler

pytestmark = pytest.mark.filterwarnings("error")


def energy(position, velocity, forces):
    """Return the energy a mass, J/kg, by the zonal potential."""
    field = forces.gravity
    r = np.linalg.norm(position, axis=-1)
    s = position[..., 2] / r
    terms = {
        "j2": field.j2 * (field.radius_m / r) ** 2 * (1.5 * s**2 - 0.5),
        "j3": field.j3 * (field.radius_m / r) ** 3 * (2.5 * s**3 - 1.5 * s),
        "j4": field.j4 * (field.radius_m / r) ** 4 * (4.375 * s**4 - 3.75 * s**2 + 0.375),
    }
    potential = field.mu_m3_s2 / r * (1.0 - sum(terms[name] for name in forces.zonal))
    return 0.5 * (velocity**2).sum(axis=-1) - potential


@pytest.mark.parametrize("forces", [Forces(), ALL_ZONALS], ids=["j2", "j2+j3+j4"])
@pytest.mark.parametrize(
    ("duration_s", "energy_error", "momentum_error"),
    [(1500.0, 1e-12, 1e-13), (20000.0, 1e-11, 5e-12)],
)
def test_energy_and_polar_angular_momentum_are_conserved(
    forces, duration_s, energy_error, momentum_error
):
    start = flights(20)
    if duration_s > 1500.0:
        around = np.cross(*start)[:6]
        position = start[0][:6] * 1.2
        velocity = np.cross(around, position)
        start = position, velocity * 7.2e3 / np.linalg.norm(velocity, axis=1, keepdims=True)
    end = propagate(*start, duration_s, forces, tolerance_m=1e-6)
    np.testing.assert_allclose(energy(*end, forces), energy(*start, forces), rtol=energy_error)
    momentum = np.cross(*start)
    change = np.abs(np.cross(*end) - momentum)[:, 2]
    assert (change / np.linalg.norm(momentum, axis=1)).max() <= momentum_error


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
    end, _ = propagate(position, velocity, duration, MODELS[name], tolerance_m=tolerance_m)
    assert np.linalg.norm(end - exact, axis=1).max() <= tolerance_m


@pytest.mark.parametrize("forces", MODELS.values(), ids=list(MODELS))
def test_there_and_back(forces):
    position, velocity = flights(30)
    end = propagate(position, velocity, 300.0, forces, tolerance_m=1e-6)
    back = propagate(*end, -300.0, forces, tolerance_m=1e-6)
    assert np.abs(back[0] - position).max() <= 1e-5
    assert np.abs(back[1] - velocity).max() <= 1e-7


@pytest.mark.parametrize("forces", MODELS.values(), ids=list(MODELS))
def test_two_halves_are_the_whole(forces):
    start = flights(30)
    end, _ = propagate(*start, 600.0, forces, tolerance_m=1e-6)
    middle = propagate(*start, 300.0, forces, tolerance_m=1e-6)
    assert np.abs(propagate(*middle, 300.0, forces, tolerance_m=1e-6)[0] - end).max() <= 1e-5


@examples(8)
@given(st.lists(st.integers(0, 23), min_size=1, max_size=24, unique=True))
@pytest.mark.parametrize("name", list(MODELS))
def test_results_do_not_depend_on_the_company(name, rows):
    """To the last bit: alone, in any subset, in any order, with any durations beside it."""

    def ends(position, velocity, duration, beta):
        forces = MODELS[name].with_ballistic_coefficients(beta)
        return propagate(position, velocity, duration, forces)

    columns = np.linspace(200.0, 1500.0, 24), np.geomspace(50.0, 2e4, 24)
    assert_rows_independent(ends, *flights(24, seed=7), *columns, rows=[rows])


@pytest.mark.slow
@pytest.mark.parametrize("tolerance_m", [1e-2, 1e-6])
@pytest.mark.parametrize("forces", MODELS.values(), ids=list(MODELS))
def test_few_arcs_are_many_to_the_last_bit(forces, tolerance_m):
    """Few arcs are stepped in plain numbers, many in columns: the same operations in the same
    order.
    """

    def ends(*states):
        return propagate(*states, 1200.0, forces, tolerance_m=tolerance_m)

    rows = (slice(0, 1), slice(1, 3), slice(3, 11))
    assert_rows_independent(ends, *flights(40, seed=9), rows=rows)


@pytest.mark.parametrize("name", ["j2", "us76"])
def test_results_do_not_depend_on_blocks_and_memory_layout(name):
    def ends(*states):
        return propagate(*states, 700.0, MODELS[name], tolerance_m=0.1)[0]

    position, velocity = flights(2100, seed=8)
    expected = ends(position, velocity)
    fortran = ends(np.asfortranarray(position), velocity[::-1][::-1])
    shaped = ends(*(column.reshape(3, 700, 3) for column in (position, velocity)))
    np.testing.assert_array_equal(fortran, expected)
    np.testing.assert_array_equal(shaped.reshape(-1, 3), expected)
    np.testing.assert_array_equal(ends(position[2050], velocity[2050]), expected[2050])


@examples(4)
@given(st.floats(-np.pi, np.pi))
@pytest.mark.parametrize("name", list(MODELS))
def test_turning_everything_about_the_axis_changes_nothing(name, angle):
    cosine = np.cos(angle)
    sine = np.sin(angle)
    turn = np.array([[cosine, sine, 0.0], [-sine, cosine, 0.0], [0.0, 0.0, 1.0]])
    start = flights(40)
    end, turned = (
        propagate(*states, 900.0, MODELS[name], tolerance_m=1e-6)
        for states in (start, [column @ turn for column in start])
    )
    for column, turned_column, scale in zip(end, turned, (6.4e6, 7e3), strict=True):
        assert np.linalg.norm(turned_column - column @ turn, axis=1).max() <= 1e-9 * scale


@pytest.mark.parametrize(
    ("forces", "is_symmetric"),
    [(Forces(), True), (MODELS["us76"], True), (Forces(zonal=("j2", "j3")), False)],
)
def test_a_mirror_at_the_equator_changes_nothing_but_j3(forces, is_symmetric):
    position, velocity = flights(10)
    mirror = np.array([1.0, 1.0, -1.0])
    end, _ = propagate(position, velocity, 900.0, forces)
    mirrored, _ = propagate(position * mirror, velocity * mirror, 900.0, forces)
    assert np.allclose(mirrored, end * mirror, rtol=0.0, atol=1e-6) == is_symmetric


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


def test_drag_goes_with_density_over_ballistic_coefficient():
    position = np.array([6378137.0 + 60e3, 0.0, 0.0])
    velocity = np.array([0.0, 3000.0, 0.0])
    still = Drag(1000.0, EXPONENTIAL, air_rotation_rad_s=0.0)
    _, speed = propagate(position, velocity, 1e-3, Forces(zonal=(), drag=still))
    expected = 1.225 * np.exp(-60e3 / 7200.0) * 3000.0**2 / (2.0 * 1000.0)
    assert abs((3000.0 - speed[1]) / 1e-3 / expected - 1.0) < 1e-3


@pytest.mark.parametrize("forces", ["kepler", Forces(zonal=())])
def test_kepler_is_solved_as_such(forces):
    start = flights(10)
    end = propagate(*start, 900.0, forces)
    np.testing.assert_array_equal(end, propagate_kepler(*start, 900.0))


def test_a_zonal_field_of_none_is_kepler():
    start = flights(50)
    forces = Forces(gravity=evolve(Forces().gravity, j2=0.0))
    end, _ = propagate(*start, 1500.0, forces, tolerance_m=1e-6)
    assert np.linalg.norm(end - propagate_kepler(*start, 1500.0)[0], axis=1).max() <= 1e-6
