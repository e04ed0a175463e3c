"""The check of a scene says what its plan would say, and computes no line of sight for it."""

from typing import Any

import numpy as np
import pytest
from repository import ROOT

import opir_core as opir
from opir_core import compile_plan
from opir_core.planning import PairCompiler, pair_compiler, solar_exclusions
from opir_core.planning.sensor_states import scan_starts
from opir_core.planning.solar_exclusion import SolarExclusion
from opir_core.reading import load_scene, scene_from_mapping
from opir_core.simulation import plan_warnings
from opir_core.simulation.scene_check import check_scene


def scene(**changes: Any) -> opir.Scene:
    launch = {"lat_deg": 10.0, "lon_deg": 20.0, "time_s": 7.0}
    target = {
        "id": "T1",
        "type": "ICBM",
        "launch": launch,
        "aim": {"lat_deg": -20.0, "lon_deg": 110.0},
    }
    geometry = {
        **target,
        "id": "T2",
        "launch": {**launch, "lon_deg": -160.0},
        "aim": {"lat_deg": -20.0, "lon_deg": -70.0},
    }
    return scene_from_mapping(
        {
            "scene": "checked",
            "epoch": "2026-04-01T12:00:00Z",
            "duration_s": 300.0,
            "sensors": [
                {"model": "DSP", "id": "A", "orbital_slot_deg": 0.0},
                {"model": "DSP", "id": "B", "orbital_slot_deg": 180.0},
                {"model": "DSP", "id": "C", "orbital_slot_deg": 60.0, "scan_period_ms": 2500.0},
            ],
            "targets": [target, geometry],
            **changes,
        }
    )


ALIGNED = [
    {
        "model": "DSP",
        "id": name,
        "orbital_slot_deg": slot,
        "scan_phase": "aligned",
        "scan_period_ms": period,
    }
    for name, slot, period in (("A", 0.0, 1000.0), ("B", 180.0, 700.0), ("C", 60.0, 3000.0))
]

SCENES = {
    "random phases": {},
    "aligned, a launch on a scan instant": {"sensors": ALIGNED},
    "aligned, hidden launches": {"sensors": ALIGNED[:1], "duration_s": 20.0},
    "false alarms": {"detection": "snr"},
}


@pytest.mark.slow
@pytest.mark.parametrize("changes", SCENES.values(), ids=SCENES)
def test_warnings_are_those_of_the_plan(changes: dict[str, Any]) -> None:
    checked_scene = scene(**changes)
    assert plan_warnings(check_scene(checked_scene)) == plan_warnings(compile_plan(checked_scene))


def test_one_of_these_scenes_has_a_warning_of_a_scan_instant() -> None:
    warnings = plan_warnings(check_scene(scene(sensors=ALIGNED)))
    assert any(
        "looks of A, B coincide with ignitions and burnouts of T1, T2" in warning
        for warning in warnings
    )


@pytest.mark.slow
@pytest.mark.parametrize(
    "limits", [{"looks_per_run": 30.0}, {"events_per_run": 30.0}, {"bytes_per_run": 3e4}]
)
@pytest.mark.parametrize("detection", ["constant", "snr"])
def test_too_much_work_is_refused_as_by_the_plan(limits: dict[str, float], detection: str) -> None:
    checked_scene = scene(limits=limits, detection=detection)
    with pytest.raises(opir.SceneError) as by_plan:
        compile_plan(checked_scene)
    with pytest.raises(opir.SceneError) as by_check:
        check_scene(checked_scene)
    assert str(by_check.value) == str(by_plan.value)


def test_too_many_false_alarms_a_second_are_refused_with_their_sensor() -> None:
    def loud(sigma: float, **changes: Any) -> opir.Scene:
        sensor = {"model": "DSP", "id": "D", "orbital_slot_deg": 0.0, "threshold_sigma": sigma}
        return scene(sensors=[sensor], detection="snr", **changes)

    check_scene(loud(3.0))
    for call in (check_scene, compile_plan):
        with pytest.raises(opir.SceneError) as refusal:
            call(loud(2.0))
        words = str(refusal.value)
        assert "limits.false_alarms_per_s: the sensors have 1.37e+05 false alarms" in words
        assert "raise the threshold of D, which has 1.37e+05" in words
    check_scene(loud(2.0, limits={"false_alarms_per_s": 2e5}))


def test_a_limit_between_the_looks_and_their_bound_is_kept() -> None:
    looks = int(compile_plan(scene()).pairs.looks.sum())
    check_scene(scene(limits={"looks_per_run": float(looks)}))
    with pytest.raises(opir.SceneError, match="looks_per_run: the scene has"):
        check_scene(scene(limits={"looks_per_run": looks - 1.0}))


@pytest.mark.slow
@pytest.mark.parametrize(
    "name", ["arctic_watch", "first_light", "pacific_test_range", "target_classes"]
)
def test_the_bound_of_the_looks_holds(name: str) -> None:
    plan = compile_plan(load_scene(ROOT / "examples" / f"{name}.yaml"))
    starts = scan_starts(plan.scene.seed, plan.sensors)
    maximum = PairCompiler(
        plan.sensors, plan.targets, starts, plan.scene.light_time, plan.end_ns, ()
    ).most_looks()
    looks = np.bincount(plan.pairs.sensor, plan.pairs.looks, minlength=len(plan.sensors))
    assert (looks <= maximum).all()


def test_no_line_of_sight_is_computed(monkeypatch: pytest.MonkeyPatch) -> None:
    rows: list[int] = []
    margins_of = pair_compiler.Margins.of
    monkeypatch.setattr(
        pair_compiler.Margins,
        "of",
        lambda *arguments: rows.append(len(arguments[2])) or margins_of(*arguments),
    )
    check_scene(scene())
    assert not rows
    compile_plan(scene())
    assert rows


@pytest.mark.slow
@pytest.mark.parametrize("hour", range(0, 24, 3))
@pytest.mark.parametrize(
    "duration_s", [60.0, 7200.0, pytest.param(86400.0, marks=pytest.mark.slow)]
)
def test_only_sensors_without_outages_leave_the_sun_search(hour: int, duration_s: float) -> None:
    sensors = [
        {"model": "DSP", "id": f"S{number}", "orbital_slot_deg": 7.2 * number - 180.0}
        for number in range(50)
    ]
    checked_scene = scene(
        sensors=sensors, epoch=f"2026-03-20T{hour:02}:00:00Z", duration_s=duration_s
    )
    plan = compile_plan(scene(sensors=sensors))
    results = solar_exclusions(plan.sensors, checked_scene.epoch_us, duration_s)
    for sensor, exclusion in zip(plan.sensors, results, strict=True):
        exact = SolarExclusion.of(sensor, checked_scene.epoch_us, duration_s)
        assert (exact is None) == (exclusion is None)
        if exact is not None and exclusion is not None:
            np.testing.assert_array_equal(exclusion.start_s, exact.start_s)
