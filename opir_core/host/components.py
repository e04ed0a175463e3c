"""Components: named, typed descriptions of a plugin's models and commands, and their owners.

A component has the name that a scene chooses it by (`name`), one line of description (`summary`),
the configuration class of its block (`config`) and the function that makes the working part
(`build`). Nothing heavy is imported before `build`.
"""

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path
from typing import Any, ClassVar

from attrs import field, frozen

from opir_core.scene.fields import LIGHT, SOURCES
from opir_core.scene.target_classes import TargetClass


@frozen(order=True)
class Provenance:
    """The owner of a component: a plugin's short name and its distribution.

    `distribution` and `version` are "" for a plugin object that was registered by the running
    program.
    """

    plugin: str
    distribution: str
    version: str

    def __str__(self) -> str:
        """Return the owner as text, `opir-dsp 0.1.0 (plugin dsp)`."""
        if not self.distribution:
            return f"plugin {self.plugin} (registered by this program)"
        owner = f"{self.distribution} {self.version or '(version unknown)'}"
        return f"{owner} (plugin {self.plugin})" if self.plugin else owner


@frozen(order=True)
class PluginFailure:
    """A plugin that cannot be used, with the reason; none of its components is available."""

    provenance: Provenance
    reason: str

    def __str__(self) -> str:
        """Return the failure as one line."""
        return f"{self.provenance}: {self.reason}"


@frozen
class NoConfig:
    """The configuration class of a component without settings."""


@frozen(kw_only=True)
class Component:
    """A component that a scene can choose.

    A kind without fields of its own is a plain subclass: attrs would build its methods anew in each
    process. `build(config, context)` returns the working part, of the contract that each kind
    names. `presets` are named sets of configuration values: a block with `preset: NAME` starts from
    them instead of the defaults.

    `reads` are the subjects of other components' settings that this one reads (`light`,
    `detection_probability`, `confusion`), or a function of its configuration that returns them;
    None if it does not say, and may read any. A setting of a subject that nothing reads is warned
    of. A component of a `subject` has an effect only where another reads it. `presets_for` names,
    by subject, the preset from which a block without one starts where the detection model reads the
    subject.

    >>> @frozen
    ... class MistConfig:
    ...     height_m: float = 50.0
    >>> def mist(config, context):
    ...     return f"a mist of {config.height_m:g} m"
    >>> model = AtmosphereModel(
    ...     name="mist",
    ...     summary="ground fog",
    ...     config=MistConfig,
    ...     build=mist,
    ...     presets={"high": {"height_m": 200.0}},
    ... )
    >>> model.build(model.config(**model.presets["high"]), None)
    'a mist of 200 m'
    """

    #: The hook that yields components of this kind.
    hook: ClassVar[str] = ""
    #: The kind in words.
    kind: ClassVar[str] = "component"
    #: The subject of every component of this kind.
    subject_of_kind: ClassVar[str] = ""

    name: str
    summary: str
    config: type = NoConfig
    build: Callable[..., Any]
    presets: Mapping[str, Mapping[str, Any]] = field(factory=dict)
    reads: Sequence[str] | Callable[[Any], Sequence[str]] | None = None
    subject: str = ""
    presets_for: Mapping[str, str] = field(factory=dict)

    def subjects_read(self, config: Any) -> Sequence[str] | None:
        """Return the subjects that the component reads with a configuration; None for any."""
        return self.reads(config) if callable(self.reads) else self.reads

    @property
    def described(self) -> str:
        """Return the component's subject, "" for none."""
        return self.subject or self.subject_of_kind


class SensorModel(Component):
    """`build(config, context) -> Sensor`: scan times, field of regard, bands and noise."""

    hook = "opir_sensor_models"
    kind = "sensor model"


@frozen(kw_only=True)
class DetectionModel(Component):
    """`build(config, context) -> DetectionProbability`: exposures to probability of detection.

    `classifier` is the name of the classifier that a scene with this model has if it names none; ""
    is `paper`.
    """

    hook = "opir_detection_models"
    kind = "detection model"

    classifier: str = ""


class ConfidenceModel(Component):
    """`build(config, context) -> Confidence`: detections and their history to a confidence in [0,
    1].
    """

    hook = "opir_confidence_models"
    kind = "confidence model"


class ClassifierModel(Component):
    """`build(config, context) -> Classifier`: measurements to the reported target type."""

    hook = "opir_classifiers"
    kind = "classifier"


class TrackerModel(Component):
    """`build(config, context) -> Tracker`: detections to tracks."""

    hook = "opir_trackers"
    kind = "tracker"


@frozen(kw_only=True)
class TrackerPart(Component):
    """`build(config, context) -> part`: an exchangeable part of trackers, for example association.

    `role` is the key of the tracker's block that chooses it; the tracker's distribution has the
    contract of each role, and the context. `trackers` are the names of the trackers that it fits,
    () for all that have the key. `state_size` is that of a motion model.
    """

    hook = "opir_tracker_parts"
    kind = "tracker part"

    role: str
    trackers: Sequence[str] = ()
    state_size: int | None = None


class DirectorModel(Component):
    """`build(config, context) -> Director`: where sensors with a narrow field look, decided during
    a run.
    """

    hook = "opir_directors"
    kind = "director"


class TargetModel(Component):
    """`build(configs, context) -> Trajectories`: the trajectories of all targets of the model."""

    hook = "opir_target_models"
    kind = "target model"


class SignatureModel(Component):
    """`build(configs, context) -> Signatures`: the radiant intensity of all targets of the
    model.
    """

    hook = "opir_signature_models"
    kind = "signature model"
    subject_of_kind = LIGHT


