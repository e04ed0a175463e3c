"""The tracker `none`, which follows nothing, and the way to the others: imported only when one is built."""

import numpy as np
from attrs import define

from opir_core.builtin.configs import BoostProfileConfig, KeplerArcConfig, StereoFilterConfig
from opir_core.plugin.components import NoConfig
from opir_core.protocols import Tracker, TrackerContext
from opir_core.records import Detections, IntArray, Tracks


@define
class NoTracker:
    """A tracker that never steps and gives every detection the track number -1."""

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


def stereo_filter(config: StereoFilterConfig, context: TrackerContext) -> Tracker:
    """Return the tracker `stereo-filter`."""
    from opir_core.tracking.stereo_tracker import stereo_filter as built

    return built(config, context)


def boost_profile(config: BoostProfileConfig, context: TrackerContext) -> Tracker:
    """Return the tracker `boost-profile`."""
    from opir_core.tracking.profile_tracker import boost_profile_tracker

    return boost_profile_tracker(config, context)


def kepler_arc(config: KeplerArcConfig, context: TrackerContext) -> Tracker:
    """Return the tracker `kepler-arc`."""
    from opir_core.tracking.arc_tracker import kepler_arc_tracker

    return kepler_arc_tracker(config, context)
