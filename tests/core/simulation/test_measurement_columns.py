"""What detections carry of their measurement: their own line-of-sight sigma, irradiances, the
sensor's bias.
"""

import json
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from attrs import evolve, frozen
from json_lines import json_lines
from opir_testing import (
    CertainDetection,
    VerticalTargets,
    stub_plan,
    stub_scene,
    stub_sensor,
    stub_window,
)
from repository import TEST_SCENES

import opir_core as opir
from opir_core import Engine, plan_windows
from opir_core.errors import ModelError
from opir_core.geometry import local_axes
from opir_core.output import ForgeEncoder, TruthFile
from opir_core.planning.sensor_states import PointingBias
from opir_core.plugin import (
    Band,
    Detections,
    EncoderContext,
    Exposures,
    Measured,
    RandomDraws,
    Window,
)
from opir_core.simulation.summary import Tally

BANDS = (Band("SWIR", 2.5, 3.0), Band("MWIR", 4.0, 5.0))
EXAMPLE = TEST_SCENES / "pacific_test_range.yaml"


@frozen
class Radiometer(CertainDetection):
    """Measures a sigma that grows with the scan, and irradiances in `bands` columns."""

    bands: int = 2

    def measure(self, exposures: Exposures, rng: RandomDraws) -> Measured:
        rows = len(exposures)
        sigma_rad = 1e-6 * (1.0 + exposures.scan)
        return Measured(
            np.ones(rows, np.uint8), np.ones(rows), sigma_rad, np.full((rows, self.bands), 1e-9)
        )


def one_target(speed_m_s: float = 10.0) -> VerticalTargets:
    return VerticalTargets(
        np.array([40.0]), np.array([20.0]), np.array([1.0]), np.array([900.0]), speed_m_s=speed_m_s
    )


def windows_of(plan: Any, *edges_s: float) -> list[Window]:
    engine = Engine(plan)
    return [engine.advance(round(edge * 1e9)) for edge in edges_s]


def test_a_model_without_irradiance_costs_no_column() -> None:
    window = windows_of(stub_plan([stub_sensor()], one_target(), ["T"], stub_scene()), 100.0)[0]
    assert window.detections.band_irradiance_w_m2.shape == (len(window.detections), 0)
    assert np.all(window.detections.line_of_sight_sigma_rad == 2e-5)


def test_measured_columns_with_windows_without_rows() -> None:
    sensors = [stub_sensor("A", bands=BANDS), stub_sensor("B")]
    plan = stub_plan(sensors, one_target(), ["T"], stub_scene(), detection=Radiometer())
    pieces = [window.detections for window in windows_of(plan, 0.5, 50.0, 100.0)]
    assert len(pieces[0]) == 0
    detections = Detections.concatenate(pieces)
    assert detections.band_irradiance_w_m2.shape == (len(detections), 2)
    assert np.array_equal(detections.line_of_sight_sigma_rad, 1e-6 * (1.0 + detections.scan))


def test_irradiances_of_another_width_are_refused() -> None:
    plan = stub_plan(
        [stub_sensor(bands=BANDS)], one_target(), ["T"], stub_scene(), detection=Radiometer(bands=3)
    )
    with pytest.raises(
        ModelError, match=r"irradiance_w_m2 returned float64 \(\d+, 3\); floats of shape \(\d+, 2\)"
    ):
        windows_of(plan, 100.0)


def test_the_spread_of_lines_of_sight_is_each_ones_own() -> None:
    plan = stub_plan(
        [stub_sensor()],
        one_target(),
        ["T"],
        stub_scene(duration_s=900),
        detection=Radiometer(bands=1),
    )
    window = windows_of(plan, 900.0)[0]
    detections = window.detections
    true = (
        one_target().position_ecef_m(window.truth.target, window.truth.emission_time_s)
        - detections.sensor_ecef_m
    )
    true /= np.linalg.norm(true, axis=1)[:, None]
    squared = np.sum(
        ((detections.line_of_sight_ecef - true) / detections.line_of_sight_sigma_rad[:, None]) ** 2,
        axis=1,
    )
    # A chi-square with two degrees of freedom has mean 2 and variance 4; 3.29 standard errors are
    # 99.9 %.
    assert len(detections) > 8000
    assert abs(squared.mean() - 2.0) < 3.29 * 2.0 / np.sqrt(len(detections))


def test_events_carry_the_line_of_sight_sigma() -> None:
    sensors = (stub_sensor(line_of_sight_sigma_rad=1.2345678e-5), stub_sensor("B"))
    encoder = ForgeEncoder(EncoderContext(sensors=sensors, epoch_us=0))
    own_rows = encoder.encode(stub_window(2, line_of_sight_sigma_rad=1.2345678e-5)).splitlines()
    mixed = encoder.encode(
        stub_window(2, line_of_sight_sigma_rad=[1.2345678e-5, 7.5e-6])
    ).splitlines()
    assert mixed[0] == own_rows[0]
    assert json.loads(mixed[1])["line_of_sight_sigma_urad"] == 7.5


