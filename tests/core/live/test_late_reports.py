"""Live runs of sensors with reporting latency: events when they are reported, also after the
scene's end.
"""

from typing import Any

import numpy as np
import pytest
from attrs import evolve
from late_scene import CONSTANT, NS, UNEVEN, late_scene
from live_scene import lines
from waiting import until

import opir_core as opir
from opir_core import compile_plan, plan_windows
from opir_core.live import LiveRun, LiveSettings, LiveWindow
from opir_core.plugin import Detections, Host


def finished(scene: opir.Scene, **settings: Any) -> tuple[LiveRun, list[LiveWindow]]:
    """Return a run that has ended, and its windows."""
    live_windows: list[LiveWindow] = []
    run = LiveRun(
        scene, Host.discover(), LiveSettings(**{"speed": None, **settings}), live_windows.append
    )
    run.start()
    until(lambda: run.status().state in ("ended", "failed"))
    return run, live_windows


@pytest.mark.slow
@pytest.mark.parametrize(
    ("tracker", "order"), [("none", "observation"), ("imm", "observation"), ("imm", "report")]
)
def test_a_live_run_ends_with_the_events_of_the_batch(tracker: str, order: str) -> None:
    scene = late_scene(
        UNEVEN,
        "paper-ground-chain",
        "none",
        tracker=tracker,
        tracking_order=order,
        outputs=["memory"],
    )
    run, live_windows = finished(scene)
    status = run.stop()
    plan = compile_plan(scene)
    assert b"".join(lines(plan, live.window) for live in live_windows) == lines(
        plan, *plan_windows(plan)
    )
    assert status.error is None
    assert [sink.delivered for sink in status.sinks] == [status.detections]
    assert status.time_ns > 70 * NS
    last_s = [sensor.last_detection_s for sensor in status.sensors]
    detections = opir.simulate(scene).detections
    assert last_s == pytest.approx(
        [detections.time_s[detections.sensor == number].max() for number in range(3)]
    )


def test_an_event_is_delivered_in_the_cycle_of_its_report() -> None:
    _, live_windows = finished(late_scene(UNEVEN, CONSTANT), cycle_ns=200_000_000)
    assert len(live_windows) >= 60
    for live in live_windows:
        reported_s = live.window.detections.reported_ns * 1e-9
        assert np.all(
            (reported_s >= live.window.start_s - 1e-9) & (reported_s < live.window.end_s + 1e-9)
        )
        assert np.all(np.diff(reported_s) >= 0.0)


@pytest.mark.slow
def test_laps_overlap_and_lose_no_report() -> None:
    short = late_scene(UNEVEN, "paper-ground-chain", duration_s=20.0)
    live_windows: list[LiveWindow] = []
    run = LiveRun(short, Host.discover(), LiveSettings(speed=None, loop=True), live_windows.append)
    run.start()
    until(lambda: run.status().lap >= 6)
    run.stop()
    reported = Detections.concatenate(live.window.detections for live in live_windows)
    assert np.all(np.diff(reported.reported_ns) >= 0)
    for lap in range(2):
        lap_scene = evolve(short, epoch_us=short.epoch_us + lap * 20_000_000, seed=short.seed + lap)
        alone = opir.simulate(lap_scene).detections
        rows = np.isin(reported.detection_id[:, 0], alone.detection_id[:, 0])
        assert np.array_equal(reported.detection_id[rows], alone.detection_id), lap
        assert np.array_equal(reported.reported_ns[rows], alone.reported_ns + lap * 20 * NS), lap
        assert alone.reported_ns.max() > 20 * NS


def test_a_looped_scene_cannot_track_in_the_order_of_report() -> None:
    scene = late_scene(UNEVEN, tracker="kepler-arc", tracking_order="report")
    with pytest.raises(
        opir.SceneError, match="tracking_order: a looped scene cannot track in the order of report"
    ):
        LiveRun(scene, Host.discover(), LiveSettings(loop=True))


@pytest.mark.slow
def test_changed_latencies_lose_no_report() -> None:
    scene = late_scene(CONSTANT, CONSTANT, tracker="kepler-arc")
    live_windows: list[LiveWindow] = []
    run = LiveRun(
        scene, Host.discover(), LiveSettings(speed=40.0, cycle_ns=5_000_000), live_windows.append
    )
    run.start()
    until(lambda: run.time_ns > 12 * NS)
    settings = run.settings_mapping()
    for sensor in settings["sensors"]:
        sensor["reporting"] = "none"
    run.configure(settings)
    until(lambda: run.status().state == "ended")
    run.stop()
    reported = Detections.concatenate(live.window.detections for live in live_windows)
    alone = opir.simulate(late_scene("none", "none")).detections
    assert sorted(reported.detection_id[:, 0].tolist()) == sorted(alone.detection_id[:, 0].tolist())
    delay_s = np.unique(np.rint((reported.reported_ns - reported.time_ns) * 1e-9 * 1e6) * 1e-6)
    assert delay_s.tolist() == [0.0, 7.25]


def test_the_order_of_tracking_needs_a_restart() -> None:
    run = LiveRun(late_scene(CONSTANT, duration_s=3000.0), Host.discover(), LiveSettings(speed=1.0))
    run.start()
    with pytest.raises(opir.OpirError, match="tracking_order: needs a restart"):
        run.configure({**run.settings_mapping(), "tracking_order": "report"})
    assert run.stop().error is None
