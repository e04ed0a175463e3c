"""Core's own plugin: an honest model of every kind that needs no plugin, the null models, encoders and sinks.

Nothing heavy is imported before a component is built.
"""

from collections.abc import Callable, Iterable
from importlib import import_module
from typing import Any

from opir_core.builtin.configs import BallisticConfig, ConfusionConfig, ConstantConfig, TableConfig, WeightedConfig
from opir_core.plugin.components import (
    AtmosphereModel,
    BackgroundModel,
    ClassifierModel,
    ConfidenceModel,
    DetectionModel,
    EventEncoder,
    SinkModel,
    TargetModel,
    TrackerModel,
)
from opir_core.plugin.hookspecs import hookimpl


def _built_by(module: str, function: str) -> Callable[..., Any]:
    """Return a `build` that imports its module of this package when it is called."""

    def build(config: Any, context: Any) -> Any:
        return getattr(import_module(f"opir_core.builtin.{module}"), function)(config, context)

    return build


@hookimpl
def opir_detection_models() -> Iterable[DetectionModel]:
    """Yield `constant`, `always` and `never`."""
    yield DetectionModel(
        name="constant",
        summary="one probability of detection for each sensor and target type (the paper's)",
        config=ConstantConfig,
        build=_built_by("detection", "constant_detection"),
    )
    yield DetectionModel(name="always", summary="every look detects", build=_built_by("detection", "always_detection"))
    yield DetectionModel(name="never", summary="no look detects", build=_built_by("detection", "never_detection"))


@hookimpl
def opir_classifiers() -> Iterable[ClassifierModel]:
    """Yield `paper`, `none`, `always` and `never`."""
    yield ClassifierModel(
        name="paper",
        summary="drawn from a confusion matrix, once for each sensor and launch",
        config=ConfusionConfig,
        build=_built_by("classification", "confusion_classifier"),
    )
    yield ClassifierModel(
        name="none", summary="every target is UNKNOWN", build=_built_by("classification", "no_answer")
    )
    yield ClassifierModel(
        name="always", summary="the true type each time", build=_built_by("classification", "true_type")
    )
    yield ClassifierModel(
        name="never", summary="every target is UNKNOWN (as none)", build=_built_by("classification", "no_answer")
    )


@hookimpl
def opir_confidence_models() -> Iterable[ConfidenceModel]:
    """Yield `weighted`, `always` and `never`."""
    yield ConfidenceModel(
        name="weighted",
        summary="weighted sum of confirming bands, detections so far and elevation (the paper's)",
        config=WeightedConfig,
        build=_built_by("confidence", "weighted_confidence"),
    )
    yield ConfidenceModel(name="always", summary="confidence 1", build=_built_by("confidence", "full_confidence"))
    yield ConfidenceModel(name="never", summary="confidence 0", build=_built_by("confidence", "no_confidence"))


@hookimpl
def opir_trackers() -> Iterable[TrackerModel]:
    """Yield `none`."""
    yield TrackerModel(name="none", summary="no tracks", build=_built_by("tracking", "no_tracker"))


@hookimpl
def opir_target_models() -> Iterable[TargetModel]:
    """Yield `ballistic` and `table`."""
    yield TargetModel(
        name="ballistic",
        summary="boost on a generic class profile, then free flight to the aim point under the scene's forces",
        config=BallisticConfig,
        build=_built_by("targets", "ballistic_targets"),
    )
    yield TargetModel(
        name="table",
        summary="a trajectory that the scene brings itself: a table of states, CSV or CCSDS OEM",
        config=TableConfig,
        build=_built_by("table_targets", "table_targets"),
    )


@hookimpl
def opir_atmosphere_models() -> Iterable[AtmosphereModel]:
    """Yield `clear`."""
    yield AtmosphereModel(
        name="clear", summary="transmittance 1, no clouds", build=_built_by("clear_sky", "clear_atmosphere")
    )


@hookimpl
def opir_background_models() -> Iterable[BackgroundModel]:
    """Yield `none`."""
    yield BackgroundModel(
        name="none", summary="nothing shines but targets", build=_built_by("clear_sky", "no_background")
    )


@hookimpl
def opir_event_encoders() -> Iterable[EventEncoder]:
    """Yield the built-in encoders."""
    from opir_core.builtin.encoders import ENCODERS

    yield from ENCODERS


@hookimpl
def opir_sinks() -> Iterable[SinkModel]:
    """Yield the built-in sinks."""
    from opir_core.builtin.sinks import SINKS

    yield from SINKS
