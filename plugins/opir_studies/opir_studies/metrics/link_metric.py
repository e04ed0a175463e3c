"""The metric of links: how late reports are, and how many do not arrive."""

from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from attrs import frozen

from opir_core import Run
from opir_core.plugin import MetricContext
from opir_studies.configs import LinksConfig


@frozen
class LinksMetric:
    """From look to report over all reports of a run; shares of late reports and of lost ones.

    Lost reports are those of the scene's links; a run that is read from files does not say how many
    there were.
    """

    late_s: float

    units: ClassVar[Mapping[str, str]] = {
        "report_delay_s": "s",
        "report_delay_p95_s": "s",
        "reports_late": "",
        "reports_lost": "",
    }

    def values(self, run: Run) -> Mapping[str, float]:
        """Return mean and 95 % quantile of the delay, and both shares; nan without reports,
        but for lost ones.
        """
        lost = {"reports_lost": _lost_share(run)}
        delay_s = (run.detections.reported_ns - run.detections.time_ns) * 1e-9
        if not len(delay_s):
            return dict.fromkeys(self.units, np.nan) | lost
        return lost | {
            "report_delay_s": float(delay_s.mean()),
            "report_delay_p95_s": float(np.quantile(delay_s, 0.95, method="inverted_cdf")),
            "reports_late": float((delay_s > self.late_s).mean()),
        }


def _lost_share(run: Run) -> float:
    if run.plan.links is None:
        return 0.0
    if run.lost is None:
        return np.nan
    lost = int(run.lost.sum())
    reports = lost + len(run.detections)
    return lost / reports if reports else np.nan


def links_metric(config: LinksConfig, _context: MetricContext) -> LinksMetric:
    """Return the metric `links`."""
    return LinksMetric(config.late_s)
