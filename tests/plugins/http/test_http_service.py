"""The service: every route, and what its answers say."""

import http.client
import json
import os
import re
import threading
import time
from importlib.metadata import version
from pathlib import Path
from typing import Any

import pytest
import yaml
from http_service import LAUNCH, RunningService, conforms, serving
from hypothesis import HealthCheck, given, settings, strategies as st
from opir_http import health
from opir_http.routes import document
from opir_kafka.document import asyncapi_document
from waiting import until, within

from opir_core import Engine, compile_plan, scene_from_mapping
from opir_core.cli.main import main
from opir_core.output import ForgeEncoder
from opir_core.plugin import EncoderContext
from opir_core.reading import scene_mapping


def test_every_answer_is_what_the_document_says(stand: RunningService) -> None:
    conforms(stand.ask("GET", "/status").json, "Status")
    conforms(stand.ask("GET", "/config").json, "Config")
    conforms(stand.ask("GET", "/detections?limit=20").json, "Detections")
    conforms(stand.ask("GET", "/tracks").json, "Tracks")
    conforms(stand.ask("GET", "/nothing").json, "Problem")
    conforms(LAUNCH, "Trigger")


def test_the_document_has_every_route_and_no_other(stand: RunningService) -> None:
    routes = stand.server.config.app._app.routes
    paths = [(route.path.replace(":str}", "}"), route.methods - {"OPTIONS"}) for route in routes]
    ours = {(path, method) for path, methods in paths for method in methods}
    page = {("/", "GET"), ("/page/{name}", "GET"), ("/page/vendor/{name}", "GET")}
    page |= {("/openapi.json", "GET")}
    reported = {
        (path, method.upper()) for path, item in document()["paths"].items() for method in item
    }
    assert ours - page == reported
    assert stand.ask("GET", "/openapi.json").json == json.loads(json.dumps(document()))


def test_schemas_are_those_of_the_command(
    stand: RunningService, capsys: pytest.CaptureFixture[str]
) -> None:
    for encoder, kind in (("forge", "application/schema+json"), ("avro", "text/plain")):
        assert main(["schema", encoder]) == 0
        answer = stand.ask("GET", f"/schemas/{encoder}")
        assert answer.status == 200
        assert answer.headers["content-type"].startswith(kind)
        assert answer.body.decode() == capsys.readouterr().out
    unknown = stand.ask("GET", "/schemas/nothing")
    assert (unknown.status, "opir plugins" in unknown.json["detail"]) == (404, True)


def test_without_a_topic_there_is_no_document(stand: RunningService) -> None:
    answer = stand.ask("GET", "/asyncapi.yaml")
    assert (answer.status, answer.json["detail"]) == (404, "no output of this run has a topic")


def test_the_document_of_the_topic_has_the_settings_of_the_output(tmp_path: Path) -> None:
    output = '{kafka: {bootstrap_servers: "localhost:1", topic: watch, spool: {path: "%s"}}}'
    words = "--set", f"outputs=[{output % (tmp_path / 'events.spool')}]"
    with serving(tmp_path, *words) as running:
        answer = running.ask("GET", "/asyncapi.yaml")
    assert answer.headers["content-type"].startswith("application/yaml")
    document = yaml.safe_load(answer.body)
    assert document["channels"]["detections"]["address"] == "watch"
    assert document["servers"]["kafka"]["host"] == "localhost:1"
    assert document["components"] == asyncapi_document()["components"]


def test_the_status_has_the_version(stand: RunningService) -> None:
    assert stand.ask("GET", "/status").json["version"] == version("opir-core")


def test_a_launch_is_in_the_run_and_seen(stand: RunningService) -> None:
    answer = stand.ask("POST", "/trigger", LAUNCH | {"id": "SEEN"})
    assert answer.status == 202
    conforms(answer.json, "Launched")
    assert answer.json["id"] == "SEEN"
    again = stand.ask("POST", "/trigger", LAUNCH | {"id": "SEEN"})
    assert (again.status, again.json["errors"][0]["path"]) == (422, "id")


