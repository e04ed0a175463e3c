"""The trackers `kepler-arc` and `imm`; each is imported when it is built."""

from collections.abc import Callable, Iterable, Sequence
from functools import partial
from importlib import import_module
from typing import TYPE_CHECKING, Any

from opir_core.plugin import TrackerModel, TrackerPart, hookimpl
from opir_trackers.configs import MOTION_STATES, ImmConfig, KeplerArcConfig

if TYPE_CHECKING:
    from opir_core.plugin import Tracker, TrackerContext


def _imm(config: ImmConfig, context: "TrackerContext") -> "Tracker":
    from opir_trackers.imm.tracker import imm_tracker

    return imm_tracker(config, context)


def _kepler_arc(config: KeplerArcConfig, context: "TrackerContext") -> "Tracker":
    from opir_trackers.imm.tracker import imm_tracker

    return imm_tracker(config.imm(), context)


def _subjects_read(config: ImmConfig) -> Sequence[str]:
    return ["bias"] if config.clock_sigma_s else []


@hookimpl
def opir_trackers() -> Iterable[TrackerModel]:
    """Yield `kepler-arc` and `imm`."""
    yield TrackerModel(
        name="kepler-arc",
        summary="the tracks of imm, with the paper's Keplerian arc to the impact once a target no"
        " longer burns",
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


def _built(module: str, name: str, config: Any, context: Any) -> Any:
    return getattr(import_module(f"opir_trackers.{module}"), name)(config, context)


def _build(module: str, name: str) -> Callable[[Any, Any], Any]:
    """Return the build function of a part: a function of a module, imported when it is called."""
    return partial(_built, module, name)


@hookimpl
def opir_tracker_parts() -> Iterable[TrackerPart]:
    """Yield the parts of `imm`."""
    yield TrackerPart(
        name="jpda",
        summary="lines that several tracks may have move each by the probability of its label",
        role="association",
        build=_build("associators.jpda", "joint_associator"),
        reads=(),
    )
    yield TrackerPart(
        name="gnn",
        summary="global nearest neighbour: the most likely one-to-one assignment of each scan",
        role="association",
        build=_build("associators.gnn", "nearest_associator"),
        reads=(),
    )
    yield TrackerPart(
        name="m-of-n",
        summary="clusters of unassigned lines with detections in M of the last N scans",
        role="initiation",
        build=_build("imm.initiate", "m_of_n_initiator"),
        reads=(),
    )
    yield TrackerPart(
        name="thrust",
        summary="thrust along the velocity: a gravity turn whose specific force slowly grows",
        role="motion",
        state_size=MOTION_STATES,
        build=_build("track_priors", "thrust_motion"),
        reads=(),
    )
    yield TrackerPart(
        name="unlikely",
        summary="tracks that are silent for too long, lost, down, or a copy of another one",
        role="pruning",
        build=_build("imm.prune", "unlikely_pruner"),
        reads=(),
    )
