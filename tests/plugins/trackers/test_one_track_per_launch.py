"""A launch has one track, however seldom the sensors look and however often the tracker tells."""

import numpy as np
import pytest
from opir_scoring import evidence_of_run
from opir_scoring.evidence import ownership
from repository import TEST_SCENES

from opir_core.planning.plan import compile_plan
from opir_core.reading import load_scene
from opir_core.simulation.run import run_of_plan

SCENE = TEST_SCENES / "pacific_test_range.yaml"
#: All launches within 10 s, so that a short scene has all burns.
SOON = ("targets[1].launch.time_s=15", "targets[2].launch.time_s=20")


def sensors(*slots_deg: float, period_ms: float, model: str = "SBIRS-GEO", more: str = "") -> str:
    """Return an override that puts sensors of one model at these slots."""
    each = (
        f"{{model: {model}, id: S{number}, orbital_slot_deg: {slot}, scan_period_ms:"
        f" {period_ms}{more}}}"
        for number, slot in enumerate(slots_deg)
    )
    return f"sensors=[{', '.join(each)}]"


def unlike(*each: tuple[float, float, float]) -> str:
    """Return an override that puts sensors at slots, deg, with biases, urad, and scan periods, ms,
    of their own.
    """
    reported = (
        f"{{model: SBIRS-GEO, id: S{number}, orbital_slot_deg: {slot},"
        f" line_of_sight_bias_sigma_urad: {bias},"
        f" scan_period_ms: {period_ms}}}"
        for number, (slot, bias, period_ms) in enumerate(each)
    )
    return f"sensors=[{', '.join(reported)}]"


def tracks_a_launch(*overrides: str) -> tuple[list[int], int]:
    """Return how many tracks each launch of a scene has, and how many tracks have none."""
    plan = compile_plan(load_scene(SCENE, overrides=list(overrides)))
    target = ownership(evidence_of_run(run_of_plan(plan), plan)).target
    return [int(np.count_nonzero(target == number)) for number in range(3)], int(
        np.count_nonzero(target < 0)
    )


@pytest.mark.slow
@pytest.mark.parametrize("phase", ["aligned", "random"])
def test_scans_ten_seconds_apart(phase: str) -> None:
    looks = sensors(-165.0, -105.0, period_ms=10000, model="DSP", more=f", scan_phase: {phase}")
    assert tracks_a_launch(looks, *SOON, "duration_s=150", "detection=always", "tracker=imm") == (
        [1, 1, 1],
        0,
    )


@pytest.mark.slow
def test_ticks_between_scans() -> None:
    """Nine ticks in ten have no look."""
    looks = sensors(-165.0, -105.0, period_ms=1000)
    assert tracks_a_launch(
        looks, *SOON, "duration_s=45", "tracker={model: imm, cadence_s: 0.1}"
    ) == ([1, 1, 1], 0)


@pytest.mark.slow
@pytest.mark.parametrize("biased", [(0, 30), (30, 0), (30, 30)])
@pytest.mark.parametrize("seed", [7, 9])
def test_a_sensor_whose_rays_graze_the_ground_sees_the_track_of_one_that_looks_from_above(
    biased: tuple[int, int], seed: int
) -> None:
    """The second sees the first launch 2° above its horizon: 30 µrad shift a ray on the ground by
    35 km.
    """
    looks = ", ".join(
        f"{{model: SBIRS-GEO, id: S{number}, orbital_slot_deg: {slot},"
        f" line_of_sight_bias_sigma_urad: {bias}}}"
        for number, (slot, bias) in enumerate(zip((-150.0, 160.0), biased, strict=True))
    )
    reported = tracks_a_launch(f"sensors=[{looks}]", "duration_s=70", f"seed={seed}", "tracker=imm")
    assert reported == ([1, 1, 1], 0)


@pytest.mark.slow
def test_a_target_whose_biased_rays_pass_above_the_ground_has_a_track() -> None:
    bias = ", line_of_sight_bias_sigma_urad: 30"
    looks = sensors(100.0, 160.0, period_ms=100, more=bias)
    assert tracks_a_launch(looks, "duration_s=70", "seed=11", "tracker=imm") == ([1, 1, 1], 0)


@pytest.mark.slow
def test_tracks_of_biased_sensors_apart_are_one_where_their_biases_say_so() -> None:
    """Two sensors with biases of five times their noise see the first launch graze the ground, a
    third sees it late.
    """
    looks = unlike((157, 0, 500), (160, 100, 500), (175, 100, 2000), (120, 0, 100))
    reported = tracks_a_launch(
        looks, "detection=always", "duration_s=80", "seed=453", "tracker=imm"
    )
    assert reported == ([1, 1, 1], 0)


@pytest.mark.slow
def test_eight_missed_scans_end_no_young_track_of_a_sensor_that_often_misses() -> None:
    looks = sensors(-90.0, 175.0, period_ms=100)
    tracker = "tracker={model: imm, cadence_s: 0.5}"
    assert tracks_a_launch(looks, "duration_s=75", "seed=984", tracker) == ([1, 1, 1], 0)


