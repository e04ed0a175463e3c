"""Forms of requests and answers: absolute targets, encoded bodies, one charset, and a stream that
goes on.
"""

import asyncio
import gzip
import http.client
import json
import socket
from pathlib import Path
from types import SimpleNamespace

import jsonschema
import numpy as np
import pytest
from http_service import LAUNCH, SCENE, RunningService, conforms, serving
from opir_http.feed import SENT_AGAIN, Client
from opir_http.gate import in_origin_form
from opir_http.history import History
from waiting import until


def lines_of(count, start=0):
    return [b"%d" % number for number in range(start, start + count)]


def detections(count):
    names = ("track", "confidence", "reported_type", "sensor")
    return SimpleNamespace(**{name: np.zeros(count, np.int64) for name in names})


def history(counts, size=8):
    stored = History(size)
    for count in counts:
        stored.add(detections(count), np.zeros(count, np.int64), lines_of(count, stored.total))
    return stored


@pytest.mark.parametrize(
    ("number", "lines", "lost"),
    [
        (0, lines_of(8, 12), 12),
        (12, lines_of(8, 12), 0),
        (18, lines_of(2, 18), 0),
        (20, [], 0),
    ],
)
def test_what_came_after_a_number_is_in_the_history(number, lines, lost):
    stored = history([5, 5, 10])
    assert stored.between(number, 20, None) == (lines, lost)
    # Part by part it is the same; what a part has lost is skipped.
    parts = []
    while number < 20:
        part, skipped = stored.between(number, 20, 3)
        assert len(part) <= 3
        assert skipped == (0 if parts else lost)
        parts += part
        number += skipped + len(part)
    assert parts == lines


def raw(stand, target, host="localhost", more=""):
    with socket.create_connection(("127.0.0.1", stand.port), timeout=60) as connection:
        connection.sendall(
            f"GET {target} HTTP/1.1\r\nHost: {host}\r\nConnection: close\r\n{more}\r\n".encode()
        )
        answer = b""
        while chunk := connection.recv(65536):
            answer += chunk
    head, _, body = answer.partition(b"\r\n\r\n")
    return int(head.split()[1]), head.decode("latin-1").lower(), body


def test_an_absolute_target_is_that_of_its_path(stand: RunningService) -> None:
    status, _, body = raw(stand, f"http://localhost:{stand.port}/health/live")
    assert (status, json.loads(body)["state"]) == (200, "running")
    assert raw(stand, f"http://localhost:{stand.port}")[0] == 200
    assert raw(stand, f"HTTP://localhost:{stand.port}/detections?limit=1")[0] == 200
    # Its authority counts, not the header: another host is refused as ever.
    assert raw(stand, "http://elsewhere.example/status")[0] == 421
    assert raw(stand, f"http://localhost:{stand.port}/status", host="elsewhere.example")[0] == 200


def test_other_targets_stay_as_they_are():
    scope = {"path": "/a://b", "headers": [(b"host", b"x")]}
    assert in_origin_form(scope) is scope
    assert in_origin_form({**scope, "path": "ftp://b/c"})["path"] == "ftp://b/c"


@pytest.mark.parametrize("encoding", ["gzip", "br", "identity, gzip"])
def test_an_encoded_body_is_refused(stand: RunningService, encoding: str) -> None:
    body = gzip.compress(json.dumps(LAUNCH).encode())
    headers = {"Content-Type": "application/json", "Content-Encoding": encoding}
    answer = stand.ask("POST", "/trigger", body, headers)
    assert (answer.status, answer.headers["accept-encoding"]) == (415, "identity")
    plain = json.dumps(LAUNCH).encode()
    assert (
        stand.ask("POST", "/trigger", plain, headers | {"Content-Encoding": "Identity"}).status
        == 202
    )


@pytest.mark.parametrize(
    "target", ["/", "/metrics", "/page/table.js", "/health/live", "/openapi.json"]
)
def test_every_answer_has_one_charset(stand: RunningService, target: str) -> None:
    status, head, _ = raw(stand, target)
    (kind,) = [line for line in head.split("\r\n") if line.startswith("content-type:")]
    assert status == 200
    assert kind.count("charset") == (0 if "json" in kind else 1)


def frames_of(stand, count, number=None):
    """Return the id and the ids of detections of the first frames of detections of a stream."""
    with socket.create_connection(("127.0.0.1", stand.port), timeout=60) as connection:
        more = "" if number is None else f"Last-Event-ID: {number}\r\n"
        connection.sendall(f"GET /stream HTTP/1.1\r\nHost: localhost\r\n{more}\r\n".encode())
        text = b""
        frames = []
        while len(frames) < count:
            text += connection.recv(65536)
            # Chunks are one frame each, with their length in hexadecimal before them.
            frames = [
                chunk
                for chunk in text.split(b"\r\n")
                if b"event: detections" in chunk and chunk.endswith(b"\n\n")
            ]
    rows = []
    for frame in frames:
        values = dict(line.split(b": ", 1) for line in frame.strip().split(b"\n"))
        data = json.loads(values[b"data"])
        rows.append(
            (int(values[b"id"]), [row["detection_id"] for row in data["detections"]], data["cycle"])
        )
    return rows


