"""The service: status, configuration, launches and readiness, independent of HTTP."""

import hashlib
import threading
from collections import OrderedDict
from collections.abc import Iterator, Mapping
from typing import Any

import msgspec
import numpy as np
from attrs import asdict, evolve, fields
from msgspec import UnsetType

from opir_core import Scene, __version__
from opir_core.errors import OpirError
from opir_core.geometry import geodetic_to_ecef
from opir_core.host import Watchdog
from opir_core.live import LiveRun, LiveStatus, SensorTask
from opir_core.output import chosen_renderer
from opir_core.plugin import EncoderContext, EventEncoder, SinkModel
from opir_http.answers import (
    Clock,
    CountsAnswer,
    Health,
    LaunchedAnswer,
    Retried,
    SensorState,
    SinkState,
    Status,
    Task,
    TaskedAnswer,
    Viewers,
)
from opir_http.feed import Feed
from opir_http.health import Backlogs, lag
from opir_http.problems import ProblemError, problem_of
from opir_http.reading import merged, refuse_names, refuse_other_names
from opir_http.sensors import pointing_of, sensor_states, timestamp
from opir_http.settings import LIVE, HttpSettings


def _heartbeat_s(scene: Scene) -> float | None:
    """Return the shortest interval of heartbeats of a scene's outputs, None without one."""
    given = [getattr(choice.config, "heartbeat_s", None) for choice in scene.outputs]
    return min((interval for interval in given if interval is not None), default=None)


