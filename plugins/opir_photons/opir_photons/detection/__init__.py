"""Detection: thresholds in Gaussian noise, cumulative probability, latency, and rules over several bands.

Each name is imported when it is first used. Signals and thresholds are in standard deviations of the noise.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from opir_core.scoring.latency import cumulative_probability, latency_cdf, latency_mean, latency_quantile
    from opir_photons.detection.band_rules import RatioGates
    from opir_photons.detection.cfar import (
        cfar_false_alarm_probability,
        cfar_loss,
        cfar_probability_of_detection,
        cfar_threshold,
    )
    from opir_photons.detection.correlated_looks import effective_looks
    from opir_photons.detection.threshold import (
        false_alarm_probability,
        log_probability_of_detection,
        m_of_n_probability,
        probability_of_detection,
        required_snr,
        threshold_sigma,
    )

#: The module of each name, by which it is imported when it is first used.
_HOMES = {
    "opir_core.scoring.latency": "cumulative_probability latency_cdf latency_mean latency_quantile",
    "opir_photons.detection.band_rules": "RatioGates",
    "opir_photons.detection.cfar": (
        "cfar_false_alarm_probability cfar_loss cfar_probability_of_detection cfar_threshold"
    ),
    "opir_photons.detection.correlated_looks": "effective_looks",
    "opir_photons.detection.threshold": (
        "false_alarm_probability log_probability_of_detection m_of_n_probability probability_of_detection "
        "required_snr threshold_sigma"
    ),
}

__all__ = [
    "RatioGates",
    "cfar_false_alarm_probability",
    "cfar_loss",
    "cfar_probability_of_detection",
    "cfar_threshold",
    "cumulative_probability",
    "effective_looks",
    "false_alarm_probability",
    "latency_cdf",
    "latency_mean",
    "latency_quantile",
    "log_probability_of_detection",
    "m_of_n_probability",
    "probability_of_detection",
    "required_snr",
    "threshold_sigma",
]


def __getattr__(name: str) -> Any:
    for home, names in _HOMES.items():
        if name in names.split():
            value = globals()[name] = getattr(import_module(home), name)
            return value
    raise AttributeError(f"module 'opir_photons.detection' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
