"""Aimed flights against published ballistic flights and the textbook's range equation."""

import json
import math

import numpy as np
import pytest
from attrs import evolve
from repository import DATA

from opir_core.constants import EARTH_MU_M3_S2
from opir_core.flight.aiming import aim, hitting_speed_m_s
from opir_core.flight.boost import boost_profile, boost_profiles
from opir_core.geometry import Geodetic, geodesic_direct

CASES = {
    case["id"]: case
    for case in json.loads((DATA / "reference_cases.json").read_text("utf-8"))["cases"]
}


def apogee_m(flight):
    r = np.linalg.norm(flight.burnout_position_eci_m, axis=1)
    v = np.linalg.norm(flight.burnout_velocity_eci_m_s, axis=1)
    a = 1.0 / (2.0 / r - v * v / EARTH_MU_M3_S2)
    momentum = np.linalg.norm(
        np.cross(flight.burnout_position_eci_m, flight.burnout_velocity_eci_m_s), axis=1
    )
    return a * (1.0 + np.sqrt(1.0 - momentum**2 / (EARTH_MU_M3_S2 * a))) - 6371e3


@pytest.mark.parametrize("name", ["ICBM_liquid", "ICBM_solid"])
def test_a_minimum_energy_flight_over_7400_km(name):
    """Launched at the pole, where the Earth's rotation neither helps nor hinders, at the angle (pi
    - psi)/4.
    """
    case = CASES["gronlund_wright_7400"]
    range_m = case["inputs"]["range_km"] * 1e3
    expected = case["expected"]
    within = case["tol"]
    angle = 0.25 * (math.pi - range_m / 6371e3)
    profile = evolve(
        boost_profile(name), reference_range_m=range_m, burnout_flight_path_angle_rad=angle
    )
    place = Geodetic(*geodesic_direct(np.array([math.pi / 2]), 0.0, 0.0, range_m), 0.0)
    flight = aim(Geodetic(math.pi / 2, 0.0, 0.0), place, 0.0, [profile])
    assert flight.burnout_speed_m_s[0] / 1e3 == pytest.approx(
        expected["burnout_speed_km_s"], rel=within
    )
    assert apogee_m(flight)[0] / 1e3 == pytest.approx(expected["apogee_km"], rel=within)
    assert flight.impact_s[0] / 60.0 == pytest.approx(expected["flight_time_min"], rel=within)


def test_the_speed_that_hits_is_the_inverse_of_the_range_equation():
    """Q = v² r/mu and psi of the textbook's grid, for equal radii."""
    grid = [
        row for row in CASES["free_flight_grid_r6471"]["expected"]["grid"] if row["psi_deg"] < 180.0
    ]
    radius_m = np.full(len(grid), 6471e3)
    gamma, psi, q = (np.array([row[key] for row in grid]) for key in ("phi_deg", "psi_deg", "Q"))
    speed = hitting_speed_m_s(radius_m, radius_m, np.radians(gamma), np.radians(psi))
    np.testing.assert_allclose(speed**2 * radius_m / EARTH_MU_M3_S2, q, rtol=1e-10)
    assert len(grid) > 70


@pytest.mark.parametrize("profile", boost_profiles().values(), ids=lambda profile: profile.name)
def test_the_reference_range_takes_the_reference_burnout_speed_on_an_earth_at_rest(profile):
    """Launched at the pole; sphere and ellipsoid differ by a quarter of a percent in speed."""
    place = Geodetic(
        *geodesic_direct(np.array([math.pi / 2]), 0.0, 0.0, profile.reference_range_m), 0.0
    )
    flight = aim(Geodetic(math.pi / 2, 0.0, 0.0), place, 0.0, [profile])
    assert flight.burnout_speed_m_s[0] == pytest.approx(profile.burnout_speed_m_s, rel=0.003)
