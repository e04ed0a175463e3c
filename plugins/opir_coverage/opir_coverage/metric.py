"""The metric `coverage` of studies: share of the Earth in view, gaps, and number of sensors."""

from collections.abc import Mapping

from attrs import frozen

from opir_core import Run
from opir_core.plugin import MetricContext
from opir_coverage.computing import computed_coverage, made_settings
from opir_coverage.metric_config import CoverageMetricConfig
from opir_coverage.settings import CoverageSettings


@frozen
class CoverageMetric:
    """Figures of geometry alone: equal in all runs of a design."""

    settings: CoverageSettings

    @property
    def units(self) -> Mapping[str, str]:
        """Return the names of the figures with their units."""
        return {"covered": "", "always_covered": "", "longest_gap_s": "s", "sensors": ""}

    def values(self, run: Run) -> Mapping[str, float]:
        """Return shares of the area covered on average and always, longest gap, s, and sensors."""
        coverage = computed_coverage(run.plan, self.settings)
        weights = coverage.grid.weights()
        share = 0.01 * coverage["coverage_time"].values.ravel()
        gap_s = coverage["revisit_time_max"].values.ravel()
        return {
            "covered": float(weights @ share),
            "always_covered": float(weights[coverage["gaps"].values.ravel() == 0].sum()),
            "longest_gap_s": float(gap_s.max()),
            "sensors": float(len(run.plan.sensors)),
        }


def coverage_metric(config: CoverageMetricConfig, _context: MetricContext) -> CoverageMetric:
    """Return the metric `coverage`."""
    settings = made_settings(
        target_class=None,
        heights_km=(config.height_km,),
        grid_deg=config.grid_deg,
        steps=config.steps,
        assets=(config.assets,),
    )
    return CoverageMetric(settings)
