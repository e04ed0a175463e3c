"""Track management: the track table, track deletion, and duplicate tracks of one target.

Two tracks are duplicates if their states agree within their covariances and no recent scan detected
both: two targets are detected in one scan sooner or later, one target never twice.
"""

from collections.abc import Sequence

import numpy as np
from attrs import frozen
from numpy.typing import ArrayLike

from opir_core.arrays import FloatArray, IndexArray, IntArray
from opir_core.interfaces import Columns
from opir_core.plugin import Sensor
from opir_trackers.imm.outliers import FRACTIONS
from opir_trackers.lines_of_sight import LinesOfSight

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
        mine = np.flatnonzero(owner >= 0)
        fresh = SharedDetections(
            number[owner[mine]], lines.sensor[mine], lines.scan[mine], lines.time_s[mine]
        )
        old = np.flatnonzero(self.time_s > time_s - memory_s[self.sensor])
        return SharedDetections.concatenate([self.take(old), fresh]) if len(old) else fresh


def sighting_memory_s(period_s: FloatArray, slice_s: float, scans: int) -> FloatArray:
    """Return how long (sensors,) detections are kept: for `scans` scans of sensors with few scans
    per slice.
    """
    long_s: FloatArray = np.where(ENOUGH_SCANS * period_s > slice_s, scans * period_s, 0.0)
    return long_s


#: A track is lost once the probability of that many consecutive misses is below this, for the type
#: with the lowest detection probability.
_LOST_CHANCE = 1e-4

#: Stated detection probabilities are clipped to these; the last is for sensors that state none.
_LEAST_STATED = 0.05
_MOST_STATED = 0.98
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
        launches = self.launch, self.launch_covariance
        return TrackTable(
            self.number,
            self.begun_s,
            self.first_s,
            self.seen_s,
            self.hits,
            outliers,
            self.reports,
            *launches,
        )

    def with_launches(self, launch: FloatArray, covariance: FloatArray) -> "TrackTable":
        """Return the table with other launches (n, 3) and covariances (n, 3, 3)."""
        seen = self.begun_s, self.first_s, self.seen_s
        return TrackTable(
            self.number, *seen, self.hits, self.outliers, self.reports, launch, covariance
        )

    def with_detections(
        self, owner: IntArray, time_s: FloatArray, sensor: IndexArray, reported: IntArray
    ) -> "TrackTable":
        """Return the table after lines (m,), in order of time, of rows `owner`, -1 for none."""
        known = owner >= 0
        if np.count_nonzero(known) < len(known):
            mine = np.flatnonzero(known)
            owner = owner[mine]
            time_s = time_s[mine]
            sensor = sensor[mine]
            reported = reported[mine]
        first_s = self.first_s
        seen_s = self.seen_s
        reports = self.reports
        if len(first_s) == 1 and len(owner):
            first_s = np.minimum(first_s, time_s[0])
            seen_s = np.maximum(seen_s, time_s[-1])
            hits = self.hits + len(owner)
        else:
            first_s = first_s.copy()
            seen_s = seen_s.copy()
            np.minimum.at(first_s, owner, time_s)
            np.maximum.at(seen_s, owner, time_s)
            hits = self.hits + np.bincount(owner, minlength=len(self))
        if np.count_nonzero(reports[owner, sensor] != reported):
            reports = reports.copy()
            reports[owner, sensor] = reported
        launches = self.launch, self.launch_covariance
        return TrackTable(
            self.number, self.begun_s, first_s, seen_s, hits, self.outliers, reports, *launches
        )


def clipped(stated: ArrayLike) -> FloatArray:
    """Return stated detection probabilities (n,), neither certain nor hopeless."""
    return np.clip(np.asarray(stated, dtype=np.float64), _LEAST_STATED, _MOST_STATED)


def longest_silence_s(sensors: Sequence[Sensor], scans: int) -> FloatArray:
    """Return the longest time (sensors,) without detection that is probable for a track in view."""
    seldom = [min(sensor.detection_probability.values(), default=UNSTATED) for sensor in sensors]
    chance = clipped(seldom)
    period_s = np.array([sensor.scan.period_ns * 1e-9 for sensor in sensors])
    return np.asarray(np.maximum(scans, np.log(_LOST_CHANCE) / np.log1p(-chance)) * period_s)
