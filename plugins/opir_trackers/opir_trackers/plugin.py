"""The trackers `kepler-arc` and `imm`; each is imported when it is built."""

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING

from opir_core.plugin import TrackerModel, hookimpl
from opir_trackers.configs import ImmConfig, KeplerArcConfig

if TYPE_CHECKING:
    from opir_core.plugin import Tracker, TrackerContext


def _imm(config: ImmConfig, context: "TrackerContext") -> "Tracker":
    from opir_trackers.imm.tracker import imm_tracker

    return imm_tracker(config, context)


def _kepler_arc(config: KeplerArcConfig, context: "TrackerContext") -> "Tracker":
    from opir_trackers.arc.tracker import kepler_arc_tracker

    return kepler_arc_tracker(config, context)


def _subjects_read(config: ImmConfig) -> Sequence[str]:
    return ["bias"] if config.clock_sigma_s else []


@hookimpl
def opir_trackers() -> Iterable[TrackerModel]:
    """Yield `kepler-arc` and `imm`."""
    yield TrackerModel(
        name="kepler-arc",
        summary="a Keplerian arc fitted to three or more detections, with the paper's empirical"
        " impact sigma",
        config=KeplerArcConfig,
        build=_kepler_arc,
        reads=(),
    )
    yield TrackerModel(
        name="imm",
        summary="an IMM filter of boost and coast for one or more sensors, with impact regions from"
        " the first track on",
        config=ImmConfig,
        build=_imm,
        reads=_subjects_read,
    )
