"""Core's own plugin: what it offers, that describing it imports nothing heavy, and the null
tracker.
"""

import subprocess
import sys

import numpy as np
import pytest
from attrs import fields, has
from repository import ROOT

from opir_core import Detections
from opir_core.builtin import plugin, target_models
from opir_core.host.components import CATALOGUE
from opir_core.plugin import ModelContext, NoConfig, ScanningSensorConfig, TrackerContext
from opir_core.scene import info_of

HEAVY = ("numpy", "scipy", "msgspec", "yaml")

MODELS = {
    "opir_detection_models": {"constant", "always", "never"},
    "opir_classifiers": {"paper", "none", "always", "never"},
    "opir_confidence_models": {"weighted", "always", "never"},
    "opir_trackers": {"none"},
    "opir_target_models": {"ballistic", "gravity-turn", "orbit", "glide"},
    "opir_atmosphere_models": {"clear"},
    "opir_background_models": {"none"},
}


def offered(hook):
    offers = [*getattr(plugin, hook)(), *getattr(target_models, hook, list)()]
    return {component.name: component for component in offers}


@pytest.mark.parametrize("hook", MODELS)
def test_every_kind_of_model_has_an_honest_one_or_a_null(hook):
    components = offered(hook)
    assert set(components) == MODELS[hook]
    assert all(isinstance(component, CATALOGUE[hook]) for component in components.values())


@pytest.mark.parametrize(
    "hook", ["opir_detection_models", "opir_classifiers", "opir_confidence_models"]
)
def test_every_model_without_sensors_can_be_built(hook):
    context = ModelContext(sensors=(), target_type_code=np.zeros(0, np.uint8))
    for component in offered(hook).values():
        assert component.build(component.config(), context) is not None


def assert_documented(config):
    for attribute in fields(config):
        info = info_of(attribute)
        assert info.help, attribute.name
        assert info.source, attribute.name
        if has(attribute.type):
            assert_documented(attribute.type)


@pytest.mark.parametrize(
    "config",
    [
        ScanningSensorConfig,
        offered("opir_detection_models")["constant"].config,
        offered("opir_classifiers")["paper"].config,
        offered("opir_confidence_models")["weighted"].config,
        offered("opir_target_models")["ballistic"].config,
    ],
)
def test_every_field_of_a_configuration_says_what_it_is(config):
    assert_documented(config)


def test_describing_built_in_components_imports_nothing_heavy():
    hooks = "; ".join(f"list(plugin.{hook}())" for hook in MODELS)
    code = f"import sys; from opir_core.builtin import plugin; {hooks}; print(*sys.modules)"
    done = subprocess.run(
        [sys.executable, "-c", code], cwd=ROOT, capture_output=True, text=True, check=True
    )
    loaded = {name.partition(".")[0] for name in done.stdout.split()}
    assert loaded.isdisjoint(HEAVY), loaded & set(HEAVY)


def test_the_null_tracker_follows_nothing():
    context = TrackerContext(sensors=(), epoch_us=0, duration_s=1.0)
    tracker = offered("opir_trackers")["none"].build(NoConfig(), context)
    assert tracker.cadence_s is None
    assert tracker.associate(Detections.empty()).shape == (0,)
    assert len(tracker.step(0.0, Detections.empty())) == 0
