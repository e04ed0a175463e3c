"""Heartbeats: lines among events that say which sensor watched from when to when.

Silence alone does not tell a consumer of a stream whether a sensor saw nothing or is not there.
"""

from collections.abc import Iterator, Sequence

import msgspec
import numpy as np

from opir_core.interfaces.sensors import Sensor
from opir_core.output.events.text import timestamp_text
from opir_core.planning.partial_looks import Steering, stated_sensors

VERSION = "1.0"


class Heartbeat(msgspec.Struct, frozen=True):
    """A span that a sensor watched, as a line; times are UTC."""

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
        #: Takes what became of commands to sensors, before the lines of their time.
        self.steering = Steering(sensors)

    def until(self, end_s: float) -> bytes:
        """Return the lines of the intervals that are complete at a time of the scene, s, and were
        not returned before.
        """
        self._end_s = max(self._end_s, end_s)
        complete = int(np.floor(self._end_s / self._every_s + 1e-9))
        edges_s = np.arange(self._complete, complete + 1) * self._every_s
        self._complete = complete
        return self._lines(edges_s)

    def rest(self) -> bytes:
        """Return the lines of the interval in which the run ended."""
        return self._lines(np.array([self._complete * self._every_s, self._end_s]))

    def _lines(self, edges_s: np.ndarray) -> bytes:
        """Return the lines of intervals between edges (n,), s."""
        intervals = zip(edges_s[:-1].tolist(), edges_s[1:].tolist(), strict=True)
        beats = [beat for interval in intervals for beat in self._beats(*interval)]
        return msgspec.json.Encoder().encode_lines(beats)

    def _beats(self, start_s: float, end_s: float) -> Iterator[Heartbeat]:
        """Yield the heartbeats of an interval."""
        for sensor in stated_sensors(self._sensors, self.steering.commands, end_s):
            for from_s, to_s in sensor.spans_until_s(end_s):
                span_s = np.array([max(from_s, start_s), min(to_s, end_s)])
                times_us = np.rint(span_s * 1e6).astype(np.int64) + self._epoch_us
                if times_us[0] < times_us[1]:
                    yield Heartbeat(VERSION, "heartbeat", sensor.id, *timestamp_text(times_us))