class Service:
    """A run, its feed and its settings; methods that change the run are called off the event
    loop.
    """

    def __init__(self, run: LiveRun, settings: HttpSettings) -> None:
        self.run = run
        self.settings = settings
        self.feed = Feed(
            EncoderContext(
                sensors=run.plan.sensors,
                epoch_us=run.scene.epoch_us,
                reported_types=run.plan.reported_types,
                paths=run.plan.link_paths,
                render=chosen_renderer(run.plan.host)[1],
            ),
            settings.history,
            settings.maximum_tracks,
            self.status,
            run.plan.hypothesis_names,
            _heartbeat_s(run.plan.scene),
        )
        self.answers = Answers()
        self._writing = threading.Lock()
        self._backlogs = Backlogs()
        #: Watches the run while it is served.
        self.watchdog: Watchdog | None = None

    def status(self) -> Status:
        """Return state and counts of the simulation, its sensors and its sinks."""
        live = self.run.status()
        scene = self.run.plan.scene
        return Status(
            version=__version__,
            scene=scene.name,
            state=live.state,  # type: ignore[arg-type]
            error=live.error or live.tracker_error,
            health=self.health(live),
            clock=Clock(
                timestamp=self._timestamp(live.time_ns),
                epoch=self._timestamp(0),
                time_s=live.time_ns * 1e-9,
                duration_s=scene.duration_s,
                speed=live.speed,
                lap=live.lap,
                cycle=live.cycle,
                late_s=round(live.late_s, 6),
                latest_s=round(live.latest_s, 6),
                late_cycles=live.late_cycles,
                cycle_age_s=round(live.cycle_age_s, 6),
            ),
            counts=CountsAnswer(
                looks=live.looks,
                detections=live.detections,
                targets=live.targets,
                targets_launched=live.targets_launched,
                tracks=len(self.feed.tracks),
            ),
            sensors=self._sensor_states(live),
            sinks=[SinkState(**asdict(sink), lag=lag(sink)) for sink in live.sinks],
            viewers=Viewers(
                connected=self.feed.viewers,
                dropped_frames=self.feed.dropped_frames,
                dropped_windows=self.feed.dropped_windows,
            ),
        )

    def _sensor_states(self, live: LiveStatus) -> list[SensorState]:
        sensors = self.run.plan.sensors
        epoch_us = self.run.scene.epoch_us
        states = sensor_states(
            sensors,
            live.time_ns * 1e-9,
            [sensor.detections for sensor in live.sensors],
            [sensor.last_detection_s for sensor in live.sensors],
            epoch_us,
            [sensor.health for sensor in live.sensors],
        )
        for sensor, status, state in zip(sensors, live.sensors, states, strict=True):
            state.pointing = pointing_of(sensor, status, epoch_us)
        return states

    def config(self) -> dict[str, Any]:
        """Return the present configuration: the scene's settings, and those of the service under
        `http`.
        """
        return {**self.run.settings_mapping(), "http": asdict(self.settings)}

    def etag(self) -> str:
        """Return the entity tag of the present configuration."""
        return etag_of(self.config())

    def configuration_bytes(self) -> int:
        """Return the size of the present configuration."""
        return len(msgspec.json.encode(self.config()))

    def configure(
        self, settings: Mapping[str, Any], if_match: str, *, is_patch: bool = False
    ) -> tuple[int, str]:
        """Apply a configuration, as a whole or not at all; return its first cycle and its entity
        tag. Of a patch (RFC 7396) only what it names changes.
        """
        with self._writing:
            present = self.config()
            if if_match not in ("*", etag_of(present)):
                raise ProblemError(412, "the configuration is not that of If-Match; get it again")
            scene = dict(merged(present, settings) if is_patch else settings)
            refuse_other_names(self.run.settings_mapping(), scene)
            http = self._http(scene.pop("http", None))
            try:
                cycle = self.run.configure(scene)
            except OpirError as error:
                raise problem_of(error) from error
            self.settings = http
            self.feed.tracks.maximum = http.maximum_tracks
            self.run.settings = evolve(self.run.settings, maximum_targets=http.maximum_targets)
            return cycle, self.etag()

    def launch(self, block: Mapping[str, Any]) -> LaunchedAnswer:
        """Add a launch to the run and return the answer."""
        refuse_names(block)
        try:
            launched = self.run.launch(block)
        except OpirError as error:
            raise problem_of(error) from error
        return LaunchedAnswer(
            id=launched.target_id,
            time_s=launched.time_s,
            timestamp=self._timestamp(round(launched.time_s * 1e9)),
            cycle=launched.cycle,
        )

    def task(self, sensor_id: str, task: Task) -> TaskedAnswer:
        """Have a sensor do a task, with neither place nor track what the director commands; return
        the answer.
        """
        if sensor_id not in [sensor.id for sensor in self.run.plan.sensors]:
            raise ProblemError(404, f"there is no sensor {sensor_id!r}")
        place_m = None
        if not isinstance(task.place_deg, UnsetType):
            latitude_rad, longitude_rad = np.radians(task.place_deg)
            place_m = geodetic_to_ecef(latitude_rad, longitude_rad, 0.0)
        track = -1 if isinstance(task.track_id, UnsetType) else task.track_id
        try:
            record = self.run.task(
                SensorTask(sensor=sensor_id, position_ecef_m=place_m, track=track, mode=task.mode)
            )
        except OpirError as error:
            raise problem_of(error) from error
        if record.refusal:
            raise ProblemError(409, record.refusal)
        starts = record.start_s == record.start_s  # nan is not itself
        return TaskedAnswer(
            sensor_id=sensor_id,
            track_id=None if record.track < 0 else record.track,
            time_s=record.time_s,
            start_s=record.start_s if starts else None,
            from_s=record.from_s if starts else None,
        )

    def retry(self, output: str) -> Retried:
        """Let an output that its destination refuses try again at once."""
        try:
            return Retried(output, self.run.retry_output(output))
        except OpirError as error:
            raise ProblemError(404, str(error)) from error

    def schema(self, encoder: str) -> str:
        """Return the schema of an encoder's messages."""
        for name in self.run.host.names(EventEncoder):
            model = self.run.host.component(EventEncoder, name)
            if name == encoder and model.schema is not None:
                return model.schema()
        raise ProblemError(404, f"no event encoder {encoder!r} has a schema: opir plugins")

    def asyncapi(self) -> str:
        """Return the AsyncAPI document of the first output that has a topic."""
        for output in self.run.plan.scene.outputs:
            model = self.run.host.component(SinkModel, output.name)
            if model.asyncapi is not None:
                return model.asyncapi(output.config)
        raise ProblemError(404, "no output of this run has a topic")

    def health(self, live: LiveStatus | None = None) -> Health:
        """Return the health of the service: the same for every route, the metrics and the log."""
        live = live or self.run.status()
        progress = self.run.progress()
        state = "the run is starting" if live.state == "starting" else f"the run has {live.state}"
        reasons = [] if live.state in ("running", "ended") else [state]
        reasons += progress.delays
        if self.feed.error is not None:
            reasons.append(f"the stream has failed: {self.feed.error}")
        reasons += [reason for sink in live.sinks if (reason := self._backlogs.reason(sink))]
        stuck = ["the run has failed"] if live.state == "failed" else list(progress.stuck)
        watchdog = self.watchdog
        return Health(
            ready=not reasons,
            alive=not stuck,
            reasons=reasons,
            stuck=stuck,
            beat_age_s=round(live.cycle_age_s, 6),
            pauses=0 if watchdog is None else watchdog.pauses,
            longest_pause_s=0.0 if watchdog is None else round(watchdog.longest_pause_s, 3),
        )

    def _http(self, block: Any) -> HttpSettings:
        """Return the service's new settings; raises `ProblemError` if they are invalid or need a
        restart.
        """
        present = asdict(self.settings)
        if not isinstance(block, Mapping) or set(block) != set(present):
            raise ProblemError(
                422, "http has missing or unknown keys", (("http", f"needs {', '.join(present)}"),)
            )
        if errors := tuple(_errors(block)):
            raise ProblemError(422, "http is not valid", errors)
        fixed = tuple(
            (f"http.{key}", "needs a restart")
            for key, value in present.items()
            if key not in LIVE and block[key] != value
        )
        if fixed:
            raise ProblemError(409, "some settings need a restart", fixed)
        return HttpSettings(**block)

    def _timestamp(self, time_ns: int) -> str:
        return timestamp(self.run.scene.epoch_us + time_ns // 1000)


def _errors(block: Mapping[str, Any]) -> Iterator[tuple[str, str]]:
    """Yield path and message of each setting of the service that is not valid."""
    kinds: Any = {bool: bool, int: int, float: (int, float), str: str}
    for attribute in fields(HttpSettings):
        value = block[attribute.name]
        kind: Any = attribute.type
        path = f"http.{attribute.name}"
        if not isinstance(value, kinds[kind]) or isinstance(value, bool) != (kind is bool):
            yield path, f"is not {kind.__name__}"
        elif attribute.validator is not None:
            try:
                attribute.validator(None, attribute, value)
            except (TypeError, ValueError) as error:
                yield path, str(error)


class Answers:
    """Answers by idempotency key, for a bounded number of keys; a key is reserved while its request
    is processed.
    """

    def __init__(self) -> None:
        self._answers: OrderedDict[str, tuple[str, LaunchedAnswer | None]] = OrderedDict()

    def begin(self, key: str, body: bytes) -> LaunchedAnswer | None:
        """Return the answer of a key; None reserves the key for this request."""
        mark = hashlib.sha256(body).hexdigest()
        previous = self._answers.get(key)
        if previous is None:
            self._answers[key] = mark, None
            while len(self._answers) > 1000:
                self._answers.popitem(last=False)
            return None
        if previous[0] != mark:
            raise ProblemError(422, "the Idempotency-Key was used before, with another body")
        if previous[1] is None:
            raise ProblemError(409, "the request with this Idempotency-Key is being processed")
        return previous[1]

    def end(self, key: str, answer: LaunchedAnswer | None) -> None:
        """Keep the answer of a key; without an answer, release the key."""
        if answer is None:
            self._answers.pop(key, None)
        elif key in self._answers:
            self._answers[key] = self._answers[key][0], answer


def etag_of(config: Mapping[str, Any]) -> str:
    """Return the entity tag of a configuration."""
    text = msgspec.json.encode(config, order="sorted")
    return f'"{hashlib.sha256(text).hexdigest()[:32]}"'
