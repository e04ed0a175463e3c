"""Drafts of a running scene: launches and settings let in between two windows change nobody else's
events.
"""

from typing import Any

import numpy as np
import pytest
from live_scene import DIRECTED, IN_MODES, LATER, NS, batch, lines, mapping

from opir_core import Engine, Scene, compile_plan
from opir_core.errors import SceneError
from opir_core.live import RestartError, SensorTask
from opir_core.live.changes import launch_change, settings_change, without_finished_targets
from opir_core.plugin import Host
from opir_core.reading import scene_from_mapping, scene_mapping


@pytest.fixture(scope="module")
def host() -> Host:
    return Host.discover()


@pytest.fixture(scope="module")
def scene(host: Host) -> Scene:
    return scene_from_mapping(mapping(), host=host)


@pytest.mark.parametrize("settings", [{}, DIRECTED, IN_MODES])
@pytest.mark.parametrize("admitted_s", [0.05, 3.2, 29.999, 31.7])
def test_a_launch_between_windows_gives_the_events_of_a_batch(
    host: Host, admitted_s: float, settings: dict[str, Any]
) -> None:
    plan = compile_plan(scene_from_mapping(mapping(**settings), host=host), host)
    engine = Engine(plan)
    earlier_window = engine.advance(round(admitted_s * NS))
    change = launch_change(plan, LATER, engine.time_ns, 0)
    change.engine.take_over(engine)
    live = lines(
        plan, earlier_window, change.engine.advance(47 * NS), change.engine.advance(100 * NS)
    )
    scene_with_launch = scene_from_mapping(
        mapping(**settings, targets=[*mapping()["targets"], LATER]), host=host
    )
    assert live == batch(scene_with_launch, host)
    assert change.not_after_ns == 31_700_000_000


def test_a_sensor_whose_mode_is_taken_away_goes_on_with_its_own_settings(host: Host) -> None:
    settings = {**IN_MODES, "director": DIRECTED["director"]}
    plan = compile_plan(scene_from_mapping(mapping(**settings), host=host), host)
    engine = Engine(plan)
    engine.advance(1 * NS)
    record = engine.task(SensorTask(sensor="NARROW", mode="sector"))
    assert record is not None
    assert not record.refusal
    engine.advance(10 * NS)
    changed = mapping(**{**settings, "sensors": DIRECTED["sensors"]})
    change = settings_change(plan, {**scene_mapping(plan.scene), **changed}, 0, plan.scene)
    change.engine.take_over(engine)
    narrow = len(plan.sensors) - 1
    assert np.count_nonzero(change.engine.advance(30 * NS).detections.sensor == narrow) > 10


def test_a_mode_that_scans_at_another_rate_numbers_its_detections_anew(host: Host) -> None:
    plan = compile_plan(scene_from_mapping(mapping(**IN_MODES), host=host), host)
    engine = Engine(plan)
    engine.advance(1 * NS)
    engine.task(SensorTask(sensor="NARROW", mode="sector"))
    earlier = engine.advance(30 * NS).detections
    (*_, narrow) = IN_MODES["sensors"]
    modes = {"sector": {**narrow["modes"]["sector"], "scan_period_ms": 1400.0}}
    sensors = [*IN_MODES["sensors"][:-1], {**narrow, "modes": modes}]
    changed = mapping(**{**IN_MODES, "sensors": sensors})
    change = settings_change(plan, {**scene_mapping(plan.scene), **changed}, 0, plan.scene)
    change.engine.take_over(engine)
    ids = np.concatenate(
        [earlier.detection_id, change.engine.advance(90 * NS).detections.detection_id]
    )
    assert len(np.unique(ids, axis=0)) == len(ids)


def test_finished_targets_are_removed_without_other_changes(scene: Scene, host: Host) -> None:
    plan = compile_plan(scene, host)
    engine = Engine(plan)
    earlier_window = engine.advance(30 * NS)
    trimmed = without_finished_targets(plan, 30 * NS)
    assert trimmed.targets.ids == ("T1",)
    assert len(trimmed.pairs) == len(plan.sensors)
    assert len(trimmed.sightlines.travel_s) < len(plan.sightlines.travel_s)
    trimmed_engine = Engine(trimmed)
    trimmed_engine.take_over(engine)
    assert lines(plan, earlier_window, trimmed_engine.advance(100 * NS)) == batch(scene, host)


@pytest.mark.parametrize(("name", "stays"), [("none", True), ("paper", False)])
def test_a_classifier_without_truth_stays_when_targets_are_added(
    host: Host, name: str, stays: bool
) -> None:
    plan = compile_plan(scene_from_mapping({**mapping(), "classification": name}, host=host), host)
    assert (launch_change(plan, LATER, 0, 0).engine.plan.classifier is plan.classifier) == stays


