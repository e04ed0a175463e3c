"""A saved run for the page: what it held at a time, and its parts between two times."""

import math
from typing import Any

import msgspec
import numpy as np

from opir_core import Run
from opir_core.arrays import IntArray, RowArray
from opir_core.output import ForgeEncoder, chosen_renderer, timestamp_text, unix_microseconds
from opir_core.plugin import EncoderContext, Window
from opir_http.sensors import sensor_documents
from opir_http.tracks import TrackDocuments

#: Maximum number of detections in an answer; of more, every n-th is sent.
MOST_DETECTIONS = 3000
#: Maximum duration of a part, s, and maximum number of times in it for which the satellites are
#: sent.
LONGEST_S = 3600.0
_SENSOR_TIMES = 12
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
            render=chosen_renderer(run.plan.host)[1],
        )
        self._encoder = ForgeEncoder(context)
        self._documents = TrackDocuments(self.scene.epoch_us, hypotheses=run.plan.hypothesis_names)
        self._by_sensor = [
            self._time_us[self._detections.sensor == row] for row in range(len(run.sensors))
        ]
        self.since_us = self.scene.epoch_us
        last = [each[-1] for each in (self._time_us, self._tick_us) if len(each)]
        self.until_us = int(max(self.since_us + round(self.scene.duration_s * _US), *last, 0))

    def status(self) -> Document:
        """Return the status of a run that has ended, with the time that it covers under
        `replay`.
        """
        counts = self.run.summary["counts"]
        clock = dict.fromkeys(("late_s", "latest_s", "cycle_age_s"), 0.0) | dict.fromkeys(
            ("lap", "cycle", "late_cycles"), 0
        )
        return {
            "scene": self.scene.name,
            "state": "saved",
            "error": None,
            "clock": clock
            | {
                "timestamp": _text(self.until_us),
                "epoch": _text(self.since_us),
                "time_s": (self.until_us - self.since_us) / _US,
                "duration_s": self.scene.duration_s,
                "speed": None,
            },
            "counts": {
                "looks": int(counts.get("looks", 0)),
                "detections": len(self._detections),
                "targets": 0,
                "targets_launched": len(self.run.target_ids),
                "tracks": len(np.unique(self._tracks.track)),
            },
            "sensors": self._sensors(self.until_us),
            "sinks": [],
            "viewers": {"connected": 0, "dropped_frames": 0, "dropped_windows": 0},
            "replay": {"since": _text(self.since_us), "until": _text(self.until_us)},
        }

    def part(self, since_us: int, until_us: int, step_s: float) -> Document:
        """Return what the run made in (since, until]: detections, the last estimate of each track
        in each step, counts.

        Counts are of all detections of the seconds touched, also of those that are left out.
        `sensors` are states of the satellites at times of the part.
        """
        first, last = np.searchsorted(self._time_us, (since_us, until_us), side="right")
        rows = np.arange(first, last)[:: -(-int(last - first) // MOST_DETECTIONS) or 1]
        times = np.unique(np.linspace(since_us, until_us, _SENSOR_TIMES).astype(np.int64)).tolist()
        return {
            "detections": [msgspec.Raw(line) for line in self._lines(rows)],
            "tracks": self._estimates(since_us, until_us, step_s),
            "activity": self._activity(since_us, until_us),
            "sensors": [
                {"timestamp": _text(time_us), "sensors": self._sensors(time_us)}
                for time_us in times
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
        first, last = np.searchsorted(self._tick_us, (since_us, until_us), side="right")
        if first == last:
            return []
        step = (self._tick_us[first:last] - since_us) // round(step_s * _US)
        newest = {
            key: int(first) + row
            for row, key in enumerate(
                zip(self._tracks.track[first:last].tolist(), step.tolist(), strict=True)
            )
        }
        return self._documents.documents(self._tracks.take(sorted(newest.values())))

    def _activity(self, since_us: int, until_us: int) -> Document:
        seconds = np.arange(since_us // _US, until_us // _US + 2)
        counts = [
            np.diff(np.searchsorted(times, seconds * _US)).tolist() for times in self._by_sensor
        ]
        names = [sensor.id for sensor in self.run.sensors]
        return {"first_s": int(seconds[0]), "sensors": dict(zip(names, counts, strict=True))}

    def _sensors(self, time_us: int) -> list[Document]:
        counts = [int(np.searchsorted(times, time_us, side="right")) for times in self._by_sensor]
        last_s = [
            None if not count else (int(times[count - 1]) - self.since_us) / _US
            for times, count in zip(self._by_sensor, counts, strict=True)
        ]
        time_s = (time_us - self.since_us) / _US
        health = [row["health"] for row in self.run.summary["sensors"]]
        return sensor_documents(self.run.sensors, time_s, counts, last_s, self.since_us, health)


def _text(unix_us: int) -> str:
    moments: IntArray = np.array([unix_us])
    return timestamp_text(moments)[0]
