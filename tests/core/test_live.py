"""The live form of the engine: the same events as in a batch, whatever comes while it runs."""

import time
from typing import Any

import numpy as np
import pytest
from attrs import evolve
from waiting import until

from opir_core.engine import Engine
from opir_core.errors import SceneError
from opir_core.events.forge import ForgeEncoder
from opir_core.live import running
from opir_core.live.drafting import Draft, RestartError, drafted_launch, drafted_settings
from opir_core.live.growth import without_those_over
from opir_core.live.running import LiveRun, LiveSettings
from opir_core.live.turns import BusyError, PastError, RefusedError
from opir_core.plan import Plan, compile_plan
from opir_core.plugin.host import Host
from opir_core.protocols import EncoderContext
from opir_core.reading import scene_from_mapping, scene_mapping
from opir_core.records import Tracks, Window
from opir_core.scene import Scene

NS = 1_000_000_000
LATER = {
    "id": "LATER",
    "type": "IRBM",
    "launch": {"lat_deg": 22.0, "lon_deg": -160.0, "time_s": 31.7},
    "aim": {"lat_deg": 9.0, "lon_deg": 167.7},
}


@pytest.fixture(scope="module")
def host() -> Host:
    return Host.discover()


def mapping(**changes: Any) -> dict[str, Any]:
    scene: dict[str, Any] = {
        "scene": "live",
        "epoch": "2026-04-01T12:00:00Z",
        "duration_s": 100,
        "seed": 3,
        "sensors": [{"constellation": "DSP"}, {"constellation": "SBIRS-GEO"}],
        "targets": [
            {
                "id": "T1",
                "type": "ICBM",
                "launch": {"lat_deg": 34.73, "lon_deg": -120.57, "time_s": 3.0},
                "aim": {"lat_deg": 9.0, "lon_deg": 167.7},
            },
            {
                "id": "T2",
                "type": "SRBM",
                "launch": {"lat_deg": 11.0, "lon_deg": 171.0, "time_s": 5.0},
                "aim": {"lat_deg": 9.0, "lon_deg": 167.7},
                "burn_time_s": 20.0,
            },
        ],
        "outputs": ["memory"],
    }
    return scene | changes


@pytest.fixture(scope="module")
def scene(host: Host) -> Scene:
    return scene_from_mapping(mapping(), host=host)


def lines(plan: Plan, *windows: Window) -> bytes:
    encoder = ForgeEncoder(EncoderContext(sensors=plan.sensors, epoch_us=plan.scene.epoch_us))
    return b"".join(map(encoder.encode, windows))


def batch(scene: Scene, host: Host, end_ns: int = 100 * NS) -> bytes:
    plan = compile_plan(scene, host)
    return lines(plan, Engine(plan).advance(end_ns))


@pytest.mark.parametrize("admitted_s", [0.05, 3.2, 29.999, 31.7])
def test_a_launch_let_in_between_windows_gives_the_events_of_a_batch(
    scene: Scene, host: Host, admitted_s: float
) -> None:
    plan = compile_plan(scene, host)
    engine = Engine(plan)
    before = engine.advance(round(admitted_s * NS))
    draft = drafted_launch(plan, LATER, engine.time_ns, 0)
    draft.engine.take_over(engine)
    live = lines(plan, before, draft.engine.advance(47 * NS), draft.engine.advance(100 * NS))
    whole = scene_from_mapping(mapping(targets=[*mapping()["targets"], LATER]), host=host)
    assert live == batch(whole, host)
    assert draft.not_after_ns == 31_700_000_000


def test_targets_that_are_over_are_let_go_and_nobody_elses_events_change(scene: Scene, host: Host) -> None:
    plan = compile_plan(scene, host)
    engine = Engine(plan)
    before = engine.advance(30 * NS)
    trimmed = without_those_over(plan, 30 * NS)
    assert trimmed.targets.ids == ("T1",)
    assert len(trimmed.pairs) == len(plan.sensors)
    assert len(trimmed.sightlines.travel_s) < len(plan.sightlines.travel_s)
    rest = Engine(trimmed)
    rest.take_over(engine)
    assert lines(plan, before, rest.advance(100 * NS)) == batch(scene, host)


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
        draft = drafted_launch(engine.plan, launched, engine.time_ns, 0)
        draft.engine.take_over(engine)
        engine = draft.engine
        engine.advance(2 * (number + 1) * NS)
        sizes.append(
            (len(engine.plan.pairs), len(engine.plan.sightlines.travel_s), len(engine.plan.targets.trajectories))
        )
    assert np.max(sizes[8:], axis=0).tolist() <= np.max(sizes[:8], axis=0).tolist()


