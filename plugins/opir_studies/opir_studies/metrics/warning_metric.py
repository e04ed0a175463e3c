"""Metrics of warnings: how long before the impact one meets a requirement, and when each bound on
region, launch point and probability is met.
"""

from collections.abc import Mapping
from functools import lru_cache
from typing import ClassVar

import numpy as np
from attrs import frozen
from opir_scoring import WarningRequirement, WarningTimes, warning_times

from opir_core import Run
from opir_core.arrays import FloatArray
from opir_core.plugin import MetricContext
from opir_studies.configs import QUANTITIES, MilestonesConfig, WarningConfig, milestone_name
from opir_studies.metrics.detection_metrics import mean_of_known, share_of_known
from opir_studies.metrics.track_metrics import comes_down, run_evidence

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
    launch_units: ClassVar[Mapping[str, str]] = {
        "region_s": "s",
        "warned_s": "s",
        "warning_held": "",
        "warning_before_impact_s": "s",
    }

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
        times = _times_of(run, self.requirement)
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

    @property
    def launch_containments(self) -> Mapping[str, float]:
        """Return the stated containment of the column that says whether a region held."""
        return {"warning_held": self.requirement.containment}

    def launches(self, run: Run) -> Mapping[str, FloatArray]:
        """Return the times from ignition to the first impact region and to the warning, whether the
        warning's region contains the impact, and the time from the warning to the impact.

        The first two are inf without one. All but the first are nan for a launch that does not come
        down; one without a warning has 0 s before its impact.
        """
        times = _times_of(run, self.requirement)
        is_warned = times.warning_s > 0.0
        warned_s = np.where(is_warned, times.warned_s, np.inf)
        return {
            "region_s": times.region_s,
            "warned_s": np.where(np.isfinite(times.impact_s), warned_s, np.nan),
            "warning_held": np.where(is_warned, times.contained == 1.0, np.nan),
            "warning_before_impact_s": times.warning_s,
        }


@lru_cache(maxsize=1)
def _times_of(run: Run, requirement: WarningRequirement) -> WarningTimes:
    return warning_times(*run_evidence(run), requirement)


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


@frozen
class Milestone:
    """A bound of a quantity of the tracks: its name in figures, and the requirement that it is."""

    quantity: str
    name: str
    requirement: WarningRequirement


@frozen
class MilestonesMetric:
    """The first estimate from which on a quantity of a launch's track is within a bound, of several.

    For each bound: the mean time over the launches that reach it, their share, and for regions the
    share of these that contain the true impact at that time. Bounds of regions are of the launches
    that come down.
    """

    milestones: tuple[Milestone, ...]

    @property
    def units(self) -> Mapping[str, str]:
        """Return the names of the figures with their units."""
        held = {f"{each.name}_held": "" for each in self._of_regions}
        times = {f"{each.name}_s": "s" for each in self.milestones}
        return {**times, **{f"share_{each.name}": "" for each in self.milestones}, **held}

    @property
    def shares(self) -> Mapping[str, str]:
        """Return the figures whose launches the times and containments are of."""
        held = {f"{each.name}_held": f"share_{each.name}" for each in self._of_regions}
        return {**{f"{each.name}_s": f"share_{each.name}" for each in self.milestones}, **held}

    @property
    def launch_units(self) -> Mapping[str, str]:
        """Return the columns of launches with their units."""
        return {name: unit for name, unit in self.units.items() if name not in self.shares.values()}

    @property
    def _of_regions(self) -> list[Milestone]:
        return [each for each in self.milestones if each.quantity == "region_km2"]

    @property
    def launch_containments(self) -> Mapping[str, float]:
        """Return the stated containment of the columns that say whether a region held."""
        return {f"{each.name}_held": each.requirement.containment for each in self._of_regions}

    def launches(self, run: Run) -> Mapping[str, FloatArray]:
        """Return the time of each bound, and for regions whether they contained the impact then."""
        return _milestones_of(self.milestones, run)

    def values(self, run: Run) -> Mapping[str, float]:
        """Return the figures of every bound."""
        columns = _milestones_of(self.milestones, run)
        means = {name: mean_of_known(column) for name, column in columns.items()}
        applicable = {name: int((~np.isnan(column)).sum()) for name, column in columns.items()}
        shares = {
            f"share_{each.name}": share_of_known(
                columns[f"{each.name}_s"], applicable[f"{each.name}_s"]
            )
            for each in self.milestones
        }
        figures = {**means, **shares}
        return {name: figures[name] for name in self.units}


@lru_cache(maxsize=1)
def _milestones_of(milestones: tuple[Milestone, ...], run: Run) -> Mapping[str, FloatArray]:
    """Return the time of each bound, inf for never, and whether the region contained the impact
    then, nan without a region.
    """
    landing = comes_down(run)
    columns = dict[str, FloatArray]()
    for each in milestones:
        times = warning_times(*run_evidence(run), each.requirement)
        is_of_region = each.quantity == "region_km2"
        applies = landing if is_of_region else np.ones_like(landing)
        columns[f"{each.name}_s"] = np.where(applies, times.warned_s, np.nan)
        if is_of_region:
            is_reached = applies & np.isfinite(times.warned_s)
            columns[f"{each.name}_held"] = np.where(is_reached, times.contained, np.nan)
    return columns


def milestones_metric(config: MilestonesConfig, _context: MetricContext) -> MilestonesMetric:
    """Return the metric `milestones`."""
    return MilestonesMetric(
        tuple(
            _milestone(quantity, bound, config.containment_percent / 100.0)
            for quantity in QUANTITIES
            for bound in getattr(config, quantity)
        )
    )


def _milestone(quantity: str, bound: float, containment: float) -> Milestone:
    bounds: dict[str, float | None] = {**dict.fromkeys(QUANTITIES), quantity: bound}
    requirement = WarningRequirement(
        missile_probability=bounds["missile_probability"],
        region_km2=bounds["region_km2"],
        launch_point_km=bounds["launch_point_km"],
        containment=containment,
    )
    return Milestone(quantity, milestone_name(quantity, bound), requirement)
