"""Metrics of the service in Prometheus's text format (version 0.0.4); labels are sensor ids and
sink paths.
"""

from collections.abc import Iterable
from typing import Any

from opir_core.live import LATE_EDGES_S, LiveStatus, SensorStatus
from opir_core.output import SinkStatus
from opir_http.answers import Health
from opir_http.service import Service

CONTENT_TYPE = "text/plain; version=0.0.4"


def metrics_text(service: Service) -> str:
    """Return all metrics."""
    status = service.run.status()
    feed = service.feed
    health = service.health(status)
    sensors = [({"sensor_id": sensor.id}, sensor.detections) for sensor in status.sensors]
    parts = [
        _metric(
            "opir_up",
            "gauge",
            "1 while the run is alive",
            [({}, status.state in ("running", "ended"))],
        ),
        *_judged(health),
        _metric(
            "opir_scene_time_seconds",
            "gauge",
            "Scene time of the run",
            [({}, status.time_ns * 1e-9)],
        ),
        _metric("opir_cycles_total", "counter", "Cycles run", [({}, status.cycle)]),
        _metric(
            "opir_late_cycles_total",
            "counter",
            "Missed deadlines: cycles later than the shortest scan period",
            [({}, status.late_cycles)],
        ),
        _late(status),
        _metric(
            "opir_late_seconds", "gauge", "How late the last cycle ended", [({}, status.late_s)]
        ),
        _metric(
            "opir_cycle_age_seconds",
            "gauge",
            "Time since the last finished cycle",
            [({}, status.cycle_age_s)],
        ),
        _metric("opir_looks_total", "counter", "Looks processed", [({}, status.looks)]),
        _metric("opir_detections_total", "counter", "Detections", sensors),
        _metric("opir_targets", "gauge", "Targets in the run", [({}, status.targets)]),
        _metric(
            "opir_targets_launched_total",
            "counter",
            "Targets launched since the start",
            [({}, status.targets_launched)],
        ),
        _metric("opir_tracks", "gauge", "Tracks kept for clients", [({}, len(feed.tracks))]),
        _metric(
            "opir_stream_up",
            "gauge",
            "1 unless the stream failed to encode its last frame",
            [({}, not feed.error)],
        ),
        _metric("opir_viewers", "gauge", "Clients of the stream", [({}, feed.viewers)]),
        _metric(
            "opir_viewer_frames_dropped_total",
            "counter",
            "Frames lost to slow clients",
            [({}, feed.dropped_frames)],
        ),
        *_health(status.sensors),
        *_sinks(status.sinks),
    ]
    return "".join(parts)


def _judged(health: Health) -> Iterable[str]:
    """Yield the health of the service."""
    yield _metric("opir_ready", "gauge", "1 while /health/ready answers 200", [({}, health.ready)])
    yield _metric(
        "opir_stuck",
        "gauge",
        "1 if a cycle or a call of a sink will not end",
        [({}, not health.alive)],
    )
    yield _metric(
        "opir_pauses_total",
        "counter",
        "Times that the whole process did not run",
        [({}, health.pauses)],
    )


def _health(sensors: tuple[SensorStatus, ...]) -> Iterable[str]:
    """Yield what the tracker has found of the sensors, as far as it is known."""
    known = [(sensor.id, sensor.health) for sensor in sensors if sensor.health is not None]
    for name, words in {
        "bias": "Line-of-sight bias",
        "bias_sigma": "Standard deviation of it",
    }.items():
        samples = [
            ({"sensor_id": each, "axis": axis}, value)
            for each, health in known
            for axis, value in zip(("east", "north"), health[f"{name}_rad"], strict=True)
            if value is not None
        ]
        yield _metric(f"opir_sensor_{name}_radians", "gauge", words, samples)
    gauges = {
        "clock_s": ("clock_offset_seconds", "Offset of the clock"),
        "clock_sigma_s": ("clock_offset_sigma_seconds", "Standard deviation of it"),
        "noise_scale": ("noise_ratio", "Noise of lines of sight in units of what is stated"),
        "noise_scale_sigma": ("noise_ratio_sigma", "Standard deviation of it"),
        "innovations": ("innovations", "Mean square of normalised innovations, 1 as stated"),
        "outlier_share": ("outlier_ratio", "Share of looks far off their target"),
    }
    for name, (series, words) in gauges.items():
        found = [
            ({"sensor_id": each}, health[name])
            for each, health in known
            if health[name] is not None
        ]
        yield _metric(f"opir_sensor_{series}", "gauge", words, found)


def _sinks(sinks: tuple[SinkStatus, ...]) -> Iterable[str]:
    counters = {
        "given": "written to",
        "delivered": "delivered by",
        "dropped": "lost by",
        "withheld": "without a message in the encoders of",
        "recovered": "of earlier runs in the spools of",
    }
    for name, words in counters.items():
        samples = [({"sink": sink.path}, getattr(sink, name)) for sink in sinks]
        yield _metric(f"opir_sink_events_{name}_total", "counter", f"Events {words} sinks", samples)
    gauges = {
        "spooled": "Events in spools",
        "queued_windows": "Windows in the queues of sinks",
        "unbalanced": "Events by which the own figures of sinks did not add up, at most",
        "busy_s": "Duration of the present call of sinks",
        "attempts": "Failed attempts of sinks since the last success",
    }
    for name, words in gauges.items():
        series = name.replace("busy_s", "busy_seconds")
        yield _metric(
            f"opir_sink_{series}",
            "gauge",
            words,
            [({"sink": sink.path}, getattr(sink, name)) for sink in sinks],
        )
    parked = [({"sink": sink.path}, float(sink.state == "parked")) for sink in sinks]
    yield _metric(
        "opir_sink_parked", "gauge", "1 while the destination refuses what the spool keeps", parked
    )
    up = [({"sink": sink.path}, float(sink.state == "open")) for sink in sinks]
    yield _metric("opir_sink_up", "gauge", "1 while the sink is open", up)


def _late(status: LiveStatus) -> str:
    name = "opir_cycle_late_seconds"
    lines = [_head(name, "histogram", "Lateness of cycles")]
    total = 0
    for edge, count in zip([*map(repr, LATE_EDGES_S), "+Inf"], status.late_counts, strict=True):
        total += count
        lines.append(f'{name}_bucket{{le="{edge}"}} {total}\n')
    return "".join([*lines, f"{name}_sum {status.late_total_s!r}\n{name}_count {total}\n"])


def _metric(name: str, kind: str, words: str, samples: Iterable[tuple[dict[str, str], Any]]) -> str:
    lines = [f"{name}{_labels(labels)} {float(value)!r}\n" for labels, value in samples]
    return "".join([_head(name, kind, words), *lines])


def _head(name: str, kind: str, words: str) -> str:
    return f"# HELP {name} {words}.\n# TYPE {name} {kind}\n"


def _labels(labels: dict[str, str]) -> str:
    """Return labels; ids and paths need no escapes."""
    inside = ",".join(f'{key}="{value}"' for key, value in labels.items())
    return f"{{{inside}}}" if inside else ""
