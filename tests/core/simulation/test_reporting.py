"""Reporting latencies: their distribution, one draw per sensor and scan, and nothing where there
are none.
"""

import json
import subprocess
import sys

import numpy as np
import pytest
from attrs import evolve
from late_scene import CONSTANT, NS, UNEVEN, late_scene
from opir_photons.detection import latency_mean
from opir_testing import stub_sensor, stub_window
from scipy.stats import gamma, kstest

import opir_core as opir
from opir_core.plugin import Detections, ReportingStage
from opir_core.simulation import engine as engine_module
from opir_core.simulation.reporting import (
    LATE_CHANCE,
    ReportingDelays,
    release_lag_ns,
    stage_latency_s,
)

#: Two-sided 99.9 % of a normal distribution.
Z = 3.2905
STAGES = (
    ReportingStage("on_board", 0.5),
    ReportingStage("downlink", 2.0, 3.0),
    ReportingStage("processing", 4.0, 1.0),
)


def delays_s(
    scans: np.ndarray, *stages: ReportingStage, seed: int = 1, name: str = "S"
) -> np.ndarray:
    """Return the latencies, s, of detections of one sensor in scans (n,)."""
    delays = ReportingDelays(seed, [stub_sensor(reporting=stages)], [name])
    detections = stub_window(len(scans), scan=scans).detections
    return (delays.reported(detections).reported_ns - detections.time_ns) * 1e-9


@pytest.mark.parametrize(
    ("mean_s", "sigma_s"), [(35.0, 8.66), (2.0, 2.0), (1.0, 1.5), (10.0, 0.01)]
)
def test_a_stage_is_gamma_distributed(mean_s: float, sigma_s: float) -> None:
    """Mean, standard deviation and distribution function (scipy.stats.gamma) within 99.9 %
    intervals.
    """
    count = 40_000
    drawn = delays_s(np.arange(count), ReportingStage("downlink", mean_s, sigma_s))
    assert drawn.min() >= 0.0
    assert abs(drawn.mean() - mean_s) < Z * sigma_s / np.sqrt(count)
    # Var(s²) = σ⁴ (kurtosis excess + 2) / n, and the excess kurtosis of a gamma distribution is 6
    # (σ/mean)².
    spread = sigma_s**2 * np.sqrt((6.0 * (sigma_s / mean_s) ** 2 + 2.0) / count)
    assert abs(drawn.var() - sigma_s**2) < Z * spread
    shape = (mean_s / sigma_s) ** 2
    # Rounding to nanoseconds is far below the resolution of the test.
    assert kstest(drawn, gamma(shape, scale=sigma_s**2 / mean_s).cdf).pvalue > 0.001


def test_stages_add_up_and_a_constant_one_is_exact() -> None:
    assert np.all(
        delays_s(np.arange(5), ReportingStage("downlink", 0.125), ReportingStage("processing", 2.0))
        == 2.125
    )
    count = 40_000
    drawn = delays_s(np.arange(count), *STAGES)
    assert drawn.min() >= 0.5
    assert abs(drawn.mean() - 6.5) < Z * np.sqrt(9.0 + 1.0) / np.sqrt(count)
    # Stages are independent: the variances add up, and a stage does not change the draws of
    # another.
    fourth = sum(
        3.0 * sigma**4 * (1.0 + 2.0 * (sigma / mean) ** 2)
        for mean, sigma in ((2.0, 3.0), (4.0, 1.0))
    )
    spread = np.sqrt((fourth + 6.0 * 9.0 * 1.0 - 100.0) / count)
    assert abs(drawn.var() - 10.0) < Z * spread
    alone = delays_s(np.arange(count), STAGES[0], evolve(STAGES[1], sigma_s=0.0), STAGES[2])
    second_run = delays_s(np.arange(count), STAGES[0], STAGES[1], evolve(STAGES[2], sigma_s=0.0))
    assert np.allclose(drawn, alone - 2.0 + second_run - 4.0 - 0.5, rtol=0.0, atol=3e-9)


def test_a_scan_has_one_latency_whatever_else_is_drawn() -> None:
    complete = delays_s(np.arange(5000), *STAGES)
    scans = np.array([4999, 3, 3, 0, 2500, 3, 4000])
    assert np.array_equal(delays_s(scans, *STAGES), complete[scans])
    assert len(np.unique(complete)) == len(complete)
    for second_run in (delays_s(scans, *STAGES, seed=2), delays_s(scans, *STAGES, name="S@1")):
        assert not np.any(second_run == complete[scans])
    assert len(delays_s(np.arange(0), *STAGES)) == 0


