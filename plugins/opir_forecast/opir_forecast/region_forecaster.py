"""The forecaster `regions`: the latest forecast of each track, and when it is renewed."""

from typing import Any, Self

import numpy as np
from attrs import evolve, frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.flight import Forces
from opir_core.interfaces import names_of
from opir_forecast.configs import RegionsConfig
from opir_forecast.estimates import BoostEstimates
from opir_forecast.forecaster import Forecaster, outcomes_of, track_ends
from opir_forecast.glide_watch import LAW as WATCH_LAW, GlideWatch, with_glides
from opir_forecast.launch_forecasts import LaunchForecasts
from opir_forecast.outcomes import Outcomes
from opir_forecast.particles import LAW
from opir_forecast.stage_history import StageHistory
from opir_forecast.track_rows import rows_of_tracks


@frozen(eq=False, repr=False)
class LatestForecasts(LaunchForecasts):
    """The latest forecasts of tracks (n,) `number`, made at `made_s`, s, of targets that were
    probably dark or not.
    """

    number: IntArray
    made_s: FloatArray
    is_dark: BoolArray

    @classmethod
    def of(
        cls, forecasts: LaunchForecasts, number: IntArray, made_s: float, is_dark: BoolArray
    ) -> Self:
        """Return the forecasts of tracks that are made at a time."""
        columns = {name: getattr(forecasts, name) for name in names_of(LaunchForecasts)}
        made_at_s = np.full(len(number), made_s)
        return cls(**columns, number=number, made_s=made_at_s, is_dark=is_dark)


class RegionForecaster(Forecaster):
    """The forecaster `regions`, under the forces of free flight; a target's forecast is renewed when
    it stops or starts to burn, and as a share of its age passes.
    """

    def __init__(
        self, outcomes: Outcomes, forces: Forces, config: RegionsConfig | None = None
    ) -> None:
        self._outcomes = outcomes
        self._forces = forces
        self._share = (config or RegionsConfig()).renewal_share
        self._history = StageHistory.begun(np.empty(0, dtype=np.int64), 0.0)
        self._latest = self._nothing(self._history.number)
        self._glides = GlideWatch.begun(self._history.number)
        self._look_s = -np.inf

    def forecasts(self, estimates: BoostEstimates, time_s: float) -> LaunchForecasts:
        """Return the forecasts of tracks (n,) at a time; what is no launch has the prior of
        hypotheses.
        """
        history = rows_of_tracks(
            self._history, estimates.track, lambda number: StageHistory.begun(number, time_s)
        )
        self._history = history.updated(estimates, time_s)
        self._latest = rows_of_tracks(self._latest, estimates.track, self._nothing)
        glides = self._gliding(estimates, time_s)
        if glides is not None:
            # What glides and is seen burns no more.
            estimates = evolve(estimates, burning=estimates.burning * (1.0 - glides))
        self._renew(estimates, time_s)
        latest = self._latest
        end = track_ends(latest, time_s, estimates.silent_s > LAW.longest_gap_s)
        impact = latest.impact, latest.impact_covariance, latest.impact_sigmas
        forecasts = LaunchForecasts(
            latest.given_launch,
            *impact,
            latest.impact_regions,
            estimates.burning,
            latest.probability_relights,
            latest.probability_comes_down,
            latest.in_orbit,
            end,
        )
        return forecasts if glides is None else with_glides(forecasts, glides, self._outcomes)

    def _gliding(self, estimates: BoostEstimates, time_s: float) -> FloatArray | None:
        """Return the probabilities (n,) that tracks glide and are seen; None where none does."""
        watch = self._glides
        if time_s < self._look_s and not watch.is_any:
            return None
        watch = rows_of_tracks(watch, estimates.track, GlideWatch.begun)
        if time_s >= self._look_s:
            watch = watch.updated(estimates, self._outcomes, time_s)
            self._look_s = time_s + WATCH_LAW.look_s
        self._glides = watch
        return watch.probability if watch.is_any else None

    def _nothing(self, number: IntArray) -> LatestForecasts:
        """Return what is said of tracks without a forecast: the prior of hypotheses."""
        count = len(number)
        zero = np.zeros(count)
        unknown = np.full(count, np.nan)
        prior = np.tile(self._outcomes.prior, (count, 1))
        forecasts = LaunchForecasts.without_impacts(prior, zero, zero, unknown, zero)
        return LatestForecasts.of(forecasts, number, -np.inf, np.zeros(count, dtype=np.bool_))

    def _renew(self, estimates: BoostEstimates, time_s: float) -> None:
        """Renew the forecasts of launches that are due, and drop those of what is none any more."""
        latest = self._latest
        due = (estimates.is_launch & self._are_due(estimates, time_s)).nonzero()[0]
        others = (~estimates.is_launch & np.isfinite(latest.made_s)).nonzero()[0]
        if not due.size + others.size:
            return
        # Reported tracks hold the columns of the tick before.
        latest = latest.take(np.arange(len(latest)))
        latest.overwrite(others, self._nothing(estimates.track[others]))
        for start in range(0, due.size, LAW.block):
            rows = due[start : start + LAW.block]
            latest.overwrite(rows, self._renewed(estimates.take(rows), rows, time_s))
        self._latest = latest

    def _renewed(self, estimates: BoostEstimates, rows: IntArray, time_s: float) -> LatestForecasts:
        """Return the new forecasts of the tracks in some rows."""
        from opir_forecast.forecast import forecasts

        history = self._history.take(rows)
        dark_s = _dark_s(estimates, history, time_s)
        made = forecasts(self._outcomes, estimates, history, dark_s, time_s, self._forces)
        return LatestForecasts.of(made, estimates.track, time_s, estimates.burning <= 0.5)

    def _are_due(self, estimates: BoostEstimates, time_s: float) -> BoolArray:
        """Return which tracks (n,) need a new forecast: those seen as a share of their age passes,
        silent ones as a share of their silence does, not for ever.
        """
        history = self._history
        latest = self._latest
        is_new = np.isinf(latest.made_s)
        made_s = np.where(is_new, time_s, latest.made_s)
        begun_s = np.where(history.is_dark, history.dark_since_s, history.ignition_s)
        since_s = time_s - made_s + 1e-6
        silent_s = estimates.silent_s
        ages_s = self._share * (made_s - begun_s)
        wait_s = np.where(silent_s < since_s, ages_s, LAW.silent_share * silent_s)
        is_over = silent_s - since_s >= LAW.longest_gap_s
        has_turned = (estimates.burning <= 0.5) != latest.is_dark
        return is_new | has_turned | ((since_s >= wait_s) & ~is_over)


def _dark_s(estimates: BoostEstimates, history: StageHistory, time_s: float) -> FloatArray:
    """Return the times (n,) since the burns ended.

    They ended when detections did, if these are of plumes; or when the tracker said so.
    """
    quiet_s = np.maximum(estimates.silent_s - estimates.pause_s, 0.0)
    return np.where(history.is_dark, time_s - history.dark_since_s, quiet_s)


def region_forecaster(config: RegionsConfig, context: Any) -> RegionForecaster:
    """Return the forecaster `regions` for the context of a part."""
    return RegionForecaster(outcomes_of(context), context.forces, config)