@pytest.mark.slow
def test_a_launch_gives_the_events_of_a_batch(tmp_path: Path) -> None:
    with serving(tmp_path, "--speed", "20") as running:
        launched = running.ask("POST", "/trigger", LAUNCH).json
        until(lambda: running.service.run.status().time_ns * 1e-9 > launched["time_s"] + 60)
        running.service.run._stopping.set()
        until(lambda: not running.service.run._thread.is_alive())
        reached_ns = running.service.run.time_ns
        run = running.service.run
        feed = running.service.feed
        until(lambda: feed.history.total == run.status().detections)
        lines = running.ask("GET", "/detections?limit=1000").body
    scene = run.scene
    block = {
        "id": launched["id"],
        **LAUNCH,
        "launch": LAUNCH["launch"] | {"time_s": launched["time_s"]},
    }
    mapping = scene_mapping(scene)
    plan = compile_plan(scene_from_mapping(mapping | {"targets": [*mapping["targets"], block]}))
    context = EncoderContext(sensors=plan.sensors, epoch_us=scene.epoch_us)
    encoder = ForgeEncoder(context, has_positions=True)
    batch = encoder.encode(Engine(plan).advance(reached_ns)).splitlines()[::-1]
    assert lines.startswith(b'{"detections":[' + b",".join(batch[:1000]))


def test_an_idempotency_key_launches_once(stand: RunningService) -> None:
    key = {"Idempotency-Key": "once"}
    answer, replay = (stand.ask("POST", "/trigger", LAUNCH, key) for _ in range(2))
    assert (answer.status, replay.status, replay.json) == (202, 202, answer.json)
    assert replay.headers["idempotent-replayed"] == "true"
    conflict = stand.ask("POST", "/trigger", LAUNCH | {"type": "SRBM"}, key)
    assert conflict.status == 422
    refused = [
        stand.ask("POST", "/trigger", {"type": "X"}, {"Idempotency-Key": "bad"}).status
        for _ in range(2)
    ]
    assert refused == [422, 422]


def test_a_configuration_changes_as_a_whole_or_not_at_all(stand: RunningService) -> None:
    response = stand.ask("GET", "/config")
    tag = {"If-Match": response.headers["etag"]}
    config = response.json
    config["sensors"][0]["members"][0]["scan_period_ms"] = 400.0
    config["sensors"][0]["members"][0]["detection_probability"]["ICBM"] = 0.9
    config["confidence"] = {"model": "weighted", "band": 0.2, "count": 0.2, "geometry": 0.6}
    config["http"]["maximum_viewers"] = 200
    config["http"]["maximum_tracks"] = 40
    answer = stand.ask("PUT", "/config", config, tag)
    assert answer.status == 200, answer.body
    conforms(answer.json, "Configured")
    later = stand.ask("GET", "/config")
    assert (later.json, later.headers["etag"]) == (config, answer.headers["etag"])
    assert stand.service.feed.tracks.maximum == 40
    assert (
        stand.ask("GET", "/config", headers={"If-None-Match": later.headers["etag"]}).status == 304
    )
    assert stand.ask("PUT", "/config", config, tag).status == 412
    assert stand.ask("PUT", "/config", config).status == 428
    config["confidence"]["band"] = 0.9
    config["sensors"][0]["members"][1]["scan_period_ms"] = 800.0
    refused = stand.ask("PUT", "/config", config, {"If-Match": "*"})
    assert (refused.status, [error["path"] for error in refused.json["errors"]]) == (
        422,
        ["confidence"],
    )
    assert stand.ask("GET", "/config").json == later.json


def test_settings_that_need_a_restart_are_refused_by_name(stand: RunningService) -> None:
    config = stand.ask("GET", "/config").json
    scene = stand.ask(
        "PUT", "/config", config | {"seed": 99, "tracker": "none", "outputs": []}, {"If-Match": "*"}
    )
    assert scene.status == 409
    assert {error["path"] for error in scene.json["errors"]} == {"seed", "outputs"}
    http_ = stand.ask(
        "PUT", "/config", config | {"http": config["http"] | {"port": 1}}, {"If-Match": "*"}
    )
    assert (http_.status, http_.json["errors"]) == (
        409,
        [{"path": "http.port", "message": "needs a restart"}],
    )


