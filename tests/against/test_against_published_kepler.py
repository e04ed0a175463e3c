"""Two-body motion against published cases: Vallado, Curtis, Bate-Mueller-White, Der
(tests/data/reference_cases).
"""

import json

import numpy as np
import pytest
from repository import DATA

from opir_core.constants import EARTH_MU_M3_S2
from opir_core.flight.kepler import propagate_kepler

CASES = json.loads((DATA / "reference_cases.json").read_text(encoding="utf-8"))["cases"]


def cases(*topics):
    selected = [
        case for case in CASES if case["topic"] in topics and case["inputs"].get("revs", 0) == 0
    ]
    assert selected
    return pytest.mark.parametrize("case", [pytest.param(case, id=case["id"]) for case in selected])


def case_named(name):
    return next(case for case in CASES if case["id"] == name)


def relative_error(result, expected):
    return np.linalg.norm(result - np.asarray(expected)) / np.linalg.norm(expected)


@cases("kepler_propagation")
def test_propagation(case):
    inputs = case["inputs"]
    expected = case["expected"]
    start = np.array(inputs["r0_km"]) * 1e3, np.array(inputs["v0_km_s"]) * 1e3
    position, velocity = propagate_kepler(*start, inputs["dt_s"], inputs["mu_km3_s2"] * 1e9)
    assert relative_error(position / 1e3, expected["r_km"]) <= 1e-12
    assert relative_error(velocity / 1e3, expected["v_km_s"]) <= case["tol"] / 50.0


@cases("lambert")
def test_transfer_arrives(case):
    inputs = case["inputs"]
    expected = case["expected"]
    start = np.array(inputs["r1_km"]) * 1e3, np.array(expected["v1_km_s"]) * 1e3
    position, velocity = propagate_kepler(*start, inputs["tof_s"], inputs["mu_km3_s2"] * 1e9)
    assert relative_error(position / 1e3, inputs["r2_km"]) <= 1e-13
    assert relative_error(velocity / 1e3, expected["v2_km_s"]) <= 1e-13


def free_flight(q, phi_rad, radius_m):
    """Return burnout states in the xy plane of given Q = v² r / mu and flight-path angle."""
    speed = np.sqrt(q * EARTH_MU_M3_S2 / radius_m)
    zero = np.zeros_like(speed)
    position = np.stack([zero + radius_m, zero, zero], axis=-1)
    return position, np.stack([speed * np.sin(phi_rad), speed * np.cos(phi_rad), zero], axis=-1)


def grid():
    expected = case_named("free_flight_grid_r6471")["expected"]["grid"]
    names = ("Q", "phi_deg", "psi_deg", "t_ff_s", "apogee_alt_km")
    return (np.array([row[name] for row in expected]) for name in names)


def test_free_flight_range_time_and_apogee():
    radius = 6471e3
    q, phi_deg, psi_deg, time_s, apogee_alt_km = grid()
    start = free_flight(q, np.radians(phi_deg), radius)
    end, _ = propagate_kepler(*start, time_s)
    np.testing.assert_allclose(np.linalg.norm(end, axis=1), radius, rtol=1e-12)
    angle = np.unwrap(np.stack([np.zeros_like(q), np.arctan2(end[:, 1], end[:, 0])]), axis=0)[1]
    np.testing.assert_allclose(np.mod(angle, 2.0 * np.pi), np.radians(psi_deg), rtol=1e-11)
    top, _ = propagate_kepler(*start, time_s / 2.0)
    # The heights are counted from a sphere: the case's own radius less its height of burnout.
    heights_km = np.linalg.norm(top, axis=1) / 1e3 - apogee_alt_km
    np.testing.assert_allclose(heights_km, heights_km[0], atol=1e-6)
    assert 6370.0 < heights_km[0] < 6379.0


