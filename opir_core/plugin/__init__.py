"""What plugin authors import: the hook marker, the component types, the fields of configuration classes and sensors."""

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
from opir_core.sensors.scanning_sensor import ScanningSensorConfig, scanning_sensor

__all__ = [
    "API_VERSION",
    "AtmosphereModel",
    "BackgroundModel",
    "ClassifierModel",
    "Component",
    "ConfidenceModel",
    "Constellation",
    "DetectionModel",
    "EventEncoder",
    "FieldInfo",
    "NoConfig",
    "ScanningSensorConfig",
    "SensorModel",
    "SignatureModel",
    "SinkModel",
    "SourceModel",
    "TargetModel",
    "TrackerModel",
    "cited",
    "flag",
    "hookimpl",
    "nested",
    "number",
    "scanning_sensor",
    "text",
    "with_defaults",
]
