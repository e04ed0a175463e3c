"""What a plugin offers: named, typed, lazy descriptions.

A component says what a scene writes to choose it (`name`), what a person reads (`summary`), which configuration class
the scene's block is read into (`config`) and how the working part is made (`build`). Nothing heavy is imported before
`build`.

Whose a component is, and whose fault a failure is.

Other defaults for the fields of a configuration class that a plugin inherits.
"""

from collections.abc import Callable, Mapping, Sequence
from functools import partial
from typing import Any, ClassVar, TypeVar

from attrs import Attribute, evolve, field, frozen

from opir_core.scene.fields import METADATA_KEY, info_of


@frozen(order=True)
class Provenance:
    """The owner of a component: a plugin's short name and the distribution that brought it.

    `distribution` and `version` are "" for a plugin object that was registered by the running program.
    """

    plugin: str
    distribution: str
    version: str

    def __str__(self) -> str:
        """Return the owner as messages call it, `opir-dsp 0.1.0 (plugin dsp)`."""
        if not self.distribution:
            return f"plugin {self.plugin} (registered by this program)"
        owner = f"{self.distribution} {self.version or '(version unknown)'}"
        return f"{owner} (plugin {self.plugin})" if self.plugin else owner


@frozen(order=True)
class PluginFailure:
    """A plugin that cannot be used, and why; none of its components is offered."""

    plugin: str
    distribution: str
    version: str
    reason: str

    @classmethod
    def of(cls, owner: Provenance, reason: str) -> "PluginFailure":
        """Return the failure of an owner."""
        return cls(owner.plugin, owner.distribution, owner.version, reason)

    @property
    def provenance(self) -> Provenance:
        """Return whose failure it is."""
        return Provenance(self.plugin, self.distribution, self.version)

    def __str__(self) -> str:
        """Return the failure as one line."""
        return f"{self.provenance}: {self.reason}"


@frozen(kw_only=True)
class ComponentRow:
    """One component in a catalogue; `contested_by` are the other plugins that claim its name."""

    hook: str
    kind: str
    name: str
    summary: str
    contested_by: tuple[Provenance, ...] = ()


@frozen(kw_only=True)
class PluginRow:
    """One plugin in a catalogue.

    `state` is "ready", "failed" (`failure` says why), "hidden" (the allow-list leaves it out, so it was not imported)
    or "unknown" (the allow-list names it and no installed distribution offers it). `api` is the range of plugin
    interfaces that it declares, "" for none. `commands` are those advertised.
    """

    distribution: str
    version: str
    plugin: str
    state: str
    api: str = ""
    components: tuple[ComponentRow, ...] = ()
    commands: tuple[str, ...] = ()
    failure: str = ""


@frozen
class NoConfig:
    """The configuration of a component that has none."""


@frozen(kw_only=True)
class Component:
    """One thing that a plugin offers and a scene may choose.

    `build(config, context)` returns the part that works; what `context` is and what the part must do stands with the
    component's kind in `opir_core.interfaces.protocols`. `presets` are named sets of configuration values: a scene that
    writes `preset: NAME` starts from them instead of from the defaults.
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


C = TypeVar("C", bound=type)


@frozen
class Cited:
    """A default value and where it comes from."""

    value: Any
    source: str


def cited(value: Any, source: str) -> Cited:
    """Return a default that names its source; a default given bare is notional."""
    return Cited(value, source)


def with_defaults(**defaults: Any) -> Callable[[C], C]:
    """Return a class decorator that makes a frozen attrs class of a configuration class's heir, with other defaults.

    Unit, help and range stay those of the inherited field, its source becomes that of `cited` or "notional". A field
    that the class does not have is a `TypeError`.
    """

    def decorated(heir: C) -> C:
        return frozen(heir, kw_only=True, field_transformer=partial(_redefaulted, defaults))

    return decorated


def _redefaulted(defaults: dict[str, Any], heir: type, attributes: "list[Attribute[Any]]") -> "list[Attribute[Any]]":
    unknown = sorted(set(defaults) - {attribute.name for attribute in attributes})
    if unknown:
        raise TypeError(f"{heir.__name__} has no field {', '.join(unknown)}")
    return [
        _with_default(attribute, defaults[attribute.name]) if attribute.name in defaults else attribute
        for attribute in attributes
    ]


def _with_default(attribute: "Attribute[Any]", default: Any) -> "Attribute[Any]":
    chosen = default if isinstance(default, Cited) else Cited(default, "notional")
    info = evolve(info_of(attribute), source=chosen.source)
    # Attribute.evolve is attrs' own way to change an attribute in a field transformer.
    return attribute.evolve(default=chosen.value, metadata={**attribute.metadata, METADATA_KEY: info})
