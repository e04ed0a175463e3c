"""The summary of a run, counted window by window, so that memory does not grow with its
duration.
"""

from collections.abc import Collection, Iterable, Iterator, Mapping, Sequence
from typing import TYPE_CHECKING, Any

import numpy as np

from opir_core.arrays import IndexArray, IntArray
from opir_core.interfaces.records import Detections, DetectionTruth, Window
from opir_core.planning.partial_looks import SteeringCommands
from opir_core.planning.plan import Plan
from opir_core.planning.sightlines import Blocked, Pairs

if TYPE_CHECKING:
    from opir_core.simulation.latest_tracks import LatestTracks


def planned_work(pairs: Pairs) -> Mapping[str, Any]:
    """Return how many pairs and looks a plan has, and how many pairs it skips, by reason, as plain
    values.

    Looks that are visible throughout need no visibility test; the others are tested one by one.
    """
    looks = pairs.looks
    skipped = pairs.blocked[pairs.looks == 0]
    tested = int(looks[pairs.is_checked].sum())
    return {
        "pairs": len(looks),
        "pairs_skipped": {
            reason.name.lower(): int(np.count_nonzero(skipped == reason))
            for reason in Blocked
            if reason in skipped
        },
        "looks": int(looks.sum()),
        "looks_visible_throughout": int(looks.sum()) - tested,
        "looks_tested_for_visibility": tested,
    }


