"""The live form of the engine in its thread: the same events as in a batch, whatever comes while it
runs.
"""

import gc
import threading
import time
from concurrent.futures import ThreadPoolExecutor
from typing import Any

import numpy as np
import pytest
from attrs import evolve
from live_scene import DIRECTED, LATER, NS, batch, lines, mapping
from opir_testing import stub_estimates, stub_window
from waiting import until

from opir_core import Engine, Plan, Scene, compile_plan
from opir_core.errors import SceneError
from opir_core.live import BusyError, LiveRun, LiveSettings, RefusedError, SensorTask, running
from opir_core.live.changes import Change, ChangeQueue, PastError, launch_change
from opir_core.plugin import Host, Tracks
from opir_core.reading import scene_from_mapping
from opir_core.simulation.shifting import shifted


@pytest.fixture(scope="module")
def host() -> Host:
    return Host.discover()


@pytest.fixture(scope="module")
def scene(host: Host) -> Scene:
    return scene_from_mapping(mapping(), host=host)


class Kept:
    """What a run tells its listener, and a way to wait for it."""

    def __init__(self) -> None:
        self.windows: list[Any] = []

    def __call__(self, window: Any) -> None:
        self.windows.append(window)


def test_a_live_run_ends_with_the_events_of_the_batch(scene: Scene, host: Host) -> None:
    viewer = Kept()
    run = LiveRun(scene, host, LiveSettings(speed=None), viewer)
    run.start()
    until(lambda: run.status().state == "ended")
    status = run.stop()
    assert b"".join(lines(run.plan, live.window) for live in viewer.windows) == batch(scene, host)
    assert [(sink.state, sink.delivered, sink.dropped) for sink in status.sinks] == [
        ("closed", status.detections, 0)
    ]
    with pytest.raises(RefusedError, match="start it again"):
        run.launch(LATER)


def test_a_directed_live_run_ends_with_the_events_of_the_batch(host: Host) -> None:
    directed = scene_from_mapping(mapping(**DIRECTED), host=host)
    viewer = Kept()
    run = LiveRun(directed, host, LiveSettings(speed=None), viewer)
    run.start()
    until(lambda: run.status().state == "ended")
    run.stop()
    live = b"".join(lines(run.plan, live.window) for live in viewer.windows)
    assert live == batch(directed, host)
    assert b'"sensor_id":"NARROW"' in live
    commands = [record for live in viewer.windows for record in live.window.commands]
    assert [record.time_s for record in commands] == [0.0, 30.0, 60.0, 90.0]


def test_each_lap_has_the_next_epoch_and_seed(host: Host) -> None:
    short = scene_from_mapping(mapping(duration_s=30), host=host)
    viewer = Kept()
    run = LiveRun(short, host, LiveSettings(speed=None, loop=True), viewer)
    run.start()
    until(lambda: run.status().lap >= 3)
    run.stop()
    plan = compile_plan(short, host)
    for lap in range(3):
        lap_scene = evolve(short, epoch_us=short.epoch_us + lap * 30_000_000, seed=short.seed + lap)
        live = b"".join(
            lines(plan, reported.window) for reported in viewer.windows if reported.lap == lap
        )
        assert live == batch(lap_scene, host, 30 * NS), lap


@pytest.mark.slow
def test_all_times_of_a_laps_tracks_are_moved_on(host: Host) -> None:
    short = scene_from_mapping(mapping(duration_s=35, tracker="kepler-arc"), host=host)
    viewer = Kept()
    run = LiveRun(short, host, LiveSettings(speed=None, loop=True), viewer)
    run.start()
    until(lambda: run.status().lap >= 2)
    run.stop()
    reported = Tracks.concatenate([live.window.tracks for live in viewer.windows if live.lap == 1])
    second_lap = evolve(short, epoch_us=short.epoch_us + 35_000_000, seed=short.seed + 1)
    alone = Engine(compile_plan(second_lap, host)).advance(35 * NS).tracks
    assert len(alone) > 10
    times = [(reported.tick_s, alone.tick_s)] + [
        (getattr(reported, name)[:, -1], getattr(alone, name)[:, -1])
        for name in ("launch", "impact")
    ]
    for actual, expected in times:
        assert np.isfinite(expected).any()
        assert np.allclose(actual, expected + 35.0, rtol=0.0, atol=1e-9, equal_nan=True)


def test_burnouts_are_moved_on() -> None:
    window = evolve(stub_window(1), tracks=stub_estimates(1, burnout=np.arange(7.0)))
    assert shifted(window, 35 * NS).tracks.burnout.tolist() == [[0, 1, 2, 3, 4, 5, 41]]


@pytest.mark.slow
def test_a_run_takes_launches_and_settings_while_it_runs(scene: Scene, host: Host) -> None:
    viewer = Kept()
    run = LiveRun(scene, host, LiveSettings(speed=5.0, cycle_ns=10_000_000), viewer)
    run.start()
    block = {key: value for key, value in LATER.items() if key != "id"}
    launch = {key: value for key, value in LATER["launch"].items() if key != "time_s"}
    launched = run.launch(block | {"launch": launch})
    settings = run.settings_mapping() | {"confidence": "always"}
    cycle = run.configure(settings)
    until(lambda: run.time_ns > (launched.time_s + 2.0) * NS)
    with pytest.raises(PastError, match="scene time is"):
        run.launch(LATER | {"launch": LATER["launch"] | {"time_s": 0.1}})
    with pytest.raises(SceneError, match=r"targets\[0\].launch.lat_deg: 95"):
        run.launch(LATER | {"launch": LATER["launch"] | {"lat_deg": 95.0}})
    run.launch(LATER | {"launch": LATER["launch"] | {"time_s": 80.0}})
    run.settings = evolve(run.settings, maximum_targets=1)
    with pytest.raises(BusyError, match="1 targets"):
        run.launch(LATER | {"id": "MORE", "launch": LATER["launch"] | {"time_s": 80.0}})
    run.stop()
    confident = [
        live.window.detections.confidence for live in viewer.windows if live.cycle >= cycle
    ]
    assert all((piece == 1.0).all() for piece in confident)
    assert launched.target_id in run.plan.targets.ids
    assert run.settings_mapping()["confidence"] == {"model": "always"}


