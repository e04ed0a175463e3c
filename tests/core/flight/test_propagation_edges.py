"""Propagation at its edges: shapes, no time, no answer, what is refused, and what is not
imported.
"""

import subprocess
import sys

import numpy as np
import pytest
from free_flights import MODELS, flights
from hypothesis import given, strategies as st

from examples import examples
from opir_core.flight import Drag, Forces, propagate
from opir_core.flight.forces import ExponentialAtmosphere

pytestmark = pytest.mark.filterwarnings("error")


def test_shapes_broadcast():
    position, velocity = flights(4)
    end, speed = propagate(
        position, velocity, np.array([[10.0], [20.0], [30.0]]), Forces(drag=Drag(np.full(4, 500.0)))
    )
    assert end.shape == speed.shape == (3, 4, 3)
    alone, _ = propagate(position[2], velocity[2], 20.0, Forces(drag=Drag(500.0)))
    np.testing.assert_array_equal(end[1, 2], alone)
    assert propagate(np.empty((0, 3)), np.empty((0, 3)), np.empty(0))[0].shape == (0, 3)
    assert propagate(position[0], velocity[0], 10.0)[0].shape == (3,)


@pytest.mark.parametrize("forces", MODELS.values(), ids=list(MODELS))
def test_no_time_at_all(forces):
    position, velocity = flights(5)
    for duration_s in (0.0, 1e-300, 1e-12):
        end, speed = propagate(position, velocity, duration_s, forces)
        np.testing.assert_allclose(end, position, rtol=0.0, atol=1e-8)
        np.testing.assert_allclose(speed, velocity, rtol=0.0, atol=1e-9)


@pytest.mark.slow
@pytest.mark.parametrize("forces", MODELS.values(), ids=list(MODELS))
def test_what_has_no_answer_is_nan_and_harms_nobody(forces):
    position, velocity = flights(6)
    duration = np.full(6, 300.0)
    expected = propagate(position[5], velocity[5], 300.0, forces)[0]
    position[0, 1] = np.nan
    velocity[1, 2] = np.inf
    duration[2] = np.inf
    position[3] = 0.0
    velocity[4] = 0.0
    position[4] = [7e6, 0.0, 0.0]
    duration[4] = 3000.0
    end, speed = propagate(position, velocity, duration, forces)
    assert np.isnan(end[:5]).all()
    assert np.isnan(speed[:5]).all()
    np.testing.assert_array_equal(end[5], expected)


def test_below_the_air_model_there_is_nothing():
    deep = np.array([6378137.0 - 6e3, 0.0, 0.0])
    assert np.isnan(propagate(deep, np.array([100.0, 0.0, 0.0]), 1.0, MODELS["us76"])[0]).all()
    falling = np.array([6378137.0 + 1e3, 0.0, 0.0])
    assert np.isnan(
        propagate(falling, np.array([-300.0, 0.0, 0.0]), 100.0, MODELS["us76"])[0]
    ).all()


@examples(60)
@given(
    st.floats(-90.0, 90.0),
    st.floats(-180.0, 180.0),
    st.floats(-1.0, 6.0),
    st.floats(0.0, 13e3),
    st.floats(0.0, 360.0),
    st.floats(-90.0, 90.0),
    st.floats(-3.0, 3.6),
    st.sampled_from(sorted(MODELS)),
)
def test_no_state_warns_or_fails(
    latitude, longitude, height_exponent, speed, azimuth, angle, time_exponent, name
):
    """From the ground to far beyond the Moon, up and down, poles and date line: a number or nan,
    never a warning.
    """
    latitude, longitude, azimuth, angle = np.radians([latitude, longitude, azimuth, angle])
    up = np.array(
        [
            np.cos(latitude) * np.cos(longitude),
            np.cos(latitude) * np.sin(longitude),
            np.sin(latitude),
        ]
    )
    east = np.array([-np.sin(longitude), np.cos(longitude), 0.0])
    along = np.cos(azimuth) * np.cross(up, east) + np.sin(azimuth) * east
    position = up * (6378137.0 + 1e3 * 10.0**height_exponent)
    velocity = speed * (np.sin(angle) * up + np.cos(angle) * along)
    end, gained = propagate(position, velocity, 10.0**time_exponent, MODELS[name], tolerance_m=1e-2)
    assert np.isfinite(end).all() == np.isfinite(gained).all()


@pytest.mark.parametrize("tolerance_m", [0.0, -1.0, np.nan])
def test_a_tolerance_has_to_be_positive(tolerance_m):
    with pytest.raises(ValueError, match="tolerance_m"):
        propagate([7e6, 0.0, 0.0], [0.0, 7e3, 0.0], 10.0, tolerance_m=tolerance_m)


@pytest.mark.parametrize(
    ("make", "words"),
    [
        (lambda: Forces(zonal=("j5",)), "j5"),
        (lambda: Drag(0.0), "ballistic_coefficient_kg_m2"),
        (lambda: Drag([100.0, np.nan]), "ballistic_coefficient_kg_m2"),
        (lambda: Drag(100.0, "mars"), "mars"),
        (lambda: ExponentialAtmosphere(1.2, -7e3), "scale_height_m"),
        (lambda: propagate([7e6, 0.0], [0.0, 7e3], 10.0), "last axis of 3"),
        (lambda: propagate([7e6, 0.0, 0.0], [0.0, 7e3, 0.0], 10.0, "newton"), "newton"),
    ],
)
def test_invalid_arguments_are_refused(make, words):
    with pytest.raises(ValueError, match=words):
        make()


def test_forces_are_values():
    assert Forces(drag=Drag([100.0, 200.0])) == Forces(drag=Drag(np.array([100.0, 200.0])))
    assert Forces(drag=Drag(100.0)) != Forces(drag=Drag(200.0))
    assert not Drag(100.0).ballistic_coefficient_kg_m2.flags.writeable


HEAVY = {
    "integration",
    "dop853",
    "gravity_and_drag",
    "altitude_events",
    "atmosphere_density",
    "dense_output",
}


@pytest.mark.slow
@pytest.mark.parametrize(
    ("forces", "absent"),
    [("'kepler'", HEAVY), ("Forces()", {"dense_output", "aiming"})],
)
def test_nothing_is_imported_for_forces_that_are_not_chosen(forces, absent):
    code = (
        "import sys\nfrom opir_core.flight.forces import Forces\nfrom opir_core.flight.propagation"
        " import propagate\n"
        f"propagate([7e6, 0.0, 0.0], [0.0, 7e3, 0.0], 10.0, {forces})\nprint(*sys.modules)"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert not {f"opir_core.flight.{name}" for name in absent} & set(done.stdout.split())
