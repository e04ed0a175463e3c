"""Replicates share what no seed changes, and are the runs that they would be alone."""

from collections.abc import Mapping
from typing import Any

import pytest
from attrs import evolve
from opir_testing.bench import bench_run_of, bench_scene

import opir_core as opir
from opir_core import reseeded

CLOUDS = {"model": "lowtran", "cloud": {"top_km": 8.0, "cover": 0.5, "cell_km": 50.0}}
REGION = {"south_deg": 35, "north_deg": 45, "west_deg": -121, "east_deg": -110}
BIASED = {
    "model": "SBIRS-GEO",
    "id": "S",
    "orbital_slot_deg": -90,
    "line_of_sight_bias_sigma_urad": 40.0,
}
FIRES = {"id": "F", "model": "fires", "field": {"region": REGION, "per_million_km2": 8}}
SCENES: dict[str, Mapping[str, Any]] = {
    "constant": {},
    "signals": {"detection": "snr", "atmosphere": "lowtran"},
    "clouds": {"detection": "snr", "atmosphere": CLOUDS},
    "sources": {"detection": "snr", "sources": [FIRES]},
    "biases": {"sensors": [BIASED]},
    "tracker": {"tracker": "kepler-arc"},
}


def scene_of(name: str) -> opir.Scene:
    return opir.scene_from_mapping(bench_scene(**SCENES[name]))


@pytest.mark.parametrize("name", SCENES)
def test_a_replicate_has_the_bytes_of_a_run_of_its_own(name: str) -> None:
    scene = scene_of(name)
    plan = opir.compile_plan(scene)
    for seed in (scene.seed + 1, 0):
        alone = bench_run_of(opir.compile_plan(evolve(scene, seed=seed)))
        assert bench_run_of(reseeded(plan, seed)).lines == alone.lines
        assert reseeded(plan, seed).scene == alone.plan.scene


def test_a_replicate_builds_no_sensor_no_trajectory_and_no_model() -> None:
    plan = opir.compile_plan(scene_of("signals"))
    replicate = reseeded(plan, 7)
    assert replicate.sensors is plan.sensors
    assert replicate.targets is plan.targets
    assert (replicate.detection, replicate.classifier, replicate.confidence) == (
        plan.detection,
        plan.classifier,
        plan.confidence,
    )
    assert replicate.detection is plan.detection


def test_replicates_share_knots_for_all_scan_phases() -> None:
    plan = opir.compile_plan(scene_of("signals"))
    calls: list[int] = []

    class Counting:
        def __getattr__(self, name: str) -> Any:
            return getattr(plan.detection, name)

        def response(self, exposures: Any, *, slack: float = 0.0) -> Any:
            calls.append(len(exposures))
            return plan.detection.response(exposures, slack=slack)

    counted = evolve(plan, detection=Counting())
    runs = [opir.run_of_plan(reseeded(counted, seed)) for seed in range(4)]
    assert len({run.plan.pairs.phase_ns.tobytes() for run in runs}) == 4
    first_calls = calls[: len(calls) - 3]
    later_calls = calls[len(calls) - 3 :]
    # The first finds the knots, round by round; each evaluates its looks near bends once more.
    assert len(first_calls) > 4
    assert max(later_calls) < 0.3 * sum(first_calls)
    assert all(len(run.detections) for run in runs)


def test_replicates_ask_the_plugins_for_their_classes_once(monkeypatch: pytest.MonkeyPatch) -> None:
    plan = opir.compile_plan(scene_of("constant"))
    opir.run_of_plan(plan)
    monkeypatch.setattr(
        "opir_core.planning.plan.offered_hypotheses", lambda _host: pytest.fail("asked again")
    )
    for seed in (5, 6):
        assert len(opir.run_of_plan(reseeded(plan, seed)).plan.hypotheses) > 1


def test_another_model_does_not_get_the_knots_of_the_first() -> None:
    plan = opir.compile_plan(scene_of("signals"))
    dim = opir.compile_plan(
        opir.scene_from_mapping(
            bench_scene(
                **SCENES["signals"] | {"detection": {"model": "snr", "probability_tolerance": 0.01}}
            )
        )
    )
    alone = bench_run_of(dim).lines
    bench_run_of(plan)
    assert bench_run_of(evolve(plan, scene=dim.scene, detection=dim.detection)).lines == alone


def test_clouds_are_drawn_anew() -> None:
    plan = opir.compile_plan(scene_of("clouds"))
    replicate = reseeded(plan, 7)
    assert replicate.detection is not plan.detection
    assert bench_run_of(replicate).lines != bench_run_of(reseeded(plan, 8)).lines


def test_replicates_are_the_runs_of_successive_seeds() -> None:
    scene = scene_of("constant")
    runs = list(opir.replicates(scene, 3))
    assert [run.plan.scene.seed for run in runs] == [scene.seed, scene.seed + 1, scene.seed + 2]
    alone = opir.simulate(evolve(scene, seed=scene.seed + 2))
    assert runs[2].detections.detection_id.tolist() == alone.detections.detection_id.tolist()
