"""The trackers `kepler-arc` and `imm`; each is imported when it is built."""

from collections.abc import Iterable, Sequence
from typing import TYPE_CHECKING, Any

from opir_core.plugin import TrackerModel, TrackerPart, deferred, hookimpl
from opir_trackers.configs import MOTION_STATES, ImmConfig, KeplerArcConfig

if TYPE_CHECKING:
    from opir_core.plugin import TrackerContext


_imm = deferred("opir_trackers.imm.tracker.imm_tracker")


def _kepler_arc(config: KeplerArcConfig, context: "TrackerContext") -> Any:
    return _imm(config.imm(), context)


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


#: Role, name, place of the function that builds it, and summary of each part.
_PARTS = (
    (
        "association",
        "jpda",
        "associators.jpda.joint_associator",
        "joint probabilistic data association: shared lines update each track by their probability",
    ),
    (
        "association",
        "gnn",
        "associators.gnn.nearest_associator",
        "global nearest neighbour: the most likely one-to-one assignment of each scan",
    ),
    (
        "initiation",
        "m-of-n",
        "imm.initiate.m_of_n_initiator",
        "clusters of unassigned lines with detections in M of the last N scans",
    ),
    (
        "motion",
        "thrust",
        "track_priors.thrust_motion",
        "thrust along the velocity: a gravity turn whose specific force slowly grows",
    ),
    (
        "pruning",
        "unlikely",
        "imm.prune.unlikely_pruner",
        "tracks that are silent for too long, lost, down, or a copy of another one",
    ),
)


@hookimpl
def opir_tracker_parts() -> Iterable[TrackerPart]:
    """Yield the parts of `imm`; the module of each is imported when it is built."""
    for role, name, place, summary in _PARTS:
        yield TrackerPart(
            name=name,
            summary=summary,
            role=role,
            state_size=MOTION_STATES if role == "motion" else None,
            build=deferred(f"opir_trackers.{place}"),
            reads=(),
        )
