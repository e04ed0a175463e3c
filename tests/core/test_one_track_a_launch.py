"""A launch has one track, however seldom the sensors look and however often the tracker tells."""

from pathlib import Path

import numpy as np
import pytest

from opir_core.plan import compile_plan
from opir_core.reading import load_scene
from opir_core.run import run_of_plan
from opir_core.scoring import evidence_of_run
from opir_core.scoring.ownership import ownership

SCENE = Path(__file__).parents[2] / "examples" / "pacific_test_range.yaml"


def sensors(*slots_deg: float, period_ms: float, model: str = "SBIRS-GEO", more: str = "") -> str:
    """Return an override that puts sensors of one model at these slots."""
    each = (
        f"{{model: {model}, id: S{number}, orbital_slot_deg: {slot}, scan_period_ms: {period_ms}{more}}}"
        for number, slot in enumerate(slots_deg)
    )
    return f"sensors=[{', '.join(each)}]"


def tracks_a_launch(*overrides: str) -> tuple[list[int], int]:
    """Return how many tracks each launch of a scene has, and how many tracks have none."""
    plan = compile_plan(load_scene(SCENE, overrides=list(overrides)))
    target = ownership(evidence_of_run(run_of_plan(plan), plan)).target
    return [int(np.count_nonzero(target == number)) for number in range(3)], int(np.count_nonzero(target < 0))


@pytest.mark.parametrize("phase", ["aligned", "random"])
def test_scans_ten_seconds_apart(phase: str) -> None:
    looks = sensors(-165.0, -105.0, period_ms=10000, model="DSP", more=f", scan_phase: {phase}")
    assert tracks_a_launch(looks, "detection=always", "tracker=stereo-filter") == ([1, 1, 1], 0)


def test_ticks_between_scans() -> None:
    """Nine ticks in ten have no look."""
    looks = sensors(-165.0, -105.0, period_ms=1000)
    assert tracks_a_launch(looks, "duration_s=90", "tracker={model: stereo-filter, cadence_s: 0.1}") == ([1, 1, 1], 0)


@pytest.mark.parametrize("biased", [(0, 30), (30, 0), (30, 30)])
@pytest.mark.parametrize("seed", [7, 9])
def test_a_sensor_whose_rays_graze_the_ground_sees_the_track_of_one_that_looks_from_above(
    biased: tuple[int, int], seed: int
) -> None:
    """The second sees the first launch 2° above its horizon: 30 µrad shift a ray on the ground by 35 km."""
    looks = ", ".join(
        f"{{model: SBIRS-GEO, id: S{number}, orbital_slot_deg: {slot}, line_of_sight_bias_sigma_urad: {bias}}}"
        for number, (slot, bias) in enumerate(zip((-150.0, 160.0), biased, strict=True))
    )
    told = tracks_a_launch(f"sensors=[{looks}]", "duration_s=70", f"seed={seed}", "tracker=stereo-filter")
    assert told == ([1, 1, 1], 0)


def test_a_target_whose_biased_rays_pass_above_the_ground_has_a_track() -> None:
    bias = ", line_of_sight_bias_sigma_urad: 30"
    looks = sensors(100.0, 160.0, period_ms=100, more=bias)
    assert tracks_a_launch(looks, "duration_s=70", "seed=11", "tracker=stereo-filter") == ([1, 1, 1], 0)


def test_tracks_of_biased_sensors_apart_are_one_where_their_biases_say_so() -> None:
    """Two sensors with biases of five times their noise see the first launch graze the ground, a third sees it late."""
    slots = ((157, 0, 500), (160, 100, 500), (175, 100, 2000), (120, 0, 100))
    looks = ", ".join(
        f"{{model: SBIRS-GEO, id: S{number}, orbital_slot_deg: {slot}, line_of_sight_bias_sigma_urad: {bias},"
        f" scan_period_ms: {period_ms}}}"
        for number, (slot, bias, period_ms) in enumerate(slots)
    )
    told = tracks_a_launch(
        f"sensors=[{looks}]", "detection=always", "duration_s=80", "seed=453", "tracker=stereo-filter"
    )
    assert told == ([1, 1, 1], 0)


def test_eight_missed_scans_end_no_young_track_of_a_sensor_that_often_misses() -> None:
    looks = sensors(-90.0, 175.0, period_ms=100)
    tracker = "tracker={model: stereo-filter, cadence_s: 0.5}"
    assert tracks_a_launch(looks, "duration_s=75", "seed=984", tracker) == ([1, 1, 1], 0)
