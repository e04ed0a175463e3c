"""Spans of a live run's windows by OpenTelemetry, where its environment says where they go."""

import os
import threading
import time
from collections.abc import Callable
from typing import Any

from opir_core import __version__
from opir_core.host import warn
from opir_core.live import LiveWindow

#: Environment variables of which one names the receiver (OpenTelemetry protocol exporter).
_ENDPOINTS = ("OTEL_EXPORTER_OTLP_TRACES_ENDPOINT", "OTEL_EXPORTER_OTLP_ENDPOINT")
_NAME = "OTEL_SERVICE_NAME"

#: Time for the last spans to be sent when the service ends, s.
_LAST_S = 0.5


def span_provider() -> Any | None:
    """Return a provider of spans, which also those who only know the API use from now on.

    None if the environment names no receiver, switches the SDK off, or the SDK is not installed.
    """
    is_off = os.environ.get("OTEL_SDK_DISABLED", "").lower() == "true"
    if is_off or not any(os.environ.get(name) for name in _ENDPOINTS):
        return None
    try:
        from opentelemetry import trace
        from opentelemetry.exporter.otlp.proto.http.trace_exporter import OTLPSpanExporter
        from opentelemetry.sdk.resources import Resource
        from opentelemetry.sdk.trace import TracerProvider
        from opentelemetry.sdk.trace.export import BatchSpanProcessor
    except ImportError:
        warn("no spans: a receiver is set, but not installed is opir-http[telemetry]")
        return None
    resource = Resource.create({"service.name": os.environ.get(_NAME, "opir")})
    provider = TracerProvider(resource=resource, shutdown_on_exit=False)
    provider.add_span_processor(BatchSpanProcessor(OTLPSpanExporter()))
    trace.set_tracer_provider(provider)
    return provider


def window_spans(provider: Any, then: Callable[[LiveWindow], None]) -> Callable[[LiveWindow], None]:
    """Return a function that makes the span of a window, then calls another."""
    tracer = provider.get_tracer("opir", __version__)

    def put(live: LiveWindow) -> None:
        end_ns = time.time_ns()
        start_ns = end_ns - (time.monotonic_ns() - live.begun_ns)
        attributes = {
            "opir.cycle": live.cycle,
            "opir.lap": live.lap,
            "opir.scene_time_s": live.window.end_s,
            "opir.detections": len(live.window.detections),
            "opir.tracks": len(live.window.tracks),
        }
        tracer.start_span("window", start_time=start_ns, attributes=attributes).end(end_ns)
        then(live)

    return put


def end_spans(provider: Any) -> None:
    """Send the last spans, as far as the receiver takes them in time."""
    ending = threading.Thread(target=provider.shutdown, name="opir-spans", daemon=True)
    ending.start()
    ending.join(_LAST_S)
