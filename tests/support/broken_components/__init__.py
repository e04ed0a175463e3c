"""Broken components, each with one fault that the contract of its kind is to find."""

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
from opir_core.plugin import hookimpl

__all__ = ["CAUGHT_BY", "SOUND"]


@hookimpl
def opir_sensor_models():
    return offered("opir_sensor_models")


@hookimpl
def opir_detection_models():
    return offered("opir_detection_models")


@hookimpl
def opir_confidence_models():
    return offered("opir_confidence_models")


@hookimpl
def opir_classifiers():
    return offered("opir_classifiers")


@hookimpl
def opir_trackers():
    return offered("opir_trackers")


@hookimpl
def opir_tracker_parts():
    return offered("opir_tracker_parts")


@hookimpl
def opir_target_models():
    return offered("opir_target_models")


@hookimpl
def opir_event_encoders():
    return offered("opir_event_encoders")


@hookimpl
def opir_sinks():
    return offered("opir_sinks")


@hookimpl
def opir_metrics():
    return offered("opir_metrics")


@hookimpl
def opir_executors():
    return offered("opir_executors")


@hookimpl
def opir_exporters():
    return offered("opir_exporters")


@hookimpl
def opir_renderers():
    return offered("opir_renderers")


@hookimpl
def opir_run_views():
    return offered("opir_run_views")
