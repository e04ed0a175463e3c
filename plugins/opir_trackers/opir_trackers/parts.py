"""Contracts of the parts of a tracker: motion model, associator, initiator and pruner.

A plugin offers a part with the hook `opir_tracker_parts`, and a scene chooses it in the tracker's
block: `tracker: {model: imm, association: gnn}`. The build function of a part gets its settings and
a `PartContext`. A part keeps no state between ticks: what an associator remembers is the `memory`
of its association, because late detections return the tracker to an earlier time.
"""

from abc import abstractmethod
from typing import Any, TypeVar

import numpy as np
from attrs import Factory, field, frozen
from numpy.typing import NDArray
from opir_estimation import GatedPairs, LinesOfSight, ModeEstimates, PredictedMeasurements

from opir_core.arrays import BoolArray, FloatArray, IndexArray, IntArray
from opir_core.errors import ModelError, OpirError
from opir_core.flight import Forces
from opir_core.host import described_error
from opir_core.interfaces import PartMaker, PluginPart
from opir_core.plugin import Host, TrackerContext, TrackerPart
from opir_trackers.association import AssociationModel, scan_groups
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


def made_part(contract: type[_Part], role: str, context: PartContext) -> _Part:
    """Return the part of a role that the settings name; raises `ModelError` with its owner if it
    cannot be built or lacks a method of the contract.
    """
    maker = context.tracker.parts.get(role) or _installed(getattr(context.settings, role))
    try:
        part = maker.made(context)
    except OpirError:
        raise
    except Exception as error:
        raise ModelError(f"{maker.owner}: build raised {described_error(error)}") from error
    return contract.adopt(part, lambda: maker.owner)


def _installed(name: str) -> PartMaker:
    """Return what makes the installed part of a name, with its default settings."""
    component = Host.discover().component(TrackerPart, name)
    return PartMaker(
        owner=f"the tracker part {name}", config=component.config(), build=component.build
    )


@frozen(eq=False, kw_only=True)
class AssociationProblem:
    """The lines of sight (m,) of a slice, and their pairs (k,) with tracks (n,) within the gates.

    `lines` are in order of time and without the known errors of their sensors; a sensor sees a
    target at most once a `scan`. `number` (n,) are the track numbers, ascending, and `path` predicts
    their positions. `seen` (n, sensors) says which sensors have seen which track. The slice ends at
    `end_s`, s, and is `span_s` long; `memory` is that of the last association, None at first.
    """

    lines: LinesOfSight
    pairs: GatedPairs
    number: IntArray
    path: PredictedMeasurements
    seen: BoolArray
    model: AssociationModel
    end_s: float
    span_s: float
    light_time: bool = True
    memory: Any = None

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


@frozen(eq=False, kw_only=True)
class Association:
    """The track row of each line (m,), -1 for none, and the pairs that update the tracks.

    Lines of no track may begin new ones. `pairs` hold at most one of a track and scan; one that
    stands for several, as that of JPDA, has their mean innovation in `measured` and its error in
    `sigma_rad`. `doubtful` are rows of tracks whose lines may be those of another one: neither
    outliers nor errors of sensors are estimated from them. `existence` (n,) is the probability that
    a track follows a target, None if it is not estimated. `memory` comes back with the next problem.
    """

    lines: LinesOfSight
    owner: IntArray
    pairs: GatedPairs
    sensor: IndexArray = field(default=Factory(_sensors_of_pairs, takes_self=True))
    doubtful: IntArray = field(factory=lambda: np.empty(0, dtype=np.int64))
    existence: FloatArray | None = None
    memory: Any = None


class Associator(PluginPart):
    """Data association: which line of sight belongs to which track.

    >>> from opir_trackers import Association, Associator
    >>> class Nearest(Associator):
    ...     def associate(self, problem):
    ...         order = np.argsort(problem.pairs.distance, kind="stable")
    ...         pairs = problem.pairs.take(order)
    ...         first = np.unique(pairs.line, return_index=True)[1]
    ...         pairs = pairs.take(first)
    ...         first = np.unique(scan_groups(pairs, problem.lines), return_index=True)[1]
    ...         pairs = pairs.take(np.sort(first))
    ...         owner = np.full(len(problem.lines), -1)
    ...         owner[pairs.line] = pairs.track
    ...         return Association(lines=problem.lines, owner=owner, pairs=pairs)
    """

    @abstractmethod
    def associate(self, problem: AssociationProblem) -> Association:
        """Return the association of a slice's lines with the predicted tracks."""

    def settled(self, tracks: "TrackPicture", memory: Any) -> "Settled":
        """Return the memory, and what it changes of the tracks, at the end of a slice: after new
        tracks began and others ended.
        """
        return Settled(memory=memory)


@frozen(eq=False, kw_only=True)
class Settled:
    """The memory of an associator at the end of a slice, and the tracks' estimates if it changed
    them.
    """

    memory: Any
    estimates: ModeEstimates | None = None


@frozen(eq=False, kw_only=True)
class TrackPicture:
    """Tracks (n,) at a time, s, by ascending number.

    `mean` (n, 6) and `covariance` (n, 6, 6) are of inertial position and velocity, m and m/s.
    `begun_s`, `first_s` and `seen_s` (n,) are the times of initiation, of the first and of the last
    detection; `hits` (n,) counts detections; `seen` (n, sensors) says which sensors have seen which
    track; `is_noise` (n,) marks tracks of false alarms. `silence_limit_s` (n,) is the longest silence
    that missed detections explain.
    """

    time_s: float
    number: IntArray
    mean: FloatArray
    covariance: FloatArray
    begun_s: FloatArray
    first_s: FloatArray
    seen_s: FloatArray
    hits: IntArray
    seen: BoolArray
    is_noise: BoolArray
    silence_limit_s: FloatArray
    existence: FloatArray | None = None


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
    ...         return np.where(tracks.time_s - tracks.seen_s > 60.0, TRACK_ENDS.index("lost"), 0)
    """

    @abstractmethod
    def ends(self, tracks: TrackPicture) -> NDArray[np.uint8]:
        """Return codes (n,) into `TRACK_ENDS`: 0 for tracks that go on."""
