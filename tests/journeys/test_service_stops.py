"""`opir serve` as a process: reported to stop it ends in time and loses nothing."""

import http.client
import json
import os
import re
import signal
import socket
import sqlite3
import subprocess
import sys
import threading
import time
from contextlib import contextmanager

import pytest
from attrs import frozen
from http_service import JSON, LAUNCH
from kafka_broker import dead_address
from opir_http import serving as serving_
from waiting import until, within

#: Time limit, s, for a service to end after SIGTERM while it waits for what never comes. It ends
#: within 5 s on a machine that does nothing else.
STOP_S = 60.0

SCENE = """
scene: stop
epoch: "2026-04-01T12:00:00Z"
duration_s: 200
seed: 5
sensors:
  - constellation: DSP
  - constellation: SBIRS-GEO
targets:
  - id: T1
    type: ICBM
    launch: {lat_deg: 34.73, lon_deg: -120.57, time_s: 0.1}
    aim: {lat_deg: 9.0, lon_deg: 167.7}
"""


@frozen
class Running:
    """A service that is a process of its own."""

    process: "subprocess.Popen[str]"
    port: int

    def ask(self, method, path, body=None):
        connection = http.client.HTTPConnection("127.0.0.1", self.port, timeout=60.0)
        try:
            connection.request(
                method, path, None if body is None else json.dumps(body), JSON if body else {}
            )
            answer = connection.getresponse()
            return answer.status, json.loads(answer.read())
        finally:
            connection.close()

    def sink(self):
        return self.ask("GET", "/status")[1]["sinks"][0]

    def terminated(self, number=signal.SIGTERM):
        """Tell it to stop; return what it prints."""
        self.process.send_signal(number)
        return self.process.communicate(timeout=STOP_S)[0]


@contextmanager
def serving(folder, *words, stderr=subprocess.DEVNULL):
    scene = folder / "scene.yaml"
    scene.write_text(SCENE, encoding="utf-8")
    command = [sys.executable, "-m", "opir_core", "serve", str(scene), "--port", "0", *words]
    process = subprocess.Popen(command, stdout=subprocess.PIPE, stderr=stderr, text=True)
    try:
        assert process.stdout is not None
        yield Running(process, int(within(60.0, process.stdout.readline).rpartition(":")[2]))
    finally:
        process.kill()
        process.wait(30.0)
        if process.stdout is not None:
            process.stdout.close()


def waiting(spool):
    """Return how many events are in a spool's file."""
    with sqlite3.connect(spool) as opened:
        assert opened.execute("PRAGMA integrity_check").fetchone() == ("ok",)
        return int(opened.execute("SELECT coalesce(sum(events), 0) FROM parcel").fetchone()[0])


def test_what_a_stop_may_take_adds_up_to_five_seconds():
    assert serving_.STOP_S + serving_._LEAST_S <= 5.0


@contextmanager
def hangups(handler):
    """Let the processes that are started begin with this handler of SIGHUP."""
    former = signal.signal(signal.SIGHUP, handler)
    try:
        yield
    finally:
        signal.signal(signal.SIGHUP, former)


def test_a_closed_terminal_stops_it_in_order(tmp_path):
    with hangups(signal.SIG_DFL), serving(tmp_path, "--speed", "10", "--loop") as running:
        reported = running.terminated(signal.SIGHUP)
    assert running.process.returncode == 0
    assert "detections" in reported


def test_a_closed_terminal_that_is_ignored_stops_nothing(tmp_path):
    with hangups(signal.SIG_IGN), serving(tmp_path, "--speed", "10", "--loop") as running:
        running.process.send_signal(signal.SIGHUP)
        assert running.ask("GET", "/status")[0] == 200
        running.terminated()


