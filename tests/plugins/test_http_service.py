"""The service: every route, what it refuses and how, and who may ask."""

import http.client
import json
import os
import re
import socket
import threading
import time
from collections.abc import Iterator
from pathlib import Path
from typing import Any

import jsonschema
import pytest
from attrs import evolve
from http_stand import LAUNCH, SCENE, Stand, serving
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from opir_http import gate, server, service
from opir_http.feed import QUEUED_FRAMES, Client
from opir_http.openapi import document
from opir_http.serving import ServeError, token_of
from waiting import until

from opir_core.engine import Engine
from opir_core.events.forge import ForgeEncoder
from opir_core.plan import compile_plan
from opir_core.protocols import EncoderContext
from opir_core.reading import scene_from_mapping, scene_mapping


@pytest.fixture(scope="module")
def stand(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Stand]:
    with serving(tmp_path_factory.mktemp("stand"), "--speed", "5", "--loop") as running:
        running.service.settings = evolve(running.service.settings, writes_per_s=10_000.0)
        until(lambda: running.service.feed.history.total > 50)
        yield running


def conforms(value: Any, name: str) -> None:
    whole = document()
    jsonschema.validate(value, {"$ref": f"#/components/schemas/{name}", "components": whole["components"]})


def test_every_answer_is_what_the_document_says(stand: Stand) -> None:
    conforms(stand.ask("GET", "/status").json, "Status")
    conforms(stand.ask("GET", "/config").json, "Config")
    conforms(stand.ask("GET", "/detections?limit=20").json, "Detections")
    conforms(stand.ask("GET", "/tracks").json, "Tracks")
    conforms(stand.ask("GET", "/nothing").json, "Problem")
    conforms(LAUNCH, "Trigger")


def test_the_document_has_every_route_and_no_other(stand: Stand) -> None:
    routes = stand.server.config.app._app.routes
    ours = {(route.path, method) for route in routes for method in route.methods - {"OPTIONS"}}
    page = {("/", "GET"), ("/page/{name:str}", "GET"), ("/openapi.json", "GET")}
    told = {(path, method.upper()) for path, item in document()["paths"].items() for method in item}
    assert ours - page == told
    assert stand.ask("GET", "/openapi.json").json == json.loads(json.dumps(document()))


def test_a_launch_is_in_the_run_and_seen(stand: Stand) -> None:
    answer = stand.ask("POST", "/trigger", LAUNCH | {"id": "SEEN"})
    assert answer.status == 202
    conforms(answer.json, "Launched")
    assert answer.json["id"] == "SEEN"
    again = stand.ask("POST", "/trigger", LAUNCH | {"id": "SEEN"})
    assert (again.status, again.json["errors"][0]["path"]) == (422, "id")


def test_a_launch_gives_the_events_of_a_batch(tmp_path: Path) -> None:
    with serving(tmp_path, "--speed", "20") as running:
        launched = running.ask("POST", "/trigger", LAUNCH).json
        until(lambda: running.service.run.status().time_ns * 1e-9 > launched["time_s"] + 60)
        running.service.run._stopping.set()
        until(lambda: not running.service.run._thread.is_alive())
        reached_ns, run, feed = running.service.run.time_ns, running.service.run, running.service.feed
        until(lambda: feed.history.total == run.status().detections)
        lines = running.ask("GET", "/detections?limit=1000").body
    scene = run.scene
    block = {"id": launched["id"], **LAUNCH, "launch": LAUNCH["launch"] | {"time_s": launched["time_s"]}}
    mapping = scene_mapping(scene)
    plan = compile_plan(scene_from_mapping(mapping | {"targets": [*mapping["targets"], block]}))
    encoder = ForgeEncoder(EncoderContext(sensors=plan.sensors, epoch_us=scene.epoch_us))
    batch = encoder.encode(Engine(plan).advance(reached_ns)).splitlines()[::-1]
    assert lines.startswith(b'{"detections":[' + b",".join(batch[:1000]))


