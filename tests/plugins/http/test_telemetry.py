"""Spans of `opir serve` arrive at a receiver as OpenTelemetry's own messages; and only if asked for."""

import os
import signal
import subprocess
import sys
import threading
from collections.abc import Iterator
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from pathlib import Path
from typing import Any

import kafka_broker
import pytest
from http_service import SCENE
from opentelemetry.proto.collector.trace.v1.trace_service_pb2 import ExportTraceServiceRequest
from opir_http.telemetry import span_provider
from waiting import until

ENDPOINT = "OTEL_EXPORTER_OTLP_ENDPOINT"


class Receiver(ThreadingHTTPServer):
    """A receiver of spans on the loopback; `services` has the resources that sent them."""

    def __init__(self) -> None:
        super().__init__(("127.0.0.1", 0), _Receiving)
        self.spans: list[Any] = []
        self.services: set[str] = set()

    def take(self, body: bytes) -> None:
        for resource in ExportTraceServiceRequest.FromString(body).resource_spans:
            names = {each.key: each.value.string_value for each in resource.resource.attributes}
            self.services.add(names["service.name"])
            for scope in resource.scope_spans:
                self.spans.extend(scope.spans)

    def named(self, name: str) -> list[Any]:
        return [span for span in self.spans if span.name == name]


class _Receiving(BaseHTTPRequestHandler):
    server: Receiver

    def do_POST(self) -> None:
        assert self.path == "/v1/traces"
        self.server.take(self.rfile.read(int(self.headers["Content-Length"])))
        self.send_response(200)
        self.end_headers()

    def log_message(self, *_: Any) -> None:
        """Print nothing."""


@pytest.fixture
def receiver() -> Iterator[Receiver]:
    with Receiver() as running:
        threading.Thread(target=running.serve_forever, daemon=True).start()
        yield running
        running.shutdown()


@pytest.fixture(scope="module")
def broker() -> Iterator[Any]:
    with kafka_broker.broker() as made:
        yield made


def attributes(span: Any) -> dict[str, Any]:
    return {
        each.key: getattr(each.value, each.value.WhichOneof("value")) for each in span.attributes
    }


@pytest.mark.slow
def test_windows_and_deliveries_arrive_and_messages_name_their_delivery(
    receiver: Receiver, broker: Any, tmp_path: Path
) -> None:
    topic = broker.topic()
    (tmp_path / "scene.yaml").write_text(SCENE, encoding="utf-8")
    kafka = f'{{bootstrap_servers: "{broker.address}", topic: {topic}}}'
    words = ["scene.yaml", "--port", "0", "--set", f"outputs=[{{kafka: {kafka}}}]"]
    environment = {**os.environ, ENDPOINT: f"http://127.0.0.1:{receiver.server_port}"}
    command = [sys.executable, "-m", "opir_core", "serve", *words, "--speed", "20"]
    service = subprocess.Popen(
        command, cwd=tmp_path, env=environment, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE
    )
    try:
        until(lambda: receiver.named("window") and receiver.named("send"), within_s=60.0)
    finally:
        service.send_signal(signal.SIGTERM)
        _, errors = service.communicate(timeout=60.0)
    assert service.returncode == 0, errors
    assert receiver.services == {"opir"}
    windows = receiver.named("window")
    cycles = [attributes(span)["opir.cycle"] for span in windows]
    assert cycles == sorted(cycles)
    assert all(span.end_time_unix_nano > span.start_time_unix_nano for span in windows)
    assert all(attributes(span)["opir.scene_time_s"] > 0 for span in windows)
    sends = {(span.trace_id, span.span_id): span for span in receiver.named("send")}
    named = {
        dict(each.headers())["traceparent"] for each in kafka_broker.messages(broker.address, topic)
    }
    parts = [header.decode().split("-") for header in named]
    assert {(bytes.fromhex(part[1]), bytes.fromhex(part[2])) for part in parts} == set(sends)
    counts = [attributes(span)["messaging.batch.message_count"] for span in sends.values()]
    assert sum(counts) == len(kafka_broker.messages(broker.address, topic))


@pytest.mark.parametrize(
    "setting", [{}, {ENDPOINT: "http://127.0.0.1:1", "OTEL_SDK_DISABLED": "true"}]
)
def test_spans_are_off_unless_a_receiver_is_named(
    setting: dict[str, str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.delenv(ENDPOINT, raising=False)
    for name, value in setting.items():
        monkeypatch.setenv(name, value)
    assert span_provider() is None


def test_a_receiver_without_the_sdk_is_a_warning(
    monkeypatch: pytest.MonkeyPatch, caplog: pytest.LogCaptureFixture
) -> None:
    monkeypatch.setenv(ENDPOINT, "http://127.0.0.1:1")
    monkeypatch.setitem(sys.modules, "opentelemetry.sdk.trace", None)
    assert span_provider() is None
    assert "opir-http[telemetry]" in caplog.text
