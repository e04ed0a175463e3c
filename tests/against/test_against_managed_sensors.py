"""The director `stonesoup` against all plans of two sensors and two tracks, compared here with
formulae of its own: a straight flight, a pinhole, and the Kalman update.
"""

from functools import cache
from itertools import product
from typing import Any

import numpy as np
from numpy.typing import NDArray
from opir_stonesoup.director import StoneSoupDirector
from opir_stonesoup.settings import StoneSoupDirectorConfig
from opir_testing import stub_estimates

import opir_core as opir
from opir_core.plugin import Detections, DirectorContext, Sensor, Situation, Tracks

Array = NDArray[np.float64]

SIGMA_URAD = 100.0
STEP_S = 5.0
CASES = 150
#: Plans whose rewards differ by less than this share depend on gravity and light time.
MARGIN = 0.02


@cache
def sensors() -> tuple[Sensor, ...]:
    rows = [
        {
            "model": "generic-pointed",
            "id": f"S{number}",
            "orbital_slot_deg": -140.0 + 50.0 * number,
            "line_of_sight_sigma_urad": SIGMA_URAD,
        }
        for number in range(2)
    ]
    scene: dict[str, Any] = {
        "scene": "plans",
        "epoch": "2026-04-01T12:00:00Z",
        "duration_s": 60.0,
        "seed": 1,
        "sensors": rows,
        "targets": [],
    }
    return opir.compile_plan(opir.scene_from_mapping(scene)).sensors


def drawn_tracks(rng: np.random.Generator) -> Tracks:
    """Return two tracks near the equator whose standard deviations differ by up to a hundred."""
    latitude, longitude = np.radians([rng.uniform(-30.0, 30.0, 2), rng.uniform(-135.0, -95.0, 2)])
    up = np.cos(latitude) * np.cos(longitude), np.cos(latitude) * np.sin(longitude)
    place_m = np.stack([*up, np.sin(latitude)], axis=1) * 6.6e6
    state = np.hstack([place_m, rng.normal(0.0, 1000.0, (2, 3))])
    covariance = []
    for _ in range(2):
        axes = np.linalg.qr(rng.normal(size=(3, 3)))[0]
        of_place = axes @ np.diag(10.0 ** rng.uniform(6.0, 10.0, 3)) @ axes.T
        covariance.append(np.block([[of_place, np.zeros((3, 3))], [np.zeros((3, 3)), np.eye(3)]]))
    return stub_estimates(
        2, track=[7, 8], tick_s=[20.0, 20.0], state=state, state_covariance=np.array(covariance)
    )


def rewards(tracks: Tracks) -> dict[tuple[int, ...], float]:
    """Return the reward of each plan: a row of the tracks for each sensor."""
    step = np.block([[np.eye(3), STEP_S * np.eye(3)], [np.zeros((3, 3)), np.eye(3)]])
    result: dict[tuple[int, ...], float] = {}
    for plan in product(range(2), repeat=2):
        covariance = [step @ each @ step.T for each in tracks.state_covariance]
        total = 0.0
        for sensor, row in zip(sensors(), plan, strict=True):
            target_m = (step @ tracks.state[row])[:3]
            line_m = target_m - sensor.orbit.position_ecef_m(np.array([25.0]))[0]
            range_m = np.linalg.norm(line_m)
            across = np.linalg.svd(line_m[None])[2][1:]
            matrix = np.hstack([across / range_m, np.zeros((2, 3))])
            chance = np.mean([*sensor.detection_probability.values()])
            looks = STEP_S / (sensor.scan.period_ns * 1e-9) * chance
            variance = (SIGMA_URAD * 1e-6) ** 2 / looks + sensor.line_of_sight_bias_sigma_rad**2
            noise = np.eye(2) * variance
            before = covariance[row]
            gain = before @ matrix.T @ np.linalg.inv(matrix @ before @ matrix.T + noise)
            covariance[row] = before - gain @ matrix @ before
            total += float(np.linalg.norm(before) - np.linalg.norm(covariance[row]))
        result[plan] = total
    return result


def chosen(tracks: Tracks, manager: str) -> tuple[int, ...]:
    """Return the row of the tracks to which the director points each sensor."""
    config = StoneSoupDirectorConfig(interval_s=STEP_S, manager=manager, noise=0.0)
    context = DirectorContext(sensors=sensors(), epoch_us=1_775_044_800_000_000, duration_s=60.0)
    situation = Situation(
        time_s=20.0,
        detections=Detections.empty(),
        tracks=tracks,
        sensors=sensors(),
        refused=(),
        in_reach=lambda _sensor, position_m, _after_s=0.0: np.ones(len(position_m), dtype=np.bool_),
    )
    commands = StoneSoupDirector(config, context).commands(situation)
    assert [command.sensor for command in commands] == ["S0", "S1"]
    return tuple(command.track - 7 for command in commands)


def test_its_choice_is_the_best_of_all_plans() -> None:
    rng = np.random.default_rng(20260401)
    compared = 0
    plans = set()
    for _ in range(CASES):
        tracks = drawn_tracks(rng)
        reward = rewards(tracks)
        best, second = sorted(reward, key=reward.__getitem__, reverse=True)[:2]
        if reward[best] - reward[second] > MARGIN * reward[best]:
            compared += 1
            plans.add(best)
            assert chosen(tracks, "brute-force") == best
    assert compared > CASES / 2
    assert len(plans) == 4, "every plan is the best of some case"


def test_the_greedy_manager_sends_all_sensors_to_the_least_known_track() -> None:
    rng = np.random.default_rng(20260402)
    for _ in range(20):
        tracks = drawn_tracks(rng)
        row = int(rng.integers(2))
        covariance = tracks.state_covariance.copy()
        covariance[row, :3, :3] = 1e12 * np.eye(3)
        tracks = tracks.replaced(state_covariance=covariance)
        assert chosen(tracks, "greedy") == (row, row)
