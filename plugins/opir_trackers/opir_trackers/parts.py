"""Contracts of the parts of a tracker: motion model, associator, initiator and pruner.

A plugin offers a part with the hook `opir_tracker_parts`, and a scene chooses it in the tracker's
block: `tracker: {model: imm, association: gnn}`. The build function of a part gets its settings and
a `PartContext`. A part keeps no state between ticks: what an associator remembers is the `memory`
of its association, because late detections return the tracker to an earlier time.
"""

from abc import abstractmethod
from collections.abc import Callable
from functools import cache
from typing import Any, TypeVar

import numpy as np
from attrs import Factory, field, frozen
from opir_estimation import GatedPairs, LinesOfSight, PredictedMeasurements

from opir_core.arrays import BoolArray, FloatArray, IndexArray, IntArray
from opir_core.errors import ModelError, OpirError
from opir_core.flight import Forces
from opir_core.host import described_error
from opir_core.interfaces import PartMaker, PluginPart
from opir_core.plugin import Host, TrackerContext, TrackerPart
from opir_trackers.association import (
    AssociationModel,
    NearestLines,
    associate_nearest,
    scan_groups,
)
from opir_trackers.imm.state import SharedDetections, TrackTable
from opir_trackers.initiation import Initiation


@frozen(kw_only=True)
class PartContext:
    """The context of a part: that of the tracker, the settings of its block, and the forces of free
    flight.
    """

    tracker: TrackerContext
    settings: Any
    forces: Forces


_Part = TypeVar("_Part", bound=PluginPart)


def made_part(contract: Callable[..., _Part], role: str, context: PartContext) -> _Part:
    """Return the part of a role that the settings name; raises `ModelError` with its owner if it
    cannot be built or lacks a method of the contract.
    """
    maker = maker_of(role, context)
    try:
        part = maker.made(context)
    except OpirError:
        raise
    except Exception as error:
        raise ModelError(f"{maker.owner}: build raised {described_error(error)}") from error
    base: Any = contract
    adopted: _Part = base.adopt(part, lambda: maker.owner)
    return adopted


def maker_of(role: str, context: PartContext) -> PartMaker:
    """Return what makes the part of a role: the scene's choice, or the installed part of the name in
    the settings, with its defaults.
    """
    chosen = context.tracker.parts.get(role)
    return _installed(getattr(context.settings, role)) if chosen is None else chosen


@cache
def _installed(name: str) -> PartMaker:
    """Return what makes an installed part, with its default settings."""
    component = Host.discover().component(TrackerPart, name)
    return PartMaker(
        owner=f"the tracker part {name}", config=component.config(), build=component.build
    )


@frozen(eq=False, kw_only=True)
class AssociationProblem:
    """The lines of sight (m,) of a slice, and their pairs (k,) with tracks (n,) within the gates.

    `lines` are in order of time and without the known errors of their sensors. A sensor sees a
    target at most once a `scan`. `number` (n,) are the track numbers, ascending, and `path` predicts
    their positions; `reports` (n, sensors) are as in `TrackTable`. The slice ends at `end_s`, s,
    and is `span_s` long; `memory` is that of the last association, None at first. `known_nearest`
    is `nearest` if it is known already. Tracks that `stands` (n,) marks are where their lines say
    that a source stands, whatever the association says.
    """

    lines: LinesOfSight
    pairs: GatedPairs
    number: IntArray
    path: PredictedMeasurements
    reports: IntArray
    model: AssociationModel
    end_s: float
    span_s: float
    memory: Any = None
    known_nearest: NearestLines | None = None
    stands: BoolArray | None = None

    @property
    def nearest(self) -> NearestLines:
        """The most likely one-to-one assignment of each scan (global nearest neighbour)."""
        if self.known_nearest is not None:
            return self.known_nearest
        return associate_nearest(self.pairs, self.lines, self.model)

    @property
    def log_ratio(self) -> FloatArray:
        """The log likelihood ratio (k,) of each pair to a miss and a false alarm."""
        return self.model.log_ratio(self.pairs, self.lines)

    @property
    def scan_group(self) -> IntArray:
        """The number (k,) of each pair's track, sensor and scan: one line at most in each."""
        return scan_groups(self.pairs, self.lines)


def _sensors_of_pairs(association: "Association") -> IndexArray:
    return association.lines.sensor.take(association.pairs.line)


def _no_rows() -> IntArray:
    return np.empty(0, dtype=np.int64)