def test_an_idempotency_key_launches_once(stand: Stand) -> None:
    key = {"Idempotency-Key": "once"}
    first, second = (stand.ask("POST", "/trigger", LAUNCH, key) for _ in range(2))
    assert (first.status, second.status, second.json) == (202, 202, first.json)
    assert second.headers["idempotent-replayed"] == "true"
    other = stand.ask("POST", "/trigger", LAUNCH | {"type": "SRBM"}, key)
    assert other.status == 422
    refused = [stand.ask("POST", "/trigger", {"type": "X"}, {"Idempotency-Key": "bad"}).status for _ in range(2)]
    assert refused == [422, 422]


def test_a_configuration_changes_whole_at_a_cycle_or_not_at_all(stand: Stand) -> None:
    before = stand.ask("GET", "/config")
    tag = {"If-Match": before.headers["etag"]}
    config = before.json
    config["sensors"][0]["members"][0]["scan_period_ms"] = 400.0
    config["sensors"][0]["members"][0]["detection_probability"]["ICBM"] = 0.9
    config["confidence"] = {"model": "weighted", "band": 0.2, "count": 0.2, "geometry": 0.6}
    config["http"]["maximum_viewers"] = 200
    answer = stand.ask("PUT", "/config", config, tag)
    assert answer.status == 200, answer.body
    conforms(answer.json, "Configured")
    after = stand.ask("GET", "/config")
    assert (after.json, after.headers["etag"]) == (config, answer.headers["etag"])
    assert stand.ask("GET", "/config", headers={"If-None-Match": after.headers["etag"]}).status == 304
    assert stand.ask("PUT", "/config", config, tag).status == 412
    assert stand.ask("PUT", "/config", config).status == 428
    config["confidence"]["band"] = 0.9
    config["sensors"][0]["members"][1]["scan_period_ms"] = 800.0
    refused = stand.ask("PUT", "/config", config, {"If-Match": "*"})
    assert (refused.status, [error["path"] for error in refused.json["errors"]]) == (422, ["confidence"])
    assert stand.ask("GET", "/config").json == after.json


def test_settings_that_need_a_restart_are_refused_by_name(stand: Stand) -> None:
    config = stand.ask("GET", "/config").json
    scene = stand.ask("PUT", "/config", config | {"seed": 99, "tracker": "none", "outputs": []}, {"If-Match": "*"})
    assert scene.status == 409
    assert {error["path"] for error in scene.json["errors"]} == {"seed", "outputs"}
    http_ = stand.ask("PUT", "/config", config | {"http": config["http"] | {"port": 1}}, {"If-Match": "*"})
    assert (http_.status, http_.json["errors"]) == (409, [{"path": "http.port", "message": "needs a restart"}])


