"""The tracker `none`."""

import numpy as np
from attrs import define

from opir_core.arrays import IntArray
from opir_core.host.components import NoConfig
from opir_core.interfaces.contexts import TrackerContext
from opir_core.interfaces.records import Detections, Tracks
from opir_core.interfaces.trackers import Tracker


@define
class NoTracker(Tracker):
    """A tracker without tracks: it never steps, and the track number of every detection is -1."""

    cadence_s: float | None = None

    def associate(self, detections: Detections) -> IntArray:
        """Return -1 for each detection."""
        return np.full(len(detections), -1, dtype=np.int64)

    def step(self, tick_s: float, detections: Detections) -> Tracks:
        """Return no estimates."""
        return Tracks.empty()


def no_tracker(_config: NoConfig, _context: TrackerContext) -> Tracker:
    """Return the tracker `none`."""
    return NoTracker()