def test_each_sensor_draws_its_own() -> None:
    sensors = [
        stub_sensor(f"S{number}", reporting=STAGES[: 3 * (number != 1)]) for number in range(3)
    ]
    delays = ReportingDelays(1, sensors, ["S0", "S1", "S2"])
    detections_read = stub_window(
        300, scan=np.arange(300) // 3, sensor=np.arange(300) % 3
    ).detections
    delay_s = (
        (delays.reported(detections_read).reported_ns - detections_read.time_ns) * 1e-9
    ).reshape(-1, 3)
    assert np.array_equal(delay_s[:, 0], delays_s(np.arange(100), *STAGES, name="S0"))
    assert np.array_equal(delay_s[:, 2], delays_s(np.arange(100), *STAGES, name="S2"))
    assert np.all(delay_s[:, 1] == 0.0)
    # Correlation of 100 independent pairs: 99.9 % within Z / √n.
    assert abs(np.corrcoef(delay_s[:, 0], delay_s[:, 2])[0, 1]) < Z / 10.0


@pytest.mark.parametrize("exceedance", [2.0**-53, 1e-3, 0.5, 1.0])
def test_the_extremes_of_a_draw_are_finite_and_not_negative(exceedance: float) -> None:
    for mean_s, sigma_s in (
        (5e-324, 5e-323),
        (1e-9, 1e-8),
        (86_400.0, 86_400.0),
        (86_400.0, 1e-300),
        (8640.0, 86_400.0),
    ):
        latency_s = stage_latency_s(ReportingStage("x", mean_s, sigma_s), np.array([exceedance]))
        assert np.all((latency_s >= 0.0) & (latency_s < 2.0**63 / NS / 2.0)), (mean_s, sigma_s)


def by_id(detections: Detections) -> dict[tuple[int, ...], int]:
    pairs = zip(
        map(tuple, detections.detection_id.tolist()), detections.reported_ns.tolist(), strict=True
    )
    return dict(pairs)


def test_reports_do_not_depend_on_windows_or_other_sensors() -> None:
    run = opir.simulate(late_scene(UNEVEN, "paper-ground-chain"))
    reports = by_id(run.detections)
    assert len(reports) > 100
    assert (
        by_id(opir.simulate(late_scene(UNEVEN, "paper-ground-chain"), window_s=0.7).detections)
        == reports
    )
    for scene in (
        late_scene(UNEVEN),
        late_scene(UNEVEN, "paper-ground-chain", targets=1),
        late_scene(UNEVEN, "none"),
    ):
        fewer = by_id(opir.simulate(scene).detections)
        first_value = {
            key: value
            for key, value in fewer.items()
            if scene.sensors[-1].id != "S1" or reports[key] == value
        }
        assert all(reports[key] == value for key, value in first_value.items())
        assert len(first_value) > 50


def test_detections_of_a_scan_share_its_latency() -> None:
    noisy = {"threshold_sigma": 4.2, "nei_w_m2": 1e-12}
    run = opir.simulate(late_scene(UNEVEN, UNEVEN, sensor=noisy, detection="snr"))
    detections_read = run.detections
    assert np.count_nonzero(run.truth.target < 0) > 20
    scans, of_row, sizes = np.unique(
        np.column_stack([detections_read.sensor, detections_read.scan]),
        axis=0,
        return_inverse=True,
        return_counts=True,
    )
    shared = sizes[of_row.ravel()] > 1
    assert np.count_nonzero(shared & (run.truth.target < 0)) > 3
    delay_ns = detections_read.reported_ns - detections_read.time_ns
    first_row = np.zeros(len(scans), dtype=np.int64)
    first_row[of_row.ravel()] = delay_ns
    assert np.array_equal(first_row[of_row.ravel()], delay_ns)
    assert len(np.unique(first_row)) == len(scans)


