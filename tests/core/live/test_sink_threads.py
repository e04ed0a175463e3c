"""Sinks of a live run: nothing is lost, no viewer gets an event too early, and no sink holds up
another.
"""

import threading
import time
from collections.abc import Callable, Mapping
from typing import Any

import pytest
from attrs import evolve
from waiting import until

from opir_core import Engine, Scene, compile_plan
from opir_core.errors import SinkError
from opir_core.live import LiveRun, LiveSettings, LiveWindow
from opir_core.output.sink_thread import QUEUED_WINDOWS, SinkThread
from opir_core.plugin import Delivery, Host, Sink, Window
from opir_core.reading import scene_from_mapping

NS = 1_000_000_000
SCENE: Mapping[str, Any] = {
    "scene": "outlets",
    "epoch": "2026-04-01T12:00:00Z",
    "duration_s": 60,
    "seed": 3,
    "sensors": [{"constellation": "DSP"}, {"constellation": "SBIRS-GEO"}],
    "targets": [
        {
            "id": "T1",
            "type": "ICBM",
            "launch": {"lat_deg": 34.73, "lon_deg": -120.57, "time_s": 3.0},
            "aim": {"lat_deg": 9.0, "lon_deg": 167.7},
        }
    ],
}


@pytest.fixture(scope="module")
def host() -> Host:
    return Host.discover()


@pytest.fixture(scope="module")
def scene(host: Host) -> Scene:
    return scene_from_mapping(SCENE, host=host)


def run_into(host: Host, speed: float | None, *outputs: Mapping[str, Any]) -> LiveRun:
    return LiveRun(
        scene_from_mapping({**SCENE, "outputs": outputs}, host=host),
        host,
        LiveSettings(speed=speed),
    )


class Slow(Sink):
    """A sink that takes its time, or fails."""

    def __init__(self, gate: threading.Event, error: str | None = None) -> None:
        self.gate = gate
        self.error = error
        self.taken = 0

    def write(self, window: Window) -> None:
        self.gate.wait(60.0)
        if self.error:
            raise SinkError(self.error)
        self.taken += len(window.detections)

    def close(self) -> Delivery:
        return Delivery(delivered=self.taken)


def some_window(scene: Scene, host: Host) -> Window:
    return Engine(compile_plan(scene, host)).advance(20 * NS)


