"""Propagation and impact against SciPy's DOP853 at its tightest, with right sides written here from
other forms.

Gravity is the gradient of the potential by complex-step differentiation; height is that of
`geometry.ecef_to_geodetic`; SciPy's steps are bounded so that it cannot miss the air.
"""

import numpy as np
import pytest
from scipy.integrate import DOP853, solve_ivp

from opir_core.constants import EARTH_MU_M3_S2, EARTH_ROTATION_RAD_S
from opir_core.flight import dop853
from opir_core.flight.atmosphere_density import density_kg_m3
from opir_core.flight.dense_output import dense_arcs
from opir_core.flight.forces import Drag, ExponentialAtmosphere, Forces, ZonalField
from opir_core.flight.propagation import impact_states_eci, propagate
from opir_core.geometry import ecef_to_geodetic

FIELD = ZonalField()
EXPONENTIAL = ExponentialAtmosphere(density_kg_m3=1.225, scale_height_m=7200.0)

STARTS = [
    ([6600e3, 200e3, 300e3], [3000.0, 5000.0, 2500.0]),
    ([-3000e3, 2000e3, 5500e3], [1000.0, -5500.0, 3800.0]),
    ([0.0, 0.0, 6500e3], [4500.0, 100.0, 4800.0]),
    ([4000e3, -4800e3, -2000e3], [4000.0, 2000.0, -5200.0]),
    ([7000e3, 0.0, 0.0], [0.0, 5300.0, 5300.0]),
]


def potential(x, y, z, zonal):
    r = np.sqrt(x * x + y * y + z * z)
    s = z / r
    legendre = {
        "j2": (FIELD.j2, 2, (3.0 * s**2 - 1.0) / 2.0),
        "j3": (FIELD.j3, 3, (5.0 * s**3 - 3.0 * s) / 2.0),
        "j4": (FIELD.j4, 4, (35.0 * s**4 - 30.0 * s**2 + 3.0) / 8.0),
    }
    terms = (legendre[name] for name in zonal)
    return EARTH_MU_M3_S2 / r * (1.0 - sum(j * (FIELD.radius_m / r) ** n * p for j, n, p in terms))


def gravity(position, zonal):
    step = 1e-20
    axes = np.eye(3) * 1j * step
    return np.array([potential(*(position + axis), zonal).imag / step for axis in axes])


def derivative(zonal, drag):
    def rates(_time, state):
        position = state[:3]
        velocity = state[3:]
        acceleration = gravity(position, zonal)
        if drag is not None:
            beta, density = drag
            wind = velocity - np.cross([0.0, 0.0, EARTH_ROTATION_RAD_S], position)
            height = float(ecef_to_geodetic(position).height_m)
            acceleration = acceleration - density(height) * np.linalg.norm(wind) * wind / (
                2.0 * beta
            )
        return np.concatenate([velocity, acceleration])

    return rates


def reference(start, duration_s, zonal, drag=None, **options):
    state = np.concatenate(start)
    return solve_ivp(
        derivative(zonal, drag),
        (0.0, duration_s),
        state,
        method="DOP853",
        rtol=1e-13,
        atol=1e-7,
        **options,
    )


@pytest.mark.parametrize("zonal", [("j2",), ("j3",), ("j2", "j3", "j4")], ids="+".join)
@pytest.mark.parametrize("duration_s", [1800.0, -400.0])
def test_zonal_harmonics(zonal, duration_s):
    starts = np.array(STARTS)
    position, velocity = propagate(
        starts[:, 0], starts[:, 1], duration_s, Forces(zonal=zonal), tolerance_m=1e-5
    )
    for index, start in enumerate(STARTS):
        end = reference(start, duration_s, zonal).y[:, -1]
        assert np.linalg.norm(position[index] - end[:3]) <= 2e-5
        assert np.linalg.norm(velocity[index] - end[3:]) <= 2e-7


def us_standard(height_m):
    return float(density_kg_m3(height_m))


def exponential(height_m):
    return 1.225 * np.exp(-height_m / 7200.0)