@pytest.mark.slow
def test_a_plan_that_many_launches_pass_through_stays_small(scene: Scene, host: Host) -> None:
    engine = Engine(compile_plan(scene, host))
    sizes = []
    for number in range(16):
        launched = {
            **LATER,
            "id": f"N{number}",
            "burn_time_s": 10.0,
            "launch": {**LATER["launch"], "time_s": 2.0 * number},
        }
        change = launch_change(engine.plan, launched, engine.time_ns, 0)
        change.engine.take_over(engine)
        engine = change.engine
        engine.advance(2 * (number + 1) * NS)
        sizes.append(
            (
                len(engine.plan.pairs),
                len(engine.plan.sightlines.travel_s),
                len(engine.plan.targets.trajectories),
            )
        )
    assert np.max(sizes[8:], axis=0).tolist() <= np.max(sizes[:8], axis=0).tolist()


def test_another_scan_rate_disturbs_nobody_and_repeats_no_id(scene: Scene, host: Host) -> None:
    plan = compile_plan(scene, host)
    engine = Engine(plan)
    windows = [engine.advance(40 * NS)]
    for period_ms in (400.0, 200.0, 100.0):
        settings = without_targets(engine.plan.scene)
        settings["sensors"][0]["members"][0]["scan_period_ms"] = period_ms
        change = settings_change(engine.plan, settings, 0, scene)
        change.engine.take_over(engine)
        engine = change.engine
        windows.append(engine.advance(engine.time_ns + 15 * NS))
    live = lines(plan, *windows).splitlines()
    undisturbed = [line for line in live if b'"DSP-1"' not in line]
    assert undisturbed == [
        line for line in batch(scene, host, 85 * NS).splitlines() if b'"DSP-1"' not in line
    ]
    ids = [line.split(b'"')[3] for line in live]
    assert len(set(ids)) == len(ids)
    scans = [
        len([line for line in lines(plan, window).splitlines() if b'"DSP-1"' in line])
        for window in windows[1:]
    ]
    assert scans[0] < scans[1] < scans[2]


@pytest.mark.slow
@pytest.mark.parametrize("tracker", ["imm", "kepler-arc"])
def test_a_tracker_gets_the_new_rate_of_sensors(host: Host, tracker: str) -> None:
    """Half a second between looks, then ten: what is not seen meanwhile burns on, and the track
    goes on.
    """
    scanner = {"model": "generic-scanner", "scan_period_ms": 500.0}
    slots = {"A": -135.0, "B": -90.0}
    sensors = [
        {**scanner, "id": name, "orbital_slot_deg": slot_deg} for name, slot_deg in slots.items()
    ]
    target = mapping()["targets"][0]
    scene = scene_from_mapping(
        mapping(duration_s=110, sensors=sensors, targets=[target], tracker=tracker), host=host
    )
    plan = compile_plan(scene, host)
    engine = Engine(plan)
    engine.advance(60 * NS)
    settings = without_targets(scene)
    for sensor in settings["sensors"]:
        sensor["scan_period_ms"] = 10_000.0
    changed_engine = settings_change(plan, settings, 0, scene).engine
    changed_engine.take_over(engine)
    tracks = changed_engine.advance(110 * NS).tracks
    assert len(np.unique(tracks.track)) == 1
    assert len(tracks) == 50
    if tracker == "kepler-arc":
        return
    assert np.all(tracks.probability_burning > 0.5), tracks.probability_burning.min()
    error_m = tracks.state[:, :3] - plan.targets.position_ecef_m(
        np.zeros(50, dtype=np.int32), tracks.tick_s
    )
    nees = (
        np.sum(
            error_m
            * np.linalg.solve(tracks.state_covariance[:, :3, :3], error_m[:, :, None])[:, :, 0],
            axis=1,
        )
        / 3.0
    )
    assert np.median(nees) < 3.0


def without_targets(scene: Scene) -> dict[str, Any]:
    return {
        key: value
        for key, value in scene_mapping(scene).items()
        if key not in ("targets", "sources")
    }


def test_settings_that_need_a_restart_are_refused_all_at_once(scene: Scene, host: Host) -> None:
    settings = without_targets(scene) | {
        "seed": 4,
        "epoch": "2026-04-01T13:00:00Z",
        "outputs": ["null"],
    }
    settings["sensors"][0]["members"][0]["orbital_slot_deg"] = 7.0
    with pytest.raises(RestartError) as refused:
        settings_change(compile_plan(scene, host), settings, 0, scene)
    reported = {problem.path: problem.message for problem in refused.value.problems}
    assert set(reported) == {"seed", "epoch", "outputs", "sensors[0].orbital_slot_deg"}
    assert all(message.startswith("needs a restart") for message in reported.values())


def test_settings_are_read_as_a_scene_is(scene: Scene, host: Host) -> None:
    settings = without_targets(scene) | {
        "confidence": {"model": "weighted", "band": 0.9, "count": 0.3, "geometry": 0.3}
    }
    settings["sensors"][0]["members"][0]["detection_probability"] = {"ICBM": 1.5}
    with pytest.raises(SceneError) as refused:
        settings_change(compile_plan(scene, host), settings, 0, scene)
    assert [problem.path for problem in refused.value.problems] == [
        "sensors[0].members[0].detection_probability",
        "confidence",
    ]
