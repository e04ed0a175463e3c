"""What the service counts, in Prometheus's text format (version 0.0.4); labels are sensor and sink ids alone."""

from collections.abc import Iterable
from typing import Any

from opir_core.live.running import LATE_EDGES_S, LiveStatus
from opir_core.output.sink_thread import SinkStatus
from opir_http.service import Service

CONTENT_TYPE = "text/plain; version=0.0.4; charset=utf-8"


def metrics_text(service: Service) -> str:
    """Return all metrics."""
    told, feed = service.run.status(), service.feed
    sensors = [({"sensor_id": sensor.id}, sensor.detections) for sensor in told.sensors]
    parts = [
        _metric("opir_up", "gauge", "1 while the run goes on", [({}, told.state in ("running", "ended"))]),
        _metric("opir_scene_time_seconds", "gauge", "Scene time reached", [({}, told.time_ns * 1e-9)]),
        _metric("opir_cycles_total", "counter", "Cycles run", [({}, told.cycle)]),
        _metric("opir_late_cycles_total", "counter", "Cycles later than a scan period", [({}, told.late_cycles)]),
        _late(told),
        _metric("opir_looks_total", "counter", "Looks judged", [({}, told.looks)]),
        _metric("opir_detections_total", "counter", "Detections made", sensors),
        _metric("opir_targets", "gauge", "Targets in the run", [({}, told.targets)]),
        _metric("opir_targets_launched_total", "counter", "Targets that ever were", [({}, told.targets_launched)]),
        _metric("opir_tracks", "gauge", "Tracks known", [({}, len(feed.tracks))]),
        _metric("opir_viewers", "gauge", "Clients of the stream", [({}, feed.viewers)]),
        _metric(
            "opir_viewer_frames_dropped_total", "counter", "Frames lost to slow clients", [({}, feed.dropped_frames)]
        ),
        *_sinks(told.sinks),
    ]
    return "".join(parts)


def _sinks(sinks: tuple[SinkStatus, ...]) -> Iterable[str]:
    counters = {
        "given": "given to",
        "delivered": "delivered by",
        "dropped": "lost by",
        "withheld": "without a message in the encoder of",
        "recovered": "found in spools of",
    }
    for name, words in counters.items():
        samples = [({"sink": sink.path}, getattr(sink, name)) for sink in sinks]
        yield _metric(f"opir_sink_events_{name}_total", "counter", f"Events {words} sinks", samples)
    gauges = {"spooled": "Events in spools", "queued_windows": "Windows that wait for sinks"}
    for name, words in gauges.items():
        yield _metric(
            f"opir_sink_{name}", "gauge", words, [({"sink": sink.path}, getattr(sink, name)) for sink in sinks]
        )
    up = [({"sink": sink.path}, float(sink.state == "open")) for sink in sinks]
    yield _metric("opir_sink_up", "gauge", "1 while the sink takes events", up)


def _late(told: LiveStatus) -> str:
    name = "opir_cycle_late_seconds"
    lines, total = [_head(name, "histogram", "How late cycles were done")], 0
    for edge, count in zip([*map(repr, LATE_EDGES_S), "+Inf"], told.late_counts, strict=True):
        total += count
        lines.append(f'{name}_bucket{{le="{edge}"}} {total}\n')
    return "".join([*lines, f"{name}_sum {told.late_total_s!r}\n{name}_count {total}\n"])


def _metric(name: str, kind: str, words: str, samples: Iterable[tuple[dict[str, str], Any]]) -> str:
    lines = [f"{name}{_labels(labels)} {float(value)!r}\n" for labels, value in samples]
    return "".join([_head(name, kind, words), *lines])


def _head(name: str, kind: str, words: str) -> str:
    return f"# HELP {name} {words}.\n# TYPE {name} {kind}\n"


def _labels(labels: dict[str, str]) -> str:
    """Return labels; ids and scene paths have no character that needs an escape."""
    inside = ",".join(f'{key}="{value}"' for key, value in labels.items())
    return f"{{{inside}}}" if inside else ""
