"""Launch points: what is worked out for all times at once is what each time alone says."""

import numpy as np
import pytest
from opir_estimation import BOOST, PredictedMeasurements, taylor_weights
from opir_forecast.launch_points import _add_noise, _covariances, _on_ground, _to_ecef, _whitened
from position_roots import position_roots

from opir_core.constants import EARTH_ROTATION_RAD_S
from opir_core.flight.gravity_and_drag import height_and_up
from opir_core.geometry import ecef_to_geodetic, geodetic_to_ecef, local_axes

TIMES_S = np.linspace(-80.0, 0.0, 9)


def places(lowest_m: float, highest_m: float) -> np.ndarray:
    """Return ECEF places all over the Earth, with a pole and the antimeridian."""
    rng = np.random.default_rng(8)
    latitude = rng.uniform(-1.57, 1.57, 200)
    longitude = rng.uniform(-np.pi, np.pi, 200)
    latitude[0] = 0.5 * np.pi - 1e-9
    longitude[1] = np.pi
    return np.asarray(geodetic_to_ecef(latitude, longitude, rng.uniform(lowest_m, highest_m, 200)))


def test_places_near_the_ground_are_reported_as_by_the_exact_formula() -> None:
    place = places(-10e3, 10e3)
    reported, level = _on_ground(place)
    where = ecef_to_geodetic(place)
    assert np.allclose(reported[:, 0], where.latitude_rad, rtol=0.0, atol=2e-13)
    assert np.allclose(reported[:, 1], where.longitude_rad, rtol=0.0, atol=1e-15)
    assert np.allclose(level, local_axes(place)[:, :2], atol=1e-9)


def test_height_grows_along_the_direction_in_which_it_is_said_to() -> None:
    place = places(-50e3, 1e6)
    height, up = height_and_up(np.ascontiguousarray(place.T), 1.0 / np.linalg.norm(place, axis=1))
    assert np.allclose(height, ecef_to_geodetic(place).height_m, atol=1e-6)
    assert np.allclose(up.T, local_axes(place)[:, 2], atol=1e-7)


def outlook_of(count: int) -> PredictedMeasurements:
    rng = np.random.default_rng(9)
    scale = np.repeat([150.0, 20.0, 2.0, 0.1], 3)[:, None]
    return PredictedMeasurements(
        0.0, rng.normal(size=(count, 5, 3)), scale * rng.normal(size=(count, BOOST, BOOST))
    )


@pytest.mark.parametrize("count", [1, 4])
def test_covariances_at_all_times_are_those_at_each(count: int) -> None:
    outlook = outlook_of(count)
    weight = taylor_weights(np.tile(TIMES_S, count)).T.reshape(5, count, -1).transpose(1, 0, 2)
    covariance = _covariances(outlook, weight)
    track = np.repeat(np.arange(count), len(TIMES_S))
    when = np.tile(TIMES_S, count)
    place = position_roots(outlook, track, when)
    # A velocity is the rate of the position.
    later = 0.5 * (
        position_roots(outlook, track, when + 1.0) - position_roots(outlook, track, when - 1.0)
    )
    later -= outlook.root.reshape(count, 4, 3, BOOST)[track, 3] / 6.0
    side = np.concatenate([place, later], axis=1)
    exact = side @ side.transpose(0, 2, 1)
    unit = np.sqrt(np.einsum("nii->ni", exact))
    assert (
        np.abs((covariance.transpose(2, 0, 1) - exact) / (unit[:, :, None] * unit[:, None])).max()
        < 1e-9
    )


def test_noise_gathers_as_that_of_a_chain_of_two_integrators() -> None:
    """∫ of τ²/2 and τ, the ways from a force's noise to position and velocity, run backwards: τ is
    against them.
    """
    covariance = np.zeros((6, 6, 2))
    span = np.array([3.0, 50.0])
    _add_noise(covariance, 0.09, span)
    tau = (np.arange(20000) + 0.5) / 20000 * span[:, None]
    far = tau**2 / 2.0
    fast = -tau
    for row, column, sums in ((0, 0, far * far), (0, 3, far * fast), (3, 3, fast * fast)):
        for axis in range(3):
            assert np.allclose(
                covariance[row + axis, column + axis], 0.09 * sums.mean(axis=1) * span, rtol=1e-6
            )
    assert np.array_equal(covariance, covariance.transpose(1, 0, 2))
    assert np.count_nonzero(covariance[0, 1:3]) == 0


def test_rows_are_whitened_as_by_a_cholesky_factor() -> None:
    rng = np.random.default_rng(10)
    side = rng.normal(size=(7, 4, 4)) * [1e3, 10.0, 1.0, 30.0]
    right = rng.normal(size=(7, 4, 4))
    spread = side.transpose(0, 2, 1) @ side
    rows = np.ascontiguousarray(np.concatenate([spread, right], axis=2).transpose(1, 2, 0))
    log = _whitened(rows, np.full(7, 1e4))
    root = np.linalg.cholesky(spread + np.diag([1e4, 1.0, 1.0, 1.0]))
    assert np.allclose(rows[:, 4:].transpose(2, 0, 1), np.linalg.solve(root, right), rtol=1e-8)
    assert np.allclose(log, -np.linalg.slogdet(root)[1], rtol=1e-12)


def test_rows_are_turned_against_the_earth() -> None:
    angle = EARTH_ROTATION_RAD_S * np.array([100.0])
    turned = _to_ecef(np.array([[1.0], [0.0], [5.0]]), np.sin(angle), np.cos(angle))
    assert np.allclose(turned[:, 0], [np.cos(angle[0]), -np.sin(angle[0]), 5.0])
