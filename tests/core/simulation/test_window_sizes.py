"""Windows hold a limited number of looks and of false alarms; results do not depend on them."""

from typing import Any

import numpy as np
from two_sensor_scene import two_sensor_scene

import opir_core as opir
from opir_core.interfaces.columns import names_of
from opir_core.interfaces.records import Detections
from opir_core.planning.work import LOOKS_PER_EVENT
from opir_core.simulation.run import LOOKS_PER_WINDOW, compile_plan, plan_windows, window_edges_ns


def scene(threshold: float, duration_s: float) -> Any:
    sensor = {
        "model": "DSP",
        "id": "D-1",
        "orbital_slot_deg": -120.0,
        "threshold_sigma": threshold,
    }
    limits = {"false_alarms_per_s": 1e6}
    return opir.scene_from_mapping(
        two_sensor_scene(duration_s=duration_s, sensors=[sensor], detection="snr", limits=limits)
    )


def test_windows_are_cut_by_expected_false_alarms() -> None:
    plan = compile_plan(scene(2.0, 14.0))
    events = plan.workload.of_run().events
    assert events > 1e6
    edges = np.array([0, *window_edges_ns(plan)])
    per_window = np.diff(edges) / plan.end_ns * events
    assert edges[-1] == plan.end_ns
    assert per_window.max() <= 1.01 * LOOKS_PER_WINDOW / LOOKS_PER_EVENT
    assert len(edges) - 1 == np.ceil(events * LOOKS_PER_EVENT / LOOKS_PER_WINDOW)
    assert list(window_edges_ns(compile_plan(scene(6.0, 14.0)))) == [plan.end_ns]


def test_false_alarms_do_not_depend_on_windows() -> None:
    plan = compile_plan(scene(4.0, 14.0))
    whole, parts = (
        Detections.concatenate(window.detections for window in plan_windows(plan, window_s))
        for window_s in (None, 0.9)
    )
    assert len(whole) > 2000
    for name in names_of(Detections):
        assert getattr(whole, name).tobytes() == getattr(parts, name).tobytes(), name
