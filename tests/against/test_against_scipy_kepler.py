"""Two-body arcs and their impacts against numerical integration: SciPy's DOP853 with event
location, above the ellipsoid by pyproj.
"""

import numpy as np
import pyproj
import pytest
from scipy.integrate import solve_ivp

from opir_core.constants import EARTH_MU_M3_S2
from opir_core.flight.conic_impact import kepler_impact
from opir_core.flight.kepler import propagate_kepler

TO_GEODETIC = pyproj.Transformer.from_crs("EPSG:4978", "EPSG:4979", always_xy=True)
TOLERANCE = {"method": "DOP853", "rtol": 1e-13, "atol": 1e-7}


def acceleration(_, state):
    position = state[:3]
    return np.concatenate([state[3:], -EARTH_MU_M3_S2 * position / np.linalg.norm(position) ** 3])


def height_above(height_m):
    def event(_, state):
        return TO_GEODETIC.transform(*state[:3])[2] - height_m

    event.terminal = True
    event.direction = -1.0
    return event


def states(count, seed):
    rng = np.random.default_rng(seed)
    up, along = rng.normal(size=(2, count, 3))
    up /= np.linalg.norm(up, axis=1)[:, None]
    along = np.cross(up, along)
    along /= np.linalg.norm(along, axis=1)[:, None]
    elevation = rng.uniform(0.2, 1.5, count)
    speed = rng.uniform(1e3, 7.5e3, count)
    velocity = (speed * np.sin(elevation))[:, None] * up + (speed * np.cos(elevation))[
        :, None
    ] * along
    return (6378e3 + rng.uniform(50e3, 400e3, count))[:, None] * up, velocity


@pytest.mark.parametrize(
    "factor", [0.4, 1.0, 1.3, 2.0], ids=["ballistic", "orbit", "near escape", "hyperbola"]
)
def test_propagation(factor):
    position, _ = states(6, 1)
    along = np.cross(position, [0.3, -0.2, 0.9])
    along /= np.linalg.norm(along, axis=1)[:, None]
    speed = factor * np.sqrt(EARTH_MU_M3_S2 / np.linalg.norm(position, axis=1))
    velocity = speed[:, None] * (
        0.8 * along + 0.6 * position / np.linalg.norm(position, axis=1)[:, None]
    )
    duration = 400.0 if factor < 1.0 else 6000.0
    for i in range(6):
        end = solve_ivp(
            acceleration, (0.0, duration), np.concatenate([position[i], velocity[i]]), **TOLERANCE
        ).y[:, -1]
        result = np.concatenate(propagate_kepler(position[i], velocity[i], duration))
        np.testing.assert_allclose(result[:3], end[:3], atol=1e-3)
        np.testing.assert_allclose(result[3:], end[3:], atol=1e-6)


@pytest.mark.parametrize("height", [0.0, 30e3])
def test_impact(height):
    position, velocity = states(12, 2)
    duration, point = kepler_impact(position, velocity, height)
    for i in range(12):
        start = np.concatenate([position[i], velocity[i]])
        run = solve_ivp(acceleration, (0.0, 1e4), start, events=height_above(height), **TOLERANCE)
        assert run.t_events[0][0] == pytest.approx(duration[i], abs=1e-6)
        np.testing.assert_allclose(point[i], run.y_events[0][0][:3], atol=2e-3)