class SourceModel(Component):
    """`build(config, context) -> Sources`: emitters other than targets, any number from one
    block.
    """

    hook = "opir_source_models"
    kind = "source model"
    subject_of_kind = SOURCES


class AtmosphereModel(Component):
    """`build(config, context) -> Transmittance`: in-band transmittance along a path."""

    hook = "opir_atmosphere_models"
    kind = "atmosphere model"
    subject_of_kind = LIGHT


class BackgroundModel(Component):
    """`build(config, context) -> Background`: background radiance and clutter."""

    hook = "opir_background_models"
    kind = "background model"
    subject_of_kind = LIGHT


@frozen(kw_only=True)
class EventEncoder(Component):
    """`build(config, context) -> Encoder`: detections to message bytes.

    With `encodes_tracks`, which its encoder has too, an output's events are tracks, one per track
    and tick. `schema()` returns the JSON Schema (draft 2020-12) of a message as text, or of a binary
    one its schema in the language of its format; `opir schema NAME` prints it.
    """

    hook = "opir_event_encoders"
    kind = "event encoder"

    encodes_tracks: bool = False
    schema: Callable[[], str] | None = None


@frozen(kw_only=True)
class SinkModel(Component):
    """`build(config, context) -> Sink`: writes events.

    `read(path)` yields the events of a file that the sink wrote, each a mapping with the keys of
    the encoder `forge`; with it, `opir_core.load_run`, `opir score` and `opir report` read runs
    whose events are in such a file. Raises `OSError` or `ValueError` if the file is another.

    The sink `parquet` also has the truth of runs as columns. `open_truth(path, place, target_ids,
    records)` opens the file `place`, which becomes `path` (its name in errors), and returns a
    context with `write(window)`; `records` are those of sensors and targets. `read_truth(path)`
    yields its records as a truth file of lines has them, and raises as `read` does.

    `asyncapi(config)` returns the AsyncAPI document of the topic that the sink writes, as YAML.
    """

    hook = "opir_sinks"
    kind = "sink"

    read: Callable[[Path], Iterable[Mapping[str, Any]]] | None = None
    open_truth: Callable[[Path, Path, Sequence[str], Sequence[Mapping[str, Any]]], Any] | None = (
        None
    )
    read_truth: Callable[[Path], Iterable[Mapping[str, Any]]] | None = None
    asyncapi: Callable[[Any], str] | None = None


class RendererModel(Component):
    """`build(config, context) -> Renderer`: lines of events and truth, joined from columns.

    `build` raises `ImportError` if the renderer cannot be used on this machine; then another one is
    chosen.
    """

    hook = "opir_renderers"
    kind = "renderer"


@frozen(kw_only=True)
class FileReader(Component):
    """`build(config, context) -> StateTable`, or what else `yields` names: the content of a file.

    `recognises(text)` returns whether a file is of the format, from its text alone. `yields` is one
    of `FILE_CONTENTS`: of trajectories a `StateTable`, of orbits a list of mappings by the keywords
    of an OMM, of detections by the keys of an event. `example` is a small file of the format, for
    the documentation and the conformance tests. `orbit(file, epoch_us, readers)` and
    `fleet`, of one reader, are the orbit of a sensor from any file and a class of settings whose
    `satellites(epoch_us, readers)` are the `id` and `orbit` of each satellite of a file.
    """

    hook = "opir_readers"
    kind = "reader"

    recognises: Callable[[str], bool]
    yields: str = "trajectories"
    example: str
    orbit: Callable[..., Any] | None = None
    fleet: type | None = None


class MetricModel(Component):
    """`build(config, context) -> Metric`: figures of a finished run, for studies."""

    hook = "opir_metrics"
    kind = "metric"


class ExecutorModel(Component):
    """`build(config, context) -> Executor`: runs the tasks of a study."""

    hook = "opir_executors"
    kind = "executor"


class ExporterModel(Component):
    """`build(config, context) -> Exporter`: writes a finished run in a format of other programs."""

    hook = "opir_exporters"
    kind = "exporter"


class RunView(Component):
    """`build(run)`: a finished run in another form, which `run.view(NAME)` returns."""

    hook = "opir_run_views"
    kind = "run view"


@frozen(kw_only=True)
class Constellation:
    """A named constellation: the sensor model of its satellites, and the settings (with an `id`) of
    each satellite.
    """

    hook: ClassVar[str] = "opir_constellations"
    kind: ClassVar[str] = "constellation"

    name: str
    summary: str
    model: str
    satellites: Sequence[Mapping[str, Any]]


def plural(kind: str) -> str:
    """Return the plural of a kind in words."""
    return f"{kind}es" if kind.endswith("s") else f"{kind}s"


#: What a plugin can offer under a name.
Offered = Component | Constellation | TargetClass

#: The catalogue hooks and the component class of each.
CATALOGUE: Mapping[str, type[Component] | type[Constellation] | type[TargetClass]] = {
    kind.hook: kind
    for kind in (
        Constellation,
        SensorModel,
        DetectionModel,
        ConfidenceModel,
        ClassifierModel,
        TrackerModel,
        TrackerPart,
        DirectorModel,
        TargetModel,
        TargetClass,
        SignatureModel,
        SourceModel,
        AtmosphereModel,
        BackgroundModel,
        EventEncoder,
        SinkModel,
        RendererModel,
        FileReader,
        MetricModel,
        ExecutorModel,
        ExporterModel,
        RunView,
    )
}
