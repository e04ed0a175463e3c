"""Detection: thresholds in Gaussian noise, cumulative probability, latency, and rules over several bands.

Each name is imported when it is first used. Signals and thresholds are in standard deviations of the noise.
"""

from importlib import import_module
from typing import TYPE_CHECKING, Any

if TYPE_CHECKING:
    from opir_core.detection.latency import cumulative_probability, latency_cdf, latency_mean, latency_quantile
    from opir_core.detection.ratio_gates import RatioGates
    from opir_core.detection.threshold import (
        false_alarm_probability,
        log_probability_of_detection,
        m_of_n_probability,
        probability_of_detection,
        required_snr,
        threshold_sigma,
    )

_HOMES = {
    "RatioGates": "ratio_gates",
    "cumulative_probability": "latency",
    "false_alarm_probability": "threshold",
    "latency_cdf": "latency",
    "latency_mean": "latency",
    "latency_quantile": "latency",
    "log_probability_of_detection": "threshold",
    "m_of_n_probability": "threshold",
    "probability_of_detection": "threshold",
    "required_snr": "threshold",
    "threshold_sigma": "threshold",
}

__all__ = [
    "RatioGates",
    "cumulative_probability",
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
    home = _HOMES.get(name)
    if home is None:
        raise AttributeError(f"module 'opir_core.detection' has no attribute {name!r}")
    value = getattr(import_module(f"opir_core.detection.{home}"), name)
    globals()[name] = value
    return value


def __dir__() -> list[str]:
    return __all__
