"""Who may ask the service, and how much: viewers, writes, targets, tokens, slow callers."""

import asyncio
import json
import socket
import time
from pathlib import Path
from types import SimpleNamespace
from typing import Any

import pytest
from http_service import LAUNCH, RunningService, serving
from opir_http import gate, server
from opir_http.feed import QUEUED_BYTES, QUEUED_FRAMES, Client, Feed, LossyQueue
from waiting import until

from opir_core.live import LiveWindow
from opir_core.plugin import EncoderContext


def test_a_full_queue_loses_the_oldest_and_counts_them() -> None:
    queue: LossyQueue[int] = LossyQueue(3)
    for number in range(10):
        queue.put(number)
    assert [queue.take(0.0) for _ in range(4)] == [7, 8, 9, None]
    assert queue.dropped == 7
    queue.close()
    assert queue.is_over


def test_a_queue_is_bounded_by_what_its_items_weigh() -> None:
    queue: LossyQueue[bytes] = LossyQueue(10, len)
    for item in (b"12345", b"1234", b"123", b"longer than the queue", b"1", b"123456789"):
        queue.put(item)
    assert [queue.take(0.0) for _ in range(3)] == [b"1", b"123456789", None]
    assert queue.dropped == 4


def test_windows_with_many_tracks_wait_in_smaller_numbers() -> None:
    def lost(tracks: int) -> int:
        feed = Feed(EncoderContext(sensors=(), epoch_us=0), 100, 10, dict)
        window: Any = SimpleNamespace(tracks=range(tracks), detections=())
        for cycle in range(40):
            feed.put(LiveWindow(window, cycle, 0, plan=None))  # type: ignore[arg-type]
        return feed.dropped_windows

    assert lost(tracks=0) == 0 < lost(tracks=100)


