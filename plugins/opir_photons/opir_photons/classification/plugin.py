"""The classifier `spectral` and the confidence model `posterior`, imported for scenes that name
them.
"""

from collections.abc import Iterable

from opir_core.plugin import ClassifierModel, ConfidenceModel, deferred, hookimpl
from opir_photons.classification.configs import PosteriorConfig, SpectralConfig


@hookimpl
def opir_confidence_models() -> Iterable[ConfidenceModel]:
    """Yield `posterior`."""
    yield ConfidenceModel(
        name="posterior",
        summary="the probability that the reported type is right, for classification: spectral",
        config=PosteriorConfig,
        build=deferred("opir_photons.classification.posterior_confidence.posterior_confidence"),
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
        build=deferred("opir_photons.classification.spectral.spectral_classifier"),
        reads=(),
        subject="light",
    )