def test_pages_of_detections_are_in_order_and_filtered(stand: RunningService) -> None:
    total = stand.service.feed.history.total
    ids = []
    cursor = ""
    for _ in range(3):
        page = stand.ask("GET", f"/detections?limit=7{cursor}").json
        ids += [event["detection_id"] for event in page["detections"]]
        cursor = f"&after={page['next']}"
    assert len(ids) == len(set(ids)) == 21
    assert total >= 21
    page_of_dsp = stand.ask(
        "GET", "/detections?limit=1000&sensor_type=DSP&min_confidence=0.5&target_type=ICBM"
    ).json
    assert page_of_dsp["detections"]
    for event in page_of_dsp["detections"]:
        assert (event["sensor_type"], event["target_type"]) == ("DSP", "ICBM")
        assert event["confidence"] >= 0.5
    middle = page_of_dsp["detections"][len(page_of_dsp["detections"]) // 2]["timestamp"]
    earlier = stand.ask("GET", f"/detections?limit=1000&until={middle}").json["detections"]
    assert all(event["timestamp"] < middle for event in earlier)
    assert not stand.ask("GET", "/detections?sensor_id=NOBODY").json["detections"]


def test_metrics_are_prometheus_text_with_bounded_labels(stand: RunningService) -> None:
    answer = stand.ask("GET", "/metrics")
    assert answer.headers["content-type"].startswith("text/plain; version=0.0.4")
    sample = re.compile(r'([a-z_]+)(\{(sensor_id|sink|le)="[^"\\\n]*"\})? [-+0-9.e]+(Inf)?')
    lines = [line for line in answer.body.decode().splitlines() if not line.startswith("#")]
    assert all(sample.fullmatch(line) for line in lines), lines
    assert "opir_cycle_late_seconds_bucket" in answer.body.decode()


def test_unbalanced_figures_of_a_sink_are_in_the_metrics(
    stand: RunningService, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(stand.service.run._sinks[0], "unbalanced", 7)

    def samples() -> list[str]:
        text = stand.ask("GET", "/metrics").body.decode()
        return [line for line in text.splitlines() if line.startswith("opir_sink_unbalanced{")]

    until(
        lambda: samples() == ['opir_sink_unbalanced{sink="outputs[0]"} 7.0']
    )  # an answer is kept for a moment


def test_health_tells_life_from_readiness(stand: RunningService) -> None:
    assert stand.ask("GET", "/health/live").json == {"state": "running", "reasons": []}
    assert stand.ask("GET", "/health/ready").json == {"ready": True, "reasons": []}


def test_a_sink_that_falls_behind_makes_the_service_not_ready(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(health, "LOOK_S", 0.1)
    with serving(tmp_path, "--speed", "5") as running:
        outlet = running.service.run._sinks[0]
        gate_ = threading.Event()
        outlet._sink.write = lambda _window: gate_.wait(60.0)

        def is_unready() -> bool:
            time.sleep(0.1)
            return running.ask("GET", "/health/ready").status == 503

        until(is_unready)
        assert "outputs[0] grows" in running.ask("GET", "/health/ready").json["reasons"][0]
        assert running.ask("GET", "/health/live").status == 200
        gate_.set()


def test_the_stream_brings_detections_and_status(stand: RunningService) -> None:
    events = streamed(stand, "/stream?view=brief", 12)
    kinds = {kind for kind, _ in events}
    assert {"detections", "status"} <= kinds
    for kind, data in events:
        if kind == "detections":
            assert 1 <= len(data["detections"]) <= min(40, data["count"])
        if kind == "status":
            conforms(data, "Status")


def streamed(stand: RunningService, path: str, count: int) -> list[tuple[str, Any]]:
    connection = http.client.HTTPConnection("127.0.0.1", stand.port, timeout=60)

    def events() -> list[tuple[str, Any]]:
        connection.request("GET", path)
        response = connection.getresponse()
        events = list[tuple[str, Any]]()
        kind = ""
        while len(events) < count or "status" not in {name for name, _ in events}:
            line = response.readline().decode()
            assert line, "the stream has ended"
            if line.startswith("event: "):
                kind = line[7:].rstrip("\n")
            if line.startswith("data: "):
                events.append((kind, json.loads(line[6:])))
        return events

    try:
        return within(30.0, events)
    finally:
        connection.close()


json_values = st.recursive(
    st.none() | st.booleans() | st.integers() | st.floats(allow_nan=False) | st.text(max_size=20),
    lambda inner: (
        st.lists(inner, max_size=4) | st.dictionaries(st.text(max_size=10), inner, max_size=4)
    ),
    max_leaves=12,
)
degrees = st.floats(-400, 400) | json_values
triggers = st.fixed_dictionaries(
    {"type": st.sampled_from(["ICBM", "IRBM", "SRBM"]) | json_values},
    optional={
        "launch": st.fixed_dictionaries(
            {"lat_deg": degrees, "lon_deg": degrees}, optional={"time_s": degrees}
        )
        | json_values,
        "aim": st.fixed_dictionaries({"lat_deg": degrees, "lon_deg": degrees}) | json_values,
        "id": st.text(max_size=8) | json_values,
        "burn_time_s": degrees,
        "model": json_values,
    },
)
EXAMPLES = int(os.environ.get("OPIR_FUZZ_EXAMPLES", "60"))
QUICK = settings(
    max_examples=EXAMPLES,
    deadline=None,
    suppress_health_check=[HealthCheck.function_scoped_fixture],
)


@pytest.mark.slow
@QUICK
@given(triggers)
def test_no_launch_breaks_the_service(stand: RunningService, body: Any) -> None:
    answer = stand.ask("POST", "/trigger", body)
    assert answer.status in {202, 400, 409, 422, 429}, answer.body
    conforms(answer.json, "Launched" if answer.status == 202 else "Problem")
    assert stand.service.run.status().state == "running"


@pytest.mark.slow
@QUICK
@given(st.data())
def test_no_configuration_breaks_the_service(stand: RunningService, data: st.DataObject) -> None:
    config = stand.ask("GET", "/config").json
    key = data.draw(st.sampled_from(sorted(config)))
    block = config[key]
    if isinstance(block, dict) and data.draw(st.booleans()):
        block[data.draw(st.sampled_from(sorted(block)) | st.text(max_size=5))] = data.draw(
            json_values
        )
    else:
        config[key] = data.draw(json_values)
    answer = stand.ask("PUT", "/config", config, {"If-Match": "*"})
    assert answer.status in {200, 400, 409, 422, 429}, answer.body
    assert stand.service.run.status().state == "running"


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="needs a device that is always full")
def test_a_refused_output_is_reported_and_tries_again(
    tmp_path: Path,
) -> None:
    spool = {"path": str(tmp_path / "spool")}
    words = f"outputs={json.dumps([{'jsonl': {'path': '/dev/full', 'spool': spool}}])}"
    with serving(tmp_path, "--speed", "20", "--set", words) as running:
        until(lambda: running.ask("GET", "/status").json["sinks"][0]["state"] == "parked")
        reported = running.ask("GET", "/status").json
        conforms(reported, "Status")
        assert (reported["sinks"][0]["dropped"], reported["sinks"][0]["delivered"]) == (0, 0)
        assert "no space left on device" in reported["sinks"][0]["error"]
        ready = running.ask("GET", "/health/ready")
        assert ready.status == 503
        assert any("is refused and keeps its events" in reason for reason in ready.json["reasons"])
        assert b'opir_sink_parked{sink="outputs[0]"} 1' in running.ask("GET", "/metrics").body
        for name in ("jsonl", "outputs[0]"):
            answer = running.ask("POST", f"/outputs/{name}/retry")
            assert (answer.status, answer.json) == (202, {"output": name, "was_parked": True})
            conforms(answer.json, "Retried")
        missing = running.ask("POST", "/outputs/kafka/retry")
        assert missing.status == 404
        assert "give the path of one of these: outputs[0]" in missing.json["detail"]


@pytest.mark.slow
def test_the_losses_without_a_spool_are_reported_at_the_start(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    pytest.importorskip("opir_kafka")
    kafka = {"bootstrap_servers": "127.0.0.1:9", "topic": "t"}
    spool = {"path": str(tmp_path / "spool")}
    outputs = [
        {"kafka": kafka},
        {"kafka": {**kafka, "spool": spool}},
        {"jsonl": {"path": str(tmp_path / "lines")}},
    ]
    with serving(tmp_path, "--speed", "20", "--set", f"outputs={json.dumps(outputs)}") as running:
        reported = running.ask("GET", "/status").json
    assert [sink["has_spool"] for sink in reported["sinks"]] == [False, True, False]
    conforms(reported, "Status")
    (warning,) = [
        record.getMessage() for record in caplog.records if "no spool" in record.getMessage()
    ]
    assert warning.startswith("outputs[0] (kafka): no spool: what waits")
    assert "at most 64 MiB" in warning