def test_a_slow_viewer_holds_a_bounded_number_of_bytes() -> None:
    async def view() -> tuple[int, int]:
        client = Client(brief=False)
        for _ in range(10):
            client.put(bytes(QUEUED_BYTES // 4))
        client.close()
        return client.dropped, sum([len(frame) async for frame in client.frames()])

    dropped, received = asyncio.run(view())
    assert dropped == 6
    assert QUEUED_BYTES <= received < QUEUED_BYTES + 200


def test_a_slow_viewer_loses_the_oldest_and_is_reported() -> None:
    async def view() -> list[bytes]:
        client = Client(brief=False)
        for number in range(QUEUED_FRAMES + 3):
            client.put(b"%d" % number)
        client.close()
        return [frame async for frame in client.frames()]

    frames = asyncio.run(view())
    assert frames[1] == b'event: dropped\ndata: {"frames":3}\n\n'
    assert frames[2:-1] == [b"%d" % number for number in range(3, QUEUED_FRAMES + 3)]
    assert frames[-1].startswith(b"event: end")


def test_frames_sent_again_let_others_have_their_turn() -> None:
    async def turns() -> list[str]:
        order = list[str]()

        async def view(name: str) -> None:
            client = Client(brief=False)
            client.backlog = (b"%d" % number for number in range(3))
            client.close()
            async for frame in client.frames():
                if frame.isdigit():
                    order.append(name)

        await asyncio.gather(view("a"), view("b"))
        return order

    assert asyncio.run(turns()) == ["a", "b"] * 3


def test_viewers_are_bounded(tmp_path: Path) -> None:
    with serving(tmp_path) as running:
        config = running.ask("GET", "/config").json
        running.ask(
            "PUT",
            "/config",
            config | {"http": config["http"] | {"maximum_viewers": 1}},
            {"If-Match": "*"},
        )
        with socket.create_connection(("127.0.0.1", running.port), timeout=60) as viewer:
            viewer.sendall(b"GET /stream HTTP/1.1\r\nHost: localhost\r\n\r\n")
            assert viewer.recv(15).startswith(b"HTTP/1.1 200")
            refused = running.ask("GET", "/stream")
        assert (refused.status, refused.headers["retry-after"]) == (503, "5")
        until(lambda: running.service.feed.viewers == 0)


@pytest.mark.parametrize(("rate", "longest_s"), [(0.5, 3), (0.01, 101)])
def test_too_many_writes_are_reported_to_wait(tmp_path: Path, rate: float, longest_s: int) -> None:
    with serving(tmp_path) as running:
        config = running.ask("GET", "/config").json
        slower = config | {"http": config["http"] | {"writes_per_s": rate}}
        assert running.ask("PUT", "/config", slower, {"If-Match": "*"}).status == 200
        refused = [running.ask("POST", "/trigger", b"{}") for _ in range(4)][-1]
        assert refused.status == 429
        assert 1 <= int(refused.headers["retry-after"]) <= longest_s
        assert running.ask("GET", "/status").status == 200


def test_targets_are_bounded(tmp_path: Path) -> None:
    with serving(tmp_path, "--max-targets", "2") as running:
        assert running.ask("POST", "/trigger", LAUNCH).status == 202
        refused = running.ask("POST", "/trigger", LAUNCH)
        assert (refused.status, refused.headers["retry-after"]) == (429, "1")


def test_a_service_with_a_token_asks_for_it(tmp_path: Path) -> None:
    token = "correct-horse-battery"
    with serving(tmp_path, token=token) as running:
        for words, status in (("Bearer {}x", 401), ("Basic {}", 401), ("Bearer {}", 200)):
            headers = {"Authorization": words.format(token)}
            answer = running.ask("GET", "/config", headers=headers)
            assert answer.status == status
            assert token.encode() not in answer.body
        for path, status in (("/status", 401), ("/health/live", 200), ("/", 200)):
            assert running.ask("GET", path).status == status


def test_writes_to_the_configuration_can_be_switched_off(tmp_path: Path) -> None:
    with serving(tmp_path, "--no-config-writes") as running:
        config = running.ask("GET", "/config").json
        assert running.ask("PUT", "/config", config, {"If-Match": "*"}).status == 403


def trickle(slow: socket.socket, words: bytes) -> None:
    for letter in words:
        slow.sendall(bytes([letter]))
        time.sleep(0.02)


@pytest.mark.slow
def test_whoever_sends_a_letter_at_a_time_is_let_go(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(server, "HEADERS_S", 0.5)
    monkeypatch.setattr(server, "_CHECK_S", 0.1)
    monkeypatch.setattr(gate, "BODY_S", 0.5)
    with serving(tmp_path) as running:
        with (
            socket.create_connection(("127.0.0.1", running.port), timeout=60) as slow,
            pytest.raises(ConnectionError),
        ):
            trickle(slow, b"GET /status HTTP/1.1\r\nHost: localhost\r\nX: " + b"y" * 2000)
        with socket.create_connection(("127.0.0.1", running.port), timeout=60) as slow:
            head = (
                b"POST /trigger HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
            )
            slow.sendall(head + b"Content-Length: 100\r\n\r\n{")
            assert slow.recv(100).startswith(b"HTTP/1.1 408")
        assert running.ask("GET", "/status").status == 200


def test_only_a_configuration_of_too_much_work_is_refused(
    stand: RunningService,
) -> None:
    answer = stand.ask("GET", "/config")
    config = answer.json
    tag = answer.headers["etag"]
    fatal = json.loads(json.dumps(config))
    fatal["sensors"][0]["members"][0]["scan_period_ms"] = 1e-6
    refused = stand.ask("PUT", "/config", fatal, {"If-Match": tag})
    assert refused.status == 422
    assert [error["path"] for error in refused.json["errors"]] == ["sensors[0].scan_period_ms"]
    refused = stand.ask("PUT", "/config", fatal | {"allow_implausible": True}, {"If-Match": tag})
    assert (refused.status, refused.json["errors"][0]["path"]) == (422, "limits.looks_per_run")
    assert "lengthen scan_period_ms of DSP-1" in refused.json["errors"][0]["message"]
    slow = {**config, "http": config["http"] | {"writes_per_s": 5e-324}}
    refused = stand.ask("PUT", "/config", slow, {"If-Match": tag})
    assert (refused.status, refused.json["errors"][0]["path"]) == (422, "http.writes_per_s")
    assert stand.ask("PUT", "/config", config, {"If-Match": tag}).status == 200