@pytest.mark.parametrize("sigma_rad", [-1e-6, np.nan, np.inf])
def test_a_sigma_that_is_none_is_refused(sigma_rad: float) -> None:
    encoder = ForgeEncoder(EncoderContext(sensors=(stub_sensor(),), epoch_us=0))
    with pytest.raises(ModelError, match="standard deviation"):
        encoder.encode(stub_window(1, line_of_sight_sigma_rad=sigma_rad))


def test_a_bias_moves_the_line_to_nadir_east_and_north() -> None:
    sensor_m = stub_sensor(slot_deg=30.0).orbit.position_ecef_m(np.zeros(1))
    axes = local_axes(sensor_m)[0]
    down = -axes[2]
    bias = PointingBias(np.array([3e-5]), np.array([-2e-5]))
    moved = bias.applied(*(down[axis : axis + 1] for axis in range(3)), *_at(sensor_m))
    shift = np.array([component[0] for component in moved]) - down
    assert axes @ shift == pytest.approx([3e-5, -2e-5, 0.0], abs=1e-9)


def _at(sensor_m: Any) -> tuple[Any, Any]:
    return np.zeros(1, np.int32), sensor_m


@pytest.mark.slow
def test_the_bias_is_one_draw_per_sensor_and_run() -> None:
    sensors = [
        stub_sensor(f"S{number}", line_of_sight_bias_sigma_rad=2e-5) for number in range(4000)
    ]
    drawn = PointingBias.drawn(7, sensors)
    assert PointingBias.drawn(7, sensors[1:]).east_rad[0] == drawn.east_rad[1]
    assert PointingBias.drawn(8, sensors).east_rad[0] != drawn.east_rad[0]
    squared = (drawn.east_rad**2 + drawn.north_rad**2) / 2e-5**2
    assert abs(squared.mean() - 2.0) < 3.29 * 2.0 / np.sqrt(len(sensors))


def test_a_biased_sensor_errs_by_its_bias_and_disturbs_no_draw() -> None:
    def lines(bias_rad: float) -> tuple[Any, Detections]:
        sensor = stub_sensor(line_of_sight_bias_sigma_rad=bias_rad)
        plan = stub_plan([sensor], one_target(), ["T"], stub_scene(duration_s=60))
        return plan, windows_of(plan, 60.0)[0].detections

    (_, plain), (plan, biased) = lines(0.0), lines(1e-4)
    assert np.array_equal(plain.scan, biased.scan)
    shift = biased.line_of_sight_ecef - plain.line_of_sight_ecef
    assert plan.bias is not None
    size = np.hypot(plan.bias.east_rad[0], plan.bias.north_rad[0])
    # The directions across the line of sight turn with it, by the bias: errors of up to 5 sigma
    # turn along.
    assert np.ptp(shift, axis=0).max() < 2.0 * size * 5.0 * 2e-5
    assert 0.98 * size < np.linalg.norm(shift[0]) <= size * (1 + 1e-6)


def test_truth_and_manifest_tell_the_bias(tmp_path: Path) -> None:
    mapping = opir.load_scene(EXAMPLE)
    plan = opir.compile_plan(mapping)
    sensors = [evolve(sensor, line_of_sight_bias_sigma_rad=1e-5) for sensor in plan.sensors]
    plan = evolve(plan, sensors=tuple(sensors), bias=PointingBias.drawn(plan.scene.seed, sensors))
    with TruthFile(tmp_path / "truth.jsonl", plan):
        pass
    reported = json_lines(tmp_path / "truth.jsonl")
    east = {
        row["sensor_id"]: row["line_of_sight_bias_east_rad"]
        for row in reported
        if row["record"] == "sensor"
    }
    assert list(east.values()) == plan.bias.east_rad.tolist()
    from opir_core.simulation.manifest import run_manifest

    manifest = run_manifest(plan, {})["sensors"]
    assert {row["sensor_id"]: row["line_of_sight_bias_east_rad"] for row in manifest} == east


@pytest.mark.slow
def test_noise_is_counted_apart_and_is_nobody_in_the_truth(tmp_path: Path) -> None:
    plan = opir.compile_plan(opir.load_scene(EXAMPLE, overrides=["duration_s=80"]))
    window = next(iter(plan_windows(plan)))
    target = window.truth.target.copy()
    target[::3] = -1
    noisy = evolve(window, truth=evolve(window.truth, target=target))
    tally = Tally(plan)
    tally.count(noisy)
    reported = tally.summary()
    assert reported["counts"]["detections"] == len(window.detections)
    assert reported["counts"]["noise_detections"] == int((target < 0).sum())
    assert sum(row["detections"] for row in reported["targets"]) == int((target >= 0).sum())
    with TruthFile(tmp_path / "truth.jsonl", plan) as truth:
        truth.write(noisy)
    rows = json_lines(tmp_path / "truth.jsonl")
    named = [row["target_id"] for row in rows if row["record"] == "detection"]
    assert [name is None for name in named] == (target < 0).tolist()
