"""The core's plugin of the detection model `snr`, imported for scenes that name it; see `CORE_PLUGINS`."""

from collections.abc import Iterable
from typing import TYPE_CHECKING

from opir_core.detection.configs import SnrConfig
from opir_core.host.components import DetectionModel
from opir_core.host.hookspecs import hookimpl

if TYPE_CHECKING:
    from opir_core.interfaces.contexts import ModelContext
    from opir_core.interfaces.protocols import DetectionProbability


def _snr(config: SnrConfig, context: "ModelContext") -> "DetectionProbability":
    from opir_core.detection.snr import snr_detection

    return snr_detection(config, context)


@hookimpl
def opir_detection_models() -> Iterable[DetectionModel]:
    """Yield `snr`."""
    yield DetectionModel(
        name="snr",
        summary="signal over noise in each band against a threshold, and the sensor's rule over its bands",
        config=SnrConfig,
        build=_snr,
    )
