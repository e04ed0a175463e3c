"""The confidence model `posterior`: the probability of the reported type, by a classifier that
computes it.
"""

import numpy as np
from attrs import frozen

from opir_core.arrays import ByteArray, FloatArray
from opir_core.errors import ModelError
from opir_core.interfaces import has_own
from opir_core.plugin import REPORTED_TYPES, Classifier, ClassifierInputs, Confidence, ModelContext
from opir_photons.classification.configs import PosteriorConfig


@frozen
class PosteriorConfidence(Confidence):
    """The probability of the reported type; of UNKNOWN, the probability that the detection is of
    none of the others.
    """

    classifier: Classifier
    reported_types: tuple[str, ...] = REPORTED_TYPES

    def confidence(self, sightings: ClassifierInputs) -> FloatArray:
        """Return confidences (n,)."""
        log_probability = self.classifier.log_posterior(sightings)
        assert log_probability is not None
        return self.of_types(self.classifier.reported(log_probability), log_probability)

    def of_types(self, reported_type: ByteArray, log_probability: FloatArray) -> FloatArray:
        """Return confidences (n,) of reported types (n,)."""
        log_types = self.classifier.over_types(log_probability, self.reported_types)
        log_reported = log_types[np.arange(len(log_types)), reported_type]
        # A sum of shares may exceed 1 by a rounding error.
        return np.minimum(np.exp(log_reported), 1.0)


def posterior_confidence(_config: PosteriorConfig, context: ModelContext) -> Confidence:
    """Return the model `posterior`; raises `ModelError` for classifiers without probabilities."""
    classifier = context.classifier
    if classifier is None or not has_own(Classifier, classifier, "log_posterior"):
        raise ModelError(
            "confidence: posterior reports type probabilities, which the scene's classifier does"
            " not compute; choose classification: spectral, or confidence: weighted"
        )
    return PosteriorConfidence(classifier, context.reported_types)