@pytest.mark.slow
def test_without_latency_reports_are_the_looks(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    def drawn(*_: object) -> None:
        raise AssertionError("a latency was drawn")

    monkeypatch.setattr(ReportingDelays, "reported", drawn)
    run = opir.simulate(late_scene("none", "none", tracker="imm"), window_s=7.0)
    assert len(run.detections) > 100
    assert run.detections.reported_ns is run.detections.time_ns
    assert run.tracks.available_s is run.tracks.tick_s
    window = engine_module.Engine(opir.compile_plan(late_scene("none"))).advance(60 * NS)
    assert window.detections.reported_ns is window.detections.time_ns
    group = window.detections.take(np.arange(3))
    assert group.reported_ns is group.time_ns
    with pytest.raises(AssertionError, match="was drawn"):
        opir.simulate(late_scene("none", UNEVEN))


@pytest.mark.slow
def test_a_scene_without_latency_imports_nothing_for_it() -> None:
    code = (
        "import json, sys; from late_scene import late_scene; import opir_core as opir;"
        "opir.simulate(late_scene('none')); print(json.dumps(sorted(sys.modules)))"
    )
    reported = subprocess.run(
        [sys.executable, "-c", code], capture_output=True, text=True, check=True, env=_paths()
    )
    assert "opir_core.simulation.reporting" not in json.loads(reported.stdout)


def _paths() -> dict[str, str]:
    import os

    return {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}


def test_mean_latency_from_ignition_to_report() -> None:
    """With random scans of period T the first detection is T (1/P - 1/2) after ignition on average,
    and its report the sum of the means later. Reports do not overtake each other: T is far above
    the spread of the latencies."""
    period_s = 20.0
    probability = 0.6
    count = 400
    stages = {
        "on_board": {"mean_s": 1.0},
        "downlink": {"mean_s": 2.0, "sigma_s": 0.5},
        "processing": {"mean_s": 4.0},
    }
    sensor = {"scan_period_ms": 1e3 * period_s, "detection_probability": {"ICBM": probability}}
    scene = late_scene(*[stages] * 1, targets=1, sensor=sensor, duration_s=230, light_time=False)
    crowd = evolve(
        scene, sensors=tuple(evolve(scene.sensors[0], id=f"S{number}") for number in range(count))
    )
    run = opir.simulate(crowd)
    first_ns = np.full(count, np.iinfo(np.int64).max)
    np.minimum.at(first_ns, run.detections.sensor, run.detections.reported_ns)
    visible = first_ns < np.iinfo(np.int64).max
    # 11 looks in the burn: a sensor sees nothing with a chance of 0.4^11 = 4e-5.
    assert np.count_nonzero(visible) >= count - 1
    latency_s = first_ns[visible] * 1e-9 - 3.1
    closed_s = float(latency_mean(period_s, probability, "random")) + 1.0 + 2.0 + 4.0
    variance = period_s**2 * ((1.0 - probability) / probability**2 + 1.0 / 12.0) + 0.5**2
    assert abs(latency_s.mean() - closed_s) < Z * np.sqrt(variance / count)


def test_the_summary_has_the_first_report_of_each_target() -> None:
    run = opir.simulate(late_scene(UNEVEN, CONSTANT))
    assert [row["reporting_mean_s"] for row in run.summary["sensors"]] == [5.5, 7.25]
    for number, row in enumerate(run.summary["targets"]):
        own_rows = run.truth.target == number
        assert row["latency_s"] == pytest.approx(
            run.detections.time_ns[own_rows].min() * 1e-9 - row["ignition_s"]
        )
        assert row["end_to_end_latency_s"] == pytest.approx(
            run.detections.reported_ns[own_rows].min() * 1e-9 - row["ignition_s"]
        )
        first_row = run.detections.take(own_rows).take(
            np.argmin(run.detections.time_ns[own_rows], keepdims=True)
        )
        assert row["first_sensor_id"] == run.sensors[int(first_row.sensor[0])].id
        assert row["last_detection_s"] == pytest.approx(
            run.detections.time_ns[own_rows].max() * 1e-9
        )
    prompt = opir.simulate(late_scene("none")).summary["targets"]
    assert all(row["end_to_end_latency_s"] == row["latency_s"] for row in prompt)
    unseen = opir.simulate(
        late_scene(UNEVEN, sensor={"detection_probability": {"ICBM": 0.0}})
    ).summary["targets"]
    assert all(row["end_to_end_latency_s"] is None for row in unseen)


def test_the_lag_holds_nearly_all_reports_of_the_slowest_sensor() -> None:
    sensors = [stub_sensor(), stub_sensor(reporting=STAGES[:1]), stub_sensor(reporting=STAGES)]
    lag_s = release_lag_ns(sensors) * 1e-9
    drawn = delays_s(np.arange(40_000), *STAGES)
    # By the union bound at most two in a thousand: 99.9 % of a binomial count.
    maximum = 2.0 * LATE_CHANCE
    assert (drawn > lag_s).mean() < maximum + Z * np.sqrt(maximum / len(drawn))
    expected = (
        0.5
        + gamma(4.0 / 9.0, scale=4.5).isf(LATE_CHANCE)
        + gamma(16.0, scale=0.25).isf(LATE_CHANCE)
    )
    assert lag_s == pytest.approx(expected, rel=1e-9)
    assert release_lag_ns([stub_sensor()]) == 0
