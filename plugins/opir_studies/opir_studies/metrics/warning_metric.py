"""The metric `warning_time`: how long before the impact a warning meets a requirement, and what
came before it.
"""

from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from attrs import frozen
from opir_scoring import WarningRequirement, warning_times

from opir_core import Run
from opir_core.plugin import MetricContext
from opir_studies.configs import WarningConfig
from opir_studies.metrics.detection_metrics import mean_of_known, share_of_known
from opir_studies.metrics.track_metrics import run_evidence

#: The times from ignition, and the share of launches that each is of.
_TIMES_TO = {
    "time_to_report_s": "share_with_report",
    "time_to_track_s": "share_with_track",
    "time_to_region_s": "share_with_region",
    "time_to_warning_s": "warned",
}


@frozen
class WarningTimeMetric:
    """From the first estimate that meets the requirement, as do all later ones, to the true impact.

    A launch without a warning before its impact has a warning time of 0 s, so that the mean is over
    the launches with an impact. `warned` is the share of these with a warning; `time_to_warning_s`
    and `warning_contained` are of them, and a warning without a region contains nothing. The other
    times, too, count from ignition, over the launches that reach them: `share_with_…` of all
    launches.
    """

    requirement: WarningRequirement
    shares: ClassVar[Mapping[str, str]] = {**_TIMES_TO, "warning_contained": "warned"}

    @property
    def units(self) -> Mapping[str, str]:
        """Return the names of the figures with their units."""
        shares = dict.fromkeys(_TIMES_TO.values(), "")
        return {
            "warning_time_s": "s",
            "warned": "",
            "warning_contained": "",
            **dict.fromkeys(_TIMES_TO, "s"),
            **shares,
        }

    def values(self, run: Run) -> Mapping[str, float]:
        """Return means over launches; nan without a launch that comes down."""
        times = warning_times(*run_evidence(run), self.requirement)
        landing = np.isfinite(times.impact_s)
        launches = len(times.impact_s)
        is_warned = times.warning_s[landing] > 0.0
        rows = run.sightings[: len(landing)]
        reports = [row["end_to_end_latency_s"] for row in rows]
        report_s = np.array(
            [np.nan if latency is None else latency for latency in reports], dtype=np.float64
        )
        return {
            "warning_time_s": mean_of_known(times.warning_s[landing]),
            "warned": mean_of_known(is_warned.astype(np.float64)),
            "warning_contained": mean_of_known(
                (times.contained[landing][is_warned] == 1.0).astype(np.float64)
            ),
            "time_to_report_s": mean_of_known(report_s),
            "time_to_track_s": mean_of_known(times.track_s),
            "time_to_region_s": mean_of_known(times.region_s),
            "time_to_warning_s": mean_of_known(times.warned_s[landing][is_warned]),
            "share_with_report": share_of_known(report_s, launches),
            "share_with_track": share_of_known(times.track_s, launches),
            "share_with_region": share_of_known(times.region_s, launches),
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