def test_another_scan_rate_disturbs_nobody_and_repeats_no_id(scene: Scene, host: Host) -> None:
    plan = compile_plan(scene, host)
    engine = Engine(plan)
    windows = [engine.advance(40 * NS)]
    for period_ms in (400.0, 200.0, 100.0):
        settings = without_targets(engine.plan.scene)
        settings["sensors"][0]["members"][0]["scan_period_ms"] = period_ms
        draft = drafted_settings(engine.plan, settings, 0, scene)
        draft.engine.take_over(engine)
        engine = draft.engine
        windows.append(engine.advance(engine.time_ns + 15 * NS))
    live = lines(plan, *windows).splitlines()
    undisturbed = [line for line in live if b'"DSP-1"' not in line]
    assert undisturbed == [line for line in batch(scene, host, 85 * NS).splitlines() if b'"DSP-1"' not in line]
    ids = [line.split(b'"')[3] for line in live]
    assert len(set(ids)) == len(ids)
    own = [len([line for line in lines(plan, window).splitlines() if b'"DSP-1"' in line]) for window in windows[1:]]
    assert own[0] < own[1] < own[2]


@pytest.mark.parametrize("tracker", ["stereo-filter", "boost-profile", "kepler-arc"])
def test_a_tracker_hears_of_sensors_that_look_more_seldom(host: Host, tracker: str) -> None:
    """Half a second between looks, then ten: what is not seen meanwhile burns on, and is tracked as surely as told."""
    scanner = {"model": "generic-scanner", "scan_period_ms": 500.0}
    slots = {"A": -135.0, "B": -90.0}
    sensors = [{**scanner, "id": name, "orbital_slot_deg": slot_deg} for name, slot_deg in slots.items()]
    target = mapping()["targets"][0]
    scene = scene_from_mapping(mapping(duration_s=110, sensors=sensors, targets=[target], tracker=tracker), host=host)
    plan = compile_plan(scene, host)
    before = Engine(plan)
    before.advance(60 * NS)
    settings = without_targets(scene)
    for sensor in settings["sensors"]:
        sensor["scan_period_ms"] = 10_000.0
    after = drafted_settings(plan, settings, 0, scene).engine
    after.take_over(before)
    tracks = after.advance(110 * NS).tracks
    assert len(np.unique(tracks.track)) == 1
    assert len(tracks) == 50
    if tracker == "kepler-arc":
        return
    assert np.isnan(tracks.impact).all()
    away = tracks.state[:, :3] - plan.targets.position_ecef_m(np.zeros(50, dtype=np.int32), tracks.tick_s)
    nees = np.sum(away * np.linalg.solve(tracks.state_covariance[:, :3, :3], away[:, :, None])[:, :, 0], axis=1) / 3.0
    assert np.median(nees) < 3.0


def without_targets(scene: Scene) -> dict[str, Any]:
    return {key: value for key, value in scene_mapping(scene).items() if key not in ("targets", "sources")}


def test_settings_that_need_a_restart_are_refused_all_at_once(scene: Scene, host: Host) -> None:
    settings = without_targets(scene) | {"seed": 4, "epoch": "2026-04-01T13:00:00Z", "outputs": ["null"]}
    settings["sensors"][0]["members"][0]["orbital_slot_deg"] = 7.0
    with pytest.raises(RestartError) as refused:
        drafted_settings(compile_plan(scene, host), settings, 0, scene)
    told = {problem.path: problem.message for problem in refused.value.problems}
    assert set(told) == {"seed", "epoch", "outputs", "sensors[0].orbital_slot_deg"}
    assert all(message.startswith("needs a restart") for message in told.values())


def test_settings_are_read_as_a_scene_is(scene: Scene, host: Host) -> None:
    settings = without_targets(scene) | {
        "confidence": {"model": "weighted", "band": 0.9, "count": 0.3, "geometry": 0.3}
    }
    settings["sensors"][0]["members"][0]["detection_probability"] = {"ICBM": 1.5}
    with pytest.raises(SceneError) as refused:
        drafted_settings(compile_plan(scene, host), settings, 0, scene)
    assert [problem.path for problem in refused.value.problems] == [
        "sensors[0].members[0].detection_probability",
        "confidence",
    ]


class Kept:
    """What a run tells its listener, and a way to wait for it."""

    def __init__(self) -> None:
        self.windows: list[Any] = []

    def __call__(self, window: Any) -> None:
        self.windows.append(window)


def test_a_live_run_ends_with_the_events_of_the_batch(scene: Scene, host: Host) -> None:
    kept = Kept()
    run = LiveRun(scene, host, LiveSettings(speed=None), kept)
    run.start()
    until(lambda: run.status().state == "ended")
    status = run.stop()
    assert b"".join(lines(run.plan, live.window) for live in kept.windows) == batch(scene, host)
    assert [(sink.state, sink.delivered, sink.dropped) for sink in status.sinks] == [("closed", status.detections, 0)]
    with pytest.raises(RefusedError, match="start it again"):
        run.launch(LATER)


def test_each_lap_is_the_scene_with_its_epoch_moved_on_and_its_seed_one_more(host: Host) -> None:
    short = scene_from_mapping(mapping(duration_s=30), host=host)
    kept = Kept()
    run = LiveRun(short, host, LiveSettings(speed=None, loop=True), kept)
    run.start()
    until(lambda: run.status().lap >= 3)
    run.stop()
    for lap in range(3):
        again = evolve(short, epoch_us=short.epoch_us + lap * 30_000_000, seed=short.seed + lap)
        live = b"".join(lines(compile_plan(short, host), told.window) for told in kept.windows if told.lap == lap)
        assert live == batch(again, host, 30 * NS), lap


