"""The engine: results that do not depend on slicing or on who else is there, and that follow the
closed forms.
"""

from collections.abc import Sequence
from typing import Any

import numpy as np
import pytest
from attrs import evolve, fields
from hypothesis import given, strategies as st
from opir_testing import (
    CertainDetection,
    CountingTracker,
    VerticalTargets,
    stub_plan,
    stub_scene,
    stub_sensor,
)
from repository import ROOT

from examples import examples
from opir_core import Engine, Scene, compile_plan
from opir_core.constants import SPEED_OF_LIGHT_M_S
from opir_core.errors import ModelError
from opir_core.geometry import azimuth_elevation_range, is_occluded
from opir_core.planning.sightlines import Blocked
from opir_core.plugin import Detections, Window
from opir_core.reading import load_scene
from opir_core.sensors import AlignedScan
from opir_core.simulation.run import window_edges_ns

EXAMPLES = ROOT / "examples"


def targets(count: int = 3, seed: int = 5) -> VerticalTargets:
    rng = np.random.default_rng(seed)
    ignition = rng.uniform(1.0, 20.0, count)
    return VerticalTargets(
        rng.uniform(-60, 60, count), rng.uniform(-60, 60, count), ignition, ignition + 30.0
    )


def ids(count: int) -> list[str]:
    return [f"T{number}" for number in range(count)]


def run(plan: Any, edges_ns: Sequence[int]) -> list[Window]:
    engine = Engine(plan)
    return [engine.advance(edge) for edge in edges_ns]


def all_detections(windows: list[Window]) -> Detections:
    return Detections.concatenate(window.detections for window in windows)


def assert_same(
    first_run: Detections, second_run: Detections, leave_out: Sequence[str] = ()
) -> None:
    for attribute in fields(Detections):
        if attribute.name not in leave_out:
            remaining = getattr(first_run, attribute.name)
            right = getattr(second_run, attribute.name)
            assert remaining.tobytes() == right.tobytes(), attribute.name


@examples(25)
@given(st.lists(st.integers(1, 59_999_999_999), max_size=12, unique=True), st.booleans())
def test_windows_cut_anywhere_give_the_same_bytes(cuts: list[int], is_constant: bool) -> None:
    def plan() -> Any:
        sensors = [stub_sensor("A", -20.0), stub_sensor("B", 75.0, scan=AlignedScan(70_000_000))]
        detection = CertainDetection(0.5, is_constant)
        return stub_plan(sensors, targets(), ids(3), stub_scene(duration_s=60), detection=detection)

    uncut = all_detections(run(plan(), [60_000_000_000]))
    cut = all_detections(run(plan(), [*sorted(cuts), 60_000_000_000]))
    assert len(uncut) > 100
    assert_same(uncut, cut)


@pytest.mark.slow
@pytest.mark.parametrize("cadence_s", [0.3, 1.0, 7.0])
def test_ticks_do_not_depend_on_the_windows(
    cadence_s: float,
) -> None:
    def run_in(edges: Sequence[int]) -> tuple[CountingTracker, Detections, np.ndarray]:
        tracker = CountingTracker(cadence_s)
        scene = stub_scene(duration_s=60)
        plan = stub_plan([stub_sensor()], targets(), ids(3), scene, make_tracker=lambda: tracker)
        windows = run(plan, edges)
        counted = [
            window.estimates.state[window.detections.estimate, 0]
            * (window.detections.estimate >= 0)
            for window in windows
            if len(window.estimates)
        ]
        return tracker, all_detections(windows), np.concatenate(counted)

    end = 60_000_000_000
    uncut = run_in([end])
    cut = run_in([*range(200_000_000, end, 200_000_000), end])
    assert uncut[0].ticks == cut[0].ticks
    assert sum(count for _, count in uncut[0].ticks) == len(uncut[1])
    assert_same(uncut[1], cut[1], leave_out=["estimate"])
    assert np.array_equal(uncut[2][uncut[2] > 0], cut[2][cut[2] > 0])


def test_an_estimate_is_of_the_last_tick_before_its_detection() -> None:
    plan = stub_plan(
        [stub_sensor()], targets(), ids(3), stub_scene(duration_s=60), make_tracker=CountingTracker
    )
    window = run(plan, [60_000_000_000])[0]
    followed = window.detections.estimate >= 0
    tick_s = window.estimates.tick_s[window.detections.estimate[followed]]
    age_s = window.detections.time_s[followed] - tick_s
    assert followed.any()
    assert np.all((age_s >= 0.0) & (age_s < 1.0))


