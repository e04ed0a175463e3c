"""The state of the tracker `imm` between two slices: one table of tracks, recent lines without a
track, and what is known of the sensors.
"""

from collections.abc import Iterable
from typing import Any, NamedTuple

import numpy as np
from attrs import frozen
from opir_estimation import (
    AngleMeasurements,
    LinesOfSight,
    ModeEstimates,
    Registration,
    no_lines_of_sight,
)

from opir_core.arrays import BoolArray, ByteArray, FloatArray, IndexArray, IntArray
from opir_core.interfaces import Columns, names_of
from opir_trackers.imm.outliers import FRACTIONS
from opir_trackers.onset.motion_statistics import MotionStatistics

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

    @classmethod
    def of(cls, number: IntArray, owner: IntArray, lines: LinesOfSight) -> "SharedDetections":
        """Return the detections of lines (m,) that tracks `number` (n,) own: rows (m,), -1 for
        none.
        """
        owned = (owner >= 0).nonzero()[0]
        return cls(
            number[owner[owned]], lines.sensor[owned], lines.scan[owned], lines.time_s[owned]
        )

    def after(
        self, detections: "SharedDetections", time_s: float, memory_s: FloatArray, first: int
    ) -> "SharedDetections":
        """Return these after those of a slice that ends at `time_s`: the ones within `memory_s`
        (sensors,), and of tracks that began in the slice, from the number `first`.
        """
        is_recent = (self.time_s > time_s - memory_s[self.sensor]) | (self.number >= first)
        recent = is_recent.nonzero()[0]
        if not recent.size:
            return detections
        return SharedDetections.concatenate([self.take(recent), detections])


def sighting_memory_s(period_s: FloatArray, slice_s: float, scans: int) -> FloatArray:
    """Return how long (sensors,) detections are kept: for `scans` scans of sensors with few scans
    per slice.
    """
    return np.where(ENOUGH_SCANS * period_s > slice_s, scans * period_s, 0.0)


