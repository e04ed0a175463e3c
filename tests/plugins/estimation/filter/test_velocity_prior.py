"""Velocities that nothing measures stay as certain as those of all targets; what looks tell is left
alone.
"""

import numpy as np
import pytest
from opir_estimation import (
    SPEED_SIGMA_M_S,
    Gaussian,
    have_uncertain_velocity,
    information_root,
    square_root,
)
from opir_estimation.filter.mode_mixing import with_velocity_prior
from opir_scoring.containments import nees
from opir_scoring.evidence import true_states_ecef

import opir_core as opir
from opir_core.constants import EARTH_ROTATION_RAD_S
from opir_core.planning.plan import compile_plan
from opir_core.simulation.run import run_of_plan


def test_only_what_is_too_long_of_a_velocity_shrinks() -> None:
    """Against Bayes' rule for one component: variances 5000² and, of what is measured, such that
    2000² comes out.
    """
    sigma = np.array([3e3, 2e3, 1e3, 5000.0, 1000.0, 10.0, 20.0, 20.0, 20.0, 0.01])
    mean = np.array([6.4e6, 1e5, 2e5, 8000.0, 3000.0, -20.0, 30.0, 0.0, 5.0, 0.01])
    after, root = with_velocity_prior(Gaussian(mean[None], np.diag(1.0 / sigma)[None]))
    share = (SPEED_SIGMA_M_S / 5000.0) ** 2
    ground = -EARTH_ROTATION_RAD_S * mean[1]
    expected = mean.copy()
    expected[3] = ground + share * (mean[3] - ground)
    np.testing.assert_allclose(after[0], expected, rtol=1e-12, atol=1e-9)
    sigma[3] = SPEED_SIGMA_M_S
    np.testing.assert_allclose(
        square_root.covariance(root)[0], np.diag(sigma**2), rtol=1e-9, atol=1e-9
    )


def test_what_goes_with_a_velocity_goes_with_it() -> None:
    """A position that the velocity tells of moves and narrows as Bayes' rule says."""
    rng = np.random.default_rng(4)
    side = rng.normal(size=(6, 6)) * np.repeat([1e4, 4000.0], 3)[:, None]
    covariance = side @ side.T
    mean = np.concatenate([[7e6, 0.0, 0.0], rng.normal(size=3) * 3000.0])
    after, root = with_velocity_prior(Gaussian(mean[None], information_root(side[None])))
    variance, axes = np.linalg.eigh(covariance[3:, 3:])
    for long in np.flatnonzero(variance > SPEED_SIGMA_M_S**2):
        row = np.concatenate([np.zeros(3), axes[:, long]])
        noise = 1.0 / (1.0 / SPEED_SIGMA_M_S**2 - 1.0 / variance[long])
        gain = covariance @ row / (row @ covariance @ row + noise)
        ground = np.concatenate([np.zeros(3), EARTH_ROTATION_RAD_S * np.array([0.0, 7e6, 0.0])])
        mean = mean + gain * (row @ (ground - mean))
        covariance = covariance - np.outer(gain, row @ covariance)
    np.testing.assert_allclose(after[0], mean, rtol=1e-9, atol=1e-6)
    np.testing.assert_allclose(square_root.covariance(root)[0], covariance, rtol=1e-8, atol=1e-3)


def test_a_velocity_that_is_known_in_every_direction_is_not_loose() -> None:
    sigma = np.array([[1.0, 1.0, 1.0, 1900.0, 1900.0, 1900.0], [1.0, 1.0, 1.0, 2100.0, 1.0, 1.0]])
    covariance = np.eye(6) * sigma[:, None] ** 2
    assert have_uncertain_velocity(covariance).tolist() == [False, True]


@pytest.mark.slow
@pytest.mark.parametrize(
    ("altitude_km", "node_deg"), [(1000.0, -130.0), (600.0, -125.0), (1500.0, -95.0)]
)
def test_what_a_low_sensor_sees_come_towards_it_does_not_run_off(
    altitude_km: float, node_deg: float
) -> None:
    circular = {"altitude_km": altitude_km, "inclination_deg": 0.0, "lon_asc_node_deg": node_deg}
    scene = {
        "scene": "along the course",
        "epoch": "2026-04-01T12:00:00Z",
        "duration_s": 195,
        "seed": 3,
        "sensors": [
            {
                "model": "generic-scanner",
                "id": "LOW",
                "orbit": {"circular": circular},
                "field_of_regard_half_angle_deg": 90.0,
            }
        ],
        "targets": [
            {
                "id": "T",
                "type": "ICBM",
                "launch": {"lat_deg": 0.0, "lon_deg": -110.0, "time_s": 10.0},
                "aim": {"lat_deg": 0.0, "lon_deg": -170.0},
            }
        ],
        "tracker": "imm",
    }
    plan = compile_plan(opir.scene_from_mapping(scene))
    tracks = run_of_plan(plan).tracks
    # At first it may as well be a fire, that stands still.
    tracks = tracks.take(tracks.probability_launch > 0.5)
    # An ICBM burns out at about 6.8 km/s; without restraint 9 to 73 km/s are reported here.
    assert np.linalg.norm(tracks.state[:, 3:], axis=1).max() < 7000.0
    away = tracks.state - true_states_ecef(
        plan, np.zeros(len(tracks), dtype=np.int32), tracks.tick_s
    )
    half = len(tracks) // 2
    assert 0.26 < nees(away[:half], tracks.state_covariance[:half]).mean() / 6.0 < 1.5
