"""Detection: thresholds in Gaussian noise, cumulative probability, latency, and rules over several bands.

Each name is imported when it is first used. Signals and thresholds are in standard deviations of the noise.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from opir_core.detection.band_rules import RatioGates
    from opir_core.detection.cfar import (
        cfar_false_alarm_probability,
        cfar_loss,
        cfar_probability_of_detection,
        cfar_threshold,
    )
    from opir_core.detection.correlated_looks import effective_looks
    from opir_core.detection.latency import cumulative_probability, latency_cdf, latency_mean, latency_quantile
    from opir_core.detection.threshold import (
        false_alarm_probability,
        log_probability_of_detection,
        m_of_n_probability,
        probability_of_detection,
        required_snr,
        threshold_sigma,
    )

#: The module of each name, by which it is imported when it is first used.
_HOMES = {
    "latency": "cumulative_probability latency_cdf latency_mean latency_quantile",
    "band_rules": "RatioGates",
    "cfar": "cfar_false_alarm_probability cfar_loss cfar_probability_of_detection cfar_threshold",
    "correlated_looks": "effective_looks",
    "threshold": (
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
            value = globals()[name] = getattr(import_module(f"opir_core.detection.{home}"), name)
            return value
    raise AttributeError(f"module 'opir_core.detection' has no attribute {name!r}")


def __dir__() -> list[str]:
    return __all__
