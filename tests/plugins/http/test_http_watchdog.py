"""Health of a service whose run is stuck, and the supervisor that ends it."""

import os
import socket
import subprocess
import sys
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

import pytest
from http_service import SCENE, serving
from rogue_components import Hang, raising, rogue_host
from waiting import until, within

WORDS = ("--speed", "20", "--unready-after", "0.5", "--dead-after", "3")
TRACKED = SCENE + "tracker: rogue\n"


@pytest.mark.slow
def test_health_fails_while_a_tracker_hangs(tmp_path: Path) -> None:
    hang = Hang()
    host = rogue_host("opir_trackers", "kepler-arc", "step", hang)
    with serving(tmp_path, *WORDS, scene=TRACKED, host=host) as stand:
        try:
            until(lambda: stand.ask("GET", "/health/ready").status == 503)
            assert (
                stand.ask("GET", "/health/ready")
                .json["reasons"][0]
                .startswith("no cycle has ended for ")
            )
            until(lambda: stand.ask("GET", "/health/live").status == 503)
            live = stand.ask("GET", "/health/live").json
            assert live["state"] == "running"
            assert "rogue_components.py, line" in live["reasons"][0]
            assert stand.ask("GET", "/status").json["clock"]["cycle_age_s"] > 3.0
            assert b"opir_cycle_age_seconds " in stand.ask("GET", "/metrics").body
        finally:
            hang.end()


def test_readiness_answers_when_the_counts_of_a_sink_do_not(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("opir_http.routes._STATUS_S", 0.3)
    hang = Hang()
    with serving(tmp_path, *WORDS) as stand:
        monkeypatch.setattr(stand.service.run._sinks[0], "status", lambda: hang(None))
        answer = stand.ask("GET", "/health/ready")
        hang.end()
        assert answer.status == 503
        assert "the status is not available within 0.3 s" in answer.json["reasons"]


def test_a_stream_that_fails_is_not_ready_and_goes_on(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    with serving(tmp_path, *WORDS) as stand:

        def failing(*_arguments: object) -> None:
            raise SystemExit(0)

        with monkeypatch.context() as patched:
            patched.setattr(stand.service.feed, "_frames", failing)
            until(lambda: stand.ask("GET", "/health/ready").status == 503)
            assert (
                "the stream has failed: SystemExit"
                in stand.ask("GET", "/health/ready").json["reasons"][0]
            )
        count = stand.service.feed.history.total
        until(lambda: stand.service.feed.history.total > count)
        until(lambda: stand.ask("GET", "/health/ready").status == 200)


def test_a_tracker_that_raises_ends_alone_and_is_reported(tmp_path: Path) -> None:
    host = rogue_host("opir_trackers", "kepler-arc", "step", raising(MemoryError()))
    with serving(tmp_path, *WORDS, scene=TRACKED, host=host) as stand:
        until(lambda: stand.ask("GET", "/health/ready").status == 503)
        (reason,) = stand.ask("GET", "/health/ready").json["reasons"]
        assert reason.startswith(
            "the tracker has ended: tracker: the tracker 'rogue' of plugin rogue"
        )
        assert "step at " in reason
        assert "MemoryError" in reason
        status = stand.ask("GET", "/status").json
        assert status["health"]["reasons"] == [reason]
        assert reason.endswith(status["error"])
        assert status["state"] == "running"
        assert stand.ask("GET", "/health/live").status == 200
        count = status["counts"]["detections"]
        until(lambda: stand.ask("GET", "/status").json["counts"]["detections"] > count)


def messages_to_the_end(manager: socket.socket) -> list[bytes]:
    """Return the messages of a service to its manager, the last its status."""
    messages = [manager.recv(999)]
    while not messages[-1].startswith(b"STATUS="):
        messages.append(manager.recv(999))
    return messages


@pytest.mark.slow
@pytest.mark.parametrize(
    ("method", "deed", "reported"),
    [
        (("opir_trackers", "kepler-arc", "step"), "hang", "no cycle has ended for "),
        (("opir_confidence_models", "weighted", "confidence"), "SystemExit", "the run has failed"),
        (("opir_confidence_models", "weighted", "confidence"), "MemoryError", ""),
    ],
)
def test_the_supervisor_ends_the_process_with_its_own_code(
    tmp_path: Path, method: tuple[str, ...], deed: str, reported: str
) -> None:
    key = "tracker" if method[0] == "opir_trackers" else "confidence"
    (tmp_path / "scene.yaml").write_text(f"{SCENE}{key}: rogue\n", encoding="utf-8")
    script = Path(__file__).parents[2] / "support" / "rogue_service.py"
    rogue = [sys.executable, str(script), *method, deed]
    words = ["serve", str(tmp_path / "scene.yaml"), "--port", "0", "--supervise", *WORDS]
    manager = socket.socket(socket.AF_UNIX, socket.SOCK_DGRAM)
    with manager, ThreadPoolExecutor() as pool:
        manager.bind(str(tmp_path / "notify"))
        manager.settimeout(90.0)
        # Read at once: a socket holds ten messages, and a slow process sends more.
        messages = pool.submit(messages_to_the_end, manager)
        systemd = {"NOTIFY_SOCKET": str(tmp_path / "notify"), "WATCHDOG_USEC": "2000000"}
        process = subprocess.Popen(
            [*rogue, *words],
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
            env={**os.environ, **systemd},
        )
        try:
            out, error = within(90.0, process.communicate)
        finally:
            process.kill()
        notes = messages.result()
    assert process.returncode == 6
    assert f"opir: {reported}" in error
    assert "Traceback" not in error
    assert "(null): " in out
    assert notes[0] == b"READY=1"
    assert set(notes[1:-1]) <= {b"WATCHDOG=1"}