@pytest.mark.slow
@pytest.mark.parametrize(
    ("atmosphere", "density"),
    [("us_standard_1976", us_standard), (EXPONENTIAL, exponential)],
    ids=["us76", "exp"],
)
@pytest.mark.parametrize("height_m", [0.0, 30e3])
def test_impact_with_drag(atmosphere, density, height_m):
    """SciPy stops at the height by its own event; its steps are at most 0.5 s, whole flights
    long.
    """
    start = (np.array([6378e3 + 140e3, 0.0, 500e3]), np.array([-2000.0, 3500.0, 2500.0]))
    beta = 1500.0
    forces = Forces(drag=Drag(beta, atmosphere))

    def reached(_time, state):
        return float(ecef_to_geodetic(state[:3]).height_m) - height_m

    reached.terminal = True
    reached.direction = -1
    end = reference(start, 600.0, ("j2",), (beta, density), events=reached, max_step=0.5)
    result = impact_states_eci(*start, height_m, forces, tolerance_m=1e-4)
    assert abs(result.duration_s - end.t_events[0][0]) <= 1e-6
    # Kinks that SciPy steps over cost it some micrometres; ours are met exactly.
    assert np.linalg.norm(result.position_m - end.y_events[0][0][:3]) <= 5e-4
    assert abs(ecef_to_geodetic(result.position_m).height_m - height_m) <= 1e-7


@pytest.mark.slow
def test_low_orbit_with_drag():
    start = (np.array([6378e3 + 250e3, 0.0, 0.0]), np.array([0.0, 6100.0, 4800.0]))
    forces = Forces(drag=Drag(100.0))
    position, _ = propagate(*start, 6000.0, forces, tolerance_m=1e-4)
    end = reference(start, 6000.0, ("j2",), (100.0, us_standard), max_step=20.0).y[:3, -1]
    without, _ = propagate(*start, 6000.0, tolerance_m=1e-4)
    assert np.linalg.norm(position - end) <= 1e-3
    assert np.linalg.norm(without - end) > 500.0


@pytest.mark.slow
def test_dense_states():
    starts = np.array(STARTS)
    arcs = dense_arcs(starts[:, 0], starts[:, 1], 1800.0, tolerance_m=1e-5)
    times = np.linspace(0.0, 1800.0, 31)
    position, velocity = arcs.state(np.arange(len(STARTS))[:, np.newaxis], times)
    for index, start in enumerate(STARTS):
        states = reference(start, 1800.0, ("j2",), t_eval=times, max_step=5.0).y
        assert np.linalg.norm(position[index].T - states[:3], axis=0).max() <= 2e-5
        assert np.linalg.norm(velocity[index].T - states[3:], axis=0).max() <= 1e-6


def table(rows, width):
    dense = np.zeros((len(rows), width))
    for row, pairs in zip(dense, rows, strict=True):
        for column, weight in pairs:
            row[column] = weight
    return dense


def test_coefficients():
    """Ours for r'' = a are products of theirs for y' = f."""
    tableau = np.zeros((16, 16))
    tableau[:12, :12] = DOP853.A
    tableau[12, :12] = DOP853.B
    tableau[13:] = DOP853.A_EXTRA
    nodes = [*DOP853.C, 1.0, *DOP853.C_EXTRA]
    np.testing.assert_array_equal(table(dop853.VELOCITY_WEIGHTS, 16), tableau)
    np.testing.assert_allclose(
        table(dop853.POSITION_WEIGHTS, 16), tableau @ tableau, rtol=0.0, atol=1e-13
    )
    np.testing.assert_array_equal(dop853.NODES, nodes)
    np.testing.assert_allclose(
        table([dop853.ERROR_3, dop853.ERROR_5], 13), [DOP853.E3, DOP853.E5], rtol=0, atol=1e-15
    )
    np.testing.assert_array_equal(table(dop853.DENSE_VELOCITY, 16), DOP853.D)
    np.testing.assert_allclose(
        table(dop853.DENSE_POSITION, 16), DOP853.D @ tableau, rtol=0.0, atol=1e-11
    )
