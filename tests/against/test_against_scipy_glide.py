"""Equilibrium glide against its equations of motion, integrated by SciPy in the plane of the glide.

Drag is lift over E, lift is weight less centrifugal force, m (g - v²/r), with g and r as at
burnout; the height is that at which lift in an exponential atmosphere has that value, found by
bisection.
"""

import numpy as np
import pytest
from scipy.integrate import solve_ivp
from scipy.optimize import brentq

from opir_core.constants import EARTH_MU_M3_S2
from opir_core.flight.glide import GlidePath, GlideShape

RADIUS_M = 6_378_137.0 + 55e3
CASES = [(2.5, 5500.0, 1500.0, 7100.0), (1.2, 3500.0, 900.0, 6700.0), (4.0, 7000.0, 2500.0, 7500.0)]


@pytest.mark.parametrize(("lift_to_drag", "first_m_s", "last_m_s", "scale_m"), CASES)
def test_time_way_and_height_are_those_of_the_equations_of_motion(
    lift_to_drag, first_m_s, last_m_s, scale_m
):
    gravity = EARTH_MU_M3_S2 / RADIUS_M**2

    def rates(_time_s, state):
        speed_m_s, _way_m = state
        return [-(gravity - speed_m_s**2 / RADIUS_M) / lift_to_drag, speed_m_s]

    def is_slow(_time_s, state):
        return state[0] - last_m_s

    is_slow.terminal = True
    solved = solve_ivp(
        rates,
        (0.0, 2e4),
        [first_m_s, 0.0],
        rtol=1e-11,
        atol=1e-6,
        events=is_slow,
        dense_output=True,
    )
    shape = GlideShape(*(np.array([value]) for value in (lift_to_drag, last_m_s, scale_m)))
    # Along the equator, over a circle of one radius.
    path = GlidePath.from_burnout(
        np.array([[RADIUS_M, 0.0, 0.0]]), np.array([[0.0, first_m_s, 0.0]]), shape
    )
    assert path.duration_s[0] == pytest.approx(solved.t[-1], rel=1e-8)
    loading = np.exp(-55e3 / scale_m) * first_m_s**2 / (gravity - first_m_s**2 / RADIUS_M)
    for time_s in np.linspace(0.0, solved.t[-1], 9):
        speed_m_s, way_m = solved.sol(time_s)
        position, velocity = (vector[0] for vector in path.state(np.array([time_s])))
        assert np.arctan2(position[1], position[0]) * RADIUS_M == pytest.approx(way_m, abs=1.0)
        radius_m = np.linalg.norm(position)
        along = np.cross([0.0, 0.0, 1.0], position / radius_m)
        assert velocity @ along * RADIUS_M / radius_m == pytest.approx(speed_m_s, abs=1e-3)

        def excess(height_m, speed_m_s=speed_m_s):
            return (
                np.exp(-height_m / scale_m) * speed_m_s**2 / (gravity - speed_m_s**2 / RADIUS_M)
                - loading
            )

        assert radius_m - 6_378_137.0 == pytest.approx(
            brentq(excess, 0.0, 1e5, xtol=1e-6), abs=0.01
        )
