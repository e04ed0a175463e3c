"""The metric `warning_time`: how long before the impact a warning meets a requirement, and what
came before it.
"""

from collections.abc import Mapping

import numpy as np
from attrs import frozen
from opir_scoring import WarningRequirement, warning_times

from opir_core import Run
from opir_core.arrays import FloatArray
from opir_core.plugin import MetricContext
from opir_studies.configs import WarningConfig
from opir_studies.metrics.track_metrics import run_evidence

_TIMES_TO = ("time_to_report_s", "time_to_track_s", "time_to_region_s", "time_to_warning_s")


@frozen
class WarningTimeMetric:
    """From the first estimate that meets the requirement, as do all later ones, to the true impact.

    A launch without a warning has a warning time of 0 s, so that the mean is over the launches with
    an impact. The other times count from ignition, over the launches that reach them.
    """

    requirement: WarningRequirement

    @property
    def units(self) -> Mapping[str, str]:
        """Return the names of the figures with their units."""
        return {
            "warning_time_s": "s",
            "warned": "",
            "warning_contained": "",
            **dict.fromkeys(_TIMES_TO, "s"),
        }

    def values(self, run: Run) -> Mapping[str, float]:
        """Return means over launches; nan without a launch that comes down."""
        found = warning_times(*run_evidence(run), self.requirement)
        landing = np.isfinite(found.impact_s)
        rows = run.summary["targets"][: len(landing)]
        reports = [row["end_to_end_latency_s"] for row in rows]
        report_s = np.array(
            [np.nan if each is None else each for each in reports], dtype=np.float64
        )
        return {
            "warning_time_s": _mean(found.warning_s[landing]),
            "warned": _mean((found.warning_s[landing] > 0.0).astype(np.float64)),
            "warning_contained": _mean(found.contained[landing]),
            "time_to_report_s": _mean(report_s),
            "time_to_track_s": _mean(found.track_s),
            "time_to_region_s": _mean(found.region_s),
            "time_to_warning_s": _mean(found.warned_s[landing]),
        }


def warning_time_metric(config: WarningConfig, _context: MetricContext) -> WarningTimeMetric:
    """Return the metric `warning_time`."""
    return WarningTimeMetric(
        WarningRequirement(
            missile_probability=config.missile_probability,
            region_km2=config.region_km2,
            launch_point_km=config.launch_point_km,
            containment=config.containment_percent / 100.0,
        )
    )


def _mean(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return float(known.mean()) if len(known) else np.nan
