"""What plugin authors import: the hook marker, component types, configuration fields, the sensor kit, and the
protocols, contexts and records that components work with.

The last three are imported when they are first used, so that discovering a plugin imports no numpy.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

from opir_core.plugin.api import API_VERSION
from opir_core.plugin.components import (
    AtmosphereModel,
    BackgroundModel,
    ClassifierModel,
    Component,
    ConfidenceModel,
    Constellation,
    DetectionModel,
    EventEncoder,
    NoConfig,
    SensorModel,
    SignatureModel,
    SinkModel,
    SourceModel,
    TargetModel,
    TrackerModel,
    cited,
    with_defaults,
)
from opir_core.plugin.hookspecs import hookimpl
from opir_core.scene.fields import FieldInfo, flag, nested, number, text
from opir_core.sensors.fleets import geostationary_fleet, one_track_fleet, scanning_model, walker_fleet
from opir_core.sensors.scanning_sensor import ScanningSensorConfig, scanning_sensor

if TYPE_CHECKING:
    from opir_core.interfaces.contexts import (
        EncoderContext,
        ModelContext,
        SensorContext,
        SinkContext,
        TargetContext,
        TrackerContext,
    )
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
        WithBreakpoints,
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
        ScanPattern,
        Sensor,
        Sink,
        Tracker,
        Trajectories,
        Transport,
    )
    from opir_core.interfaces.records import Batch, ClassifierInputs, Detections, Exposures, Tracks, Window
    from opir_core.plugin.host import Host
    from opir_core.radiometry.protocols import (
        AtmosphereContext,
        Background,
        BackgroundContext,
        SignatureContext,
        Signatures,
        SourceContext,
        Sources,
        Transmittance,
    )

_HOMES = {
    "AtmosphereContext": "radiometry.protocols",
    "Background": "radiometry.protocols",
    "BackgroundContext": "radiometry.protocols",
    "Band": "interfaces.protocols",
    "Batch": "interfaces.records",
    "BufferingSink": "interfaces.optional",
    "Classifier": "interfaces.protocols",
    "ClassifierInputs": "interfaces.records",
    "Confidence": "interfaces.protocols",
    "DeadlineSink": "interfaces.optional",
    "Delivery": "interfaces.protocols",
    "DetectionProbability": "interfaces.protocols",
    "Detections": "interfaces.records",
    "Encoder": "interfaces.protocols",
    "EncoderContext": "interfaces.contexts",
    "Exposures": "interfaces.records",
    "FalseAlarmModel": "interfaces.optional",
    "FreeFlight": "interfaces.optional",
    "FromFiles": "interfaces.optional",
    "Host": "plugin.host",
    "Measured": "interfaces.protocols",
    "ModelContext": "interfaces.contexts",
    "MonitoredSink": "interfaces.optional",
    "Orbit": "interfaces.protocols",
    "PartialEncoder": "interfaces.optional",
    "PosteriorClassifier": "interfaces.optional",
    "RandomDraws": "interfaces.protocols",
    "ReconfigurableTracker": "interfaces.optional",
    "Response": "interfaces.optional",
    "ScanPattern": "interfaces.protocols",
    "Sensor": "interfaces.protocols",
    "SensorContext": "interfaces.contexts",
    "SignalModel": "interfaces.optional",
    "SignatureContext": "radiometry.protocols",
    "Signatures": "radiometry.protocols",
    "Sink": "interfaces.protocols",
    "SinkContext": "interfaces.contexts",
    "SourceContext": "radiometry.protocols",
    "Sources": "radiometry.protocols",
    "TargetContext": "interfaces.contexts",
    "Tracker": "interfaces.protocols",
    "TrackerContext": "interfaces.contexts",
    "Tracks": "interfaces.records",
    "Trajectories": "interfaces.protocols",
    "Transmittance": "radiometry.protocols",
    "Transport": "interfaces.protocols",
    "Window": "interfaces.records",
    "WithBreakpoints": "interfaces.optional",
}

__all__ = [
    "API_VERSION",
    "AtmosphereContext",
    "AtmosphereModel",
    "Background",
    "BackgroundContext",
    "BackgroundModel",
    "Band",
    "Batch",
    "BufferingSink",
    "Classifier",
    "ClassifierInputs",
    "ClassifierModel",
    "Component",
    "Confidence",
    "ConfidenceModel",
    "Constellation",
    "DeadlineSink",
    "Delivery",
    "DetectionModel",
    "DetectionProbability",
    "Detections",
    "Encoder",
    "EncoderContext",
    "EventEncoder",
    "Exposures",
    "FalseAlarmModel",
    "FieldInfo",
    "FreeFlight",
    "FromFiles",
    "Host",
    "Measured",
    "ModelContext",
    "MonitoredSink",
    "NoConfig",
    "Orbit",
    "PartialEncoder",
    "PosteriorClassifier",
    "RandomDraws",
    "ReconfigurableTracker",
    "Response",
    "ScanPattern",
    "ScanningSensorConfig",
    "Sensor",
    "SensorContext",
    "SensorModel",
    "SignalModel",
    "SignatureContext",
    "SignatureModel",
    "Signatures",
    "Sink",
    "SinkContext",
    "SinkModel",
    "SourceContext",
    "SourceModel",
    "Sources",
    "TargetContext",
    "TargetModel",
    "Tracker",
    "TrackerContext",
    "TrackerModel",
    "Tracks",
    "Trajectories",
    "Transmittance",
    "Transport",
    "Window",
    "WithBreakpoints",
    "cited",
    "flag",
    "geostationary_fleet",
    "hookimpl",
    "nested",
    "number",
    "one_track_fleet",
    "scanning_model",
    "scanning_sensor",
    "text",
    "walker_fleet",
    "with_defaults",
]


def __getattr__(name: str) -> Any:
    home = _HOMES.get(name)
    if home is None:
        raise AttributeError(f"module 'opir_core.plugin' has no attribute {name!r}")
    return getattr(import_module(f"opir_core.{home}"), name)


def __dir__() -> list[str]:
    return __all__
