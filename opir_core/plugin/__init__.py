"""What plugin authors import: the hook marker, the component types and the fields of configuration classes."""

from opir_core.fields import FieldInfo, flag, nested, number, text
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
    SinkModel,
    TargetModel,
    TrackerModel,
)
from opir_core.plugin.hookspecs import hookimpl

__all__ = [
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
    "SensorModel",
    "SinkModel",
    "TargetModel",
    "TrackerModel",
    "flag",
    "hookimpl",
    "nested",
    "number",
    "text",
]
