"""Heartbeats: lines among events that say which sensor watched from when to when.

Silence alone does not tell a consumer of a stream whether a sensor saw nothing or is not there.
"""

from collections.abc import Iterator, Sequence
from typing import Any

import msgspec
import numpy as np

from opir_core.interfaces.records import Batch, CommandRecord
from opir_core.interfaces.sensors import Sensor
from opir_core.output.events.text import timestamp_text
from opir_core.planning.partial_looks import SteeringCommands, stated_sensors
from opir_core.reading.format_versions import HEARTBEAT_FORMAT

VERSION = HEARTBEAT_FORMAT.version

_encode_lines = msgspec.json.Encoder().encode_lines


class Heartbeat(msgspec.Struct, frozen=True):
    """A span that a sensor watched, whatever it saw; times are RFC 3339, UTC."""

    schema_version: str
    record: str
    sensor_id: str
    watched_from: str
    watched_to: str


class Heartbeats:
    """The heartbeats of a run, one for each sensor and interval of `every_s` in which it watches.

    The intervals begin with the run: the lines do not depend on its windows.
    """

    def __init__(self, sensors: Sequence[Sensor], epoch_us: int, every_s: float) -> None:
        self._sensors = sensors
        self._epoch_us = epoch_us
        self._every_s = every_s
        self._complete = 0
        self._end_s = 0.0
        self._steering = SteeringCommands(sensors)

    def until(self, end_s: float, commands: Sequence[CommandRecord] = ()) -> bytes:
        """Return the lines of the intervals that are complete at a time of the scene, s, and were
        not returned before; `commands` are what became of those to sensors since the last call.
        """
        return _encode_lines(self._until(end_s, commands))

    def rest(self) -> bytes:
        """Return the lines of the interval in which the run ended."""
        return _encode_lines(self._rest())

    def batches_until(
        self, end_s: float, commands: Sequence[CommandRecord] = ()
    ) -> Iterator[Batch]:
        """Yield what `until` returns as a batch keyed by the sensors' ids, if there are any."""
        return self._batches(self._until(end_s, commands))

    def last_batches(self) -> Iterator[Batch]:
        """Yield what `rest` returns, likewise."""
        return self._batches(self._rest())

    def _until(self, end_s: float, commands: Sequence[CommandRecord]) -> list[Heartbeat]:
        self._steering.take(commands)
        self._end_s = max(self._end_s, end_s)
        complete = int(np.floor(self._end_s / self._every_s + 1e-9))
        edges_s = np.arange(self._complete, complete + 1) * self._every_s
        self._complete = complete
        beats = self._between(edges_s)
        self._steering.forget(complete * self._every_s)
        return beats

    def _rest(self) -> list[Heartbeat]:
        return self._between(np.array([self._complete * self._every_s, self._end_s]))

    def _between(self, edges_s: np.ndarray) -> list[Heartbeat]:
        """Return the heartbeats of intervals between edges (n,), s."""
        intervals = zip(edges_s[:-1].tolist(), edges_s[1:].tolist(), strict=True)
        return [beat for interval in intervals for beat in self._beats(*interval)]

    def _batches(self, beats: Sequence[Heartbeat]) -> Iterator[Batch]:
        if beats:
            ids, key_of = np.unique([beat.sensor_id for beat in beats], return_inverse=True)
            yield Batch(
                body=_encode_lines(beats),
                keys=tuple(ids.tolist()),
                key_of=key_of.astype(np.uint16),
                content_type="application/json",
                schema_version=f"{HEARTBEAT_FORMAT.name}-{VERSION}",
            )

    def _beats(self, start_s: float, end_s: float) -> Iterator[Heartbeat]:
        """Yield the heartbeats of an interval."""
        for sensor in stated_sensors(self._sensors, self._steering.commands, end_s):
            for from_s, to_s in sensor.spans_until_s(end_s):
                span_s = np.array([max(from_s, start_s), min(to_s, end_s)])
                times_us = np.rint(span_s * 1e6).astype(np.int64) + self._epoch_us
                if times_us[0] < times_us[1]:
                    yield Heartbeat(VERSION, "heartbeat", sensor.id, *timestamp_text(times_us))


def heartbeat_schema() -> dict[str, Any]:
    """Return the JSON Schema of a heartbeat, open for later minor versions."""
    _, definitions = msgspec.json.schema_components([Heartbeat])
    return definitions["Heartbeat"]