def test_another_sensor_or_target_changes_no_other_event() -> None:
    group = targets(4)
    more = [stub_sensor("A", -20.0), stub_sensor("NEW", 10.0), stub_sensor("B", 75.0)]
    subset = VerticalTargets(*(getattr(group, name)[[0, 1, 3]] for name in ("latitude_deg", "longitude_deg")), *(
        getattr(group, name)[[0, 1, 3]] for name in ("ignition_s", "burnout_s")))  # fmt: skip
    scene = stub_scene(duration_s=60)
    detection = CertainDetection(0.4)
    old = run(
        stub_plan([more[0], more[2]], subset, ["T0", "T1", "T3"], scene, detection=detection),
        [60_000_000_000],
    )[0]
    new = run(stub_plan(more, group, ids(4), scene, detection=detection), [60_000_000_000])[0]
    selected = new.detections.take((new.detections.sensor != 1) & (new.truth.target != 2))
    renumbered = evolve(
        selected, sensor=np.where(selected.sensor == 2, 1, selected.sensor).astype(np.int32)
    )
    assert 0 < len(selected) < len(new.detections)
    assert_same(old.detections, renumbered)


def test_another_seed_gives_other_dice() -> None:
    def times_ns(seed: int) -> bytes:
        plan = stub_plan(
            [stub_sensor()],
            targets(),
            ids(3),
            stub_scene(seed=seed),
            detection=CertainDetection(0.5),
        )
        return run(plan, [10**11])[0].detections.time_ns.tobytes()

    assert times_ns(1) != times_ns(2)


def test_emission_precedes_the_look_by_the_light_time() -> None:
    plan = stub_plan([stub_sensor()], targets(), ids(3), stub_scene(duration_s=60))
    window = run(plan, [60_000_000_000])[0]
    travel_s = window.detections.time_s - window.truth.emission_time_s
    assert np.allclose(travel_s, window.truth.range_m / SPEED_OF_LIGHT_M_S, rtol=0, atol=5e-8)


def test_without_light_time_a_look_sees_the_target_where_it_is() -> None:
    plan = stub_plan(
        [stub_sensor()], targets(), ids(3), stub_scene(duration_s=60, light_time=False)
    )
    window = run(plan, [60_000_000_000])[0]
    assert np.array_equal(window.detections.time_s, window.truth.emission_time_s)


def test_a_launch_on_a_scan_is_first_seen_a_period_later() -> None:
    first_run = VerticalTargets(
        np.zeros(1), np.zeros(1), np.array([10.0]), np.array([310.0]), speed_m_s=10.0
    )
    for period_ms, looks in ((200, 1500), (100, 3000), (50, 6000)):
        sensor = stub_sensor(scan=AlignedScan(period_ms * 1_000_000))
        plan = stub_plan([sensor], first_run, ["T"], stub_scene(duration_s=400, light_time=False))
        window = run(plan, [400_000_000_000])[0]
        assert window.looks == looks
        assert window.detections.time_ns[0] == 10_000_000_000 + period_ms * 1_000_000
        assert window.detections.time_ns[-1] == 310_000_000_000


def test_line_of_sight_errors_are_normal_with_the_stated_sigma() -> None:
    first_run = VerticalTargets(
        np.array([40.0]), np.array([20.0]), np.zeros(1), np.array([900.0]), speed_m_s=10.0
    )
    sensor = stub_sensor(line_of_sight_sigma_rad=3e-5, scan=AlignedScan(20_000_000))
    window = run(stub_plan([sensor], first_run, ["T"], stub_scene(duration_s=1000)), [10**12])[0]
    place = first_run.position_ecef_m(window.truth.target, window.truth.emission_time_s)
    true = place - window.detections.sensor_ecef_m
    true /= np.linalg.norm(true, axis=1)[:, None]
    error = window.detections.line_of_sight_ecef - true
    squared = np.sum(error * error, axis=1) / 3e-5**2
    count = len(squared)
    # A chi-square with two degrees of freedom has mean 2 and variance 4; 3.29 standard errors are
    # 99.9 %.
    assert count > 40_000
    assert abs(squared.mean() - 2.0) < 3.29 * 2.0 / np.sqrt(count)
    # Its distribution function is 1 - exp(-x/2): a Kolmogorov-Smirnov distance at 99.9 %.
    ordered = np.sort(1.0 - np.exp(-squared / 2.0))
    distance = np.max(np.abs(ordered - (np.arange(count) + 0.5) / count))
    assert distance < 1.95 / np.sqrt(count)


def test_azimuth_and_elevation_of_the_measured_line_of_sight() -> None:
    window = run(
        stub_plan([stub_sensor()], targets(), ids(3), stub_scene(duration_s=60)), [60_000_000_000]
    )[0]
    detections = window.detections
    distant = detections.sensor_ecef_m + 4e7 * detections.line_of_sight_ecef
    angles = azimuth_elevation_range(detections.sensor_ecef_m, distant)
    assert np.allclose(detections.azimuth_rad, angles.azimuth_rad, rtol=0, atol=1e-9)
    assert np.allclose(detections.elevation_rad, angles.elevation_rad, rtol=0, atol=1e-12)


def test_a_target_behind_the_earth_is_skipped_with_its_reason() -> None:
    far_side = VerticalTargets(np.zeros(1), np.array([180.0]), np.zeros(1), np.array([60.0]))
    plan = stub_plan([stub_sensor()], far_side, ["T"], stub_scene())
    assert plan.pairs.blocked.tolist() == [Blocked.BEHIND_EARTH]
    assert run(plan, [10**11])[0].looks == 0


