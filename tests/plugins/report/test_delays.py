"""Delays of reports in a run's report, against the run."""

from pathlib import Path

import numpy as np
import pytest
from opir_report import RunPlots, write_run_report
from opir_report.plots.delays import report_delays
from reported_runs import report_data
from two_sensor_scene import two_sensor_scene

import opir_core as opir

LINKS = {
    "stations": [{"id": "HI", "lat_deg": 21.3, "lon_deg": -158.0}],
    "downlinks": [{"rate_bytes_s": 5000.0, "loss": 0.1}],
    "outages": [{"node": "HI", "at_s": 20.0, "until_s": 30.0}],
}


def test_delays_are_those_of_the_reports(tmp_path: Path) -> None:
    run = opir.simulate(opir.scene_from_mapping(two_sensor_scene(links=LINKS)))
    data = report_data(run)["delays"]
    assert data["reports"].sum() == len(run.detections)
    detections = run.detections
    delay_s = (detections.reported_ns - detections.time_ns) * 1e-9
    west = data[data["sensor_id"] == "WEST"]
    for time_s, median_s in zip(west["time_s"], west["median_s"], strict=True):
        rows = (detections.sensor == 0) & (np.abs(detections.time_s - time_s) <= 0.5)
        assert median_s == pytest.approx(np.median(delay_s[rows]), abs=1e-9)
    assert 8.0 < west["median_s"].max() < 11.0
    page = write_run_report(run, tmp_path / "report.html")[0].read_text(encoding="utf-8")
    assert "When reports arrive" in page
    assert "lost" in page
    assert "2 sensors, 1 target, " in page


def test_a_run_without_latency_has_no_delays() -> None:
    run = opir.simulate(opir.scene_from_mapping(two_sensor_scene(duration_s=10.0)))
    plots = RunPlots(run)
    assert len(report_delays(plots.facts)) == 0
    assert "delays" not in report_data(run)
    assert "at the times of their looks" in plots.delays().texts[0].get_text()