def test_pages_of_detections_follow_one_another_and_filters_hold(stand: Stand) -> None:
    total = stand.service.feed.history.total
    seen, cursor = [], ""
    for _ in range(3):
        page = stand.ask("GET", f"/detections?limit=7{cursor}").json
        seen += [event["detection_id"] for event in page["detections"]]
        cursor = f"&after={page['next']}"
    assert len(seen) == len(set(seen)) == 21
    assert total >= 21
    some = stand.ask("GET", "/detections?limit=1000&sensor_type=DSP&min_confidence=0.5&target_type=ICBM").json
    assert some["detections"]
    for event in some["detections"]:
        assert (event["sensor_type"], event["target_type"]) == ("DSP", "ICBM")
        assert event["confidence"] >= 0.5
    middle = some["detections"][len(some["detections"]) // 2]["timestamp"]
    early = stand.ask("GET", f"/detections?limit=1000&until={middle}").json["detections"]
    assert all(event["timestamp"] < middle for event in early)
    assert not stand.ask("GET", "/detections?sensor_id=NOBODY").json["detections"]


@pytest.mark.parametrize(
    ("path", "word"),
    [
        ("/detections?limit=0", "limit"),
        ("/detections?limit=1001", "limit"),
        ("/detections?limit=1&limit=2", "twice"),
        ("/detections?min_confidence=nan", "min_confidence"),
        ("/detections?since=yesterday", "since"),
        ("/detections?after=%FF", "read"),
        ("/detections?after=../..", "after"),
        ("/detections?nothing=1", "unknown"),
        ("/status?x=1", "unknown"),
        ("/stream?view=all", "view"),
    ],
)
def test_a_parameter_that_is_wrong_is_named(stand: Stand, path: str, word: str) -> None:
    answer = stand.ask("GET", path)
    assert (answer.status, answer.headers["content-type"]) == (400, "application/problem+json")
    assert word in answer.json["detail"]


BAD_BODIES = {
    "empty": (b"", 400),
    "not JSON": (b"{", 400),
    "a list": (b"[]", 422),
    "NaN": (b'{"type": NaN}', 400),
    "beyond a float": (b'{"type":"ICBM","launch":{"lat_deg":1e400,"lon_deg":0},"aim":{"lat_deg":0,"lon_deg":1}}', 422),
    "huge whole number": (b'{"type":"ICBM","launch":{"lat_deg":' + b"9" * 5000 + b"}}", 400),
    "deep": (b'{"a":' * 9000 + b"1" + b"}" * 9000, 400),
    "deep list": (b"[" * 60000, 400),
    "key twice": (b'{"type":"ICBM","type":"SRBM"}', 400),
    "not UTF-8": (b'{"type":"\xff"}', 400),
    "UTF-16": ('{"type":"ICBM"}'.encode("utf-16"), 400),
    "half a surrogate pair": (b'{"type":"\\ud800"}', 422),
    "zero byte": (b'{"id":"\\u0000"}', 422),
    "wrong types": (b'{"type":1,"launch":"here","aim":[]}', 422),
    "too large": (b'{"type":"' + b"x" * 70000 + b'"}', 413),
    "unknown model": (json.dumps(LAUNCH | {"model": "warp"}).encode(), 422),
    "unknown key": (json.dumps(LAUNCH | {"secret": 1}).encode(), 422),
}


@pytest.mark.parametrize(("body", "status"), BAD_BODIES.values(), ids=BAD_BODIES)
def test_a_body_that_is_wrong_is_refused_and_changes_nothing(stand: Stand, body: bytes, status: int) -> None:
    for method, path in (("POST", "/trigger"), ("PUT", "/config")):
        answer = stand.ask(method, path, body, {"If-Match": "*"})
        assert answer.status == status, answer.body
        conforms(answer.json, "Problem")
        assert "Traceback" not in answer.body.decode()
        assert "/work" not in answer.body.decode()
        assert ".py" not in answer.body.decode()


SECRETS = {
    "a table": {"model": "table", "type": "ICBM", "file": "/etc/passwd"},
    "a table that never ends": {"model": "table", "type": "ICBM", "file": "/dev/zero"},
    "a signature": LAUNCH | {"signature": [{"table": {"path": "/etc/passwd"}}]},
    "very deep": LAUNCH | {"signature": json.loads('{"a":' * 300 + '{"file": "x"}' + "}" * 300)},
}


@pytest.mark.parametrize("body", SECRETS.values(), ids=SECRETS)
def test_no_launch_has_a_file_of_the_machine_read(stand: Stand, body: Any) -> None:
    answer = stand.ask("POST", "/trigger", body)
    assert answer.status == 422
    assert b"root:" not in answer.body
    assert answer.json["errors"][0]["message"] == "a request names no file and no variable; a scene may"


OUTPUT = """
  - jsonl: {path: PATH, spool: {path: SPOOL}}
  - kafka:
      bootstrap_servers: "127.0.0.1:1"
      topic: t
      security: {protocol: SASL_PLAINTEXT, username: me, password_variable: OPIR_TEST_PASSWORD}
"""


def test_no_configuration_names_another_file_or_sends_a_secret_elsewhere(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("OPIR_TEST_PASSWORD", "the-word-itself")
    outputs = OUTPUT.replace("PATH", str(tmp_path / "a.jsonl")).replace("SPOOL", str(tmp_path / "spool"))
    with serving(tmp_path, scene=SCENE.replace('outputs: ["null"]', f"outputs:{outputs}")) as running:
        config = running.ask("GET", "/config")
        assert b"the-word-itself" not in config.body + running.ask("GET", "/status").body
        places = {
            "outputs[0].jsonl.path": lambda whole: whole["outputs"][0]["jsonl"].update(path=str(tmp_path / "evil")),
            "outputs[0].jsonl.spool.path": lambda whole: whole["outputs"][0]["jsonl"]["spool"].update(path="evil"),
            "outputs[1]": lambda whole: whole["outputs"][1]["kafka"].update(bootstrap_servers="evil.example:9092"),
            "outputs[1].kafka.security.password_variable": lambda whole: whole["outputs"][1]["kafka"][
                "security"
            ].update(password_variable="HOME"),
        }
        for place, change in places.items():
            wanted = config.json
            change(wanted)
            answer = running.ask("PUT", "/config", wanted, {"If-Match": "*"})
            assert (answer.status, place in [error["path"] for error in answer.json["errors"]]) == (409, True)
        assert running.ask("PUT", "/config", config.json, {"If-Match": "*"}).status == 200
        assert not list(tmp_path.glob("evil*"))


def test_a_launch_that_is_past_is_told_the_clock(stand: Stand) -> None:
    answer = stand.ask("POST", "/trigger", LAUNCH | {"launch": LAUNCH["launch"] | {"time_s": 0.0}})
    assert (answer.status, "clock is at" in answer.json["detail"]) == (409, True)


FORM = "application/x-www-form-urlencoded"


@pytest.mark.parametrize("kind", ["text/plain", f"{FORM}; charset=utf-8", "application/json; charset=latin-1", ""])
def test_other_content_types_are_refused(stand: Stand, kind: str) -> None:
    assert stand.ask("POST", "/trigger", json.dumps(LAUNCH).encode(), {"Content-Type": kind}).status == 415


@pytest.mark.parametrize(
    "header",
    [{"Origin": "https://elsewhere.example"}, {"Origin": "null"}, {"Sec-Fetch-Site": "cross-site"}],
)
def test_no_form_of_a_browser_is_taken(stand: Stand, header: dict[str, str]) -> None:
    assert stand.ask("POST", "/trigger", json.dumps(LAUNCH).encode(), {"Content-Type": FORM} | header).status == 415


def test_what_curl_posts_by_default_is_read_as_json(stand: Stand) -> None:
    assert stand.ask("POST", "/trigger", json.dumps(LAUNCH).encode(), {"Content-Type": FORM}).status == 202
    assert stand.ask("POST", "/trigger", b"type=ICBM", {"Content-Type": FORM}).status == 400


def test_other_methods_are_refused_and_no_origin_is_let_in(stand: Stand) -> None:
    for method, path in (("DELETE", "/config"), ("POST", "/status"), ("PATCH", "/config"), ("PUT", "/trigger")):
        answer = stand.ask(method, path, b"{}")
        assert answer.status == 405
        assert answer.headers["allow"]
    answer = stand.ask("GET", "/status", headers={"Origin": "https://elsewhere.example"})
    assert not [name for name in answer.headers if name.startswith("access-control")]
    assert answer.headers["x-content-type-options"] == "nosniff"
    assert "default-src 'none'" in answer.headers["content-security-policy"]


def test_options_name_the_methods_of_each_path(stand: Stand) -> None:
    for path, item in document()["paths"].items():
        answer = stand.ask("OPTIONS", path)
        assert answer.status == 204
        assert {word.strip().lower() for word in answer.headers["allow"].split(",")} == {*item, "options"}


def test_a_name_that_is_not_ours_is_not_served(stand: Stand) -> None:
    assert stand.ask("GET", "/status", headers={"Host": "rebound.example"}).status == 421


def test_metrics_are_prometheus_text_with_bounded_labels(stand: Stand) -> None:
    answer = stand.ask("GET", "/metrics")
    assert answer.headers["content-type"].startswith("text/plain; version=0.0.4")
    sample = re.compile(r'([a-z_]+)(\{(sensor_id|sink|le)="[^"\\\n]*"\})? [-+0-9.e]+(Inf)?')
    lines = [line for line in answer.body.decode().splitlines() if not line.startswith("#")]
    assert all(sample.fullmatch(line) for line in lines), lines
    assert "opir_cycle_late_seconds_bucket" in answer.body.decode()


def test_health_tells_life_from_readiness(stand: Stand) -> None:
    assert stand.ask("GET", "/health/live").json == {"state": "running"}
    assert stand.ask("GET", "/health/ready").json == {"ready": True, "reasons": []}


def test_a_sink_that_falls_behind_makes_the_service_not_ready(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(service, "LOOK_S", 0.1)
    with serving(tmp_path, "--speed", "5") as running:
        outlet = running.service.run._outlets[0]
        gate_ = threading.Event()
        outlet._sink.write = lambda _window: gate_.wait(20.0)

        def is_unready() -> bool:
            time.sleep(0.1)
            return running.ask("GET", "/health/ready").status == 503

        until(is_unready)
        assert "outputs[0] grows" in running.ask("GET", "/health/ready").json["reasons"][0]
        assert running.ask("GET", "/health/live").status == 200
        gate_.set()


def test_the_stream_brings_detections_and_status(stand: Stand) -> None:
    events = streamed(stand, "/stream?view=brief", 12)
    kinds = {kind for kind, _ in events}
    assert {"detections", "status"} <= kinds
    for kind, data in events:
        if kind == "detections":
            assert 1 <= len(data["detections"]) <= min(40, data["count"])
        if kind == "status":
            conforms(data, "Status")


def streamed(stand: Stand, path: str, count: int) -> list[tuple[str, Any]]:
    connection = http.client.HTTPConnection("127.0.0.1", stand.port, timeout=20)
    try:
        connection.request("GET", path)
        response = connection.getresponse()
        events: list[tuple[str, Any]] = []
        kind = ""
        while len(events) < count or not {"status"} <= {known for known, _ in events}:
            line = response.readline().decode().rstrip("\n")
            if line.startswith("event: "):
                kind = line[7:]
            if line.startswith("data: "):
                events.append((kind, json.loads(line[6:])))
        return events
    finally:
        connection.close()


def test_a_slow_viewer_loses_the_oldest_and_is_told() -> None:
    import asyncio

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


def test_viewers_are_bounded(tmp_path: Path) -> None:
    with serving(tmp_path) as running:
        config = running.ask("GET", "/config").json
        running.ask("PUT", "/config", config | {"http": config["http"] | {"maximum_viewers": 1}}, {"If-Match": "*"})
        with socket.create_connection(("127.0.0.1", running.port), timeout=10) as first:
            first.sendall(b"GET /stream HTTP/1.1\r\nHost: localhost\r\n\r\n")
            assert first.recv(15).startswith(b"HTTP/1.1 200")
            second = running.ask("GET", "/stream")
        assert (second.status, second.headers["retry-after"]) == (503, "5")
        until(lambda: running.service.feed.viewers == 0)


def test_too_many_writes_are_told_to_wait(tmp_path: Path) -> None:
    with serving(tmp_path) as running:
        config = running.ask("GET", "/config").json
        slower = config | {"http": config["http"] | {"writes_per_s": 0.5}}
        assert running.ask("PUT", "/config", slower, {"If-Match": "*"}).status == 200
        answers = [running.ask("POST", "/trigger", b"{}") for _ in range(4)]
        assert 429 in [answer.status for answer in answers]
        assert int(next(answer for answer in answers if answer.status == 429).headers["retry-after"]) >= 1
        assert running.ask("GET", "/status").status == 200


def test_targets_are_bounded(tmp_path: Path) -> None:
    with serving(tmp_path, "--max-targets", "2") as running:
        assert running.ask("POST", "/trigger", LAUNCH).status == 202
        refused = running.ask("POST", "/trigger", LAUNCH)
        assert (refused.status, refused.headers["retry-after"]) == (429, "1")


def test_a_token_is_needed_where_there_is_one(tmp_path: Path) -> None:
    token = "correct-horse-battery"
    with serving(tmp_path, token=token) as running:
        assert running.ask("GET", "/status").status == 401
        assert running.ask("GET", "/status", headers={"Authorization": f"Bearer {token}x"}).status == 401
        assert running.ask("GET", "/status", headers={"Authorization": f"Basic {token}"}).status == 401
        assert running.ask("GET", "/status", headers={"Authorization": f"Bearer {token}"}).status == 200
        assert running.ask("GET", "/health/live").status == 200
        assert running.ask("GET", "/").status == 200
        assert token.encode() not in running.ask("GET", "/config", headers={"Authorization": f"Bearer {token}"}).body


def test_writes_to_the_configuration_can_be_switched_off(tmp_path: Path) -> None:
    with serving(tmp_path, "--no-config-writes") as running:
        config = running.ask("GET", "/config").json
        assert running.ask("PUT", "/config", config, {"If-Match": "*"}).status == 403


def test_other_addresses_need_a_token(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    import argparse

    monkeypatch.delenv("OPIR_HTTP_TOKEN", raising=False)
    with pytest.raises(ServeError, match="bearer token"):
        token_of(argparse.Namespace(host="0.0.0.0", token_file=None))
    monkeypatch.setenv("OPIR_HTTP_TOKEN", "short")
    with pytest.raises(ServeError, match="at least 16"):
        token_of(argparse.Namespace(host="0.0.0.0", token_file=None))
    secret = tmp_path / "token"
    secret.write_text("from-a-file-of-ours\n")
    assert token_of(argparse.Namespace(host="0.0.0.0", token_file=str(secret))) == "from-a-file-of-ours"


def trickle(slow: socket.socket, words: bytes) -> None:
    for letter in words:
        slow.sendall(bytes([letter]))
        time.sleep(0.02)


def test_whoever_sends_a_letter_at_a_time_is_let_go(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(server, "HEADERS_S", 0.5)
    monkeypatch.setattr(server, "_CHECK_S", 0.1)
    monkeypatch.setattr(gate, "BODY_S", 0.5)
    with serving(tmp_path) as running:
        with socket.create_connection(("127.0.0.1", running.port), timeout=10) as slow, pytest.raises(ConnectionError):
            trickle(slow, b"GET /status HTTP/1.1\r\nHost: localhost\r\nX: " + b"y" * 200)
        with socket.create_connection(("127.0.0.1", running.port), timeout=10) as slow:
            head = b"POST /trigger HTTP/1.1\r\nHost: localhost\r\nContent-Type: application/json\r\n"
            slow.sendall(head + b"Content-Length: 100\r\n\r\n{")
            assert slow.recv(100).startswith(b"HTTP/1.1 408")
        assert running.ask("GET", "/status").status == 200


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=20),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=10), inner, max_size=4),
    max_leaves=12,
)
degrees = st.floats(-400, 400) | json_values
triggers = st.fixed_dictionaries(
    {"type": st.sampled_from(["ICBM", "IRBM", "SRBM"]) | json_values},
    optional={
        "launch": st.fixed_dictionaries({"lat_deg": degrees, "lon_deg": degrees}, optional={"time_s": degrees})
        | json_values,
        "aim": st.fixed_dictionaries({"lat_deg": degrees, "lon_deg": degrees}) | json_values,
        "id": st.text(max_size=8) | json_values,
        "burn_time_s": degrees,
        "model": json_values,
    },
)
EXAMPLES = int(os.environ.get("OPIR_FUZZ_EXAMPLES", "60"))
QUICK = settings(max_examples=EXAMPLES, deadline=None, suppress_health_check=[HealthCheck.function_scoped_fixture])


@QUICK
@given(triggers)
def test_no_launch_breaks_the_service(stand: Stand, body: Any) -> None:
    answer = stand.ask("POST", "/trigger", body)
    assert answer.status in {202, 400, 409, 422, 429}, answer.body
    conforms(answer.json, "Launched" if answer.status == 202 else "Problem")
    assert stand.service.run.status().state == "running"


@QUICK
@given(st.data())
def test_no_configuration_breaks_the_service(stand: Stand, data: st.DataObject) -> None:
    config = stand.ask("GET", "/config").json
    key = data.draw(st.sampled_from(sorted(config)))
    part = config[key]
    if isinstance(part, dict) and data.draw(st.booleans()):
        part[data.draw(st.sampled_from(sorted(part)) | st.text(max_size=5))] = data.draw(json_values)
    else:
        config[key] = data.draw(json_values)
    answer = stand.ask("PUT", "/config", config, {"If-Match": "*"})
    assert answer.status in {200, 400, 409, 422, 429}, answer.body
    assert stand.service.run.status().state == "running"