class Tally:
    """Counts looks, detections and first detections of the windows of a plan."""

    def __init__(self, plan: Plan) -> None:
        sensors = plan.sensors
        targets = plan.targets
        pairs = plan.pairs
        self._sensors = sensors
        self._targets = targets
        self._types = plan.reported_types
        self._automatic = plan.scene.automatic
        self._is_source = ~targets.is_launch
        self._work = planned_work(pairs)
        self._looks_of_sensor = np.bincount(pairs.sensor, pairs.looks, minlength=len(sensors))
        shape = len(sensors), len(targets.ids)
        self._looks = 0
        self._hypotheses = plan.hypothesis_names
        self._latest: LatestTracks | None = None
        #: Detections by target and track.
        self._held: dict[tuple[int, int], int] = {}
        #: What the tracker has found of each sensor, as plain values.
        self.health: Sequence[Mapping[str, Any]] | None = None
        self._noise = np.zeros(shape[0], dtype=np.int64)
        self._detections = np.zeros(shape, dtype=np.int64)
        self._first_s = np.full(shape, np.inf)
        self._first_report_s = np.full(shape[1], np.inf)
        self._is_delayed = plan.has_latency
        #: Reports by sensor that did not arrive; None without links.
        self.lost: IntArray | None = None
        if plan.links is not None:
            self.lost = np.zeros(shape[0], dtype=np.int64)
        #: The commands to sensors and those that were refused, of a scene with a director.
        self._commands = np.zeros(2, dtype=np.int64)
        self._is_directed = plan.make_director is not None
        self.steering = SteeringCommands(sensors)
        self._last_s = np.full(shape, -np.inf)
        self._reported = np.zeros((shape[1], len(self._types)), dtype=np.int64)
        self._confidence = np.zeros(shape[1])

    def over(self, windows: Iterable[Window]) -> Iterator[Window]:
        """Yield the windows, counting them."""
        for window in windows:
            self.count(window)
            yield window

    def count(self, window: Window) -> None:
        """Count a window."""
        self.count_sightings(window)
        self.count_types(window.detections, window.truth)

    def count_types(self, detections: Detections, truth: DetectionTruth) -> None:
        """Count the reported types and the confidences of detections."""
        rows = np.flatnonzero(truth.target >= 0)
        target = truth.target.take(rows)
        types = self._reported.shape[1]
        code = target * types + detections.reported_type.take(rows)
        self._reported += np.bincount(code, minlength=self._reported.size).reshape(-1, types)
        np.maximum.at(self._confidence, target, detections.confidence.take(rows))

    def count_sightings(self, window: Window) -> None:
        """Count a window but for its types and confidences, which are not computed for this."""
        self._looks += window.looks
        if window.health is not None:
            self.health = window.health.documents()
        if len(window.tracks):
            self._latest_tracks().take(window.tracks)
        if self.lost is not None and window.lost is not None:
            self.lost += window.lost
        refused = sum(bool(record.refusal) for record in window.commands)
        self._commands += len(window.commands), refused
        self.steering.take(window.commands)
        detections = window.detections
        target = window.truth.target
        self._count_held(target, detections.track)
        is_noise = target < 0
        columns: tuple[Any, ...] = (detections.sensor, target, detections.time_ns)
        rows = np.flatnonzero(~is_noise)
        if self._is_delayed:
            rows = rows.take(np.argsort(detections.time_ns.take(rows), kind="stable"))
            np.minimum.at(
                self._first_report_s, target.take(rows), detections.reported_ns.take(rows) * 1e-9
            )
        if is_noise.any() or self._is_delayed:
            self._noise += np.bincount(detections.sensor[is_noise], minlength=len(self._noise))
            columns = tuple(column.take(rows) for column in columns)
        self._count_looks(*columns)

    def _latest_tracks(self) -> "LatestTracks":
        if self._latest is None:
            from opir_core.simulation.latest_tracks import (
                LatestTracks,
            )  # a run without tracks does not load it

            self._latest = LatestTracks(self._hypotheses)
        return self._latest

    def _count_looks(self, sensor: IndexArray, target: IndexArray, time_ns: IntArray) -> None:
        """Count detections (n,) of targets, sorted by time."""
        sensors, targets = self._detections.shape
        pair = sensor * targets + target
        time_s = time_ns * 1e-9
        self._detections += np.bincount(pair, minlength=sensors * targets).reshape(sensors, targets)
        # The last of repeated writes stays: written backwards, it is the first detection of each
        # pair.
        first_s = np.full(sensors * targets, np.inf)
        last_s = np.full(sensors * targets, -np.inf)
        first_s[pair[::-1]] = time_s[::-1]
        last_s[pair] = time_s
        np.minimum(self._first_s, first_s.reshape(sensors, targets), out=self._first_s)
        np.maximum(self._last_s, last_s.reshape(sensors, targets), out=self._last_s)

    def _count_held(self, target: IndexArray, track: IntArray) -> None:
        """Count detections (n,) of targets by the tracks that hold them."""
        held = np.flatnonzero((track >= 0) & (target >= 0))
        if not len(held):
            return
        pair_number, count = np.unique(
            (target[held].astype(np.int64) << 32) | track[held], return_counts=True
        )
        for pair, number in zip(pair_number.tolist(), count.tolist(), strict=True):
            key = pair >> 32, pair & 0xFFFFFFFF
            self._held[key] = self._held.get(key, 0) + number

    def _track_of(self, target: int, tracks: Collection[int]) -> int | None:
        """Return the reported track with the most detections of a target, the first of equals, or
        None.
        """
        held = {
            track: number
            for (row_target, track), number in self._held.items()
            if row_target == target and track in tracks
        }
        return max(sorted(held), key=lambda track: held[track]) if held else None

    def counts(self) -> Mapping[str, int]:
        """Return the run's totals."""
        commands, refused = self._commands.tolist()
        directed = {"commands": commands, "refused_commands": refused}
        return {
            "sensors": len(self._sensors),
            "targets": int(np.count_nonzero(~self._is_source)),
            "sources": int(np.count_nonzero(self._is_source)),
            "looks": self._looks,
            "detections": int(self._detections.sum() + self._noise.sum()),
            "noise_detections": int(self._noise.sum()),
            "tracks": len(self._latest) if self._latest else 0,
            **({} if self.lost is None else {"lost_reports": int(self.lost.sum())}),
            **(directed if self._is_directed else {}),
        }

    def summary(self) -> Mapping[str, Any]:
        """Return the totals and one row per sensor, target, other hot source and track, as plain
        values.
        """
        tracks = self._latest.rows() if self._latest else []
        numbers = {row["track_id"] for row in tracks}
        return {
            "counts": self.counts(),
            "work": self._work,
            "automatic": self._automatic,
            "sensors": [
                {
                    "sensor_id": sensor.id,
                    "sensor_type": sensor.type,
                    # Those of its own settings are not those that a sensor with modes makes.
                    "looks": None if sensor.modes else int(self._looks_of_sensor[row]),
                    "reporting_mean_s": sum(stage.mean_s for stage in sensor.reporting),
                    "detections": int(self._detections[row].sum() + self._noise[row]),
                    "noise_detections": int(self._noise[row]),
                    "targets_detected": int((self._detections[row] > 0)[~self._is_source].sum()),
                    "sources_detected": int((self._detections[row] > 0)[self._is_source].sum()),
                    "health": self.health[row] if self.health else None,
                    **({} if self.lost is None else {"lost_reports": int(self.lost[row])}),
                }
                for row, sensor in enumerate(self._sensors)
            ],
            "targets": [
                {**self._target_row(row), "track_id": self._track_of(row, numbers)}
                for row in np.flatnonzero(~self._is_source).tolist()
            ],
            "sources": [
                {**self._source_row(row), "track_id": self._track_of(row, numbers)}
                for row in np.flatnonzero(self._is_source).tolist()
            ],
            "tracks": tracks,
        }

    def summary_with_types(
        self, detections: Detections, truth: DetectionTruth
    ) -> Mapping[str, Any]:
        """Return the summary with the types of all detections of the run."""
        self._reported[:] = 0
        self.count_types(detections, truth)
        return self.summary()

    def sightings(self) -> Sequence[Mapping[str, Any]]:
        """Return a row per target as in the summary, without its type, confidence and track."""
        names = {"reported_type", "highest_confidence"}
        rows = map(self._target_row, np.flatnonzero(~self._is_source).tolist())
        return [{name: row[name] for name in row if name not in names} for row in rows]

    def _target_row(self, row: int) -> Mapping[str, Any]:
        sighting = self._seen(row)
        ignition_s = float(self._targets.ignition_s[row])
        first_s = sighting["first_detection_s"]
        first_report_s = float(self._first_report_s[row]) if self._is_delayed else first_s
        return {
            "target_id": self._targets.ids[row],
            "target_type": self._targets.class_names[row],
            "ignition_s": ignition_s,
            "burnout_s": float(self._targets.burnout_s[row]),
            **sighting,
            "latency_s": None if first_s is None else first_s - ignition_s,
            "end_to_end_latency_s": None if first_s is None else first_report_s - ignition_s,
        }

    def _source_row(self, row: int) -> Mapping[str, Any]:
        """Return the row of a hot source other than a target, without an ignition."""
        return {
            "source_id": self._targets.ids[row],
            "source_type": self._targets.class_names[row],
            **self._seen(row),
        }

    def _seen(self, row: int) -> Mapping[str, Any]:
        """Return the detections of a target or source."""
        detections = self._detections[:, row]
        first_sensor = int(self._first_s[:, row].argmin())
        sighting = {
            "first_detection_s": float(self._first_s[first_sensor, row]),
            "first_sensor_id": self._sensors[first_sensor].id,
            "last_detection_s": float(self._last_s[:, row].max()),
            "reported_type": self._types[int(self._reported[row].argmax())],
            "highest_confidence": float(self._confidence[row]),
        }
        return {
            "detections": int(detections.sum()),
            "sensors": int((detections > 0).sum()),
            **(sighting if detections.any() else dict.fromkeys(sighting)),
        }
