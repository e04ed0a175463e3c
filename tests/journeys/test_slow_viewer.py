"""A viewer that does not read loses the oldest and is notified; neither run, sink nor other viewers
wait for it.
"""

import re
import socket
import time

import pytest
from http_service import serving


@pytest.mark.slow
def test_a_viewer_that_does_not_read_holds_up_nobody(tmp_path):
    with (
        serving(tmp_path, "--speed", "max", "--loop") as running,
        viewer(running) as idle,
        viewer(running) as busy,
    ):
        give_up_at = time.monotonic() + 60.0
        received = bytearray()
        while not dropped(running):
            assert time.monotonic() < give_up_at
            received += busy.recv(1 << 20)
        status = running.ask("GET", "/status", timeout_s=30.0).json
        busy_for(busy, received, 0.3)
        final_status = running.ask("GET", "/status", timeout_s=30.0).json
        assert final_status["clock"]["cycle"] > status["clock"]["cycle"]
        assert final_status["sinks"][0]["delivered"] > status["sinks"][0]["delivered"]
        assert final_status["sinks"][0]["dropped"] == 0
        late = bytearray()
        reported = None
        while reported is None:
            assert time.monotonic() < give_up_at
            late += idle.recv(1 << 20)
            reported = re.search(rb'event: dropped\ndata: \{"frames":(\d+)\}', bytes(late))
        assert int(reported[1]) > 0
        assert b"event: detections" in received


def viewer(running):
    """Return a connection to the stream, with little room for what is not read."""
    connection = socket.socket()
    connection.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 1 << 14)
    connection.settimeout(20.0)
    connection.connect(("127.0.0.1", running.port))
    connection.sendall(b"GET /stream HTTP/1.1\r\nHost: localhost\r\n\r\n")
    return connection


def dropped(running):
    reported = running.ask("GET", "/status", timeout_s=30.0).json["viewers"]
    return int(reported["dropped_frames"])


def busy_for(busy, received, seconds):
    end_at = time.monotonic() + seconds
    while time.monotonic() < end_at:
        received += busy.recv(1 << 20)
