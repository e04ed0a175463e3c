"""The detection model `snr`, imported for scenes that name it."""

from collections.abc import Iterable, Sequence

from opir_core.plugin import DetectionModel, deferred, hookimpl
from opir_photons.detection.configs import SnrConfig


def _subjects_read(config: SnrConfig) -> Sequence[str]:
    return ["light", "sources", *(["detection_probability"] if config.calibrate == "paper" else [])]


@hookimpl
def opir_detection_models() -> Iterable[DetectionModel]:
    """Yield `snr`."""
    yield DetectionModel(
        name="snr",
        summary="signal over noise in each band against a threshold, and the sensor's rule over its"
        " bands",
        config=SnrConfig,
        build=deferred("opir_photons.detection.snr.snr_detection"),
        classifier="spectral",
        reads=_subjects_read,
    )
