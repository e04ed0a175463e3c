"""A metric whose figure each launch of a run has by chance, with a probability that is known."""

from collections.abc import Mapping
from typing import ClassVar

import numpy as np
from attrs import frozen

from opir_core.plugin import MetricModel, hookimpl, number

#: Launches that are drawn in each run.
LAUNCHES = 10


@frozen(kw_only=True)
class ChanceConfig:
    """The settings of the metric `chance`."""

    time_s: float = number(
        help="least time of a launch that has one", default=50.0, unit="s", source="arbitrary"
    )
    spread_s: float = number(
        help="largest time minus the least", default=10.0, unit="s", source="arbitrary"
    )


@frozen
class ChanceMetric:
    """A launch has the time with the probability of detection of ICBM that the first sensor has."""

    time_s: float
    spread_s: float
    shares: ClassVar[Mapping[str, str]] = {"time_s": "having"}
    units: ClassVar[Mapping[str, str]] = {"time_s": "s", "having": "", "time_of_all_s": "s"}

    def values(self, run):
        """Return the mean time of those that have one, their share, and the time where all have
        one.
        """
        chance = run.plan.scene.sensors[0].model.config.detection_probability["ICBM"]
        draws = np.random.default_rng(run.plan.scene.seed).random(LAUNCHES)
        has = draws < chance
        time_s = self.time_s + self.spread_s * draws[has]
        return {
            "time_s": float(time_s.mean()) if len(time_s) else np.nan,
            "having": float(has.mean()),
            "time_of_all_s": float(time_s.mean()) if has.all() else np.nan,
        }


@hookimpl
def opir_metrics():
    """Yield the metric."""
    yield MetricModel(
        name="chance",
        summary="a time that some launches have",
        config=ChanceConfig,
        build=lambda config, _context: ChanceMetric(config.time_s, config.spread_s),
    )


def values_of(seed, runs, chance, spread_s=10.0):
    """Return the times (runs, launches), nan where a launch has none, of runs with seeds from one
    on.
    """
    draws = np.array([np.random.default_rng(seed + row).random(LAUNCHES) for row in range(runs)])
    return np.where(draws < chance, 50.0 + spread_s * draws, np.nan)
