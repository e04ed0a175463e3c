"""A saved run for the page: its state at a time, and its parts between two times."""

import math
from typing import Any

import msgspec
import numpy as np

from opir_core import Run, __version__
from opir_core.arrays import RowArray
from opir_core.output import ForgeEncoder, chosen_renderer, unix_microseconds
from opir_core.plugin import EncoderContext, Window
from opir_http.answers import (
    ActivityAnswer,
    Clock,
    CountsAnswer,
    Covered,
    SensorState,
    SensorStatesAnswer,
    Status,
    Viewers,
)
from opir_http.sensors import sensor_states, timestamp
from opir_http.tracks import TrackDocuments

#: Maximum number of detections in an answer; of more, every n-th is sent.
MOST_DETECTIONS = 3000
_US = 1_000_000

Document = dict[str, Any]


class Replay:
    """A saved run; times are Unix microseconds."""

    def __init__(self, run: Run) -> None:
        self.run = run
        self.scene = run.plan.scene
        order = np.argsort(run.detections.time_ns, kind="stable")
        self._detections = run.detections.take(order)
        self._truth = run.truth.take(order)
        self._time_us = unix_microseconds(self._detections.time_ns, self.scene.epoch_us)
        self._tracks = run.tracks.take(np.argsort(run.tracks.tick_s, kind="stable"))
        self._tick_us = self.scene.epoch_us + np.rint(self._tracks.tick_s * _US).astype(np.int64)
        context = EncoderContext(
            sensors=tuple(run.sensors),
            epoch_us=self.scene.epoch_us,
            reported_types=tuple(run.reported_types),
            paths=run.plan.link_paths,
            render=chosen_renderer(run.plan.host)[1],
        )
        self._encoder = ForgeEncoder(context, has_positions=True)
        self._documents = TrackDocuments(self.scene.epoch_us, hypotheses=run.plan.hypothesis_names)
        self._by_sensor = [
            self._time_us[self._detections.sensor == row] for row in range(len(run.sensors))
        ]
        self.since_us = self.scene.epoch_us
        last_us = [times[-1] for times in (self._time_us, self._tick_us) if len(times)]
        self.until_us = int(max(self.since_us + round(self.scene.duration_s * _US), *last_us, 0))

    def status(self) -> Status:
        """Return the status of a run that has ended, with the time that it covers under
        `replay`.
        """
        looks = self.run.summary["counts"].get("looks", 0)
        return Status(
            version=__version__,
            scene=self.scene.name,
            state="saved",
            error=None,
            clock=Clock(
                timestamp=timestamp(self.until_us),
                epoch=timestamp(self.since_us),
                time_s=(self.until_us - self.since_us) / _US,
                duration_s=self.scene.duration_s,
                speed=None,
            ),
            counts=CountsAnswer(
                looks=int(looks),
                detections=len(self._detections),
                targets=0,
                targets_launched=len(self.run.target_ids),
                tracks=len(np.unique(self._tracks.track)),
            ),
            sensors=self._sensors(self.until_us),
            sinks=[],
            viewers=Viewers(),
            replay=Covered(timestamp(self.since_us), timestamp(self.until_us)),
        )

    def part(self, since_us: int, until_us: int, step_s: float) -> Document:
        """Return the results of the run in (since, until]: detections, the last estimate of each
        track in each step, counts.

        Counts are of all detections of the seconds touched, also of those that are left out.
        `sensors` are states of the satellites at times of the part.
        """
        start, stop = np.searchsorted(self._time_us, (since_us, until_us), side="right")
        rows = np.arange(start, stop)[:: -(-int(stop - start) // MOST_DETECTIONS) or 1]
        times = np.unique(np.linspace(since_us, until_us, 12).astype(np.int64)).tolist()
        return {
            "detections": [msgspec.Raw(line) for line in self._lines(rows)],
            "tracks": self._estimates(since_us, until_us, step_s),
            "activity": self._activity(since_us, until_us),
            "sensors": [
                SensorStatesAnswer(timestamp(time_us), self._sensors(time_us)) for time_us in times
            ],
        }

    def _lines(self, rows: RowArray) -> list[bytes]:
        if not len(rows):
            return []
        window = Window(
            start_s=0.0,
            end_s=math.inf,
            looks=0,
            detections=self._detections.take(rows),
            truth=self._truth.take(rows),
            tracks=self.run.tracks.take([]),
            estimates=self.run.estimates,
        )
        return self._encoder.encode(window).splitlines()

    def _estimates(self, since_us: int, until_us: int, step_s: float) -> list[Document]:
        start, stop = np.searchsorted(self._tick_us, (since_us, until_us), side="right")
        if start == stop:
            return []
        steps = (self._tick_us[start:stop] - since_us) // round(step_s * _US)
        keys = zip(self._tracks.track[start:stop].tolist(), steps.tolist(), strict=True)
        newest = {key: row for row, key in enumerate(keys, int(start))}
        return self._documents.documents(self._tracks.take(sorted(newest.values())))

    def _activity(self, since_us: int, until_us: int) -> ActivityAnswer:
        seconds = np.arange(since_us // _US, until_us // _US + 2)
        counts = [
            np.diff(np.searchsorted(times, seconds * _US)).tolist() for times in self._by_sensor
        ]
        names = [sensor.id for sensor in self.run.sensors]
        return ActivityAnswer(int(seconds[0]), dict(zip(names, counts, strict=True)))

    def _sensors(self, time_us: int) -> list[SensorState]:
        counts = [int(np.searchsorted(times, time_us, side="right")) for times in self._by_sensor]
        last_s = [
            None if not count else (int(times[count - 1]) - self.since_us) / _US
            for times, count in zip(self._by_sensor, counts, strict=True)
        ]
        time_s = (time_us - self.since_us) / _US
        health = [row["health"] for row in self.run.summary["sensors"]]
        return sensor_states(self.run.sensors, time_s, counts, last_s, self.since_us, health)
