"""The core's own plugin: the default model of most kinds, null models, encoders, sinks and the
reference renderer.

Nothing heavy is imported before a component is built.
"""

from collections.abc import Callable, Iterable
from functools import partial
from importlib import import_module
from typing import Any

from opir_core.builtin.configs import (
    BallisticConfig,
    ConfusionConfig,
    ConstantConfig,
    JsonlConfig,
    MemoryConfig,
    WeightedConfig,
)
from opir_core.doors import deferred
from opir_core.host.components import (
    AtmosphereModel,
    BackgroundModel,
    ClassifierModel,
    ConfidenceModel,
    DetectionModel,
    EventEncoder,
    RendererModel,
    RunView,
    SinkModel,
    TargetModel,
    TrackerModel,
)
from opir_core.host.hookspecs import hookimpl
from opir_core.output.events import schema_text
from opir_core.scene.fields import CONFUSION, DETECTION_PROBABILITY, SKY, SOURCES


def _encoder(name: str, summary: str, module: str, encoder: str, **options: bool) -> EventEncoder:
    """Return an encoder of a module of `opir_core.output.events`, which is imported when the
    encoder is built.
    """

    def build(_config: Any, context: Any) -> Any:
        return getattr(import_module(f"opir_core.output.events.{module}"), encoder)(
            context, **options
        )

    encodes_tracks = name == "tracks"
    schema = partial(schema_text, "track" if encodes_tracks else "detection")
    return EventEncoder(
        name=name, summary=summary, build=build, encodes_tracks=encodes_tracks, schema=schema
    )


ENCODERS = (
    _encoder(
        "forge",
        "one flat JSON object per event, for the FORGE fusion pipeline",
        "forge",
        "ForgeEncoder",
    ),
    _encoder(
        "forge-bands",
        "the event of forge, with the measured irradiance of each band",
        "forge",
        "ForgeEncoder",
        has_irradiances=True,
    ),
    _encoder(
        "forge-tracks",
        "the event of forge, with the state, burnout, covariances and type of its track",
        "forge",
        "ForgeEncoder",
        has_tracks=True,
    ),
    _encoder(
        "tracks",
        "one JSON object per track and tick, as in the tracks file, with impact regions as GeoJSON",
        "tracks",
        "TracksEncoder",
    ),
)

SINKS = (
    SinkModel(
        name="jsonl",
        summary="one event per line, to a file or standard output",
        config=JsonlConfig,
        build=deferred("opir_core.builtin.sinks.line_file"),
    ),
    SinkModel(
        name="memory",
        summary="windows kept in memory, as columns and as events",
        config=MemoryConfig,
        build=deferred("opir_core.builtin.sinks.memory_sink"),
    ),
    SinkModel(
        name="null",
        summary="discards events without encoding them",
        build=deferred("opir_core.builtin.sinks.null_sink"),
    ),
)


@hookimpl
def opir_detection_models() -> Iterable[DetectionModel]:
    """Yield `constant`, `always` and `never`."""
    yield DetectionModel(
        name="constant",
        summary="a probability of detection per sensor and target type (the paper's)",
        config=ConstantConfig,
        build=deferred("opir_core.builtin.detection.constant_detection"),
        reads=(DETECTION_PROBABILITY,),
    )
    yield DetectionModel(
        name="always",
        summary="every look detects",
        build=deferred("opir_core.builtin.detection.always_detection"),
        reads=(SOURCES,),
    )
    yield DetectionModel(
        name="never",
        summary="no look detects",
        build=deferred("opir_core.builtin.detection.never_detection"),
        reads=(SOURCES,),
    )


@hookimpl
def opir_classifiers() -> Iterable[ClassifierModel]:
    """Yield `paper`, `none`, `always` and `never`."""
    yield ClassifierModel(
        name="paper",
        summary="drawn from a confusion matrix, once per sensor and launch; knows the true type",
        config=ConfusionConfig,
        build=deferred("opir_core.builtin.classification.confusion_classifier"),
        reads=(CONFUSION,),
    )
    yield ClassifierModel(
        name="none",
        summary="every target is UNKNOWN",
        build=deferred("opir_core.builtin.classification.no_answer"),
        reads=(),
    )
    yield ClassifierModel(
        name="always",
        summary="the true type, each time",
        build=deferred("opir_core.builtin.classification.true_type"),
        reads=(),
    )
    yield ClassifierModel(
        name="never",
        summary="every target is UNKNOWN, like none",
        build=deferred("opir_core.builtin.classification.no_answer"),
        reads=(),
    )


@hookimpl
def opir_confidence_models() -> Iterable[ConfidenceModel]:
    """Yield `weighted`, `always` and `never`."""
    yield ConfidenceModel(
        name="weighted",
        summary="weighted sum of confirming bands, number of detections and elevation (the"
        " paper's)",
        config=WeightedConfig,
        build=deferred("opir_core.builtin.classification.weighted_confidence"),
        reads=(),
    )
    yield ConfidenceModel(
        name="always",
        summary="confidence 1",
        build=deferred("opir_core.builtin.classification.full_confidence"),
        reads=(),
    )
    yield ConfidenceModel(
        name="never",
        summary="confidence 0",
        build=deferred("opir_core.builtin.classification.no_confidence"),
        reads=(),
    )


@hookimpl
def opir_trackers() -> Iterable[TrackerModel]:
    """Yield `none`."""
    yield TrackerModel(
        name="none",
        summary="no tracks",
        build=deferred("opir_core.builtin.no_tracker.no_tracker"),
        reads=(),
    )


@hookimpl
def opir_target_models() -> Iterable[TargetModel]:
    """Yield `ballistic`."""
    yield TargetModel(
        name="ballistic",
        summary="boost on a generic class profile, then free flight to the aim point under the"
        " scene's forces",
        config=BallisticConfig,
        build=deferred("opir_core.builtin.targets.ballistic_targets"),
    )


@hookimpl
def opir_atmosphere_models() -> Iterable[AtmosphereModel]:
    """Yield `clear`."""
    yield AtmosphereModel(
        name="clear",
        summary="transmittance 1, no clouds",
        build=deferred("opir_core.builtin.empty_space.clear_atmosphere"),
        reads=(SKY,),
    )


@hookimpl
def opir_background_models() -> Iterable[BackgroundModel]:
    """Yield `none`."""
    yield BackgroundModel(
        name="none",
        summary="no background radiance",
        build=deferred("opir_core.builtin.empty_space.no_background"),
    )


@hookimpl
def opir_event_encoders() -> Iterable[EventEncoder]:
    """Yield the built-in encoders."""
    return ENCODERS


@hookimpl
def opir_sinks() -> Iterable[SinkModel]:
    """Yield the built-in sinks."""
    return SINKS


@hookimpl
def opir_run_views() -> Iterable[RunView]:
    """Yield `save`."""
    yield RunView(
        name="save",
        summary="a function that writes the files of a run, which `run.save(PATH)` calls",
        build=_save,
    )


def _save(run: Any) -> Callable[..., Any]:
    return partial(import_module("opir_core.output.saving").saved, run)


@hookimpl
def opir_renderers() -> Iterable[RendererModel]:
    """Yield `reference`."""
    yield RendererModel(
        name="reference",
        summary="lines joined by numpy, whose bytes every renderer makes",
        build=_reference,
    )


def _reference(_config: Any, context: Any) -> Any:
    return context.reference
