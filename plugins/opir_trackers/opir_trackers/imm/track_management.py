"""Track management: the track table, track deletion, and duplicate tracks of one target.

Two tracks are duplicates if their states agree within their covariances and no recent scan detected
both: two targets are detected in one scan sooner or later, one target never twice.
"""

from collections.abc import Sequence

import numpy as np
from attrs import evolve, frozen
from numpy.typing import ArrayLike
from opir_estimation import LinesOfSight

from opir_core.arrays import FloatArray, IndexArray, IntArray
from opir_core.interfaces import Columns
from opir_core.plugin import Sensor
from opir_trackers.imm.outliers import FRACTIONS

#: Least number of scans with a detection before two tracks count as duplicates.
ENOUGH_SCANS = 4


@frozen(eq=False, repr=False)
class SharedDetections(Columns):
    """Recent detections by track number, sensor, scan and time: one row each."""

    number: IntArray
    sensor: IndexArray
    scan: IntArray
    time_s: FloatArray

    @classmethod
    def empty(cls) -> "SharedDetections":
        """Return an empty record."""
        none = np.empty(0, dtype=np.int64)
        return cls(none, none.astype(np.int32), none, np.empty(0))

    def after(
        self,
        number: IntArray,
        owner: IntArray,
        lines: LinesOfSight,
        time_s: float,
        memory_s: FloatArray,
    ) -> "SharedDetections":
        """Return the detections of a slice that ends at `time_s`, and earlier ones within
        `memory_s` (sensors,).

        `owner` (m,) is the row, in `number`, of the track of each line, -1 for none.
        """
        owned = np.flatnonzero(owner >= 0)
        detections = SharedDetections(
            number[owner[owned]], lines.sensor[owned], lines.scan[owned], lines.time_s[owned]
        )
        old = np.flatnonzero(self.time_s > time_s - memory_s[self.sensor])
        return (
            SharedDetections.concatenate([self.take(old), detections]) if len(old) else detections
        )


def sighting_memory_s(period_s: FloatArray, slice_s: float, scans: int) -> FloatArray:
    """Return how long (sensors,) detections are kept: for `scans` scans of sensors with few scans
    per slice.
    """
    return np.where(ENOUGH_SCANS * period_s > slice_s, scans * period_s, 0.0)


#: Detection probability of sensors that state none.
UNSTATED = 0.8


@frozen(eq=False, repr=False)
class TrackTable(Columns):
    """Properties of tracks besides their estimates, one row each.

    Number, start, first and last detection, and hit count. `outliers` (n, fractions) is the log
    likelihood of the outlier fractions (`outliers`); `reports` (n, sensors) are the types that each
    sensor last reported, codes into `REPORTED_TYPES`, -1 for none; `launch` (n, 3) and
    `launch_covariance` (n, 3, 3) are as in `Tracks`.
    """

    number: IntArray
    begun_s: FloatArray
    first_s: FloatArray
    seen_s: FloatArray
    hits: IntArray
    outliers: FloatArray
    reports: IntArray
    launch: FloatArray
    launch_covariance: FloatArray

    @classmethod
    def of(cls, sensors: int) -> "TrackTable":
        """Return the table of no tracks."""
        none = np.empty(0, dtype=np.int64)
        return cls.fresh(none, 0.0, sensors)

    @classmethod
    def fresh(cls, number: IntArray, now_s: float, sensors: int) -> "TrackTable":
        """Return the table of new tracks."""
        count = len(number)
        return cls(
            number=number,
            begun_s=np.full(count, now_s),
            first_s=np.full(count, np.inf),
            seen_s=np.full(count, -np.inf),
            hits=np.zeros(count, dtype=np.int64),
            outliers=np.zeros((count, len(FRACTIONS))),
            reports=np.full((count, sensors), -1, dtype=np.int64),
            launch=np.full((count, 3), np.nan),
            launch_covariance=np.full((count, 3, 3), np.nan),
        )

    def with_outliers(self, outliers: FloatArray) -> "TrackTable":
        """Return the table with other log likelihoods (n, fractions) of outlier fractions."""
        return evolve(self, outliers=outliers)

    def with_launches(self, launch: FloatArray, covariance: FloatArray) -> "TrackTable":
        """Return the table with other launches (n, 3) and covariances (n, 3, 3)."""
        return evolve(self, launch=launch, launch_covariance=covariance)

    def with_detections(
        self, owner: IntArray, time_s: FloatArray, sensor: IndexArray, reported: IntArray
    ) -> "TrackTable":
        """Return the table after lines (m,), in order of time, of rows `owner`, -1 for none."""
        has_track = owner >= 0
        if np.count_nonzero(has_track) < len(has_track):
            rows = np.flatnonzero(has_track)
            owner = owner[rows]
            time_s = time_s[rows]
            sensor = sensor[rows]
            reported = reported[rows]
        first_s = self.first_s.copy()
        seen_s = self.seen_s.copy()
        np.minimum.at(first_s, owner, time_s)
        np.maximum.at(seen_s, owner, time_s)
        hits = self.hits + np.bincount(owner, minlength=len(self))
        reports = self.reports
        if np.count_nonzero(reports[owner, sensor] != reported):
            reports = reports.copy()
            reports[owner, sensor] = reported
        columns = (self.number, self.begun_s, first_s, seen_s, hits, self.outliers, reports)
        return TrackTable(*columns, self.launch, self.launch_covariance)


def mean_detection_probability(sensors: Sequence[Sensor]) -> FloatArray:
    """Return detection probabilities (sensors,), means over the types."""
    stated = [
        np.mean(list(sensor.detection_probability.values()) or [UNSTATED]) for sensor in sensors
    ]
    return clipped(stated)


def clipped(stated: ArrayLike) -> FloatArray:
    """Return stated detection probabilities (n,), neither certain nor hopeless."""
    return np.clip(np.asarray(stated, dtype=np.float64), 0.05, 0.98)


def longest_silence_s(sensors: Sequence[Sensor], scans: int) -> FloatArray:
    """Return the longest time (sensors,) without detection that is probable for a track in view, of
    the type with the lowest detection probability.
    """
    seldom = [min(sensor.detection_probability.values(), default=UNSTATED) for sensor in sensors]
    chance = clipped(seldom)
    period_s = np.array([sensor.scan.period_ns * 1e-9 for sensor in sensors])
    # So many consecutive misses have a probability of 1e-4.
    misses = np.log(1e-4) / np.log1p(-chance)
    return np.maximum(scans, misses) * period_s
