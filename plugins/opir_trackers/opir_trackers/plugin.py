"""The trackers `kepler-arc` and `stereo-filter`; each is imported when it is built."""

from collections.abc import Iterable
from typing import TYPE_CHECKING

from opir_core.plugin.components import TrackerModel
from opir_core.plugin.hookspecs import hookimpl
from opir_trackers.configs import KeplerArcConfig, StereoFilterConfig

if TYPE_CHECKING:
    from opir_core.interfaces.contexts import TrackerContext
    from opir_core.interfaces.protocols import Tracker


def _stereo_filter(config: StereoFilterConfig, context: "TrackerContext") -> "Tracker":
    from opir_trackers.stereo.tracker import stereo_filter

    return stereo_filter(config, context)


def _kepler_arc(config: KeplerArcConfig, context: "TrackerContext") -> "Tracker":
    from opir_trackers.arc.tracker import kepler_arc_tracker

    return kepler_arc_tracker(config, context)


@hookimpl
def opir_trackers() -> Iterable[TrackerModel]:
    """Yield `kepler-arc` and `stereo-filter`."""
    yield TrackerModel(
        name="kepler-arc",
        summary="a Keplerian arc fitted to three or more detections, with the paper's empirical impact sigma",
        config=KeplerArcConfig,
        build=_kepler_arc,
    )
    yield TrackerModel(
        name="stereo-filter",
        summary="a multi-sensor IMM filter of two modes: boost with thrust about along the velocity, and coast",
        config=StereoFilterConfig,
        build=_stereo_filter,
    )
