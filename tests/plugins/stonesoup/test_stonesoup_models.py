"""The models of `opir-stonesoup` against opir's own flight, differences and closed forms."""

from datetime import timedelta

import numpy as np
import pytest
from opir_stonesoup.models import EarthFixedTransition, SightModel, sensor_axes
from stonesoup.types.array import StateVector
from stonesoup.types.state import State

from opir_core.flight.kepler import propagate_kepler
from opir_core.geometry import ecef_to_eci_state, eci_to_ecef_state


def state(ndim, seed=1):
    rng = np.random.default_rng(seed)
    mean = np.concatenate(
        [[-2.7e6, -4.6e6, 3.7e6], rng.normal(size=3) * 2e3, rng.normal(size=6) * 10.0]
    )[:ndim]
    return mean, np.repeat([1e3, 1e2, 10.0, 1.0], 3)[:ndim]


def differences(function, mean, step):
    """Return the Jacobian by central differences."""
    columns = []
    for row, size in enumerate(step):
        ends = [
            function(State(StateVector(mean + sign * size * np.eye(len(mean))[row])))
            for sign in (1.0, -1.0)
        ]
        columns.append((np.array(ends[0], float) - np.array(ends[1], float))[:, 0] / (2.0 * size))
    return np.stack(columns, axis=1)


@pytest.mark.parametrize("step_s", [0.1, 5.0, 60.0, -7.0])
def test_two_body_motion_is_the_propagation_of_keplers_arcs(step_s):
    mean, _ = state(6)
    model = EarthFixedTransition(ndim_state=6, noise=0.0)
    found = np.array(
        model.function(State(StateVector(mean)), time_interval=timedelta(seconds=step_s)), float
    )[:, 0]
    start = ecef_to_eci_state(mean[None, :3], mean[None, 3:], np.zeros(1))
    end = eci_to_ecef_state(*propagate_kepler(*start, np.array([step_s])), np.array([step_s]))
    np.testing.assert_allclose(found[:3], end[0][0], rtol=0.0, atol=2e-3)
    np.testing.assert_allclose(found[3:], end[1][0], rtol=0.0, atol=1e-4)
    assert not np.array(model.covar(time_interval=timedelta(seconds=1.0)), float).any()


@pytest.mark.parametrize("ndim", [6, 9, 12])
def test_slopes_of_the_motion_are_those_of_differences(ndim):
    mean, step = state(ndim)
    model = EarthFixedTransition(ndim_state=ndim, noise=1.0, forces="kepler")
    interval = timedelta(seconds=2.0)
    expected = differences(lambda at: model.function(at, time_interval=interval), mean, step)
    np.testing.assert_allclose(
        model.jacobian(State(StateVector(mean)), time_interval=interval), expected, atol=1e-6
    )


def test_noise_is_that_of_an_integrated_random_walk():
    """A chain of integrators: variances q h⁵/20, q h³/3 and q h of position, velocity and force;
    rotation changes none.

    What the Earth's turning moves from position to velocity is 7e-5 of it.
    """
    spread = np.array(
        EarthFixedTransition(noise=3.0).covar(time_interval=timedelta(seconds=2.0)), float
    )
    expected = 9.0 * np.repeat([2.0**5 / 20.0, 2.0**3 / 3.0, 2.0], 3)
    np.testing.assert_allclose(np.diag(spread), expected, rtol=1e-3)
    np.testing.assert_allclose(spread, spread.T, rtol=1e-12)
    assert np.linalg.eigvalsh(spread).min() > 0.0


@pytest.mark.parametrize("light_time", [True, False])
@pytest.mark.parametrize("place", [[4.2e7, 1e6, 0.0], [0.0, 0.0, 7.4e6], [3e6, -2e6, -6.5e6]])
def test_slopes_of_lines_of_sight_are_those_of_differences(place, light_time):
    mean, _ = state(9)
    axes = sensor_axes(np.array(place))
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-15)
    assert np.linalg.det(axes) == pytest.approx(1.0)
    model = SightModel(
        ndim_state=9,
        mapping=(0, 1, 2),
        noise_covar=np.eye(2),
        translation_offset=StateVector(place),
        axes=axes,
        light_time=light_time,
    )
    expected = differences(model.function, mean, np.repeat([100.0, 100.0, 1.0], 3))
    found = model.jacobian(State(StateVector(mean)))
    np.testing.assert_allclose(found, expected, rtol=0.0, atol=1e-6 * np.abs(expected).max())
