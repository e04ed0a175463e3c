"""What the service knows and does, apart from how it is asked."""

import hashlib
import threading
import time
from collections import OrderedDict
from collections.abc import Mapping
from typing import Any

import msgspec
import numpy as np
from attrs import asdict, evolve, fields

from opir_core.errors import OpirError
from opir_core.live.running import LiveRun, LiveStatus
from opir_core.output.events.text import timestamp_text
from opir_core.output.sink_thread import SinkStatus
from opir_http.confined import refuse_names, refuse_other_names
from opir_http.feed import Feed
from opir_http.problems import ProblemError, problem_of
from opir_http.settings import LIVE, HttpSettings

_KEYS = 1000
_RISES = 3

#: How far apart looks at what waits for sinks are at least, s.
LOOK_S = 1.0


class Service:
    """A run, its feed and its settings; methods that change the run are called off the event loop."""

    def __init__(self, run: LiveRun, settings: HttpSettings) -> None:
        self.run, self.settings = run, settings
        self.feed = Feed(run.plan.sensors, run.scene.epoch_us, settings.history, self.status)
        self.answers = Answers()
        self._writing = threading.Lock()
        self._waiting: dict[str, tuple[int, float, int]] = {}

    def status(self) -> dict[str, Any]:
        """Return how the simulation, its sensors and its sinks stand."""
        told, plan = self.run.status(), self.run.plan
        return {
            "scene": plan.scene.name,
            "state": told.state,
            "error": told.error,
            "clock": {
                "timestamp": self._timestamp(told.time_ns),
                "epoch": self._timestamp(0),
                "time_s": told.time_ns * 1e-9,
                "duration_s": plan.scene.duration_s,
                "speed": told.speed,
                "lap": told.lap,
                "cycle": told.cycle,
                "late_s": round(told.late_s, 6),
                "latest_s": round(told.latest_s, 6),
                "late_cycles": told.late_cycles,
            },
            "counts": {
                "looks": told.looks,
                "detections": told.detections,
                "targets": told.targets,
                "targets_launched": told.targets_launched,
                "tracks": len(self.feed.tracks),
            },
            "sensors": self._sensors(told),
            "sinks": [asdict(sink) | {"lag": _lag(sink)} for sink in told.sinks],
            "viewers": {
                "connected": self.feed.viewers,
                "dropped_frames": self.feed.dropped_frames,
                "dropped_windows": self.feed.dropped_windows,
            },
        }

    def config(self) -> dict[str, Any]:
        """Return the configuration in force: the scene's settings, and those of the service under `http`."""
        return {**self.run.settings_mapping(), "http": asdict(self.settings)}

    def etag(self) -> str:
        """Return the entity tag of the configuration in force."""
        return etag_of(self.config())

    def configure(self, wanted: Mapping[str, Any], if_match: str) -> tuple[int, str]:
        """Put a whole configuration in force, or nothing of it; return the cycle it begins with, and its tag."""
        with self._writing:
            if if_match not in ("*", self.etag()):
                raise ProblemError(412, "it is not the one of If-Match; get it again")
            scene = dict(wanted)
            refuse_other_names(self.run.settings_mapping(), scene)
            http = self._http(scene.pop("http", None))
            try:
                cycle = self.run.configure(scene)
            except OpirError as error:
                raise problem_of(error) from error
            self.settings = http
            self.run.settings = evolve(self.run.settings, maximum_targets=http.maximum_targets)
            return cycle, self.etag()

    def launch(self, block: Mapping[str, Any]) -> dict[str, Any]:
        """Add a launch to the run and return the answer to who asked."""
        refuse_names(block)
        try:
            taken = self.run.launch(block)
        except OpirError as error:
            raise problem_of(error) from error
        return {
            "id": taken.target_id,
            "time_s": taken.time_s,
            "timestamp": self._timestamp(round(taken.time_s * 1e9)),
            "cycle": taken.cycle,
        }

    def is_ready(self) -> tuple[bool, list[str]]:
        """Return whether the service does its work, and what keeps it from it."""
        told = self.run.status()
        reasons = [] if told.state in ("running", "ended") else [f"the run has {told.state}"]
        for sink in told.sinks:
            if sink.state == "failed":
                reasons.append(f"the sink {sink.path} has failed")
            elif self._grows(sink):
                reasons.append(f"what waits for the sink {sink.path} grows")
        return not reasons, reasons

    def _grows(self, sink: SinkStatus) -> bool:
        """Return whether what waits for a sink has grown at the last looks, and has not shrunk since."""
        waiting, now_s = sink.spooled + sink.queued_windows, time.monotonic()
        before, looked_s, rises = self._waiting.get(sink.path, (waiting, now_s, 0))
        if now_s - looked_s >= LOOK_S:
            rises = 0 if waiting == 0 or waiting < before else rises + (waiting > before)
            self._waiting[sink.path] = waiting, now_s, rises
        else:
            self._waiting.setdefault(sink.path, (before, looked_s, rises))
        return rises >= _RISES

    def _http(self, wanted: Any) -> HttpSettings:
        """Return settings of the service that may be put in force."""
        ours = asdict(self.settings)
        if not isinstance(wanted, Mapping) or set(wanted) != set(ours):
            raise ProblemError(422, "http has other keys than it needs", (("http", f"needs {', '.join(ours)}"),))
        errors = []
        for attribute in fields(HttpSettings):
            try:
                _checked(attribute, wanted[attribute.name])
            except (TypeError, ValueError) as error:
                errors.append((f"http.{attribute.name}", str(error)))
        if errors:
            raise ProblemError(422, "http is not valid", tuple(errors))
        fixed = tuple(
            (f"http.{key}", "needs a restart") for key in ours if key not in LIVE and wanted[key] != ours[key]
        )
        if fixed:
            raise ProblemError(409, "some settings need a restart", fixed)
        return HttpSettings(**wanted)

    def _sensors(self, told: LiveStatus) -> list[dict[str, Any]]:
        plan = self.run.plan
        moment = np.array([told.time_ns * 1e-9])
        rows = []
        for sensor, done in zip(plan.sensors, told.sensors, strict=True):
            position = sensor.orbit.position_ecef_m(moment)[0]
            period_s = sensor.scan.period_ns * 1e-9
            last_s = done.last_detection_s
            sees = last_s is not None and told.time_ns * 1e-9 - last_s <= 2.0 * period_s + 0.5
            rows.append(
                {
                    "sensor_id": sensor.id,
                    "sensor_type": sensor.type,
                    "state": "detecting" if sees else "searching",
                    "scan_period_ms": sensor.scan.period_ns * 1e-6,
                    "position_ecef_m": [round(axis, 1) for axis in position.tolist()],
                    "field_of_regard_half_angle_deg": round(
                        float(np.degrees(sensor.field_of_regard_half_angle_rad)), 4
                    ),
                    "detections": done.detections,
                    "last_detection": None if last_s is None else self._timestamp(round(last_s * 1e9)),
                }
            )
        return rows

    def _timestamp(self, time_ns: int) -> str:
        return timestamp_text(np.array([self.run.scene.epoch_us + time_ns // 1000]))[0]


class Answers:
    """Answers by idempotency key, of a bounded number of keys; a key is taken while its request is being answered."""

    def __init__(self) -> None:
        self._known: OrderedDict[str, tuple[str, dict[str, Any] | None]] = OrderedDict()

    def begin(self, key: str, body: bytes) -> dict[str, Any] | None:
        """Return the answer that a key has, or None where its request is to be answered."""
        mark = hashlib.sha256(body).hexdigest()
        known = self._known.get(key)
        if known is None:
            self._known[key] = mark, None
            while len(self._known) > _KEYS:
                self._known.popitem(last=False)
            return None
        if known[0] != mark:
            raise ProblemError(422, "the Idempotency-Key came before, with another body")
        if known[1] is None:
            raise ProblemError(409, "the request with this Idempotency-Key is being answered")
        return known[1]

    def end(self, key: str, answer: dict[str, Any] | None) -> None:
        """Keep the answer to a key, or, where there is none, let it be used again."""
        if answer is None:
            self._known.pop(key, None)
        elif key in self._known:
            self._known[key] = self._known[key][0], answer


def etag_of(config: Mapping[str, Any]) -> str:
    """Return the entity tag of a configuration."""
    text = msgspec.json.encode(config, order="sorted")
    return f'"{hashlib.sha256(text).hexdigest()[:32]}"'


def _lag(sink: SinkStatus) -> int:
    """Return how many events a sink was given, or found in its spool, that are not accounted for yet."""
    return max(0, sink.given + sink.recovered - sink.delivered - sink.dropped - sink.withheld)


def _checked(attribute: Any, value: Any) -> None:
    """Raise `ValueError` or `TypeError` where a value does not fit an attribute of the settings."""
    kinds = {bool: (bool,), int: (int,), float: (int, float), str: (str,)}
    if not isinstance(value, kinds[attribute.type]) or (attribute.type is not bool and isinstance(value, bool)):
        raise TypeError(f"is not {attribute.type.__name__}")
    if attribute.validator is not None:
        attribute.validator(None, attribute, value)