@pytest.mark.slow
def test_sigterm_ends_it_in_time_with_the_broker_away_and_viewers_there(tmp_path):
    kafka = {
        "bootstrap_servers": dead_address(),
        "topic": "t",
        "spool": {"path": str(tmp_path / "spool")},
    }
    outputs = f"outputs=[{{kafka: {json.dumps(kafka)}}}]"
    with serving(tmp_path, "--set", outputs, "--speed", "10", "--loop") as running:
        with socket.create_connection(("127.0.0.1", running.port), timeout=60.0) as viewer:
            viewer.sendall(b"GET /stream HTTP/1.1\r\nHost: localhost\r\n\r\n")
            until(lambda: running.sink()["spooled"] > 50)
            reported = running.terminated()
            viewer.settimeout(60.0)
            assert b"event: end" in b"".join(iter(lambda: viewer.recv(65536), b""))
        assert running.process.returncode == 0
    result = re.search(
        r"(\d+) detections.*\n.*kafka\): 0 delivered, (\d+) spooled, 0 dropped", reported
    )
    assert result, reported
    assert int(result[1]) == int(result[2]) == waiting(tmp_path / "spool")


@pytest.mark.slow
def test_a_viewer_that_does_not_read_is_cut_off_at_the_end_without_complaint(
    tmp_path,
):
    words = ("--set", 'outputs=["null"]', "--speed", "max", "--loop")
    with serving(tmp_path, *words, stderr=subprocess.STDOUT) as running, socket.socket() as viewer:
        viewer.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 12)
        viewer.connect(("127.0.0.1", running.port))
        viewer.sendall(b"GET /stream HTTP/1.1\r\nHost: localhost\r\n\r\n")
        until(lambda: running.ask("GET", "/status")[1]["viewers"]["dropped_frames"] > 0)
        reported = running.terminated().splitlines()
    assert len(reported) == 2, reported
    assert reported[0].startswith("opir: stopped at ")
    assert reported[1].startswith("opir: outputs[0] (null): ")


@pytest.mark.slow
def test_sigterm_ends_it_in_time_while_a_full_spool_holds_the_run_and_a_launch_waits(
    tmp_path,
):
    pipe = tmp_path / "pipe"
    spool = tmp_path / "spool"
    os.mkfifo(pipe)
    stored = {"path": str(spool), "max_bytes": 1 << 20, "when_full": "wait", "wait_s": 600}
    outputs = f"outputs=[{{jsonl: {json.dumps({'path': str(pipe), 'spool': stored})}}}]"
    reading = os.open(pipe, os.O_RDONLY | os.O_NONBLOCK)  # and nobody reads
    try:
        with serving(tmp_path, "--set", outputs, "--speed", "max", "--loop") as running:
            until(lambda: running.sink()["waits"] > 0)
            answers = []
            asking = threading.Thread(
                target=lambda: answers.append(running.ask("POST", "/trigger", LAUNCH))
            )
            asking.start()
            time.sleep(2.0)  # until the service has read the request: nothing shows that it waits
            reported = running.terminated()
            asking.join(30.0)
            assert running.process.returncode == 5, (
                reported
            )  # the window that waited for room is lost, and reported
    finally:
        os.close(reading)
    assert answers[0][0] == 409
    assert re.search(r"[1-9]\d* spooled, [1-9]\d* dropped.* is full", reported), reported
    assert waiting(spool) > 0


pytestmark = pytest.mark.skipif(not hasattr(os, "mkfifo"), reason="needs POSIX signals and pipes")


@pytest.mark.slow
def test_a_service_that_was_paused_for_longer_than_it_may_be_stuck_goes_on(tmp_path):
    words = (
        "--set",
        'outputs=["null"]',
        "--loop",
        "--supervise",
        "--dead-after",
        "4",
        "--unready-after",
        "2",
    )
    with serving(tmp_path, *words) as running:
        until(lambda: running.sink()["given"] > 0)
        running.process.send_signal(signal.SIGSTOP)
        time.sleep(7.0)
        running.process.send_signal(signal.SIGCONT)
        time.sleep(6.0)
        assert running.process.poll() is None
        events = running.sink()["given"]
        until(lambda: running.sink()["given"] > events)
        running.terminated()
        assert running.process.returncode == 0


@pytest.mark.slow
def test_a_service_that_dropped_events_ends_with_the_exit_code_of_a_run_that_did(
    tmp_path,
):
    with serving(tmp_path, "--set", "outputs=[{jsonl: {path: /dev/full}}]", "--loop") as running:
        until(lambda: running.sink()["dropped"] > 0)
        assert "no space left" in running.sink()["error"]
        running.terminated()
        assert running.process.returncode == 5
