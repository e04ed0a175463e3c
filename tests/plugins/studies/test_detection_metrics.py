"""Metrics of detections, against the columns of the run."""

import numpy as np
import pytest
from attrs import evolve
from opir_testing import MetricContract
from study_metrics import figures_of
from study_scene import SCENE

import opir_core


class TestLatency(MetricContract):
    name = "latency"


class TestDetectionByTime(MetricContract):
    name = "detection_by_time"


class TestFalseEvents(MetricContract):
    name = "false_events"


def launch(number, time_s):
    target = SCENE["targets"][0]
    return {**target, "id": f"T{number}", "launch": {**target["launch"], "time_s": time_s}}


@pytest.fixture(scope="module")
def run():
    targets = [*(launch(number, 1.0 + number) for number in range(5)), launch(9, 19.99)]
    return opir_core.simulate(opir_core.scene_from_mapping({**SCENE, "targets": targets}))


def first_latencies(run):
    latencies = []
    for target, ignition_s in enumerate(run.plan.targets.ignition_s):
        times_s = run.detections.time_s[run.truth.target == target]
        latencies.append(times_s[0] - ignition_s if len(times_s) else np.nan)
    return np.array(latencies)


def test_latency_is_that_of_the_first_detections(run):
    expected = first_latencies(run)
    figures = figures_of("latency", run)
    assert figures["detected"] == pytest.approx(np.isfinite(expected).mean()) == 5 / 6
    assert figures["latency_s"] == pytest.approx(np.nanmean(expected), abs=1e-8)
    ordered = np.sort(expected)
    assert figures["latency_p50_s"] == pytest.approx(0.5 * (ordered[2] + ordered[3]), abs=1e-8)
    # Place 4.5 of 0 to 5 lies between the fifth launch and the sixth, which is never detected.
    assert np.isnan(figures["latency_p90_s"])
    assert figures["latency_end_to_end_s"] == pytest.approx(figures["latency_s"], abs=1e-8)


def test_reports_follow_their_looks(run):
    delayed = {**SCENE, "sensors": [{**SCENE["sensors"][0], "reporting": "paper-ground-chain"}]}
    figures = figures_of("latency", opir_core.simulate(opir_core.scene_from_mapping(delayed)))
    assert figures["latency_end_to_end_s"] > figures["latency_s"] + 0.1


def test_detection_by_time_counts_launches(run):
    expected = first_latencies(run)
    figures = figures_of("detection_by_time", run, times_s=(0.1, 0.5, 2.5, 10.0))
    assert figures == {
        "detected_by_0_1_s": np.mean(expected <= 0.1),
        "detected_by_0_5_s": np.mean(expected <= 0.5),
        "detected_by_2_5_s": np.mean(expected <= 2.5),
        "detected_by_10_s": 5 / 6,
    }


def test_false_events_are_scaled_to_a_day(run):
    rows = len(run.detections)
    target = run.truth.target.copy()
    target[: rows // 4] = -1
    changed = evolve(run, truth=evolve(run.truth, target=target))
    expected = (rows // 4) * 86400.0 / 20.0
    assert figures_of("false_events", changed) == pytest.approx(
        {"false_events_a_day": expected, "false_alarms_a_day": expected}
    )
    assert figures_of("false_events", run) == {"false_events_a_day": 0.0, "false_alarms_a_day": 0.0}
