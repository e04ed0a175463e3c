"""Core's own plugin: what it offers, that describing it imports nothing heavy, and the null
tracker.
"""

import subprocess
import sys

import numpy as np
import pytest
from attrs import fields, has
from core_components import HOST, built
from repository import ROOT

from opir_core import Detections
from opir_core.plugin import (
    AtmosphereModel,
    BackgroundModel,
    ClassifierModel,
    ConfidenceModel,
    DetectionModel,
    EventEncoder,
    ModelContext,
    SensorModel,
    SinkModel,
    TargetModel,
    TrackerContext,
    TrackerModel,
)
from opir_core.scene import info_of

HEAVY = ("numpy", "scipy", "msgspec", "yaml")

MODELS = {
    DetectionModel: {"constant", "always", "never"},
    ClassifierModel: {"paper", "none", "always", "never"},
    ConfidenceModel: {"weighted", "always", "never"},
    TrackerModel: {"none"},
    TargetModel: {"ballistic", "gravity-turn", "orbit", "glide", "air-launch"},
    AtmosphereModel: {"clear"},
    BackgroundModel: {"none"},
}


def offered(kind):
    return {name: HOST.component(kind, name) for name in HOST.names(kind)}


@pytest.mark.parametrize("kind", MODELS)
def test_every_kind_of_model_has_an_honest_one_or_a_null(kind):
    components = offered(kind)
    assert set(components) == MODELS[kind]
    assert all(isinstance(component, kind) for component in components.values())


@pytest.mark.parametrize("kind", [DetectionModel, ClassifierModel, ConfidenceModel])
def test_every_model_without_sensors_can_be_built(kind):
    context = ModelContext(sensors=(), target_type_code=np.zeros(0, np.uint8))
    assert all(built(kind, name, context) is not None for name in MODELS[kind])


def settings_of(config):
    """Yield the fields of a class of settings and of its blocks."""
    for field in fields(config):
        yield field
        if has(field.type):
            yield from settings_of(field.type)


@pytest.mark.parametrize("kind", [*MODELS, SinkModel, EventEncoder, SensorModel])
def test_every_setting_has_a_help_and_a_source(kind):
    for name, component in offered(kind).items():
        assert component.summary, name
        for field in settings_of(component.config):
            info = info_of(field)
            assert info.help, (name, field.name)
            assert info.source, (name, field.name)


def test_describing_built_in_components_imports_nothing_heavy():
    hooks = "opir_detection_models", "opir_classifiers", "opir_confidence_models", "opir_trackers"
    hooks += "opir_target_models", "opir_atmosphere_models", "opir_background_models"
    listed = "; ".join(f"list(plugin.{hook}())" for hook in hooks)
    code = f"import sys; from opir_core.builtin import plugin; {listed}; print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    loaded = {name.partition(".")[0] for name in done.stdout.split()}
    assert loaded.isdisjoint(HEAVY), loaded & set(HEAVY)


def test_the_null_tracker_follows_nothing():
    context = TrackerContext(sensors=(), epoch_us=0, duration_s=1.0)
    tracker = built(TrackerModel, "none", context)
    assert tracker.cadence_s is None
    assert tracker.associate(Detections.empty()).shape == (0,)
    assert len(tracker.step(0.0, Detections.empty())) == 0
