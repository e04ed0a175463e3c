"""Batches have spans, and their messages the header `traceparent`, where the process has a tracer."""

import subprocess
import sys
from concurrent.futures import Future
from typing import Any

import pytest
from opentelemetry import trace
from opentelemetry.sdk.trace import TracerProvider
from opentelemetry.sdk.trace.export import SimpleSpanProcessor
from opentelemetry.sdk.trace.export.in_memory_span_exporter import InMemorySpanExporter
from opentelemetry.trace import StatusCode
from opentelemetry.trace.propagation.tracecontext import TraceContextTextMapPropagator
from opir_kafka.lanes import Shipment
from spool_transports import ENCODER, SENSORS, window

from opir_core.output.spool.batches import EncodedBatcher


@pytest.fixture
def spans(monkeypatch: pytest.MonkeyPatch) -> InMemorySpanExporter:
    """Return where the spans of this test are, without a provider for other tests."""
    exporter = InMemorySpanExporter()
    provider = TracerProvider()
    provider.add_span_processor(SimpleSpanProcessor(exporter))
    monkeypatch.setattr(trace, "get_tracer", provider.get_tracer)
    return exporter


class Appended:
    """A batch of aiokafka that notes the headers of its messages."""

    def __init__(self) -> None:
        self.headers: list[dict[str, bytes]] = []

    def append(self, *, headers: list[tuple[str, bytes]], **_: Any) -> bool:
        self.headers.append(dict(headers))
        return True


def sent(future: "Future[None]") -> list[dict[str, bytes]]:
    """Put a batch of ten messages and return their headers."""
    shipment = Shipment(next(EncodedBatcher(ENCODER, SENSORS).batches(window(10))), future)
    batch = Appended()
    assert shipment.put(batch, list(range(10)), None) == 10
    return batch.headers


def test_messages_name_the_span_of_their_batch_which_ends_with_it(
    spans: InMemorySpanExporter,
) -> None:
    future: Future[None] = Future()
    headers = sent(future)
    assert len({each["traceparent"] for each in headers}) == 1
    assert spans.get_finished_spans() == ()
    future.set_result(None)
    (span,) = spans.get_finished_spans()
    carrier = {"traceparent": headers[0]["traceparent"].decode()}
    read = trace.get_current_span(TraceContextTextMapPropagator().extract(carrier))
    assert read.get_span_context().span_id == span.context.span_id
    assert read.get_span_context().trace_id == span.context.trace_id
    assert span.kind is trace.SpanKind.PRODUCER
    assert span.attributes["messaging.system"] == "kafka"
    assert span.attributes["messaging.batch.message_count"] == 10
    assert span.status.status_code is StatusCode.UNSET


@pytest.mark.parametrize("end", [Future.cancel, lambda each: each.set_exception(OSError("lost"))])
def test_a_batch_that_is_not_delivered_is_an_error(end: Any, spans: InMemorySpanExporter) -> None:
    future: Future[None] = Future()
    sent(future)
    end(future)
    (span,) = spans.get_finished_spans()
    assert span.status.status_code is StatusCode.ERROR


def test_without_a_provider_there_is_no_header() -> None:
    assert all("traceparent" not in each for each in sent(Future()))


def test_without_the_sdk_nothing_of_it_is_imported() -> None:
    program = (
        "import sys\nfrom concurrent.futures import Future\n"
        "from opir_kafka.telemetry import trace_headers\n"
        "assert trace_headers([], Future()) == []\n"
        "assert not [name for name in sys.modules if name.startswith('opentelemetry')]"
    )
    subprocess.run([sys.executable, "-c", program], check=True, timeout=60)
