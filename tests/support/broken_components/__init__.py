"""Broken components, each with one fault that the contract of its kind is to find."""

from collections.abc import Iterable

# Each module offers its components as it is imported.
from broken_components import (  # noqa: F401
    confidence_and_classifiers,
    detection,
    outputs,
    renderers,
    results,
    sensors,
    targets,
    trackers,
)
from broken_components.offers import CAUGHT_BY, SOUND, offered
from opir_core.plugin import (
    ClassifierModel,
    ConfidenceModel,
    DetectionModel,
    EventEncoder,
    ExecutorModel,
    ExporterModel,
    MetricModel,
    RendererModel,
    RunView,
    SensorModel,
    SinkModel,
    TargetModel,
    TrackerModel,
    hookimpl,
)

__all__ = ["CAUGHT_BY", "SOUND"]


@hookimpl
def opir_sensor_models() -> Iterable[SensorModel]:
    return offered("opir_sensor_models")


@hookimpl
def opir_detection_models() -> Iterable[DetectionModel]:
    return offered("opir_detection_models")


@hookimpl
def opir_confidence_models() -> Iterable[ConfidenceModel]:
    return offered("opir_confidence_models")


@hookimpl
def opir_classifiers() -> Iterable[ClassifierModel]:
    return offered("opir_classifiers")


@hookimpl
def opir_trackers() -> Iterable[TrackerModel]:
    return offered("opir_trackers")


@hookimpl
def opir_target_models() -> Iterable[TargetModel]:
    return offered("opir_target_models")


@hookimpl
def opir_event_encoders() -> Iterable[EventEncoder]:
    return offered("opir_event_encoders")


@hookimpl
def opir_sinks() -> Iterable[SinkModel]:
    return offered("opir_sinks")


@hookimpl
def opir_metrics() -> Iterable[MetricModel]:
    return offered("opir_metrics")


@hookimpl
def opir_executors() -> Iterable[ExecutorModel]:
    return offered("opir_executors")


@hookimpl
def opir_exporters() -> Iterable[ExporterModel]:
    return offered("opir_exporters")


@hookimpl
def opir_renderers() -> Iterable[RendererModel]:
    return offered("opir_renderers")


@hookimpl
def opir_run_views() -> Iterable[RunView]:
    return offered("opir_run_views")