@frozen(eq=False, kw_only=True)
class Association:
    """The track row of each line (m,), -1 for none, and the pairs that update the tracks.

    Lines of no track may begin new ones. `pairs` hold at most one of a track and scan; one that
    stands for several, as that of JPDA, has their mean innovation in `measured` and its error in
    `sigma_rad`. `single` are those that stand for one line each, by default all: outliers and errors
    of sensors are estimated from them, but for tracks whose rows are `doubtful`, whose lines may be
    those of another one. `existence` (n,) is the probability that a track follows a target, None if
    it is not estimated. `memory` comes back with the next problem.
    """

    lines: LinesOfSight
    owner: IntArray
    pairs: GatedPairs
    sensor: IndexArray = field(default=Factory(_sensors_of_pairs, takes_self=True))
    single: GatedPairs = field(default=Factory(lambda self: self.pairs, takes_self=True))
    doubtful: IntArray = field(factory=_no_rows)
    existence: FloatArray | None = None
    memory: Any = None


class Associator(PluginPart):
    """Data association: which line of sight belongs to which track.

    >>> from opir_trackers import Association, Associator
    >>> class Nearest(Associator):
    ...     def associate(self, problem):
    ...         order = np.argsort(problem.pairs.distance, kind="stable")
    ...         pairs = problem.pairs.take(order)
    ...         pairs = pairs.take(np.unique(pairs.line, return_index=True)[1])
    ...         pairs = pairs.take(np.unique(scan_groups(pairs, problem.lines), return_index=True)[1])
    ...         owner = np.full(len(problem.lines), -1)
    ...         owner[pairs.line] = pairs.track
    ...         return Association(lines=problem.lines, owner=owner, pairs=pairs)
    """

    @abstractmethod
    def associate(self, problem: AssociationProblem) -> Association:
        """Return the association of a slice's lines with the predicted tracks."""

    def labels(self, problem: AssociationProblem, eligible: BoolArray) -> IntArray:
        """Return the track rows (m,) of lines of the next tick, -1 for none, among the tracks that
        are `eligible` (n,); `problem` has no other pairs.
        """
        return self.associate(problem).owner


@frozen(eq=False, kw_only=True)
class TrackPicture:
    """The table of tracks (n,) at a time, s, the end of a slice.

    `mean` (n, 6) and `covariance` (n, 6, 6) are of inertial position and velocity, m and m/s,
    `shared_covariance` is that of the errors that sensors share, None without.
    For `silent_s` (n,), s, they were looked at in vain; `sensor_silence_s` (sensors,) is the
    longest silence, s, that missed detections explain.
    `sightings` are the recent scans with detections, `existence` (n,) is that of the association.
    """

    time_s: float
    table: TrackTable
    mean: FloatArray
    covariance: FloatArray
    shared_covariance: FloatArray | None
    silent_s: FloatArray
    sensor_silence_s: FloatArray
    sightings: SharedDetections
    existence: FloatArray | None = None

    @property
    def number(self) -> IntArray:
        """The track numbers (n,), ascending."""
        return self.table.number

    @property
    def silence_limit_s(self) -> FloatArray:
        """The longest silences (n,), s, of the sensors that have seen each track."""
        silence_s: FloatArray = np.where(self.table.seen, self.sensor_silence_s, 0.0)
        return np.maximum.reduce(silence_s, axis=1)


class Initiator(PluginPart):
    """Track initiation: candidates of new tracks in the lines of sight that no track has.

    >>> from opir_trackers import Initiator, track_candidates
    >>> class Cautious(Initiator):
    ...     def candidates(self, lines, bias_sigma_rad):
    ...         return track_candidates(lines, 6, bias_sigma_rad)
    """

    @abstractmethod
    def candidates(self, lines: LinesOfSight, bias_sigma_rad: FloatArray) -> Initiation:
        """Return the candidates of unassigned lines (m,) of the last scans.

        `bias_sigma_rad` (sensors,) is the standard deviation of each sensor's bias.
        """


class Pruner(PluginPart):
    """Track deletion: which tracks end, and how.

    >>> from opir_trackers import Pruner
    >>> class Impatient(Pruner):
    ...     def ends(self, tracks):
    ...         is_silent = tracks.time_s - tracks.table.seen_s > 60.0
    ...         return np.where(is_silent, TRACK_ENDS.index("lost"), 0)
    """

    @abstractmethod
    def ends(self, tracks: TrackPicture) -> IntArray:
        """Return codes (n,) into `TRACK_ENDS`: 0 for tracks that go on."""


def require_shape(part: PluginPart, owner: str, words: str, *, is_right: bool) -> None:
    """Raise the `ModelError` of a part that returned something else than words say."""
    if not is_right:
        raise ModelError(f"{owner}: {type(part).__name__} must return {words}")
