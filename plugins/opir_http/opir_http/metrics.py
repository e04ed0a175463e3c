"""Metrics of the service in Prometheus's text format (version 0.0.4); labels are sensor ids and
sink paths.
"""

from collections.abc import Iterable, Iterator
from typing import Any

from opir_core.live import LATE_EDGES_S, LiveStatus, SensorStatus
from opir_core.output import SinkStatus
from opir_http.service import Service

CONTENT_TYPE = "text/plain; version=0.0.4"

#: Help of the figures of sensors, by their name in the calibration of a sensor.
_SENSOR_GAUGES = {
    "clock_s": ("clock_offset_seconds", "Offset of the clock"),
    "clock_sigma_s": ("clock_offset_sigma_seconds", "Standard deviation of it"),
    "noise_scale": ("noise_ratio", "Noise of lines of sight in units of what is stated"),
    "noise_scale_sigma": ("noise_ratio_sigma", "Standard deviation of it"),
    "innovations": ("innovations", "Mean square of normalised innovations, 1 as stated"),
    "outlier_share": ("outlier_ratio", "Share of looks far off their target"),
}
_SINK_COUNTERS = {
    "given": "written to",
    "delivered": "delivered by",
    "dropped": "lost by",
    "withheld": "without a message in the encoders of",
    "recovered": "of earlier runs in the spools of",
}
_SINK_GAUGES = {
    "spooled": ("spooled", "Events in spools"),
    "queued_windows": ("queued_windows", "Windows in the queues of sinks"),
    "unbalanced": (
        "unbalanced",
        "Events by which the own figures of sinks did not add up, at most",
    ),
    "busy_s": ("busy_seconds", "Duration of the present call of sinks"),
    "attempts": ("attempts", "Failed attempts of sinks since the last success"),
}
_SINK_STATES = {
    "parked": ("parked", "1 while the destination refuses what the spool keeps"),
    "open": ("up", "1 while the sink is open"),
}


def metrics_text(service: Service) -> str:
    """Return all metrics."""
    status = service.run.status()
    return "".join(
        [
            *_run_metrics(service, status),
            *_sensor_metrics(status.sensors),
            *_sink_metrics(status.sinks),
        ]
    )


def _run_metrics(service: Service, status: LiveStatus) -> Iterator[str]:
    feed = service.feed
    health = service.health(status)
    is_up = status.state in ("running", "ended")
    yield _gauge("up", "1 while the run is alive", is_up)
    yield _gauge("ready", "1 while /health/ready answers 200", health.ready)
    yield _gauge("stuck", "1 if a cycle or a call of a sink will not end", not health.alive)
    yield _counter("pauses", "Times that the whole process did not run", health.pauses)
    yield _gauge("scene_time_seconds", "Scene time of the run", status.time_ns * 1e-9)
    yield _counter("cycles", "Cycles run", status.cycle)
    words = "Missed deadlines: cycles later than the shortest scan period"
    yield _counter("late_cycles", words, status.late_cycles)
    yield _lateness(status)
    yield _gauge("late_seconds", "How late the last cycle ended", status.late_s)
    yield _gauge("cycle_age_seconds", "Time since the last finished cycle", status.cycle_age_s)
    yield _counter("looks", "Looks processed", status.looks)
    detections = [({"sensor_id": sensor.id}, sensor.detections) for sensor in status.sensors]
    yield _metric("detections_total", "counter", "Detections", detections)
    yield _gauge("targets", "Targets in the run", status.targets)
    words = "Targets launched since the start"
    yield _counter("targets_launched", words, status.targets_launched)
    yield _gauge("tracks", "Tracks kept for clients", len(feed.tracks))
    words = "1 unless the stream failed to encode its last frame"
    yield _gauge("stream_up", words, not feed.error)
    yield _gauge("viewers", "Clients of the stream", feed.viewers)
    yield _counter("viewer_frames_dropped", "Frames lost to slow clients", feed.dropped_frames)


def _sensor_metrics(sensors: tuple[SensorStatus, ...]) -> Iterator[str]:
    """Yield the calibration of the sensors as the tracker estimates it, as far as it is known."""
    calibrations = {sensor.id: sensor.health for sensor in sensors if sensor.health is not None}
    for name, words in (("bias", "Line-of-sight bias"), ("bias_sigma", "Standard deviation of it")):
        samples = [
            ({"sensor_id": sensor, "axis": axis}, value)
            for sensor, calibration in calibrations.items()
            for axis, value in zip(("east", "north"), calibration[f"{name}_rad"], strict=True)
            if value is not None
        ]
        yield _metric(f"sensor_{name}_radians", "gauge", words, samples)
    for name, (series, words) in _SENSOR_GAUGES.items():
        values = [
            ({"sensor_id": sensor}, calibration[name])
            for sensor, calibration in calibrations.items()
            if calibration[name] is not None
        ]
        yield _metric(f"sensor_{series}", "gauge", words, values)


def _sink_metrics(sinks: tuple[SinkStatus, ...]) -> Iterator[str]:
    for name, words in _SINK_COUNTERS.items():
        values = [({"sink": sink.path}, getattr(sink, name)) for sink in sinks]
        yield _metric(f"sink_events_{name}_total", "counter", f"Events {words} sinks", values)
    for name, (series, words) in _SINK_GAUGES.items():
        values = [({"sink": sink.path}, getattr(sink, name)) for sink in sinks]
        yield _metric(f"sink_{series}", "gauge", words, values)
    for state, (series, words) in _SINK_STATES.items():
        values = [({"sink": sink.path}, sink.state == state) for sink in sinks]
        yield _metric(f"sink_{series}", "gauge", words, values)
    words = "1 while nothing gets through; /status has the reason"
    troubled = [
        ({"sink": sink.path}, sink.state != "closed" and bool(sink.error)) for sink in sinks
    ]
    yield _metric("sink_troubled", "gauge", words, troubled)


def _lateness(status: LiveStatus) -> str:
    name = "opir_cycle_late_seconds"
    lines = [_head(name, "histogram", "Lateness of cycles")]
    total = 0
    for edge, count in zip([*map(repr, LATE_EDGES_S), "+Inf"], status.late_counts, strict=True):
        total += count
        lines.append(f'{name}_bucket{{le="{edge}"}} {total}\n')
    return "".join([*lines, f"{name}_sum {status.late_total_s!r}\n{name}_count {total}\n"])


def _gauge(name: str, words: str, value: float) -> str:
    return _metric(name, "gauge", words, [({}, value)])


def _counter(name: str, words: str, value: float) -> str:
    return _metric(f"{name}_total", "counter", words, [({}, value)])


def _metric(name: str, kind: str, words: str, samples: Iterable[tuple[dict[str, str], Any]]) -> str:
    series = f"opir_{name}"
    lines = [f"{series}{_labels(labels)} {float(value)!r}\n" for labels, value in samples]
    return "".join([_head(series, kind, words), *lines])


def _head(name: str, kind: str, words: str) -> str:
    return f"# HELP {name} {words}.\n# TYPE {name} {kind}\n"


def _labels(labels: dict[str, str]) -> str:
    """Return labels; ids and paths need no escapes."""
    pairs = ",".join(f'{key}="{value}"' for key, value in labels.items())
    return f"{{{pairs}}}" if pairs else ""