def test_all_times_of_a_laps_tracks_are_moved_on(host: Host) -> None:
    short = scene_from_mapping(mapping(duration_s=20, tracker="kepler-arc"), host=host)
    kept = Kept()
    run = LiveRun(short, host, LiveSettings(speed=None, loop=True), kept)
    run.start()
    until(lambda: run.status().lap >= 2)
    run.stop()
    told = Tracks.concatenate([live.window.tracks for live in kept.windows if live.lap == 1])
    again = evolve(short, epoch_us=short.epoch_us + 20_000_000, seed=short.seed + 1)
    alone = Engine(compile_plan(again, host)).advance(20 * NS).tracks
    assert len(alone) > 10
    assert np.isfinite(alone.burnout[-1]).all()
    times = [(told.tick_s, alone.tick_s)] + [
        (getattr(told, name)[:, -1], getattr(alone, name)[:, -1]) for name in ("launch", "impact", "burnout")
    ]
    for ours, theirs in times:
        assert np.allclose(ours, theirs + 20.0, rtol=0.0, atol=1e-9, equal_nan=True)


def test_a_run_takes_launches_and_settings_while_it_runs(scene: Scene, host: Host) -> None:
    kept = Kept()
    run = LiveRun(scene, host, LiveSettings(speed=5.0, cycle_ns=10_000_000), kept)
    run.start()
    block = {key: value for key, value in LATER.items() if key != "id"}
    launch = {key: value for key, value in LATER["launch"].items() if key != "time_s"}
    launched = run.launch(block | {"launch": launch})
    settings = run.settings_mapping() | {"confidence": "always"}
    cycle = run.configure(settings)
    until(lambda: run.time_ns > (launched.time_s + 2.0) * NS)
    with pytest.raises(PastError, match="scene's clock is at"):
        run.launch(LATER | {"launch": LATER["launch"] | {"time_s": 0.1}})
    with pytest.raises(SceneError, match=r"targets\[0\].launch.lat_deg: 95"):
        run.launch(LATER | {"launch": LATER["launch"] | {"lat_deg": 95.0}})
    run.launch(LATER | {"launch": LATER["launch"] | {"time_s": 80.0}})
    run.settings = evolve(run.settings, maximum_targets=1)
    with pytest.raises(BusyError, match="1 targets"):
        run.launch(LATER | {"id": "MORE", "launch": LATER["launch"] | {"time_s": 80.0}})
    run.stop()
    confident = [live.window.detections.confidence for live in kept.windows if live.cycle >= cycle]
    assert all((part == 1.0).all() for part in confident)
    assert launched.target_id in run.plan.targets.ids
    assert run.settings_mapping()["confidence"] == {"model": "always"}


UNTIMED = {"type": "SRBM", "launch": {"lat_deg": 22.0, "lon_deg": -160.0}, "aim": {"lat_deg": 24.0, "lon_deg": -158.0}}


def test_a_launch_that_its_lap_has_no_time_for_goes_up_in_the_next(host: Host) -> None:
    scene = scene_from_mapping(mapping(duration_s=20, targets=[], outputs=["null"]), host=host)
    run = LiveRun(scene, host, LiveSettings(speed=20.0, loop=True))
    run.start()
    launched = [run.launch(UNTIMED) for _ in range(20)]
    times = [each.time_s for each in launched]
    status = run.stop()
    assert times == sorted(times)
    assert status.lap >= 1
    assert status.targets_launched == 20


def test_a_launch_goes_up_as_soon_as_a_machine_that_is_slow_to_plan_it_can(
    host: Host, monkeypatch: pytest.MonkeyPatch
) -> None:
    def slowly(plan: Plan, block: Any, time_ns: int, lap: int) -> Draft:
        time.sleep(0.4)
        return drafted_launch(plan, block, time_ns, lap)

    monkeypatch.setattr(running, "drafted_launch", slowly)
    scene = scene_from_mapping(mapping(duration_s=600, targets=[], outputs=["null"]), host=host)
    run = LiveRun(scene, host, LiveSettings(speed=20.0, cycle_ns=1_000_000))
    run.start()
    before_s = run.time_ns / NS
    launched = run.launch(UNTIMED)
    run.stop()
    # Planning takes 8 s of scene time at the least.
    assert launched.time_s - before_s > 8.0
    assert launched.target_id in run.plan.targets.ids


def test_a_launch_that_the_scene_has_no_time_for_is_refused_with_the_way_out(host: Host) -> None:
    scene = scene_from_mapping(mapping(duration_s=0.2, targets=[], outputs=["null"]), host=host)
    run = LiveRun(scene, host, LiveSettings(speed=0.1, cycle_ns=1_000_000_000))
    run.start()
    with pytest.raises(RefusedError, match="--loop"):
        run.launch(UNTIMED)
    run.stop()
