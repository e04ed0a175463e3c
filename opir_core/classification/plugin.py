"""The core's plugin of the classifier `spectral`, imported for scenes that name it; see `CORE_PLUGINS`."""

from collections.abc import Iterable
from typing import TYPE_CHECKING

from opir_core.classification.configs import SpectralConfig
from opir_core.host.components import ClassifierModel
from opir_core.host.hookspecs import hookimpl

if TYPE_CHECKING:
    from opir_core.interfaces.contexts import ModelContext
    from opir_core.interfaces.protocols import Classifier


def _spectral(config: SpectralConfig, context: "ModelContext") -> "Classifier":
    from opir_core.classification.spectral import spectral_classifier

    return spectral_classifier(config, context)


@hookimpl
def opir_classifiers() -> Iterable[ClassifierModel]:
    """Yield `spectral`."""
    yield ClassifierModel(
        name="spectral",
        summary="probabilities of each type from measured band intensities, for detection: snr",
        config=SpectralConfig,
        build=_spectral,
    )
