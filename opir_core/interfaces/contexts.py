"""The contexts of components: the second argument of `build`, after the configuration."""

from collections.abc import Callable, Mapping, Sequence
from itertools import compress
from pathlib import Path
from typing import TYPE_CHECKING, Any, Protocol

import numpy as np
from attrs import field, frozen

from opir_core.arrays import ByteArray, IndexArray
from opir_core.interfaces.classification import Classifier
from opir_core.interfaces.detection_models import DetectionProbability
from opir_core.interfaces.outputs import Encoder
from opir_core.interfaces.records import Window
from opir_core.interfaces.sensors import Sensor
from opir_core.scene.hypotheses import Hypothesis, core_hypotheses
from opir_core.scene.scene import EMITTER_TYPES, REPORTED_TYPES, TARGET_TYPES
from opir_core.scene.target_classes import TargetClass, core_target_class

if TYPE_CHECKING:
    from opir_core.flight.forces import ForceModel


@frozen(kw_only=True)
class SensorContext:
    """The context of a sensor model; `readers` returns the readers of files that plugins offer
    (`FileReader`), `duration_s` is the length of the scene.
    """

    id: str
    epoch_us: int
    duration_s: float = 0.0
    readers: Callable[[], Sequence[Any]] = field(default=tuple, eq=False)


@frozen(kw_only=True)
class TargetContext:
    """The context of a target model: the ids and scene paths of its targets, one per configuration.

    `forces` act in free flight: "kepler", or `opir_core.flight.Forces`, with the default ballistic
    coefficient of targets. `epoch_us` is the scene's zero of time, microseconds of UTC since
    1970-01-01, `duration_s` its length. With `free_flight` a sensor follows targets after burnout:
    the model returns `FreeFlight` trajectories if it can. With `measures_light` the scene's
    detection model computes the light of targets: sensors look at bodies that the air heats.
    `target_class` returns the target class of a name; by default the core's. `readers` returns the
    readers of files that plugins offer (`FileReader`).
    """

    ids: tuple[str, ...]
    paths: tuple[str, ...]
    forces: "ForceModel" = "kepler"
    epoch_us: int = 0
    duration_s: float = float("inf")
    free_flight: bool = False
    measures_light: bool = False
    target_class: Callable[[str], TargetClass] = field(default=core_target_class, eq=False)
    readers: Callable[[], Sequence[Any]] = field(default=tuple, eq=False)


@frozen(eq=False)
class Surroundings:
    """The surroundings of a model of light: the scene with its choices, the host of their
    components, and the built parts. An `opir_core.Plan` has these attributes too.
    """

    scene: Any
    host: Any
    sensors: tuple[Sensor, ...]
    targets: Any
    sources: tuple[Any, ...]


@frozen(kw_only=True)
class ModelContext:
    """The context of detection models; with the built `detection` of classifiers; with the
    `classifier` of confidence models.

    Of the `surroundings` a model of light builds its environment. `class_names` are the target
    classes of launches and the types of other hot sources, by default those of `target_type_code`;
    `target_class` returns the target class of a name, by default the core's. `reported_types` are
    the names of the types that may be reported, of which `REPORTED_TYPES` are the first.
    `hypotheses` are those of a hot object.
    """

    sensors: tuple[Sensor, ...]
    target_type_code: ByteArray = field(
        eq=False
    )  #: into `EMITTER_TYPES`: launches, then other hot sources
    surroundings: Surroundings | None = field(default=None, eq=False)
    detection: DetectionProbability | None = field(default=None, eq=False)
    classifier: Classifier | None = field(default=None, eq=False)
    class_names: tuple[str, ...] = field(default=(), eq=False)
    reported_types: tuple[str, ...] = REPORTED_TYPES
    target_class: Callable[[str], TargetClass] = field(default=core_target_class, eq=False)
    hypotheses: tuple[Hypothesis, ...] = field(factory=core_hypotheses, eq=False)

    def emitter_classes(self) -> tuple[tuple[str, ...], IndexArray]:
        """Return the distinct classes of the emitters, in order of occurrence, and the number (n,)
        of each one's.
        """
        names = self._names()
        number = {name: place for place, name in enumerate(dict.fromkeys(names))}
        return tuple(number), np.array([number[name] for name in names], dtype=np.int32)

    def launched_classes(self) -> frozenset[str]:
        """Return the names of the target classes of launches, without the types of other hot
        sources.
        """
        is_launch = (self.target_type_code < len(TARGET_TYPES)).tolist()
        return frozenset(compress(self._names(), is_launch))

    def _names(self) -> tuple[str, ...]:
        return self.class_names or tuple(
            EMITTER_TYPES[code] for code in self.target_type_code.tolist()
        )


