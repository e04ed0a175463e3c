"""The API for plugin authors: hook marker, component classes, configuration fields, sensor kit, contracts and records.

Contracts, contexts and records are imported on first use, so that discovering a plugin imports no numpy.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from opir_core.interfaces.focal_plane import FocalPlaneConfig
from opir_core.plugin.components import (
    AtmosphereModel,
    BackgroundModel,
    ClassifierModel,
    Component,
    ConfidenceModel,
    Constellation,
    DetectionModel,
    EventEncoder,
    ExecutorModel,
    ExporterModel,
    MetricModel,
    NoConfig,
    SensorModel,
    SignatureModel,
    SinkModel,
    SourceModel,
    TargetModel,
    TrackerModel,
)
from opir_core.plugin.hookspecs import hookimpl
from opir_core.scene.fields import FieldInfo, cited, flag, named, nested, number, text, with_defaults
from opir_core.scene.scene import EMITTER_TYPES, REPORTED_TYPES, TARGET_TYPES
from opir_core.scene.target_classes import Ballistic, BoostProfile, EquilibriumGlide, OrbitInsertion, Plume, TargetClass
from opir_core.sensors.reporting import ReportingConfig, ReportingStageConfig
from opir_core.sensors.scanning_sensor import ScanningSensorConfig
from opir_core.sensors.sensor_components import (
    geostationary_fleet,
    one_track_fleet,
    scanning_model,
    scanning_sensor,
    walker_fleet,
)

if TYPE_CHECKING:
    from opir_core.interfaces.contexts import (
        EncoderContext,
        ModelContext,
        SensorContext,
        SinkContext,
        TargetContext,
        TrackerContext,
    )
    from opir_core.interfaces.impact_regions import ImpactRegion
    from opir_core.interfaces.outputs import Delivery, Encoder, Sink, Transport
    from opir_core.interfaces.protocols import (
        Band,
        Classifier,
        Confidence,
        DetectionProbability,
        Measured,
        Orbit,
        RandomDraws,
        ReportingStage,
        Response,
        ScanPattern,
        Sensor,
        Tracker,
        Trajectories,
    )
    from opir_core.interfaces.radiometric_models import (
        AtmosphereContext,
        Background,
        BackgroundContext,
        Paths,
        SignatureContext,
        Signatures,
        SourceContext,
        Sources,
        Transmittance,
        Views,
    )
    from opir_core.interfaces.records import Batch, ClassifierInputs, Detections, Exposures, Tracks, Window
    from opir_core.interfaces.results import (
        Executor,
        ExecutorContext,
        Exporter,
        ExporterContext,
        Metric,
        MetricContext,
    )
    from opir_core.plugin.host import Host

#: The module of each name that is imported on first use.
_HOMES = {
    name: module
    for module, names in {
        "interfaces.radiometric_models": (
            "AtmosphereContext Background BackgroundContext SignatureContext Paths Signatures SourceContext Sources "
            "Transmittance Views"
        ),
        "interfaces.outputs": "Delivery Encoder Sink Transport",
        "interfaces.protocols": (
            "Band Classifier Confidence DetectionProbability Measured Orbit RandomDraws ReportingStage Response "
            "ScanPattern Sensor Tracker Trajectories"
        ),
        "interfaces.impact_regions": "ImpactRegion",
        "interfaces.records": "Batch ClassifierInputs Detections Exposures Tracks Window",
        "interfaces.contexts": "EncoderContext ModelContext SensorContext SinkContext TargetContext TrackerContext",
        "interfaces.results": "Executor ExecutorContext Exporter ExporterContext Metric MetricContext",
        "plugin.host": "Host",
    }.items()
    for name in names.split()
}

#: Contracts of optional abilities, now methods with defaults of one base class each.
_JOINED = {
    **dict.fromkeys(("BufferingSink", "DeadlineSink", "MonitoredSink"), "Sink"),
    **dict.fromkeys(("PartialEncoder", "TrackEncoder"), "Encoder"),
    "ReconfigurableTracker": "Tracker",
    **dict.fromkeys(("FalseAlarmModel", "SignalModel", "WithBreakpoints"), "DetectionProbability"),
    "PosteriorClassifier": "Classifier",
    **dict.fromkeys(("FreeFlight", "FromFiles", "WithBurns", "WithClasses"), "Trajectories"),
}

# fmt: off
__all__ = [  # noqa: RUF022
    "AtmosphereContext", "AtmosphereModel", "Background", "BackgroundContext", "BackgroundModel", "Ballistic", "Band",
    "Batch", "BoostProfile", "Classifier", "ClassifierInputs", "ClassifierModel", "Component", "Confidence",
    "ConfidenceModel", "Constellation", "Delivery", "DetectionModel", "DetectionProbability", "Detections",
    "EMITTER_TYPES", "Encoder", "EncoderContext", "EquilibriumGlide", "EventEncoder", "Executor", "ExecutorContext",
    "ExecutorModel", "Exporter", "ExporterContext", "ExporterModel", "Exposures", "FieldInfo", "FocalPlaneConfig",
    "Host", "ImpactRegion", "Measured", "Metric", "MetricContext", "MetricModel", "ModelContext", "NoConfig", "Orbit",
    "OrbitInsertion", "Paths", "Plume", "REPORTED_TYPES", "RandomDraws", "ReportingConfig", "ReportingStage",
    "ReportingStageConfig", "Response", "ScanPattern", "ScanningSensorConfig", "Sensor", "SensorContext",
    "SensorModel", "SignatureContext", "SignatureModel", "Signatures", "Sink", "SinkContext", "SinkModel",
    "SourceContext", "SourceModel", "Sources", "TARGET_TYPES", "TargetClass", "TargetContext", "TargetModel",
    "Tracker", "TrackerContext", "TrackerModel", "Tracks", "Trajectories", "Transmittance", "Transport", "Views",
    "Window", "cited", "flag", "geostationary_fleet", "hookimpl", "named", "nested", "number", "one_track_fleet",
    "scanning_model", "scanning_sensor", "text", "walker_fleet", "with_defaults"
]
# fmt: on


def __getattr__(name: str) -> Any:
    name = _JOINED.get(name, name)
    home = _HOMES.get(name)
    if home is None:
        raise AttributeError(f"module 'opir_core.plugin' has no attribute {name!r}")
    return getattr(import_module(f"opir_core.{home}"), name)


def __dir__() -> list[str]:
    return __all__
