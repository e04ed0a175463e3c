"""Ignitions and burnouts on the scan instants of sensors with aligned phases are reported; others
are not.
"""

from collections.abc import Mapping
from typing import Any

import numpy as np
import pytest
from attrs import evolve

import opir_core as opir
from opir_core import Plan
from opir_core.plugin import Classifier
from opir_core.simulation import plan_warnings
from opir_core.simulation.explanation import explained
from opir_core.simulation.plan_checks import alignment_warnings, launch_expectations

SENSOR = {
    "model": "generic-scanner",
    "orbital_slot_deg": -130.0,
    "detection_probability": {"ICBM": 1.0},
}


def plan(
    *sensors: Mapping[str, Any], ignition_s: float = 10.0, burn_s: float = 60.05, **scene: Any
) -> Plan:
    launch = {"lat_deg": 34.73, "lon_deg": -120.57, "time_s": ignition_s}
    target = {
        "id": "T1",
        "type": "ICBM",
        "launch": launch,
        "aim": {"lat_deg": 9.0, "lon_deg": 167.7},
    }
    head = {"scene": "s", "epoch": "2026-04-01T12:00:00Z", "duration_s": 120.0}
    mapping = {
        **head,
        **scene,
        "sensors": [
            {**SENSOR, "id": f"S{number}", **sensor} for number, sensor in enumerate(sensors)
        ],
        "targets": [{**target, "burn_time_s": burn_s}],
    }
    return opir.compile_plan(opir.scene_from_mapping(mapping))


def test_aligned_scans_on_an_ignition_are_reported() -> None:
    (warning,) = alignment_warnings(plan({"scan_phase": "aligned", "scan_period_ms": 5000.0}))
    assert "S0" in warning
    assert "ignitions of T1" in warning
    assert "burnouts" not in warning
    assert "scan_phase: random" in warning


def test_a_burnout_counts_if_the_scene_lasts_so_long() -> None:
    aligned = {"scan_phase": "aligned", "scan_period_ms": 500.0}
    (warning,) = alignment_warnings(plan(aligned, ignition_s=10.25, burn_s=60.25))
    assert "burnouts of T1" in warning
    assert "ignitions" not in warning
    assert not alignment_warnings(plan(aligned, ignition_s=10.25, burn_s=60.25, duration_s=70.0))


@pytest.mark.parametrize(
    ("off_periods", "is_reported"), [(0.0, True), (5e-7, True), (-5e-7, True), (2e-6, False)]
)
def test_the_tolerance_is_a_millionth_of_a_period(off_periods: float, is_reported: bool) -> None:
    aligned = {"scan_phase": "aligned", "scan_period_ms": 4000.0}
    assert (
        bool(alignment_warnings(plan(aligned, ignition_s=12.0 + 4.0 * off_periods))) == is_reported
    )


@pytest.mark.parametrize("pattern", ["spin", "step-stare", "staring"])
def test_other_phases_are_not_reported(pattern: str) -> None:
    phases = ({"scan_phase": phase, "scan_pattern": pattern} for phase in ("random", "swept"))
    assert not alignment_warnings(plan(*phases, {"scan_phase": "aligned", "scan_period_ms": 700.0}))


def test_a_sensor_that_does_not_see_the_target_does_not_count() -> None:
    aligned = {"scan_phase": "aligned", "scan_period_ms": 1000.0}
    (warning,) = alignment_warnings(plan(aligned, {**aligned, "orbital_slot_deg": 60.0}))
    assert "S0 " in warning
    assert "S1" not in warning


def test_long_lists_are_cut() -> None:
    aligned = {"scan_phase": "aligned", "scan_period_ms": 1000.0}
    (warning,) = alignment_warnings(plan(*[aligned] * 5))
    assert "S0, S1, S2 and 2 more" in warning


def test_explain_lists_the_warnings() -> None:
    assert explained(plan({}))["warnings"] == []
    aligned = plan({"scan_phase": "aligned", "scan_period_ms": 1000.0})
    assert explained(aligned)["warnings"] == alignment_warnings(aligned)


@pytest.mark.slow
def test_latencies_of_aligned_and_random_scans() -> None:
    """With P_d of 1 and no light time the latency is one period, or uniform in it: its mean is half
    a period.
    """
    aligned = {"scan_phase": "aligned", "scan_period_ms": 5000.0}
    records = [
        opir.simulate(plan(aligned, seed=seed).scene).summary["targets"][0]["latency_s"]
        for seed in range(3)
    ]
    assert records == pytest.approx([5.0] * 3)
    crowd = plan(*[{"scan_period_ms": 5000.0}] * 500, light_time=False)
    detections = opir.simulate(crowd.scene).detections
    _, first_row = np.unique(detections.sensor, return_index=True)
    latency_s = detections.time_s[first_row] - 10.0
    assert len(latency_s) == 500
    # 3.29 standard deviations of the mean: 99.9 %.
    assert abs(latency_s.mean() - 2.5) < 3.29 * 5.0 / np.sqrt(12.0 * 500.0)


class Expecting(Classifier):
    """A classifier that expects a number of launches a day."""

    uses_truth = False

    def __init__(self, launches_per_day: float) -> None:
        self.launches_per_day = launches_per_day

    def reported_type(self, sightings: Any, rng: Any) -> Any:
        return np.zeros(len(sightings), dtype=np.uint8)

    def expected_launches(self, duration_s: float) -> float:
        return self.launches_per_day * duration_s / 86_400.0


@pytest.mark.parametrize(
    ("launches", "expected", "is_reported"),
    [
        (1, 0.001, False),
        (9, 0.5, False),
        (11, 0.5, True),
        (30, 3.5, False),
        (30, 2.5, True),
        (1, 9.0, False),
        (1, 11.0, True),
    ],
)
def test_ten_times_as_many_launches_as_expected_are_reported(
    launches: int, expected: float, is_reported: bool
) -> None:
    compiled = plan({})
    scene = evolve(compiled.scene, targets=compiled.scene.targets * launches)
    compiled = evolve(compiled, scene=scene, classifier=Expecting(expected * 720.0))
    assert launch_expectations(compiled) == [
        {
            "component": "classification: paper",
            "expected_launches": pytest.approx(expected),
            "launches": launches,
        }
    ]
    warnings = [words for words in plan_warnings(compiled) if "expects" in words]
    assert bool(warnings) == is_reported
    assert all(f"in the scene, which has {launches}" in words for words in warnings)


def test_explain_says_which_classifier_knows_the_truth() -> None:
    compiled = plan({})
    assert explained(compiled)["truth_users"] == ["classification: paper"]
    assert not explained(compiled)["expected_launches"]
    assert not explained(plan({}, classification="none"))["truth_users"]
