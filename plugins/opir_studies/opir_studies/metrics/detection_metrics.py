"""Metrics of detections: latency, share of targets detected by time, false events."""

from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from attrs import frozen

from opir_core import Run
from opir_core.arrays import FloatArray
from opir_core.plugin import MetricContext, NoConfig
from opir_studies.configs import DetectionByTimeConfig

_DAY_S = 86_400.0


def _detected(run: Run, column: str) -> FloatArray:
    """Return latencies (n,), s, of a run's launches, nan for those not detected."""
    rows = run.sightings[: len(run.plan.scene.targets)]
    return np.array(
        [np.nan if row[column] is None else row[column] for row in rows], dtype=np.float64
    )


@frozen
class LatencyMetric:
    """From ignition to the first detection, and to its report, over the launches of a run.

    Means are over the launches that are detected. Quantiles are over all launches: one that is not
    detected is later than any, and a quantile that is such a launch's is nan.
    """

    shares: ClassVar[Mapping[str, str]] = {
        "latency_s": "detected",
        "latency_end_to_end_s": "detected",
    }

    @property
    def units(self) -> Mapping[str, str]:
        """Return the names of the figures with their units."""
        names = (
            "latency_s",
            "latency_p50_s",
            "latency_p90_s",
            "latency_end_to_end_s",
            "latency_end_to_end_p90_s",
        )
        return {**dict.fromkeys(names, "s"), "detected": ""}

    def values(self, run: Run) -> Mapping[str, float]:
        """Return mean and quantiles over launches, and the share of launches detected."""
        sensor = _detected(run, "latency_s")
        report = _detected(run, "end_to_end_latency_s")
        return {
            "latency_s": mean_of_known(sensor),
            "latency_p50_s": _quantile(sensor, 0.5),
            "latency_p90_s": _quantile(sensor, 0.9),
            "latency_end_to_end_s": mean_of_known(report),
            "latency_end_to_end_p90_s": _quantile(report, 0.9),
            "detected": share_of_known(sensor, len(sensor)),
        }


def latency_metric(_config: NoConfig, _context: MetricContext) -> LatencyMetric:
    """Return the metric `latency`."""
    return LatencyMetric()


@frozen
class DetectionByTimeMetric:
    """The share of a run's launches that are detected within each time: its mean over runs is the
    cumulative P_d.
    """

    times_s: tuple[float, ...]

    @property
    def units(self) -> Mapping[str, str]:
        """Return the names of the figures, without units."""
        return {f"detected_by_{time_words(time_s)}": "" for time_s in self.times_s}

    def values(self, run: Run) -> Mapping[str, float]:
        """Return the share detected within each time."""
        latency_s = _detected(run, "latency_s")
        shares = [
            float((latency_s <= time_s).mean()) if len(latency_s) else np.nan
            for time_s in self.times_s
        ]
        return dict(zip(self.units, shares, strict=True))


def detection_by_time_metric(
    config: DetectionByTimeConfig, _context: MetricContext
) -> DetectionByTimeMetric:
    """Return the metric `detection_by_time`."""
    return DetectionByTimeMetric(config.times_s)


@frozen
class FalseEventsMetric:
    """Detections that belong to no launch, and those without any source, per day."""

    @property
    def units(self) -> Mapping[str, str]:
        """Return the names of the figures with their units."""
        return {"false_events_a_day": "1/day", "false_alarms_a_day": "1/day"}

    def values(self, run: Run) -> Mapping[str, float]:
        """Return both rates over the duration of the scene: all false events, and those of noise
        alone.
        """
        days = run.plan.scene.duration_s / _DAY_S
        target = run.truth.target
        is_launch = (target >= 0) & (target < len(run.plan.scene.targets))
        return {
            "false_events_a_day": float(np.count_nonzero(~is_launch)) / days,
            "false_alarms_a_day": float(np.count_nonzero(target < 0)) / days,
        }


def false_events_metric(_config: NoConfig, _context: MetricContext) -> FalseEventsMetric:
    """Return the metric `false_events`."""
    return FalseEventsMetric()


def time_words(time_s: float) -> str:
    """Return a time as part of a name, `2_5_s`."""
    return f"{time_s:g}_s".replace(".", "_").replace("-", "m").replace("+", "")


def mean_of_known(values: FloatArray) -> float:
    """Return the mean of the finite ones of values (n,), nan without any; `share_of_known` belongs
    beside it.
    """
    finite = values[np.isfinite(values)]
    return float(finite.mean()) if len(finite) else np.nan


def share_of_known(values: FloatArray, launches: int) -> float:
    """Return the number of finite values (n,), one a launch, over the number of launches; nan
    without launches.
    """
    return np.count_nonzero(np.isfinite(values)) / launches if launches else np.nan


def _quantile(values: FloatArray, share: float) -> float:
    """Return a quantile of values (n,) of which nan is larger than any; nan where it falls beyond a
    known one.
    """
    if not len(values):
        return np.nan
    ordered = np.sort(np.where(np.isnan(values), np.inf, values))
    quantile = float(np.interp(share * (len(values) - 1), np.arange(len(values)), ordered))
    return quantile if np.isfinite(quantile) else np.nan
