"""All that the tracker `stereo-filter` knows at a time, as one frozen record: a step makes a new one.

So late detections are taken in by going back to the situation before them and stepping forward again: the result is
that of their having been in time.
"""

import numpy as np
from attrs import field, frozen

from opir_core.arrays import IntArray
from opir_core.estimation.lines_of_sight import LinesOfSight, no_rays
from opir_trackers.filter.mixtures import ModeEstimates
from opir_trackers.stereo.duplicate_tracks import SharedDetections
from opir_trackers.stereo.histories import Histories
from opir_trackers.stereo.track_management import TrackTable


@frozen(eq=False)
class TrackerState:
    """All a tracker knows at a time: estimates, roster, recent rays that belong to no track, and the next number.

    `doubtful` are the numbers of tracks that may have others' histories, and what is told of them; `recent` says in
    which scans tracks were seen lately.
    """

    time_s: float
    bank: ModeEstimates
    roster: TrackTable
    pool: LinesOfSight
    reported: IntArray
    histories: Histories = field(factory=Histories.none)
    doubtful: tuple[IntArray, ModeEstimates] = field(
        factory=lambda: (np.empty(0, dtype=np.int64), ModeEstimates.empty())
    )
    next_number: int = 0
    recent: SharedDetections = field(factory=SharedDetections.empty)

    def after(self, time_s: float, bank: ModeEstimates, roster: TrackTable, histories: Histories) -> "TrackerState":
        """Return the situation at a time with its tracks as they are then."""
        known = self.doubtful, self.next_number, self.recent
        return TrackerState(time_s, bank, roster, self.pool, self.reported, histories, *known)

    @classmethod
    def first(cls, sensors: int) -> "TrackerState":
        """Return the situation before the first detection, of a scene with so many sensors."""
        return cls(0.0, ModeEstimates.empty(), TrackTable.of(sensors), no_rays(), np.empty(0, dtype=np.int64))
