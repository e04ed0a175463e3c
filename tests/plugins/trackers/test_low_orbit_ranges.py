"""Sensors in low orbits move past what they look at; launches they see begin one track each all the
same.
"""

from typing import Any

import numpy as np
import pytest
from opir_estimation import LinesOfSight, geostationary_directions, points_near_ground

import opir_core as opir
from opir_core.interfaces.records import Tracks
from opir_core.planning.plan import compile_plan
from opir_core.simulation.run import run_of_plan

GEO_M = 42164e3


def low(name: str, altitude_km: float, node_deg: float, along_deg: float) -> dict[str, Any]:
    """Return a scanner of half a second in a low orbit that covers all it sees."""
    circular = {"altitude_km": altitude_km, "inclination_deg": 80.0, "lon_asc_node_deg": node_deg}
    orbit = {"circular": circular | {"arg_latitude_deg": along_deg}}
    return {
        "model": "generic-scanner",
        "id": name,
        "orbit": orbit,
        "field_of_regard_half_angle_deg": 90.0,
    }


@pytest.mark.slow
@pytest.mark.parametrize("altitude_km", [600.0, 1500.0])
def test_a_launch_that_low_sensors_see_has_one_track_near_the_truth(altitude_km: float) -> None:
    scene = {
        "scene": "low",
        "epoch": "2026-04-01T12:00:00Z",
        "duration_s": 50,
        "seed": 3,
        "sensors": [low(f"L{k}", altitude_km, -120.0 + 5.0 * k, 25.0 + 8.0 * k) for k in range(4)],
        "targets": [
            {
                "id": "T",
                "type": "ICBM",
                "launch": {"lat_deg": 34.73, "lon_deg": -120.57, "time_s": 10.0},
                "aim": {"lat_deg": 9.0, "lon_deg": 167.7},
            }
        ],
        "tracker": "imm",
    }
    plan = compile_plan(opir.scene_from_mapping(scene))
    tracks = run_of_plan(plan).tracks
    assert tracks.tick_s[0] <= 16.0
    assert np.unique(tracks.track).tolist() == [0]
    away = tracks.state[:, :3] - plan.targets.position_ecef_m(
        np.zeros(len(tracks), dtype=np.int32), tracks.tick_s
    )
    assert np.sqrt(np.mean(away[-20:] ** 2) * 3.0) < 200.0


@pytest.mark.slow
def test_each_launch_of_the_arctic_example_has_one_track() -> None:
    changes = ["duration_s=80", "outputs=[]", "tracker=imm", "sensors=[{constellation: LEO-WIDE}]"]
    tracks: Tracks = opir.simulate(
        opir.load_scene("examples/arctic_watch.yaml", overrides=changes)
    ).tracks
    assert np.unique(tracks.track).tolist() == [0, 1]


def rays(origin_m: np.ndarray, aim_m: np.ndarray) -> LinesOfSight:
    """Return rays of 20 urad from points (n, 3) at a point (3,), half a second apart."""
    count = len(origin_m)
    along = aim_m - origin_m
    direction = along / np.linalg.norm(along, axis=1)[:, None]
    index = np.zeros(count, dtype=np.int32)
    return LinesOfSight(
        0.5 * np.arange(count), index, np.arange(count), origin_m, direction, np.full(count, 2e-5)
    )


def test_what_stands_still_stays_in_its_direction_as_a_low_sensor_moves() -> None:
    angle = np.linspace(0.0, 0.01, 9)
    origin = 7.1e6 * np.stack([np.cos(angle), np.sin(angle), 0.0 * angle], axis=1)
    one = rays(origin, np.array([6.3781e6, 2e5, 1e5]))
    ground = rays(origin, points_near_ground(origin[:1], one.direction_ecef[:1])[0])
    direction, sigma_rad = geostationary_directions(ground, ground.sensor)
    assert np.linalg.norm(ground.direction_ecef - ground.direction_ecef[0], axis=1).max() > 0.05
    assert np.linalg.norm(direction - direction[0], axis=1).max() < 1e-9
    assert (sigma_rad < ground.sigma_rad).all()


def test_rays_of_high_sensors_are_unchanged() -> None:
    origin = np.tile([GEO_M, 0.0, 0.0], (3, 1))
    ours = rays(origin, np.array([6.3781e6, 2e5, 1e5]))
    direction, sigma_rad = geostationary_directions(ours, ours.sensor)
    assert direction is ours.direction_ecef
    assert sigma_rad is ours.sigma_rad