def test_a_target_outside_the_field_of_regard_is_skipped() -> None:
    plan = stub_plan(
        [stub_sensor(field_of_regard_half_angle_rad=0.01)], targets(1, seed=1), ["T"], stub_scene()
    )
    assert plan.pairs.blocked.tolist() == [Blocked.OUTSIDE_FIELD_OF_REGARD]


def test_a_target_below_the_minimum_elevation_is_skipped() -> None:
    first_run = VerticalTargets(np.array([60.0]), np.array([60.0]), np.zeros(1), np.array([60.0]))
    plan = stub_plan([stub_sensor(minimum_elevation_rad=1.0)], first_run, ["T"], stub_scene())
    assert plan.pairs.blocked.tolist() == [Blocked.BELOW_MINIMUM_ELEVATION]


def test_a_rising_target_is_seen_from_the_end_of_occlusion() -> None:
    # 82.5 degrees of longitude away a site is hidden; the target clears the limb as it climbs.
    first_run = VerticalTargets(
        np.zeros(1), np.array([82.5]), np.zeros(1), np.array([90.0]), speed_m_s=2000.0
    )
    sensor = stub_sensor(scan=AlignedScan(10_000_000))
    plan = stub_plan([sensor], first_run, ["T"], stub_scene(light_time=False))
    detections = run(plan, [10**11])[0].detections
    look_s = np.arange(1, 9001) * 10_000_000 * 1e-9
    place = first_run.position_ecef_m(np.zeros(9000, dtype=np.int32), look_s)
    free = ~is_occluded(
        np.broadcast_to(sensor.orbit.position_ecef_m(np.zeros(1))[0], place.shape), place
    )
    assert 0 < free.sum() < len(free)
    assert np.array_equal(detections.scan, np.flatnonzero(free) + 1)


def test_detection_counts_run_up_by_sensor_and_target() -> None:
    plan = stub_plan(
        [stub_sensor("A"), stub_sensor("B")],
        targets(),
        ids(3),
        stub_scene(),
        detection=CertainDetection(0.3),
    )
    windows = run(plan, [10_000_000_000, 20_000_000_000, 100_000_000_000])
    detections = all_detections(windows)
    target = np.concatenate([window.truth.target for window in windows])
    for sensor in range(2):
        for number in range(3):
            count = detections.detection_count[(detections.sensor == sensor) & (target == number)]
            assert count.tolist() == list(range(1, len(count) + 1))


def test_identifiers_are_unique_and_repeatable() -> None:
    def identifiers() -> np.ndarray:
        plan = stub_plan([stub_sensor("A"), stub_sensor("B")], targets(), ids(3), stub_scene())
        return run(plan, [10**11])[0].detections.detection_id

    assert len(np.unique(identifiers(), axis=0)) == len(identifiers())
    assert np.array_equal(identifiers(), identifiers())


@pytest.mark.parametrize("chance", [-0.1, 1.1, float("nan")])
def test_a_model_that_returns_no_probability_is_refused(chance: float) -> None:
    plan = stub_plan(
        [stub_sensor()], targets(), ids(3), stub_scene(), detection=CertainDetection(chance)
    )
    with pytest.raises(ModelError, match=r"in row 0; \[0, 1\] is required"):
        run(plan, [10**11])


def test_a_scene_without_targets_has_empty_windows() -> None:
    nobody = VerticalTargets(*(np.zeros(0) for _ in range(4)))
    plan = stub_plan([stub_sensor()], nobody, [], stub_scene())
    assert len(run(plan, [10**11])[0].detections) == 0


@pytest.mark.slow
def test_windows_are_sized_by_the_looks_they_hold() -> None:
    sensors = [stub_sensor(f"S{number}", scan=AlignedScan(1_000_000)) for number in range(10)]
    plan = stub_plan(sensors, targets(6), ids(6), stub_scene())
    edges = window_edges_ns(plan)
    looks = [window.looks for window in run(plan, edges)]
    assert edges[-1] == plan.end_ns
    assert sum(looks) == plan.pairs.looks.sum()
    assert max(looks) < 1.05 * (1 << 18)


def test_what_leaves_the_engine_cannot_be_written_to() -> None:
    detections = run(stub_plan([stub_sensor()], targets(), ids(3), stub_scene()), [10**11])[
        0
    ].detections
    with pytest.raises(ValueError, match="read-only"):
        detections.time_ns[0] = 1


def stages_of(scene: Scene) -> set[str]:
    return {
        getattr(stage, "__name__", type(stage).__name__)
        for stage in Engine(compile_plan(scene))._stages
    }


def test_the_engine_has_only_the_stages_that_the_scene_needs() -> None:
    constant, photons = (
        stages_of(load_scene(EXAMPLES / name)) for name in ("first_light.yaml", "photons.yaml")
    )
    assert constant - photons == {"EvaluatedProbability"}
    only_photons = {
        "InterpolatedProbability",
        "MeasureResponses",
        "DrawFalseAlarms",
        "insert_false_alarms",
    }
    assert photons - constant == only_photons