@pytest.mark.slow
def test_rays_of_one_sensor_pass_the_gate_of_a_track_that_the_bias_of_another_has_moved() -> None:
    """The third looks most often, with a bias of five times the noise; the others see the launch
    graze the ground.
    """
    looks = unlike((157, 0, 2000), (160, 0, 500), (-70, 100, 100))
    reported = tracks_a_launch(
        looks, "detection=always", "duration_s=75", "seed=791", "tracker=imm"
    )
    assert reported == ([1, 1, 1], 0)


GRID = [
    # cadence_s, period_ms, sensors, bias_urad, chance of detection
    (0.2, 1000, 1, 0, 0.8),
    (0.5, 200, 3, 30, 0.8),
    (1.0, 100, 1, 30, 0.3),
    (1.0, 100, 2, 30, 0.3),
    (1.0, 1000, 1, 0, 1.0),
    (1.0, 1000, 2, 30, 0.8),
    (1.0, 1000, 3, 0, 0.3),
    (5.0, 200, 2, 30, 0.8),
    (5.0, 1000, 3, 0, 1.0),
    (10.0, 500, 1, 30, 0.8),
    (10.0, 10000, 3, 30, 1.0),
]


@pytest.mark.slow
@pytest.mark.parametrize(("cadence_s", "period_ms", "count", "bias_urad", "chance"), GRID)
def test_any_cadence_scans_sensors_biases_and_chances(
    cadence_s: float, period_ms: float, count: int, bias_urad: float, chance: float
) -> None:
    more = (
        f", scan_phase: random, line_of_sight_bias_sigma_urad: {bias_urad},"
        f" detection_probability: {{ICBM: {chance}, IRBM: {chance}, SRBM: {chance}}}"
    )
    looks = sensors(*(-150.0, -165.0, 175.0)[:count], period_ms=period_ms, more=more)
    tracker = f"tracker={{model: imm, cadence_s: {cadence_s}}}"
    assert tracks_a_launch(looks, *SOON, "duration_s=85", "seed=3", tracker) == ([1, 1, 1], 0)


@pytest.mark.slow
def test_neighbours_take_no_rays_in_missed_scans() -> None:
    """Thirty launches 33 km apart in three seconds: what begins a track is its own place's rays
    alone.
    """
    launches = [
        {
            "id": f"L{number}",
            "type": ("ICBM", "IRBM", "SRBM")[number % 3],
            "launch": {
                "lat_deg": 34.0 + 0.3 * number,
                "lon_deg": -120.0,
                "time_s": 1.0 + 0.1 * number,
            },
            "aim": {"lat_deg": 34.0 + 0.3 * number, "lon_deg": (150.0, -155.0, -124.0)[number % 3]},
        }
        for number in range(30)
    ]
    looks = unlike((-150, 0, 100), (-90, 0, 100))
    plan = compile_plan(
        load_scene(
            SCENE,
            overrides=[looks, "duration_s=15", "seed=7", f"targets={launches}", "tracker=imm"],
        )
    )
    tracks = run_of_plan(plan).tracks
    assert len(np.unique(tracks.track)) == 30
    last = tracks.take(tracks.tick_s == 15.0)
    here = plan.targets.position_ecef_m(np.arange(30, dtype=np.int32), np.full(30, 15.0))
    nearest_m = np.linalg.norm(last.state[:, None, :3] - here, axis=2).min(axis=0)
    assert nearest_m.max() < 2e3


@pytest.mark.slow
def test_a_track_that_rays_of_several_pulled_apart_is_dropped() -> None:
    """Among thirty launches 4.6 km apart some tracks follow no target: one was reported at 25 km/s,
    for many ticks.
    """
    launches = [
        {
            "id": f"L{number}",
            "type": ("ICBM", "IRBM", "SRBM")[number % 3],
            "launch": {
                "lat_deg": 34.0,
                "lon_deg": -120.0 + 0.05 * number,
                "time_s": 1.0 + 0.1 * number,
            },
            "aim": {
                "lat_deg": (9.0, 20.0, 34.0)[number % 3],
                "lon_deg": (167.7, -150.0, -124.0 + 0.05 * number)[number % 3],
            },
        }
        for number in range(30)
    ]
    looks = (
        "sensors=[{model: SBIRS-GEO, id: SBIRS-GEO-150, orbital_slot_deg: -150}, {model: SBIRS-GEO,"
        " id: SBIRS-GEO-90, orbital_slot_deg: -90}]"
    )
    plan = compile_plan(
        load_scene(
            SCENE,
            overrides=[looks, "duration_s=30", "seed=3", f"targets={launches}", "tracker=imm"],
        )
    )
    state = run_of_plan(plan).tracks.state
    assert len(state) > 500
    assert np.linalg.norm(state[:, 3:], axis=1).max() < 20.5e3
