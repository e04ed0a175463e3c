"""The tracker `none`, which follows nothing, and what a scene may set of the other trackers.

Nothing heavy is imported before a tracker is built.
"""

import numpy as np
from attrs import define, frozen

from opir_core.fields import number, text
from opir_core.plugin.components import NoConfig
from opir_core.protocols import Tracker, TrackerContext
from opir_core.records import Detections, IntArray, Tracks

ASSOCIATIONS = ("nearest", "joint")
MOTIONS = ("boost-coast", "boost", "coast")


@frozen(kw_only=True)
class StereoFilterConfig:
    """What a scene may set of the tracker `stereo-filter`."""

    cadence_s: float = number(
        default=1.0, unit="s", minimum=0.01, maximum=60.0, help="time between two estimates of a track"
    )
    association: str = text(
        default="nearest",
        choices=ASSOCIATIONS,
        help="nearest: the likeliest one-to-one assignment of each scan; joint: all of them, each as probable as it is",
    )
    slice_s: float = number(
        default=1.0,
        unit="s",
        minimum=0.001,
        maximum=10.0,
        help="looks of a slice are taken in together; never longer than the cadence",
    )
    settling: int = number(
        default=2,
        minimum=0,
        maximum=20,
        help="how often a slice's rays are assigned anew by the estimates they led to",
    )
    gate_sigma: float = number(
        default=4.5, minimum=1.0, maximum=20.0, help="how far from the expected direction a ray may be"
    )
    false_alarms_per_sr: float = number(
        default=100.0, unit="1/sr", above=0.0, maximum=1e9, help="expected false alarms a scan, by solid angle"
    )
    needed_scans: int = number(
        default=4, minimum=2, maximum=100, help="M: in so many different scans a new target has to be seen"
    )
    recent_scans: int = number(
        default=8, minimum=2, maximum=1000, help="N: among so many of the last scans of a sensor"
    )
    motion: str = text(
        default="boost-coast",
        choices=MOTIONS,
        help="modes a target may be in: boost with a nearly constant jerk, free flight, or either",
    )
    jerk_noise_m_s3: float = number(
        default=0.3, unit="m/s³/√s", minimum=0.0, maximum=1000.0, help="how fast the jerk of a boost wanders"
    )
    coast_noise_m_s: float = number(
        default=0.01, unit="m/s/√s", minimum=0.0, maximum=100.0, help="how fast the velocity of a free flight wanders"
    )
    boost_s: float = number(default=150.0, unit="s", above=0.0, maximum=10000.0, help="mean length of a boost")
    coast_s: float = number(
        default=1000.0, unit="s", above=0.0, maximum=1e6, help="mean time of free flight before a boost"
    )
    late_s: float = number(
        default=0.0,
        unit="s",
        minimum=0.0,
        maximum=600.0,
        help="detections that arrive up to this late are taken in as if they had been in time",
    )
    silence_s: float = number(
        default=1800.0, unit="s", above=0.0, maximum=1e6, help="a track unseen for longer is dropped"
    )
    lost_sigma_m: float = number(
        default=300e3, unit="m", above=0.0, maximum=1e9, help="a track less certain than this is dropped"
    )

    def __attrs_post_init__(self) -> None:
        if self.recent_scans < self.needed_scans:
            raise ValueError(f"recent_scans is {self.recent_scans}, less than needed_scans, {self.needed_scans}")


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
