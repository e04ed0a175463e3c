"""The state of the tracker `imm` between two slices, and tracks that have ended."""

import numpy as np
from attrs import evolve, field, frozen
from numpy.typing import NDArray
from opir_estimation import LinesOfSight, ModeEstimates, Registration, no_lines_of_sight

from opir_core.arrays import BoolArray, IntArray
from opir_trackers.imm.crowds import Crowds
from opir_trackers.imm.track_management import SharedDetections, TrackTable
from opir_trackers.onset.motion_statistics import MotionStatistics


@frozen(eq=False)
class EndedTracks:
    """Tracks (n,) as they were when they ended, and how: codes into `TRACK_ENDS`."""

    estimates: ModeEstimates
    table: TrackTable
    motion: MotionStatistics
    end: NDArray[np.uint8]

    def take(self, rows: IntArray) -> "EndedTracks":
        """Return some of the tracks."""
        return EndedTracks(
            self.estimates.take(rows), self.table.take(rows), self.motion.take(rows), self.end[rows]
        )

    def and_others(self, earlier: "EndedTracks | None") -> "EndedTracks":
        """Return these tracks after others."""
        if earlier is None:
            return self
        return EndedTracks(
            ModeEstimates.concatenate([earlier.estimates, self.estimates]),
            TrackTable.concatenate([earlier.table, self.table]),
            MotionStatistics.concatenate([earlier.motion, self.motion]),
            np.concatenate([earlier.end, self.end]),
        )


@frozen(eq=False)
class TrackerState:
    """The state of the tracker at a time: estimates, track table, unassigned recent lines and the
    next track number.

    `crowds` are the tracks in focal planes of tracks that share lines; `sightings` are the recent
    scans in which tracks were detected. `motion` (rows of the table) says what each track is;
    `ended` are those that ended since the last tick; `registration` is what is known of the
    sensors.
    """

    time_s: float
    estimates: ModeEstimates
    table: TrackTable
    unclaimed: LinesOfSight
    reported: IntArray
    crowds: Crowds = field(factory=Crowds)
    next_number: int = 0
    sightings: SharedDetections = field(factory=SharedDetections.empty)
    motion: MotionStatistics = field(factory=MotionStatistics.empty)
    ended: "EndedTracks | None" = None
    registration: Registration = field(kw_only=True)

    def after(
        self,
        time_s: float,
        estimates: ModeEstimates,
        table: TrackTable,
        motion: MotionStatistics | None = None,
    ) -> "TrackerState":
        """Return the state at a time with its tracks updated."""
        return TrackerState(
            time_s,
            estimates,
            table,
            self.unclaimed,
            self.reported,
            self.crowds,
            self.next_number,
            self.sightings,
            self.motion if motion is None else motion,
            self.ended,
            registration=self.registration,
        )

    def without(self, drop: BoolArray) -> "TrackerState":
        """Return the state without some tracks (n,)."""
        keep = np.flatnonzero(~drop)
        return evolve(
            self,
            estimates=self.estimates.take(keep),
            table=self.table.take(keep),
            motion=self.motion.take(keep),
            crowds=self.crowds.without(self.table.number[drop]),
        )

    @property
    def is_empty(self) -> bool:
        """Whether it has no track, also none that has just ended, and no recent line."""
        return not (len(self.table) or len(self.unclaimed.time_s) or self.ended)

    @classmethod
    def first(cls, sensors: int, registration: Registration) -> "TrackerState":
        """Return the state before the first detection, for a number of sensors."""
        none = (
            ModeEstimates.empty(),
            TrackTable.of(sensors),
            no_lines_of_sight(),
            np.empty(0, dtype=np.int64),
        )
        return cls(0.0, *none, registration=registration)
