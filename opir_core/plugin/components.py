"""What a plugin offers: named, typed, lazy descriptions.

A component says what a scene writes to choose it (`name`), what a person reads (`summary`), which configuration class
the scene's block is read into (`config`) and how the working part is made (`build`). Nothing heavy is imported before
`build`.
"""

from collections.abc import Callable, Mapping, Sequence
from typing import Any, ClassVar

from attrs import field, frozen


@frozen
class NoConfig:
    """The configuration of a component that has none."""


@frozen(kw_only=True)
class Component:
    """One thing that a plugin offers and a scene may choose.

    `build(config, context)` returns the part that works; what `context` is and what the part must do stands with the
    component's kind in `opir_core.protocols`. `presets` are named sets of configuration values: a scene that writes
    `preset: NAME` starts from them instead of from the defaults.
    """

    #: The hook that yields components of this kind.
    hook: ClassVar[str] = ""
    #: How messages call a component of this kind.
    kind: ClassVar[str] = "component"

    name: str
    summary: str
    config: type = NoConfig
    build: Callable[..., Any]
    presets: Mapping[str, Mapping[str, Any]] = field(factory=dict)


@frozen(kw_only=True)
class SensorModel(Component):
    """`build(config, context) -> Sensor`: when it looks, what it sees, in which bands, how noisily."""

    hook = "opir_sensor_models"
    kind = "sensor model"


@frozen(kw_only=True)
class DetectionModel(Component):
    """`build(config, context) -> DetectionProbability`: exposures to probability of detection."""

    hook = "opir_detection_models"
    kind = "detection model"


@frozen(kw_only=True)
class ConfidenceModel(Component):
    """`build(config, context) -> Confidence`: detections and their history to a confidence in [0, 1]."""

    hook = "opir_confidence_models"
    kind = "confidence model"


@frozen(kw_only=True)
class ClassifierModel(Component):
    """`build(config, context) -> Classifier`: measurements to the reported target type."""

    hook = "opir_classifiers"
    kind = "classifier"


@frozen(kw_only=True)
class TrackerModel(Component):
    """`build(config, context) -> Tracker`: detections to tracks."""

    hook = "opir_trackers"
    kind = "tracker"


@frozen(kw_only=True)
class TargetModel(Component):
    """`build(configs, context) -> Trajectories`: all targets of the model at once, launch to trajectory and plume."""

    hook = "opir_target_models"
    kind = "target model"


@frozen(kw_only=True)
class SignatureModel(Component):
    """`build(configs, context) -> Signatures`: the radiant intensity of all targets of the model at once."""

    hook = "opir_signature_models"
    kind = "signature model"


@frozen(kw_only=True)
class SourceModel(Component):
    """`build(config, context) -> Sources`: emitters that are no targets, any number from one block."""

    hook = "opir_source_models"
    kind = "source model"


@frozen(kw_only=True)
class AtmosphereModel(Component):
    """`build(config, context) -> Transmittance`: a path to in-band transmittance."""

    hook = "opir_atmosphere_models"
    kind = "atmosphere model"


@frozen(kw_only=True)
class BackgroundModel(Component):
    """`build(config, context) -> Background`: background radiance and clutter."""

    hook = "opir_background_models"
    kind = "background model"


@frozen(kw_only=True)
class EventEncoder(Component):
    """`build(config, context) -> Encoder`: detections to message bytes."""

    hook = "opir_event_encoders"
    kind = "event encoder"


@frozen(kw_only=True)
class SinkModel(Component):
    """`build(config, context) -> Sink`: where events go."""

    hook = "opir_sinks"
    kind = "sink"


@frozen(kw_only=True)
class Constellation:
    """A named fleet: the sensor model its satellites carry, and settings (with an `id`) for each satellite."""

    hook: ClassVar[str] = "opir_constellations"
    kind: ClassVar[str] = "constellation"

    name: str
    summary: str
    model: str
    satellites: Sequence[Mapping[str, Any]]


#: Every catalogue hook and the type of what it yields.
CATALOGUE: Mapping[str, type[Component] | type[Constellation]] = {
    kind.hook: kind
    for kind in (
        Constellation,
        SensorModel,
        DetectionModel,
        ConfidenceModel,
        ClassifierModel,
        TrackerModel,
        TargetModel,
        SignatureModel,
        SourceModel,
        AtmosphereModel,
        BackgroundModel,
        EventEncoder,
        SinkModel,
    )
}
