"""The classifier `spectral`, imported for scenes that name it."""

from collections.abc import Iterable
from typing import TYPE_CHECKING

from opir_core.plugin import ClassifierModel, hookimpl
from opir_photons.classification.configs import SpectralConfig

if TYPE_CHECKING:
    from opir_core.plugin import Classifier, ModelContext


def _spectral(config: SpectralConfig, context: "ModelContext") -> "Classifier":
    from opir_photons.classification.spectral import spectral_classifier

    return spectral_classifier(config, context)


@hookimpl
def opir_classifiers() -> Iterable[ClassifierModel]:
    """Yield `spectral`."""
    yield ClassifierModel(
        name="spectral",
        summary="probabilities of each hypothesis from measured band intensities; default with detection: snr",
        config=SpectralConfig,
        build=_spectral,
    )