def test_a_stream_goes_on_after_the_last_event_that_arrived(tmp_path: Path) -> None:
    with serving(tmp_path) as running:
        frames = frames_of(running, 3)
        ids = [name for _, names, _ in frames for name in names]
        number = frames[1][0]
        resumed = frames_of(running, 2, number)
        assert resumed[0][2] is None
        assert resumed[0][1][: len(frames[2][1])] == frames[2][1]
        assert not set(resumed[0][1]) & set(ids[: -len(frames[2][1])])
        assert resumed[1][0] > resumed[0][0]
        assert not set(resumed[1][1]) & set(resumed[0][1])
        # An id of another run, or what is none, begins a stream as without it.
        assert frames_of(running, 1, 10**9)[0][2] is not None
        assert frames_of(running, 1, "x")[0][2] is not None


def events_of(stand, kinds, number):
    """Return the events of a stream after a number, as its schema has them, until there is one of
    each kind.
    """
    connection = http.client.HTTPConnection("127.0.0.1", stand.port, timeout=60)
    connection.request("GET", "/stream", headers={"Last-Event-ID": str(number)})
    response = connection.getresponse()
    events = []
    fields = {}
    while not kinds <= {event["event"] for event in events}:
        key, _, value = response.readline().decode().rstrip("\n").partition(": ")
        if key in ("id", "data"):
            fields[key] = json.loads(value)
        elif key == "event":
            fields[key] = value
        elif not key and fields:
            events.append(fields)
            fields = {}
    connection.close()
    return events


def test_every_frame_conforms_to_the_schema_of_the_stream(tmp_path: Path) -> None:
    scene = SCENE + "tracker: kepler-arc\n"
    with serving(tmp_path, "--speed", "20", "--history", "100", scene=scene) as running:
        until(lambda: running.service.feed.history.total > 200)
        events = events_of(running, {"dropped", "detections", "tracks", "status"}, number=1)
    assert [event["event"] for event in events[:2]] == ["dropped", "detections"]
    assert events[1]["data"]["cycle"] is None
    for event in [
        *events,
        {"event": "end", "data": {}},
        {"event": "dropped", "data": {"frames": 3}},
    ]:
        conforms(event, "StreamEvent")


@pytest.mark.parametrize(
    "event",
    [
        {"event": "other", "data": {}},
        {"event": "end", "data": {"more": 1}},
        {"event": "dropped", "data": {"frames": "3"}},
        {"event": "detections", "data": {"cycle": 1, "time_s": 1.0, "count": 0, "detections": []}},
    ],
)
def test_what_is_no_frame_does_not_conform(event) -> None:
    with pytest.raises(jsonschema.ValidationError):
        conforms(event, "StreamEvent")


def test_a_viewer_that_does_not_read_holds_no_detections(tmp_path: Path) -> None:
    with serving(tmp_path) as running:
        feed = running.service.feed
        total = 2 * SENT_AGAIN + 10
        feed.history = history([total], 10_000)

        async def resumed(brief):
            client = Client(brief=brief)
            feed.resume(client, 0)
            feed.leave(client)
            # Nothing waits; each frame is made when the one before is sent.
            assert client._frames.take(0.0) is None
            return [json.loads(text.split(b"data: ")[1]) for text in client.backlog]

        full = asyncio.run(resumed(False))
        (brief,) = asyncio.run(resumed(True))
        assert [part["count"] for part in full] == [SENT_AGAIN, SENT_AGAIN, 10]
        assert [line for part in full for line in part["detections"]] == list(range(total))
        assert brief["count"] == total
        assert len(brief["detections"]) <= 40


def test_frames_on_their_way_are_not_sent_twice(tmp_path: Path) -> None:
    with serving(tmp_path) as running:
        feed = running.service.feed

        async def seen():
            client = Client(brief=False)
            feed.resume(client, 0)
            total = client.seen
            feed._fan_out(
                [(total, b"old", b"old"), (total + 1, b"new", b"new"), (0, b"status", b"status")]
            )
            client.close()
            return [
                frame async for frame in client.frames() if frame in (b"old", b"new", b"status")
            ]

        frames_of(running, 1)
        assert asyncio.run(seen()) == [b"new", b"status"]
