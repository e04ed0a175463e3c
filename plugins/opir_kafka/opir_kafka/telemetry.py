"""Spans of batches by OpenTelemetry, where the process has its SDK."""

import sys
from concurrent.futures import Future
from functools import partial
from typing import Any

from opir_core.plugin import Batch


def trace_headers(batch: Batch, future: "Future[None]") -> list[tuple[str, bytes]]:
    """Begin the span of a batch, which ends with its future; return the headers that name it.

    They are those of W3C Trace Context, none without the SDK.
    """
    if "opentelemetry.sdk.trace" not in sys.modules:
        return []
    from opentelemetry import trace
    from opentelemetry.trace.propagation.tracecontext import TraceContextTextMapPropagator

    attributes: dict[str, str | int] = {
        "messaging.system": "kafka",
        "messaging.operation.name": "send",
        "messaging.batch.message_count": len(batch),
    }
    tracer = trace.get_tracer("opir")
    span = tracer.start_span("send", kind=trace.SpanKind.PRODUCER, attributes=attributes)
    future.add_done_callback(partial(_end, span))
    carrier = dict[str, str]()
    TraceContextTextMapPropagator().inject(carrier, trace.set_span_in_context(span))
    return [(name, text.encode()) for name, text in carrier.items()]


def _end(span: Any, future: "Future[None]") -> None:
    from opentelemetry.trace import StatusCode

    if future.cancelled() or future.exception() is not None:
        span.set_status(StatusCode.ERROR)
    span.end()
