"""The latest forecast of each track, and when it is renewed."""

from typing import NamedTuple

import numpy as np
from attrs import evolve
from opir_estimation import ModeEstimates

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.flight import Forces
from opir_core.interfaces import TRACK_ENDS
from opir_core.plugin import Hypothesis, Tracks
from opir_forecast.launch_forecasts import LaunchForecasts
from opir_forecast.outcomes import Outcomes
from opir_forecast.particles import LAW
from opir_forecast.stage_history import StageHistory
from opir_forecast.vehicles import VehicleModel, vehicle_model

_IMPACT = TRACK_ENDS.index("impact")
_ORBIT = TRACK_ENDS.index("orbit")


class _Latest(NamedTuple):
    """The latest forecast of a track: one row."""

    tick_s: float
    is_dark: bool
    forecast: LaunchForecasts


class Forecaster:
    """The latest forecasts of tracks, renewed every `every_s` and where a target stops or starts to
    burn.
    """

    def __init__(
        self,
        every_s: float,
        forces: Forces,
        hypotheses: tuple[Hypothesis, ...],
        model: VehicleModel | None = None,
    ) -> None:
        self._every_s = every_s
        self._forces = forces
        self._outcomes = Outcomes(model or vehicle_model(), hypotheses)
        self._latest: dict[int, _Latest] = {}
        self._history = StageHistory.begun(np.empty(0, dtype=np.int64), 0.0)
        self._nothing = _without_impact(self._outcomes.prior)

    def launch_forecasts(
        self,
        tracks: Tracks,
        estimates: ModeEstimates,
        log_likelihood: FloatArray,
        is_launch: BoolArray,
    ) -> LaunchForecasts:
        """Return the forecasts of tracks (n,), given their estimates (same rows); to be called at
        each tick.

        `log_likelihood` (n, H) is that of sensors' reports. Without a launch by `is_launch` (n,) a
        track has the prior of hypotheses, and no region.
        """
        numbers = tracks.track.tolist()
        tick_s = float(tracks.tick_s[0]) if numbers else 0.0
        launch_sigma_s = np.sqrt(tracks.launch_covariance[:, 2, 2])
        history = self._history.of(tracks.track, tick_s)
        self._history = history.updated(estimates, tracks.launch[:, 2], launch_sigma_s, tick_s)
        silent_s = estimates.detection_rate[:, 2]
        rows_due = self._due_rows(numbers, tick_s, estimates, is_launch)
        if len(rows_due):
            self._renew(rows_due, tracks, estimates, log_likelihood)
        self._latest = {
            number: self._latest[number] for number in numbers if number in self._latest
        }
        latest = self._of(numbers, is_launch)
        end = _ends(latest, tick_s, silent_s > LAW.longest_gap_s)
        return evolve(latest, probability_burning=estimates.weight[:, 0], end=end)

    def _of(self, numbers: list[int], is_launch: BoolArray) -> LaunchForecasts:
        """Return the latest forecasts of tracks with numbers; without a launch, that of none."""
        rows = [
            self._latest[number].forecast if launched else self._nothing
            for number, launched in zip(numbers, is_launch.tolist(), strict=True)
        ]
        return LaunchForecasts.concatenate([self._nothing.take(slice(0)), *rows])

    def _due_rows(
        self, numbers: list[int], tick_s: float, estimates: ModeEstimates, is_launch: BoolArray
    ) -> IntArray:
        """Return the rows of launched tracks whose forecasts are due."""
        silent_s = estimates.detection_rate[:, 2].tolist()
        is_dark = _is_dark(estimates).tolist()
        rows = [
            row
            for row in np.flatnonzero(is_launch).tolist()
            if self._is_due(numbers[row], tick_s, silent_s[row], is_dark[row])
        ]
        return np.array(rows, dtype=np.int64)

    def _is_due(self, number: int, tick_s: float, silent_s: float, is_dark: bool) -> bool:
        """Whether a track needs a new forecast: the longer it is silent, the less often; not for
        ever.
        """
        latest = self._latest.get(number)
        if latest is None or is_dark != latest.is_dark:
            return True
        since_s = tick_s - latest.tick_s
        # Tracks of a group have the same periods, so one batch renews them; groups take turns, so
        # no tick renews all.
        turn_s = number // LAW.group + 1e-6
        is_new = (tick_s + turn_s) // self._every_s > (latest.tick_s + turn_s) // self._every_s
        is_long = since_s >= LAW.silent_share * silent_s - 1e-6
        return bool(is_new and is_long and silent_s - since_s < LAW.longest_gap_s)

    def _renew(
        self, rows: IntArray, tracks: Tracks, estimates: ModeEstimates, log: FloatArray
    ) -> None:
        """Renew the forecasts of some rows of tracks."""
        from opir_forecast.forecast import forecasts

        tick_s = float(tracks.tick_s[0])
        estimates = estimates.take(rows)
        history = self._history.take(rows)
        dark_s = _dark_s(estimates, history, tick_s)
        launch = tracks.launch[rows]
        renewed = forecasts(
            self._outcomes, estimates, history, dark_s, launch, log[rows], tick_s, self._forces
        )
        is_dark = _is_dark(estimates).tolist()
        for row, number in enumerate(tracks.track[rows].tolist()):
            forecast = renewed.take(slice(row, row + 1))
            self._latest[number] = _Latest(tick_s, is_dark[row], forecast)


def _dark_s(estimates: ModeEstimates, history: StageHistory, tick_s: float) -> FloatArray:
    """Return the times (n,) since the burns ended.

    They ended when detections did, if these are of plumes; or when the filter said so.
    """
    hits, spell, silent_s = estimates.detection_rate.T
    quiet_s = np.maximum(silent_s - spell / np.maximum(hits, 1.0), 0.0)
    return np.where(history.is_dark, tick_s - history.dark_since_s, quiet_s)


def _is_dark(estimates: ModeEstimates) -> BoolArray:
    """Whether tracks (n,) probably do not burn."""
    return estimates.weight[:, 0] <= 0.5


def _ends(latest: LaunchForecasts, tick_s: float, is_silent: BoolArray) -> IntArray:
    """Return the codes (n,) of the ends of tracks, which are silent for longer than a gap."""
    impact_s = latest.impact[:, 2]
    sigma_s = np.sqrt(latest.impact_covariance[:, 2, 2])
    end = np.where(is_silent & (latest.in_orbit > LAW.in_orbit), _ORBIT, 0)
    return np.where(is_silent & (impact_s + 3.0 * sigma_s < tick_s), _IMPACT, end)


def _without_impact(prior: FloatArray) -> LaunchForecasts:
    """Return the forecast of a track without any: the prior (H,) of hypotheses."""
    zero = np.zeros(1)
    return LaunchForecasts.without_impacts(prior[None], zero, zero, np.full(1, np.nan), zero)
