"""Parts of the forecast against closed forms: ranges of free flights, impacts, features of states,
moments.
"""

import numpy as np
import pytest
from opir_forecast.conditional_impacts import impact_moments
from opir_forecast.fates import features, free_impacts
from opir_forecast.kernel_regression import squared_distances
from opir_forecast.planar_boost import elevations, ranges_m
from plain_boosts import MU, RADIUS_M, SPIN
from scipy.integrate import solve_ivp
from scipy.spatial.transform import Rotation

from opir_core.arrays import FloatArray
from opir_core.flight import Forces
from opir_core.geometry import geodetic_to_ecef, local_axes


@pytest.mark.parametrize("speed_m_s", [1500.0, 4000.0, 7000.0])
@pytest.mark.parametrize("angle_deg", [15.0, 40.0, 80.0])
@pytest.mark.parametrize("sense", [1.0, -1.0])
def test_ranges_from_the_ground_are_those_of_the_hit_equation(
    speed_m_s: float, angle_deg: float, sense: float
) -> None:
    """tan(Λ/2) = sin γ cos γ / (g R / v² - cos² γ), with Λ the angle of the range."""
    angle = np.radians(angle_deg)
    state = np.array(
        [[0.0], [RADIUS_M], [sense * speed_m_s * np.cos(angle)], [speed_m_s * np.sin(angle)]]
    )
    ratio = MU / (RADIUS_M * speed_m_s**2)
    half = np.arctan2(np.sin(angle) * np.cos(angle), ratio - np.cos(angle) ** 2)
    assert ranges_m(state)[0] == pytest.approx(2.0 * RADIUS_M * half, rel=1e-6)
    assert elevations(state)[0] == pytest.approx(angle)


def state_over(
    latitude_deg: float, longitude_deg: float, height_m: float, over_ground: FloatArray
) -> FloatArray:
    """Return an inertial state at time 0 of east, north and up velocities over the ground."""
    place = geodetic_to_ecef(*np.radians([latitude_deg, longitude_deg]), height_m)
    velocity = over_ground @ local_axes(place[None])[0] + np.cross(SPIN, place)
    return np.concatenate([place, velocity])


STATE = state_over(34.0, -120.0, 80e3, np.array([-2500.0, 800.0, 900.0]))


@pytest.mark.parametrize("later_s", [0.0, 500.0])
def test_free_flights_end_where_an_integrator_meets_the_ground(later_s: float) -> None:
    """The ground turns below: at a later scene time the same flight is another inertial one."""
    turn = Rotation.from_rotvec(SPIN * later_s)
    state = np.concatenate([turn.apply(STATE[:3]), turn.apply(STATE[3:])])
    place, when = free_impacts(state[None], np.array([later_s]), Forces(zonal=()))

    def rates(_time_s: float, flying: FloatArray) -> FloatArray:
        return np.concatenate([flying[3:], -MU * flying[:3] / np.linalg.norm(flying[:3]) ** 3])

    flight = solve_ivp(rates, (0.0, float(when[0]) - later_s), STATE, rtol=1e-11, atol=1e-6)
    down = Rotation.from_rotvec(-SPIN * flight.t[-1]).apply(flight.y[:3, -1])
    assert np.linalg.norm(geodetic_to_ecef(place[0, 0], place[0, 1], 0.0) - down) < 5.0


def test_features_are_those_over_the_ground() -> None:
    rng = np.random.default_rng(1)
    over_ground = rng.normal(size=(6, 3)) * 2000.0
    places = rng.uniform([-80.0, -180.0, 0.0], [80.0, 180.0, 2e5], (6, 3))
    states = np.array(
        [state_over(*place, velocity) for place, velocity in zip(places, over_ground, strict=True)]
    )
    height, climb, speed = features(states)
    assert height == pytest.approx(places[:, 2], abs=100.0)
    assert speed == pytest.approx(np.linalg.norm(over_ground, axis=1))
    # Up by the ellipsoid and by the centre differ by at most 0.2°.
    assert climb == pytest.approx(np.arcsin(over_ground[:, 2] / speed), abs=0.004)


def test_moments_of_impacts_are_east_north_and_time() -> None:
    """Points some kilometres apart along each axis, weighed; and the radii that contain the
    shares.
    """
    latitude, longitude = np.radians([-33.0, 151.0])
    east = np.array([-2e3, 0.0, 5e3, 0.0])
    north = np.array([0.0, 1e3, 0.0, -4e3])
    radius_m = 6371.0088e3 * np.array([1.0, np.cos(latitude)])
    place = [latitude, longitude] + np.stack([north, east], axis=1) / radius_m
    columns = np.column_stack([east, north, [1.0, 2.0, 3.0, 4.0]])
    weight = np.array([0.4, 0.3, 0.2, 0.1])
    mean, covariance, radii = impact_moments(place, columns[:, 2], weight)
    expected = weight @ columns
    offset = columns - expected
    moved = (mean[:2] - [latitude, longitude]) * radius_m
    assert moved == pytest.approx(expected[1::-1], abs=1.2)
    assert mean[2] == pytest.approx(expected[2])
    # On a sphere of another radius, by geodetic latitudes: 0.3 %.
    spread = (weight[:, None] * offset).T @ offset
    assert covariance == pytest.approx(spread, rel=3e-3, abs=3e-4 * 6.56e6)
    assert (np.diff(radii) >= 0.0).all()


def test_distances_are_those_of_kernel_and_noise() -> None:
    rng = np.random.default_rng(3)
    offsets = rng.normal(size=(5, 2))
    width = np.array([0.5, 2.0])
    noise = np.array([[1.0, 0.3], [0.3, 0.5]])
    inverse = np.linalg.inv(noise + np.diag(width**2))
    assert squared_distances(offsets, width, noise) == pytest.approx(
        np.einsum("ni,ij,nj->n", offsets, inverse, offsets)
    )