def test_free_flight_of_bate_mueller_white_page_290():
    """Burnout at 0.2 DU with 2/3 DU/TU, apogee at 0.5 DU: canonical units, mu = 1."""
    expected = case_named("bmw_p290")["expected"]
    phi = np.radians(expected["phi_deg"])
    speed = 2.0 / 3.0
    position = np.array([1.2, 0.0, 0.0])
    velocity = speed * np.array([np.sin(phi), np.cos(phi), 0.0])
    semi_major = -1.0 / (2.0 * (speed**2 / 2.0 - 1.0 / 1.2))
    sigma = position @ velocity
    eccentricity = np.hypot(1.0 - 1.2 / semi_major, sigma / np.sqrt(semi_major))
    anomaly = np.arctan2(sigma / np.sqrt(semi_major), 1.0 - 1.2 / semi_major)
    rise = semi_major**1.5 * (np.pi - anomaly + eccentricity * np.sin(anomaly))
    top, top_velocity = propagate_kepler(position, velocity, rise, 1.0)
    assert np.linalg.norm(top) == pytest.approx(1.5, abs=1e-12)
    assert np.linalg.norm(top_velocity) == pytest.approx(1.0 / 3.0, abs=1e-12)
    end, _ = propagate_kepler(position, velocity, 2.0 * rise, 1.0)
    assert np.degrees(np.arctan2(end[1], end[0])) == pytest.approx(expected["psi_deg"], abs=1e-9)


@pytest.mark.parametrize("which", ["phi_high_deg", "phi_low_deg"])
def test_free_flight_of_bate_mueller_white_page_291(which):
    """From 30 N 60 E to 30 S 60 W at 1.0817 DU/TU from 0.025 DU: two flight-path angles reach it,
    one falls.
    """
    expected = case_named("bmw_p291")["expected"]
    phi = np.radians(expected[which])
    psi = np.arccos(expected["cos_psi"])
    radius = 1.025
    speed = 1.0817
    position = radius * np.array([1.0, 0.0, 0.0])
    velocity = speed * np.array([np.sin(phi), np.cos(phi), 0.0])
    aim = radius * np.array([np.cos(psi), np.sin(psi), 0.0])
    semi_major = 1.0 / (2.0 / radius - speed**2)
    sigma = position @ velocity
    anomaly = np.arctan2(sigma / np.sqrt(semi_major), 1.0 - radius / semi_major)
    eccentricity = np.hypot(1.0 - radius / semi_major, sigma / np.sqrt(semi_major))
    mean = anomaly - eccentricity * np.sin(anomaly)
    time = semi_major**1.5 * np.mod(-2.0 * mean, 2.0 * np.pi)
    end, _ = propagate_kepler(position, velocity, time, 1.0)
    np.testing.assert_allclose(end, aim, atol=1e-9)


def test_minimum_energy_flight_of_7400_km():
    """Gronlund and Wright (Science and Global Security 3, 1992, table 1), which counts the boost: a
    loose check.
    """
    expected = case_named("gronlund_wright_7400")["expected"]
    half = 0.5 * 7400e3 / 6371e3
    q = 2.0 * np.sin(half) / (1.0 + np.sin(half))
    phi = 0.25 * (np.pi - 2.0 * half)
    radius = 6371e3 + 200e3
    position, velocity = free_flight(np.array(q), np.array(phi), radius)
    speed = np.linalg.norm(velocity)
    assert speed / 1e3 == pytest.approx(expected["burnout_speed_km_s"], rel=0.05)
    times = np.linspace(0.0, 60.0 * expected["flight_time_min"], 2001)
    heights = np.linalg.norm(propagate_kepler(position, velocity, times)[0], axis=1) - 6371e3
    assert heights.max() / 1e3 == pytest.approx(expected["apogee_km"], rel=0.15)
    back = times[np.flatnonzero(heights >= 200e3)[-1]]
    assert back / 60.0 == pytest.approx(expected["flight_time_min"], rel=0.12)
