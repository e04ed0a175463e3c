"""Broken confidence models and classifiers."""

from collections.abc import Callable
from typing import Any

import numpy as np
from attrs import frozen

from broken_components.offers import mutant
from opir_core.arrays import FloatArray
from opir_core.builtin.classification import (
    ConfusionClassifier,
    confusion_classifier,
    weighted_confidence,
)
from opir_core.builtin.configs import ConfusionConfig, WeightedConfig
from opir_core.interfaces.records import ClassifierInputs
from opir_core.plugin import ClassifierModel, ConfidenceModel


@frozen
class OwnConfidence:
    """The built-in confidence, changed."""

    change: Callable[[FloatArray, ClassifierInputs], FloatArray]
    model: Any

    def confidence(self, sightings):
        return self.change(self.model.confidence(sightings), sightings)


def confidence_mutant(name, caught_by):
    """Offer a confidence model made of the built-in one."""

    def offered(change):
        def build(config, context):
            return OwnConfidence(change, weighted_confidence(config, context))

        mutant(ConfidenceModel, name, caught_by, WeightedConfig)(build)
        return change

    return offered


@confidence_mutant("certain-by-rank", "test_confidences_are_independent")
def certain_by_rank(confidence, _sightings):
    return np.linspace(0.0, 1.0, len(confidence))


@confidence_mutant("snr-for-granted", "test_confidences_lie_in_the_unit_interval")
def snr_for_granted(confidence, sightings):
    return np.clip(confidence * sightings.snr, 0.0, 1.0)


@confidence_mutant("one-by-one", "test_detections_are_computed_as_arrays")
def row_by_row(confidence, _sightings):
    return np.array([min(value, 1.0) for value in confidence.tolist()])


@confidence_mutant("writes-to-its-input", "test_confidences_lie_in_the_unit_interval")
def writes_to_its_input(confidence, sightings):
    sightings.snr[:] = 0.0
    return confidence


class UnknownCodes(ConfusionClassifier):
    """Codes of types that do not exist."""

    def pair_type(self, sensor, target, rng):
        return np.full(len(sensor), 9, dtype=np.uint8)


class ThreeStates(ConfusionClassifier):
    """One type for the pair, another for the detection."""

    def reported_type(self, sightings, rng):
        return (super().reported_type(sightings, rng) + 1) % 4


def classifier_build(component):
    def build(config, context):
        like = confusion_classifier(config, context)
        return component(like.thresholds, like.class_number, like.classes)

    return build


mutant(ClassifierModel, "unknown-codes", "test_codes_are_reported_types", ConfusionConfig)(
    classifier_build(UnknownCodes)
)
mutant(ClassifierModel, "three-states", "test_pairs_and_detections_agree", ConfusionConfig)(
    classifier_build(ThreeStates)
)


class SureOfAll(ConfusionClassifier):
    """Type probabilities that sum to 4."""

    def log_posterior(self, sightings):
        return np.zeros((len(sightings), 4))

    def revised(self, log_posterior, type_probability):
        return log_posterior

    def reported(self, log_posterior):
        return np.zeros(len(log_posterior), dtype=np.uint8)


mutant(
    ClassifierModel,
    "sure-of-all-types",
    "test_type_probabilities_agree_with_types",
    ConfusionConfig,
)(classifier_build(SureOfAll))


class HalfPosterior(ConfusionClassifier):
    """Has posteriors, and nothing that reports them."""

    def log_posterior(self, sightings):
        return np.full((len(sightings), 4), np.log(0.25))


mutant(ClassifierModel, "half-posterior", "test_optional_abilities_are_complete", ConfusionConfig)(
    classifier_build(HalfPosterior)
)
