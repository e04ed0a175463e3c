"""Clients: limits of connections, health checks above them, HEAD and OPTIONS, the log of writes,
token files.
"""

import socket
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import pytest
from http_service import LAUNCH, RunningService, serving
from opir_http import server
from opir_http.log import RequestLog
from opir_http.problems import ProblemError
from opir_http.reading import refuse_other_names
from waiting import until


def test_health_is_answered_above_the_limit_of_connections(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(server, "MAXIMUM_CONNECTIONS", 3)
    with serving(tmp_path) as running, ExitStack() as stack:
        for _ in range(3):
            stack.enter_context(socket.create_connection(("127.0.0.1", running.port), timeout=60))
        until(lambda: len(running.server.server_state.connections) == 3)
        assert running.ask("GET", "/health/live").status == 200
        refused = running.ask("GET", "/status")
        assert (refused.status, refused.headers["connection"], refused.headers["retry-after"]) == (
            503,
            "close",
            "5",
        )


def test_a_client_has_a_limit_of_its_own(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server, "LOOPBACK", frozenset())
    monkeypatch.setattr(server, "CONNECTIONS_PER_CLIENT", 1)
    with (
        serving(tmp_path) as running,
        socket.create_connection(("127.0.0.1", running.port), timeout=60),
    ):
        until(lambda: len(running.server.server_state.connections) == 1)
        assert running.ask("GET", "/status").status == 503
        assert running.ask("GET", "/health/live").status == 200


def test_a_client_that_reads_nothing_is_disconnected(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(server, "WRITE_S", 0.3)
    monkeypatch.setattr(server, "_CHECK_S", 0.1)
    with serving(tmp_path) as running, socket.socket() as idle:
        idle.setsockopt(socket.SOL_SOCKET, socket.SO_RCVBUF, 4096)
        idle.connect(("127.0.0.1", running.port))
        idle.setblocking(False)
        request = b"GET /openapi.json HTTP/1.1\r\nHost: localhost\r\n\r\n" * 400
        idle.send(request)
        until(lambda: len(running.server.server_state.connections) == 1)
        until(lambda: not running.server.server_state.connections)


@pytest.mark.parametrize(
    "path", ["/", "/status", "/config", "/health/live", "/metrics", "/stream", "/openapi.json"]
)
def test_head_and_options_are_answered(stand: RunningService, path: str) -> None:
    answer = stand.ask("HEAD", path)
    assert (answer.status, answer.body) == (200, b"")
    allowed = stand.ask("OPTIONS", path).headers["allow"]
    assert {"GET", "HEAD", "OPTIONS"} <= set(allowed.split(", "))


def test_writes_are_logged_and_refusals_at_a_limited_rate(stand: RunningService) -> None:
    lines: list[str] = []
    gate: Any = stand.server.config.app
    old_log = gate._log
    gate._log = RequestLog(lines.append, "secret-name")
    try:
        stand.ask("PUT", "/config", stand.ask("GET", "/config").json, {"If-Match": "*"})
        assert stand.ask("POST", "/trigger", LAUNCH).status == 202
        for _ in range(20):
            stand.ask("GET", "/nowhere")
    finally:
        gate._log = old_log
    assert lines[0].startswith(
        'opir: write: 127.0.0.1, token secret-name: PUT "/config" 200, ETag "*" '
    )
    assert [line.split(":")[1].strip() for line in lines] == ["write", "write", "refused"]


def test_a_table_of_sources_is_a_file_too() -> None:
    with pytest.raises(ProblemError) as refused:
        refuse_other_names({"sources": []}, {"sources": [{"hotspots": {"csv": "/etc/passwd"}}]})
    assert refused.value.errors[0][0] == "sources[0].hotspots.csv"
