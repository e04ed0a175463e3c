"""The contract of a forecaster, and what says nothing of where a target comes down."""

from abc import abstractmethod
from typing import Any

import numpy as np

from opir_core.arrays import BoolArray, IntArray
from opir_core.interfaces import TRACK_ENDS, PluginPart
from opir_forecast.configs import NoForecastConfig
from opir_forecast.estimates import BoostEstimates
from opir_forecast.launch_forecasts import LaunchForecasts
from opir_forecast.outcomes import Outcomes
from opir_forecast.particles import LAW
from opir_forecast.vehicles import vehicle_model

_IMPACT = TRACK_ENDS.index("impact")
_ORBIT = TRACK_ENDS.index("orbit")


class Forecaster(PluginPart):
    """Hypotheses and impacts of launched targets.

    A tracker asks once a tick, with the tracks that it reports then. A forecaster may remember what
    it has made by track number.

    >>> from opir_forecast import Forecaster, LaunchForecasts
    >>> class Ignorant(Forecaster):
    ...     def forecasts(self, estimates, time_s):
    ...         hypotheses = estimates.log_likelihood.shape[1]
    ...         even = np.full((len(estimates), hypotheses), 1.0 / hypotheses)
    ...         unknown = np.full(len(estimates), np.nan)
    ...         return LaunchForecasts.without_impacts(even, estimates.burning, *[unknown] * 3)
    """

    @abstractmethod
    def forecasts(self, estimates: BoostEstimates, time_s: float) -> LaunchForecasts:
        """Return the forecasts of tracks (n,) at a time, rows as of the estimates.

        Rows that are no launch have no impact.
        """


class NoForecast(Forecaster):
    """The forecaster `none`: hypotheses by their prior and the sensors' reports, and no impacts."""

    def __init__(self, outcomes: Outcomes) -> None:
        self._outcomes = outcomes

    def forecasts(self, estimates: BoostEstimates, time_s: float) -> LaunchForecasts:
        """Return forecasts without impacts, and without the probabilities that these would give."""
        given_launch = self._outcomes.by_reports(estimates.log_likelihood)
        unknown = np.full(len(estimates), np.nan)
        return LaunchForecasts.without_impacts(given_launch, estimates.burning, *[unknown] * 3)


def no_forecast(config: NoForecastConfig, context: Any) -> NoForecast:
    """Return the forecaster `none` for the context of a part."""
    return NoForecast(outcomes_of(context))


def outcomes_of(context: Any) -> Outcomes:
    """Return the outcomes of the hypotheses of a part's context, under the law of vehicles that the
    tracker's setting `boost_prior` names, if it has one.
    """
    model = vehicle_model(getattr(context.settings, "boost_prior", None))
    return Outcomes(model, tuple(context.tracker.hypotheses))


def track_ends(latest: LaunchForecasts, time_s: float, is_silent: BoolArray) -> IntArray:
    """Return the codes (n,) of the ends of tracks, which are silent for longer than a gap."""
    impact_s = latest.impact[:, 2]
    sigma_s = np.sqrt(latest.impact_covariance[:, 2, 2])
    end = np.where(is_silent & (latest.in_orbit > LAW.in_orbit), _ORBIT, 0)
    return np.where(is_silent & (impact_s + 3.0 * sigma_s < time_s), _IMPACT, end)
