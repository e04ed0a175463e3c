"""A live run is watched: systemd is notified while cycles end, and the callback is called when it
is stuck.
"""

import socket
import threading
import time
from pathlib import Path

import pytest
from opir_http.watchdog import Notifier, RunWatchdog
from waiting import until

from opir_core.live import Progress


class Pretended:
    """A run with a given progress."""

    state = "running"

    def __init__(self) -> None:
        self.now = Progress()

    def progress(self) -> Progress:
        return self.now


@pytest.mark.parametrize("kind", ["path", "abstract"])
def test_systemd_is_notified_only_while_cycles_end(tmp_path: Path, kind: str) -> None:
    name = str(tmp_path / "notify") if kind == "path" else f"@opir-test-{time.monotonic_ns()}"
    with socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM) as listening:
        listening.bind(name if kind == "path" else f"\0{name[1:]}")
        listening.settimeout(10.0)
        run = Pretended()
        reasons = list[str]()
        notifier = Notifier.of({"NOTIFY_SOCKET": name, "WATCHDOG_USEC": "100000"})
        watchdog = RunWatchdog(run, reasons.append, notifier)
        watchdog.start()
        assert listening.recv(99) == b"READY=1"
        assert {listening.recv(99) for _ in range(3)} == {b"WATCHDOG=1"}
        run.now = Progress(9.0, ("slow",), ("stuck here",))
        until(lambda: reasons)
        reported = [listening.recv(99)]
        while reported[-1] == b"WATCHDOG=1":
            reported.append(listening.recv(99))
        assert reported[-1] == b"STATUS=stuck here"
        watchdog.stop()
        assert listening.recv(99) == b"STOPPING=1"
        assert reasons == ["stuck here"]


def test_an_absent_service_manager_is_ignored(tmp_path: Path) -> None:
    Notifier.of({}).send("READY=1")
    Notifier.of({"NOTIFY_SOCKET": str(tmp_path / "nobody")}).send("READY=1")
    assert Notifier.of({"WATCHDOG_USEC": "100000", "WATCHDOG_PID": "1"}).within_s is None
    assert Notifier.of({"WATCHDOG_USEC": "soon"}).within_s is None


def test_a_run_that_is_only_slow_is_not_reported_as_stuck() -> None:
    run = Pretended()
    reasons = list[str]()
    run.now = Progress(9.0, ("slow",))
    watchdog = RunWatchdog(run, reasons.append, Notifier(within_s=0.02))
    watchdog.start()
    threading.Event().wait(0.2)
    watchdog.stop()
    assert reasons == []


def test_a_pause_of_the_process_is_not_a_stuck_run(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    clock_s = [0.0]
    beats = threading.Semaphore(0)
    reasons = list[str]()

    class Watched(Pretended):
        def progress(self) -> Progress:
            beats.release()
            clock_s[0] += 0.02
            return self.now

    monkeypatch.setattr("opir_core.host.watchdog.time.monotonic", lambda: clock_s[0])
    run = Watched()
    watchdog = RunWatchdog(run, reasons.append, Notifier(within_s=0.02), dead_after_s=20.0)
    watchdog.start()
    for _ in range(3):
        assert beats.acquire(timeout=60.0)
    run.now = Progress(31.0, ("slow",), ("stuck here",))
    clock_s[0] += 30.0  # the process was stopped for as long
    for _ in range(5):
        assert beats.acquire(timeout=60.0)
    assert reasons == []
    for _ in range(40):
        if not reasons:
            clock_s[0] += 1.0
            beats.acquire(timeout=1.0)
    until(lambda: reasons)
    assert reasons == ["stuck here"]
    watchdog.stop()
