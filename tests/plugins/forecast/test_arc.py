"""The forecaster `arc`: impacts of free flights and their covariances, against SciPy and draws."""

import numpy as np
import pytest
from attrs import evolve
from opir_forecast import ArcForecaster, BoostEstimates, Outcomes, vehicle_model
from scipy.integrate import solve_ivp

from opir_core.geometry import ecef_to_geodetic
from opir_core.scene import core_hypotheses

MU = 3.986004418e14
SPIN = 7.292115e-5
OUTCOMES = Outcomes(vehicle_model(), core_hypotheses())
STATE = np.array([6.378137e6 + 2e5, 1e5, -2e5, 1500.0, 3000.0, 1200.0])
SIGMA = np.array([200.0] * 3 + [5.0] * 3)


def fallen(state):
    """Return latitude, longitude, rad, and time, s, of the impact of an inertial state at 0 s."""

    def rates(_time_s, y):
        return np.concatenate([y[3:], -MU / np.linalg.norm(y[:3]) ** 3 * y[:3]])

    def ground(time_s, y):
        return height(time_s, y)[2]

    ground.terminal = True
    ground.direction = -1.0
    flight = solve_ivp(rates, (0.0, 5e3), state, events=ground, rtol=1e-10, atol=1e-3)
    time_s = float(flight.t_events[0][0])
    latitude, longitude, _ = height(time_s, flight.y_events[0][0])
    return np.array([latitude, longitude, time_s])


def height(time_s, y):
    """Return latitude, longitude and height of an inertial state."""
    turn = SPIN * time_s
    x = np.cos(turn) * y[0] + np.sin(turn) * y[1]
    z = -np.sin(turn) * y[0] + np.cos(turn) * y[1]
    place = ecef_to_geodetic(np.array([[x, z, y[2]]]))
    return place.latitude_rad[0], place.longitude_rad[0], place.height_m[0]


def record(burning, state=STATE):
    count = len(burning)
    times_s = np.full(count, 5.0)
    estimates = BoostEstimates.of_moments(
        np.arange(count),
        np.tile(state, (count, 1)),
        np.tile(np.diag(SIGMA**2), (count, 1, 1)),
        np.array(burning),
        times_s,
        times_s,
        len(OUTCOMES.hypotheses),
    )
    return evolve(estimates, launch=np.zeros((count, 3)))


def test_the_impact_and_its_covariance_are_those_of_drawn_flights() -> None:
    forecast = ArcForecaster(OUTCOMES).forecasts(record([0.1]), 0.0)
    assert forecast.impact[0] == pytest.approx(fallen(STATE), abs=2e-5)
    rng = np.random.default_rng(4)
    draws = np.array([fallen(STATE + SIGMA * rng.normal(size=6)) for _ in range(300)])
    offset = draws - draws.mean(axis=0)
    scale = 6.378137e6 * np.array([np.cos(forecast.impact[0, 0]), 1.0])
    metres = np.column_stack([offset[:, 1] * scale[0], offset[:, 0] * scale[1], offset[:, 2]])
    stated = np.sqrt(np.diag(forecast.impact_covariance[0]))
    assert stated == pytest.approx(metres.std(axis=0), rel=0.15)
    white = np.linalg.solve(np.linalg.cholesky(forecast.impact_covariance[0]), metres.T)
    assert np.cov(white) == pytest.approx(np.eye(3), abs=0.25)


def test_a_burning_target_has_no_arc_and_one_in_orbit_no_impact() -> None:
    orbit = np.array([7e6, 0.0, 0.0, 0.0, 7.6e3, 0.0])
    burning, _ = ArcForecaster(OUTCOMES).forecasts(record([0.9, 0.1]), 0.0).impact
    assert np.isnan(burning).all()
    forecast = ArcForecaster(OUTCOMES).forecasts(record([0.1], orbit), 0.0)
    assert np.isnan(forecast.impact).all()
    assert forecast.in_orbit[0] == 1.0
    launchers = OUTCOMES.columns("orbit")
    assert forecast.given_launch[0, launchers].sum() > 0.5
    assert forecast.given_launch[0, OUTCOMES.columns("missile")].sum() == 0.0


def test_classes_that_do_not_reach_an_impact_are_excluded() -> None:
    forecast = ArcForecaster(OUTCOMES).forecasts(record([0.1]), 0.0)
    covers = OUTCOMES.missiles(np.array([2.5e6]))[0] > 0.0
    share = forecast.given_launch[0, OUTCOMES.columns("missile")]
    assert share.sum() > 0.5
    assert covers.any()
