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


class TestLinks(MetricContract):
    name = "links"


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


def test_delays_and_losses_of_reports():
    station = {"id": "EQ", "lat_deg": 0.0, "lon_deg": -90.0, "delay_s": 0.5}
    links = {
        "stations": [station],
        "downlinks": [{"rate_bytes_s": 1e6, "loss": 0.2}],
        "outages": [{"node": "EQ", "at_s": 5.0, "until_s": 10.0}],
    }
    scene = opir_core.scene_from_mapping({**SCENE, "links": links})
    run = opir_core.simulate(scene)
    delay_s = run.detections.reported_ns * 1e-9 - run.detections.time_s
    figures = figures_of("links", run, late_s=2.0)
    assert figures["report_delay_s"] == pytest.approx(delay_s.mean())
    assert figures["reports_late"] == pytest.approx(np.count_nonzero(delay_s > 2.0) / len(delay_s))
    assert 0.05 < figures["reports_late"] < 0.25
    assert np.mean(delay_s <= figures["report_delay_p95_s"] + 1e-6) == pytest.approx(0.95, abs=0.01)
    links["downlinks"][0]["loss"] = 1.0
    silent = opir_core.simulate(opir_core.scene_from_mapping({**SCENE, "links": links}))
    assert figures_of("links", silent)["reports_lost"] == 1.0
    perfect = opir_core.simulate(opir_core.scene_from_mapping(SCENE))
    lost = 1.0 - len(run.detections) / len(perfect.detections)
    assert figures["reports_lost"] == pytest.approx(lost)
    assert figures_of("links", perfect) == {
        "report_delay_s": 0.0,
        "report_delay_p95_s": 0.0,
        "reports_late": 0.0,
        "reports_lost": 0.0,
    }
