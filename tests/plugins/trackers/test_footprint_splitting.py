"""Launches side by side, nearer to one another than spots of rays are, have one track each."""

from typing import Any

import numpy as np
import pytest
from opir_estimation import LinesOfSight
from opir_trackers.initiation import split_clusters
from opir_trackers.pairing import Directions, SetModel, normal_equations

import opir_core as opir
from opir_core.arrays import FloatArray, IntArray
from opir_core.simulation.run import run_of_plan

AIMS = {"ICBM": (9.0, 167.7), "IRBM": (20.0, -150.0), "SRBM": (34.0, -124.0)}
TWO = [
    {"model": "SBIRS-GEO", "id": f"S{slot}", "orbital_slot_deg": slot} for slot in (-150.0, -90.0)
]
FIVE = [
    *TWO,
    {"model": "SBIRS-GEO", "id": "S-120", "orbital_slot_deg": -120.0},
    {"model": "NEXTGEN-GEO", "id": "N-140", "orbital_slot_deg": -140.0},
    {"model": "DSP", "id": "D-100", "orbital_slot_deg": -100.0},
]
SIGMA_RAD = 2e-5


def chain(
    sensors: list[dict[str, Any]], step_deg: tuple[float, float], every_s: float
) -> tuple[int, FloatArray]:
    """Return how many tracks thirty launches in a line have, and how far from each the nearest is
    in the end, m.
    """
    launches = [
        {
            "id": f"L{number}",
            "type": tuple(AIMS)[number % 3],
            "launch": {
                "lat_deg": 34.0 + step_deg[0] * number,
                "lon_deg": -120.0 + step_deg[1] * number,
                "time_s": 1.0 + every_s * number,
            },
            "aim": dict(zip(("lat_deg", "lon_deg"), tuple(AIMS.values())[number % 3], strict=True)),
        }
        for number in range(30)
    ]
    end_s = 10.0 + 30 * every_s
    scene = {
        "scene": "chain",
        "epoch": "2026-04-01T12:00:00Z",
        "duration_s": end_s,
        "seed": 7,
        "sensors": sensors,
    }
    plan = opir.compile_plan(
        opir.scene_from_mapping({**scene, "targets": launches, "tracker": "imm"})
    )
    tracks = run_of_plan(plan).tracks
    last = tracks.take(tracks.tick_s == end_s)
    here = plan.targets.position_ecef_m(np.arange(30, dtype=np.int32), np.full(30, end_s))
    apart = np.linalg.norm(last.state[:, None, :3] - here, axis=2)
    return len(np.unique(tracks.track)), apart.min(axis=0)


@pytest.mark.slow
@pytest.mark.parametrize("sensors", [TWO, FIVE], ids=["two", "five"])
@pytest.mark.parametrize("every_s", [0.0, 0.1])
def test_launches_six_kilometres_apart_have_a_track_each(
    sensors: list[dict[str, Any]], every_s: float
) -> None:
    tracks, nearest_m = chain(sensors, (0.05, -0.02), every_s)
    assert tracks == 30
    assert nearest_m.max() < 2e3


@pytest.mark.slow
@pytest.mark.parametrize(
    "sensors", [pytest.param(TWO, marks=pytest.mark.slow), FIVE], ids=["two", "five"]
)
def test_launches_along_the_sensors_base_begin_no_more_than_a_tenth_too_many(
    sensors: list[dict[str, Any]],
) -> None:
    """A ray of one sensor meets the other's rays of all its neighbours, at other heights; two are
    in one plane.
    """
    tracks, nearest_m = chain(sensors, (0.0, 0.05), 0.1)
    assert 30 <= tracks <= 33
    assert sensors is TWO or nearest_m.max() < 3e3


def rays_of(aside_sigmas: FloatArray, seen: FloatArray) -> tuple[LinesOfSight, IntArray]:
    """Return rays of targets (n,) so far aside, in errors of a look, that scans (m, n) saw, and
    whose each is.
    """
    rng = np.random.default_rng(1)
    scan, target = np.nonzero(seen)
    y, z = SIGMA_RAD * (
        rng.standard_normal((2, len(scan))) + np.stack([aside_sigmas[target], 0.0 * target])
    )
    along = np.stack([-np.sqrt(1.0 - y * y - z * z), y, z], axis=1)
    origin = np.tile([4.2e7, 0.0, 0.0], (len(scan), 1))
    sensor = np.zeros(len(scan), dtype=np.int32)
    sigma = np.full(len(scan), SIGMA_RAD)
    return LinesOfSight(0.1 * scan, sensor, scan, origin, along, sigma), target


def test_a_wide_spot_is_parted_target_by_target() -> None:
    """Four in five looks see something, so that no scan sees all."""
    seen = np.random.default_rng(2).random((12, 9)) < 0.8
    rays, target = rays_of(9.0 * np.arange(9.0), seen)
    spot, parts = split_clusters(
        np.zeros(len(rays), dtype=np.int64), rays, rays.direction_ecef, rays.sigma_rad
    )
    assert parts.tolist() == [True] * 9
    pairs = np.unique(np.stack([spot, target]), axis=1)
    assert pairs.shape == (2, 9)


def test_targets_within_the_error_of_a_look_stay_one_spot() -> None:
    rays, _ = rays_of(np.array([0.0, 1.0]), np.ones((12, 2)))
    spot, parts = split_clusters(
        np.zeros(len(rays), dtype=np.int64), rays, rays.direction_ecef, rays.sigma_rad
    )
    assert not spot.any()
    assert parts.tolist() == [False]


def test_a_spot_beside_a_wide_one_keeps_its_rays() -> None:
    wide, target = rays_of(np.array([0.0, 8.0]), np.ones((6, 2)))
    other, _ = rays_of(np.array([400.0]), np.ones((6, 1)))
    rays = LinesOfSight.concatenate([wide, other])
    spot, parts = split_clusters(
        np.repeat([0, 1], [12, 6]), rays, rays.direction_ecef, rays.sigma_rad
    )
    assert len(np.unique(spot[:12])) == 2
    assert [len(np.unique(spot[:12][target == one])) for one in (0, 1)] == [1, 1]
    assert np.unique(spot[12:]).tolist() == [0]
    assert parts.tolist() == [False, True, True]


def test_first_crossings_near_the_ground_are_the_likelier() -> None:
    up = np.array([1.0, 0.0, 0.0])
    origin = 4.2e7 * np.array([[0.87, 0.5, 0.0], [0.87, -0.5, 0.0]])
    gain = []
    for height_m in (0.0, 6e3, -6e3):
        apart = (6378137.0 + height_m) * up - origin
        range_m = np.linalg.norm(apart, axis=1)
        unit = apart / range_m[:, None]
        error = np.full(2, 0.5 * SIGMA_RAD)
        lines = Directions(np.arange(2), np.arange(2), np.zeros(2), origin, unit, error)
        table, centre = normal_equations(lines, np.arange(2), 2, range_m)
        gain.append(float(SetModel(centre, begin=True).gains(table.sum(axis=0))))
    ground, high, deep = gain
    assert ground > high > deep