def test_a_slow_sink_loses_nothing(scene: Scene, host: Host) -> None:
    window = some_window(scene, host)
    gate = threading.Event()
    slow = SinkThread("outputs[0]", "slow", Slow(gate))
    broken = SinkThread("outputs[1]", "broken", Slow(gate, "no room"))
    for _ in range(QUEUED_WINDOWS // 2):
        slow.write(window, threading.Event())
        broken.write(window, threading.Event())
    gate.set()
    slow.close(time.monotonic() + 60.0)
    broken.close(time.monotonic() + 60.0)
    events = len(window.detections) * (QUEUED_WINDOWS // 2)
    assert (slow.status().delivered, slow.status().state) == (events, "closed")
    assert (broken.status().dropped, broken.status().state, broken.status().error) == (
        events,
        "failed",
        "no room",
    )


class Kept(Slow):
    """A sink with a spool, which counts what it has written down, and how many of another's windows
    came before.
    """

    outlives_the_process = True
    waits = 0

    def __init__(self, heard: Callable[[], int]) -> None:
        super().__init__(threading.Event())
        self.gate.set()
        self.heard = heard
        self.ahead: list[int] = []

    def write(self, window: Window) -> None:
        self.ahead.append(self.heard() - self.taken)
        super().write(window)


def test_viewers_get_events_after_spooled_outputs(scene: Scene, host: Host) -> None:
    shown: list[LiveWindow] = []
    run = LiveRun(evolve(scene, outputs=()), host, LiveSettings(speed=None), shown.append)
    slow_sink = Slow(threading.Event())
    slow_sink.gate.set()
    viewer = Kept(lambda: max(run.status().detections, reported(shown), slow_sink.taken))
    run._sinks = (
        SinkThread("outputs[0]", "other", slow_sink),
        SinkThread("outputs[1]", "kept", viewer, is_spooled=True),
    )
    run._state = "running"
    run._thread.start()
    until(lambda: run.state == "ended")
    run.stop()
    assert viewer.taken == slow_sink.taken == reported(shown) == run.status().detections > 0
    assert max(viewer.ahead) == 0


def reported(shown: list[LiveWindow]) -> int:
    return sum(len(live.window.detections) for live in shown)


def test_a_failing_output_does_not_end_the_run(scene: Scene, host: Host) -> None:
    window = some_window(scene, host)
    gate = threading.Event()
    gate.set()
    broken = SinkThread("outputs[0]", "broken", Slow(gate, "no room"), is_spooled=True)
    for _ in range(3):
        broken.write(window, threading.Event())
    broken.close(time.monotonic() + 60.0)
    reported = broken.status()
    assert (reported.state, reported.error, reported.dropped) == (
        "failed",
        "no room",
        3 * len(window.detections),
    )


def test_a_spooled_output_that_is_changed_loses_nothing(tmp_path: Any, host: Host) -> None:
    selected = {"path": str(tmp_path / "one.jsonl"), "spool": {"path": str(tmp_path / "spool")}}
    run = run_into(host, 20.0, {"jsonl": selected})
    run.start()
    until(lambda: run.status().detections > 50)
    settings = run.settings_mapping()
    settings["outputs"][0]["jsonl"]["path"] = str(tmp_path / "two.jsonl")
    run.configure(settings)
    taken = run.status().detections
    until(lambda: run.status().detections > taken + 50)
    status = run.stop()
    written = [(tmp_path / name).read_bytes().count(b"\n") for name in ("one.jsonl", "two.jsonl")]
    assert min(written) > 0
    sink = status.sinks[0]
    assert (sum(written), sink.spooled, sink.dropped) == (status.detections, 0, 0)
    assert sink.given == sink.delivered == status.detections


def test_a_sink_that_hangs_does_not_keep_the_run_from_stopping(scene: Scene, host: Host) -> None:
    gate = threading.Event()
    hanging = SinkThread("outputs[0]", "hanging", Slow(gate))
    hanging.write(some_window(scene, host), threading.Event())
    start_s = time.monotonic()
    hanging.close(start_s + 0.2)
    assert time.monotonic() - start_s < 30.0  # of 60 s for which the sink hangs
    gate.set()
    assert hanging.status().error == "it did not close before the deadline"


def test_a_failed_output_with_a_full_queue_does_not_hold_up_its_replacement(
    scene: Scene, host: Host
) -> None:
    gate = threading.Event()
    stopping = threading.Event()
    failing = SinkThread("outputs[0]", "failing", Slow(gate, "no room"))
    window = some_window(scene, host)
    for _ in range(QUEUED_WINDOWS + 1):
        failing.write(window, stopping)
    gate.set()
    until(lambda: failing.is_closed)
    failing.replace(lambda: Slow(gate), stopping)
    assert failing.status().error == "no room"


def test_a_stop_does_not_wait_for_an_output_that_is_replaced(scene: Scene, host: Host) -> None:
    gate = threading.Event()
    stopping = threading.Event()
    hanging = SinkThread("outputs[0]", "hanging", Slow(gate))
    hanging.write(some_window(scene, host), stopping)
    hanging.replace(lambda: Slow(gate), stopping, is_spooled=True)
    stopping.set()
    hanging.write(some_window(scene, host), stopping)
    gate.set()
    assert hanging.status().error == "the run was stopped before it was opened anew"


def test_changed_outputs_are_opened_anew_and_counts_go_on(tmp_path: Any, host: Host) -> None:
    run = run_into(host, 20.0, {"jsonl": {"path": str(tmp_path / "one.jsonl")}})
    run.start()
    until(lambda: run.status().detections > 50)
    settings = run.settings_mapping()
    settings["outputs"][0]["jsonl"]["path"] = str(tmp_path / "two.jsonl")
    run.configure(settings)
    taken = run.status().detections
    until(lambda: run.status().detections > taken + 50)
    status = run.stop()
    written = [(tmp_path / name).read_bytes().count(b"\n") for name in ("one.jsonl", "two.jsonl")]
    assert min(written) > 0
    assert sum(written) == status.sinks[0].delivered == status.detections
