"""The classifier `spectral` and the confidence model `posterior`, imported for scenes that name
them.
"""

from collections.abc import Iterable
from typing import TYPE_CHECKING

from opir_core.plugin import ClassifierModel, ConfidenceModel, hookimpl
from opir_photons.classification.configs import PosteriorConfig, SpectralConfig

if TYPE_CHECKING:
    from opir_core.plugin import Classifier, Confidence, ModelContext


def _spectral(config: SpectralConfig, context: "ModelContext") -> "Classifier":
    from opir_photons.classification.spectral import spectral_classifier

    return spectral_classifier(config, context)


def _posterior(config: PosteriorConfig, context: "ModelContext") -> "Confidence":
    from opir_photons.classification.posterior_confidence import posterior_confidence

    return posterior_confidence(config, context)


@hookimpl
def opir_confidence_models() -> Iterable[ConfidenceModel]:
    """Yield `posterior`."""
    yield ConfidenceModel(
        name="posterior",
        summary="the probability that the reported type is right, for classification: spectral",
        config=PosteriorConfig,
        build=_posterior,
        reads=(),
        subject="light",
    )


@hookimpl
def opir_classifiers() -> Iterable[ClassifierModel]:
    """Yield `spectral`."""
    yield ClassifierModel(
        name="spectral",
        summary="probabilities of each hypothesis from measured band intensities; default with"
        " detection: snr",
        config=SpectralConfig,
        build=_spectral,
        reads=(),
        subject="light",
    )
