"""The API for plugin authors: hook marker, component classes, configuration fields, sensor kit, protocols and records.

Protocols, contexts and records are imported on first use, so that discovering a plugin imports no numpy.
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
    RendererModel,
    RunView,
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
        Renderer,
        RendererContext,
        SensorContext,
        SinkContext,
        TargetContext,
        TrackerContext,
    )
    from opir_core.interfaces.impact_regions import ImpactRegion
    from opir_core.interfaces.optional import (
        BufferingSink,
        DeadlineSink,
        FalseAlarmModel,
        FreeFlight,
        FromFiles,
        MonitoredSink,
        PartialEncoder,
        PosteriorClassifier,
        ReconfigurableTracker,
        Response,
        SignalModel,
        TrackEncoder,
        WithBreakpoints,
        WithBurns,
        WithClasses,
    )
    from opir_core.interfaces.protocols import (
        Band,
        Classifier,
        Confidence,
        Delivery,
        DetectionProbability,
        Encoder,
        Measured,
        Orbit,
        RandomDraws,
        ReportingStage,
        ScanPattern,
        Sensor,
        Sink,
        Tracker,
        Trajectories,
        Transport,
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
        "interfaces.protocols": (
            "Band Classifier Confidence Delivery DetectionProbability Encoder Measured Orbit RandomDraws "
            "ReportingStage ScanPattern Sensor Sink Tracker Trajectories Transport"
        ),
        "interfaces.impact_regions": "ImpactRegion",
        "interfaces.records": "Batch ClassifierInputs Detections Exposures Tracks Window",
        "interfaces.optional": (
            "BufferingSink DeadlineSink FalseAlarmModel FreeFlight FromFiles MonitoredSink PartialEncoder "
            "PosteriorClassifier ReconfigurableTracker Response SignalModel TrackEncoder WithBreakpoints WithBurns "
            "WithClasses"
        ),
        "interfaces.contexts": (
            "EncoderContext ModelContext Renderer RendererContext SensorContext SinkContext TargetContext "
            "TrackerContext"
        ),
        "interfaces.results": "Executor ExecutorContext Exporter ExporterContext Metric MetricContext",
        "plugin.host": "Host",
    }.items()
    for name in names.split()
}

# fmt: off
__all__ = [  # noqa: RUF022
    "AtmosphereContext", "AtmosphereModel", "Background", "BackgroundContext", "BackgroundModel", "Ballistic",
    "Band", "Batch", "BoostProfile", "BufferingSink", "Classifier", "ClassifierInputs", "ClassifierModel",
    "Component", "Confidence", "ConfidenceModel", "Constellation", "DeadlineSink", "Delivery", "DetectionModel",
    "DetectionProbability", "Detections", "EMITTER_TYPES", "Encoder", "EncoderContext", "EquilibriumGlide",
    "EventEncoder", "Executor", "ExecutorContext", "ExecutorModel", "Exporter", "ExporterContext", "ExporterModel",
    "Exposures", "FalseAlarmModel", "FieldInfo", "FocalPlaneConfig", "FreeFlight", "FromFiles",
    "Host", "ImpactRegion", "Measured",
    "Metric", "MetricContext", "MetricModel", "ModelContext", "MonitoredSink", "NoConfig", "Orbit", "OrbitInsertion",
    "PartialEncoder", "Paths", "Plume", "PosteriorClassifier", "REPORTED_TYPES", "RandomDraws", "ReconfigurableTracker",
    "Renderer", "RendererContext", "RendererModel",
    "ReportingConfig", "ReportingStage", "ReportingStageConfig", "Response", "RunView", "ScanPattern",
    "ScanningSensorConfig",
    "Sensor", "SensorContext", "SensorModel", "SignalModel",
    "SignatureContext", "SignatureModel", "Signatures", "Sink", "SinkContext", "SinkModel", "SourceContext",
    "SourceModel", "Sources", "TARGET_TYPES", "TargetClass", "TargetContext", "TargetModel", "TrackEncoder",
    "Tracker", "TrackerContext", "TrackerModel", "Tracks", "Trajectories", "Transmittance", "Transport", "Views",
    "Window", "WithBreakpoints", "WithBurns", "WithClasses", "cited", "flag", "geostationary_fleet", "hookimpl",
    "named", "nested", "number", "one_track_fleet", "scanning_model", "scanning_sensor", "text", "walker_fleet",
    "with_defaults"
]
# fmt: on


def __getattr__(name: str) -> Any:
    home = _HOMES.get(name)
    if home is None:
        raise AttributeError(f"module 'opir_core.plugin' has no attribute {name!r}")
    return getattr(import_module(f"opir_core.{home}"), name)


def __dir__() -> list[str]:
    return __all__