@frozen(kw_only=True)
class PartMaker:
    """The part of a tracker that a scene chose: its `build` function, its settings, and its owner
    in words.
    """

    owner: str
    config: Any
    build: Callable[[Any, Any], Any]

    def made(self, context: Any) -> Any:
        """Return what `build` makes with the context of its role."""
        return self.build(self.config, context)


@frozen(kw_only=True)
class TrackerContext:
    """The context of a tracker; it has no targets.

    `forces` act in free flight: "kepler", or `opir_core.flight.Forces`. Without `light_time` light
    is instantaneous. `hypotheses` are what a hot object may be, in the order of
    `Tracks.hypothesis_probability`. `false_alarms_per_scan` (sensors,) is the mean number of false
    alarms in a scan of the whole field of regard, None where it is unknown. `confirmation`
    (sensors,) are M and N of sensors that report a source once M of their last N looks detected it,
    None where each detection is reported with the probability that the sensor states. `parts` are
    the parts that the scene chose, by the keys of the tracker's block.
    """

    sensors: tuple[Sensor, ...]
    epoch_us: int
    duration_s: float
    forces: "ForceModel" = "kepler"
    light_time: bool = True
    hypotheses: tuple[Hypothesis, ...] = field(factory=core_hypotheses)
    false_alarms_per_scan: tuple[float, ...] | None = None
    confirmation: tuple[tuple[int, int], ...] | None = None
    parts: Mapping[str, PartMaker] = field(factory=dict, eq=False)


#: Returns lines of text, given their number and their columns.
Renderer = Callable[[int, Sequence[Any]], bytes]


@frozen(kw_only=True)
class RendererContext:
    """The context of a renderer; it returns the bytes of `reference`, faster."""

    reference: Renderer


@frozen(kw_only=True)
class EncoderContext:
    """The context of an encoder; `reported_types` are the names of the detections' codes.

    `hypotheses` are the names of what a hot object may be, in the order of
    `Tracks.hypothesis_probability`. `paths` are the ways of reports to the ground, by number, each
    the nodes after the sensor. `render` joins lines from columns for the core's encoders; None
    is the reference.
    """

    sensors: tuple[Sensor, ...]
    epoch_us: int
    reported_types: tuple[str, ...] = REPORTED_TYPES
    hypotheses: tuple[str, ...] = ()
    paths: tuple[tuple[str, ...], ...] = ()
    render: Renderer | None = field(default=None, eq=False)


def detection_count(window: Window) -> int:
    """Return the number of a window's detections."""
    return len(window.detections)


class FilePlacement(Protocol):
    """Tells sinks of a batch run where to write: the files of a run are put in place together, once
    it is whole.
    """

    def __call__(self, path: str | Path, *, only_appends: bool = False) -> Path:
        """Return the path of an existing, empty, temporary file to open and write; it must not be
        replaced by another.

        The path itself if it is no regular file. `only_appends` promises that written bytes do not
        change, so that they can be hashed while the run goes on. Raises `SinkError` if another run
        writes the same file.
        """


def _in_place(path: str | Path, *, only_appends: bool = False) -> Path:
    return Path(path)


@frozen(kw_only=True)
class SinkContext:
    """The context of a sink.

    `make_encoder` builds the encoder of the output's block (`encoder: NAME`) and imports what it
    needs. `resumes` is true if a spool may hold events of an earlier run: the sink must append to
    its output, not overwrite it. `count` returns the number of a window's events in that encoder:
    of its detections, or of its tracks. `stage` returns where to write a file that the sink makes
    anew; in a live run, the path itself. `origin` are the sensors, the epoch and the reported types
    of the run, for sinks that write columns and not the messages of an encoder.
    """

    make_encoder: Callable[[], Encoder]
    scene_name: str
    resumes: bool = False
    count: Callable[[Window], int] = field(default=detection_count, eq=False)
    stage: FilePlacement = field(default=_in_place, eq=False)
    origin: EncoderContext = field(default=EncoderContext(sensors=(), epoch_us=0), eq=False)