UNTIMED = {
    "type": "SRBM",
    "launch": {"lat_deg": 22.0, "lon_deg": -160.0},
    "aim": {"lat_deg": 24.0, "lon_deg": -158.0},
}


@pytest.mark.slow
def test_a_late_launch_goes_up_in_the_next_lap(host: Host) -> None:
    scene = scene_from_mapping(mapping(duration_s=20, targets=[], outputs=["null"]), host=host)
    run = LiveRun(scene, host, LiveSettings(speed=5.0, loop=True))
    run.start()
    asked_s = list[float]()
    times = list[float]()
    while len(times) < 20 or times[-1] < 20.0:
        asked_s.append(run.time_ns / NS)
        times.append(run.launch(UNTIMED).time_s)
    status = run.stop()
    # Not in order within a lap: one that a busy machine was slow to plan goes up later than the
    # next, at once planned.
    assert all(time_s > before_s for time_s, before_s in zip(times, asked_s, strict=True))
    laps = [time_s // 20.0 for time_s in times]
    assert laps == sorted(laps)
    assert status.lap >= laps[-1]
    assert status.targets_launched == len(times)


@pytest.mark.slow
def test_a_launch_goes_up_once_it_is_planned(host: Host, monkeypatch: pytest.MonkeyPatch) -> None:
    def slowly(plan: Plan, block: Any, time_ns: int, lap: int) -> Change:
        time.sleep(0.4)
        return launch_change(plan, block, time_ns, lap)

    monkeypatch.setattr(running, "launch_change", slowly)
    scene = scene_from_mapping(mapping(duration_s=600, targets=[], outputs=["null"]), host=host)
    run = LiveRun(scene, host, LiveSettings(speed=20.0, cycle_ns=1_000_000))
    run.start()
    before_s = run.time_ns / NS
    launched = run.launch(UNTIMED)
    run.stop()
    # Planning takes 8 s of scene time at the least.
    assert launched.time_s - before_s > 8.0
    assert launched.target_id in run.plan.targets.ids


def test_a_launch_after_the_end_of_the_scene_is_refused(host: Host) -> None:
    scene = scene_from_mapping(mapping(duration_s=0.2, targets=[], outputs=["null"]), host=host)
    run = LiveRun(scene, host, LiveSettings(speed=0.1, cycle_ns=1_000_000_000))
    run.start()
    with pytest.raises(RefusedError, match="--loop"):
        run.launch(UNTIMED)
    run.stop()


def test_refused_launches_are_not_counted(scene: Scene, host: Host) -> None:
    run = LiveRun(scene, host, LiveSettings(speed=5.0, cycle_ns=10_000_000))
    run.start()
    launched = run.status().targets_launched
    for launch in ({"lat_deg": 95.0}, {"time_s": -1.0}):
        with pytest.raises((SceneError, PastError)):
            run.launch(UNTIMED | {"launch": UNTIMED["launch"] | launch})
    assert run.status().targets_launched == launched == 2
    delayed = UNTIMED | {"launch": UNTIMED["launch"] | {"time_s": 80.0}}
    names = {run.launch(delayed).target_id for _ in range(2)}
    assert len(names) == 2
    assert run.status().targets_launched == 4
    run.stop()


#: Ten places that burn; a launch is none of them.
FIRES = {
    "id": "fires",
    "model": "fires",
    "at": [{"lat_deg": 35.0 + row, "lon_deg": -115.0} for row in range(10)],
}


def test_hot_sources_are_no_launches(host: Host) -> None:
    lit = {"duration_s": 6, "sources": [FIRES], "detection": "snr", "classification": "none"}
    run = LiveRun(
        scene_from_mapping(mapping(**lit), host=host), host, LiveSettings(speed=None, loop=True)
    )
    assert run.status().targets == 2
    run.start()
    until(lambda: run.status().lap >= 2)
    status = run.stop()
    assert status.targets_launched == 2 * (status.lap + 1)


def test_a_stop_does_not_wait_for_a_task_that_does_not_return() -> None:
    stopping = threading.Event()
    changes = ChangeQueue(stopping)
    with ThreadPoolExecutor() as pool:
        answer = pool.submit(changes.apply, SensorTask(sensor="S"), time.monotonic() + 0.5)
        until(lambda: list(changes.pending()))  # the run's thread has begun it
        stopping.set()
        with pytest.raises(RefusedError, match="being stopped"):
            answer.result(10.0)


def test_the_tracker_of_a_lap_that_is_over_needs_no_collection(host: Host) -> None:
    """Collections are rare in a service, and a tracker's arrays are large."""

    def models() -> int:
        return sum(type(each).__name__ == "TrackingModels" for each in gc.get_objects())

    scene = scene_from_mapping(mapping(duration_s=8, tracker="imm"), host=host)
    gc.collect()
    gc.disable()
    try:
        before = models()
        run = LiveRun(scene, host, LiveSettings(speed=None, loop=True))
        run.start()
        until(lambda: run.status().lap >= 6)
        run.stop()
        # Of the lap and the next one, perhaps also of the one whose end was under way.
        assert models() - before <= 3
    finally:
        gc.enable()