@frozen(eq=False, repr=False, slots=False)
class TrackTable(Columns):
    """The tracks (n,) by ascending number: all that is known of each, one row.

    `begun_s` is the time of initiation, `first_s` and `seen_s` are those of the first and the last
    detection, `hits` counts detections. `reports` (n, sensors) are the types that each sensor last
    reported, codes into `REPORTED_TYPES`, -1 for a sensor that has not seen the track; `launch`
    (n, 3) and `launch_covariance` (n, 3, 3) are as in `Tracks`; `outliers` (n, fractions) is the
    log likelihood of the outlier fractions (`outliers`). `estimates` are those of the filter,
    `motion` says what each track is, `burnt_s` (n,) is the last detection of the burn whose end has
    been found from all its looks, -inf for none.
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
    estimates: ModeEstimates
    motion: MotionStatistics
    burnt_s: FloatArray

    @classmethod
    def of(cls, sensors: int) -> "TrackTable":
        """Return the table of no tracks."""
        none = np.empty(0, dtype=np.int64)
        return cls.fresh(none, 0.0, sensors, ModeEstimates.empty(), MotionStatistics.empty())

    @classmethod
    def fresh(
        cls,
        number: IntArray,
        time_s: float,
        sensors: int,
        estimates: ModeEstimates,
        motion: MotionStatistics,
    ) -> "TrackTable":
        """Return the table of new tracks without detections."""
        count = len(number)
        never_s = np.full(count, -np.inf)
        return cls(
            number=number,
            begun_s=np.full(count, time_s),
            first_s=np.full(count, np.inf),
            seen_s=never_s,
            hits=np.zeros(count, dtype=np.int64),
            outliers=np.zeros((count, len(FRACTIONS))),
            reports=np.full((count, sensors), -1, dtype=np.int64),
            launch=np.full((count, 3), np.nan),
            launch_covariance=np.full((count, 3, 3), np.nan),
            estimates=estimates,
            motion=motion,
            burnt_s=never_s,
        )

    @property
    def seen(self) -> BoolArray:
        """Which sensors have seen which track, (n, sensors)."""
        return self.reports >= 0

    def take(self, rows: Any) -> "TrackTable":
        """Return some of the tracks, by an index array or a mask."""
        columns: list[Any] = [getattr(self, name) for name in names_of(TrackTable)]
        taken: list[Any] = [
            column.take(rows) if isinstance(column, Columns) else column[rows] for column in columns
        ]
        return TrackTable(*taken)

    @classmethod
    def concatenate(cls, records: Iterable["TrackTable"]) -> "TrackTable":
        """Return one table of all tracks, in order."""
        tables = list(records)
        columns = [[getattr(table, name) for table in tables] for name in names_of(TrackTable)]
        joined: list[Any] = [
            type(column[0]).concatenate(column)
            if isinstance(column[0], Columns)
            else np.concatenate(column)
            for column in columns
        ]
        return cls(*joined)

    def with_detections(
        self, owner: IntArray, time_s: FloatArray, sensor: IndexArray, reported: IntArray
    ) -> "TrackTable":
        """Return the table after lines (m,), in order of time, of rows `owner`, -1 for none."""
        has_track = owner >= 0
        if False in has_track:
            owner = owner[has_track]
            time_s = time_s[has_track]
            sensor = sensor[has_track]
            reported = reported[has_track]
        first_s = self.first_s.copy()
        seen_s = self.seen_s.copy()
        np.minimum.at(first_s, owner, time_s)
        np.maximum.at(seen_s, owner, time_s)
        hits = self.hits + np.bincount(owner, minlength=len(self.number))
        reports = self.reports
        if True in (reports[owner, sensor] != reported):
            reports = reports.copy()
            reports[owner, sensor] = reported
        return self.changed(first_s=first_s, seen_s=seen_s, hits=hits, reports=reports)

    def changed(self, **columns: Any) -> "TrackTable":
        """Return the table with other columns."""
        table = TrackTable.__new__(TrackTable)
        table.__dict__.update(self.__dict__)
        table.__dict__.update(columns)
        return table

    def with_estimates(self, estimates: ModeEstimates) -> "TrackTable":
        """Return the table with other estimates of the filter."""
        return self.changed(estimates=estimates)


@frozen(eq=False)
class EndedTracks:
    """Tracks (n,) as they were when they ended, and how: codes into `TRACK_ENDS`."""

    table: TrackTable
    end: ByteArray

    def take(self, rows: IntArray) -> "EndedTracks":
        """Return some of the tracks."""
        return EndedTracks(self.table.take(rows), self.end[rows])

    def and_others(self, earlier: "EndedTracks | None") -> "EndedTracks":
        """Return these tracks after others."""
        if earlier is None:
            return self
        return EndedTracks(
            TrackTable.concatenate([earlier.table, self.table]),
            np.concatenate([earlier.end, self.end]),
        )


class SliceLooks(NamedTuple):
    """What a slice that ended at `end_s` showed of burns: its measurements of tracks `number` (n,),
    whose states in boost were `mean` (n, 10), with lines that lacked the errors `error` of their sensors.
    """

    end_s: float
    number: IntArray
    mean: FloatArray
    measurements: AngleMeasurements
    error: FloatArray


class TrackerState(NamedTuple):
    """The state of the tracker at a time: tracks, unassigned recent lines with their reported types,
    and what is known of the sensors.

    `looks` are those of the last slices, with which the ends of burns are found; `sightings` are
    the recent scans in which tracks were detected; `ended` are the tracks that ended since the last
    tick; `memory` is that of the associator.
    """

    time_s: float
    table: TrackTable
    registration: Registration
    unclaimed: LinesOfSight
    reported: IntArray
    sightings: SharedDetections
    next_number: int = 0
    ended: EndedTracks | None = None
    memory: Any = None
    looks: tuple[SliceLooks, ...] = ()

    @property
    def is_empty(self) -> bool:
        """Whether it has no track, also none that has just ended, and no recent line."""
        return not (self.table.number.size or self.unclaimed.scan.size or self.ended)

    def without(self, drop: BoolArray) -> "TrackerState":
        """Return the state without some tracks (n,)."""
        return self._replace(table=self.table.take((~drop).nonzero()[0]))

    @classmethod
    def first(cls, sensors: int, registration: Registration) -> "TrackerState":
        """Return the state before the first detection, for a number of sensors."""
        return cls(
            0.0,
            TrackTable.of(sensors),
            registration,
            no_lines_of_sight(),
            np.empty(0, dtype=np.int64),
            SharedDetections.empty(),
        )
