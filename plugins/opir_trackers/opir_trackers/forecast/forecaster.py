"""When forecasts of tracks are made anew, and the latest of each."""

from typing import NamedTuple

import numpy as np
from attrs import frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray, ObjectArray
from opir_core.flight import Forces
from opir_core.plugin import Hypothesis, ImpactRegion, Tracks
from opir_trackers.filter.estimates import ModeEstimates
from opir_trackers.forecast.outcomes import Outcomes
from opir_trackers.forecast.stage_history import StageHistory
from opir_trackers.forecast.vehicles import VehicleModel, vehicle_model

#: A dark gap longer than this, s, is none: nothing new can come of a silent track.
LONGEST_GAP_S = 90.0

#: A silent track has a new forecast after this share of its silence: only the chance of a relight
#: changes.
_SILENT_SHARE = 0.5

#: Tracks that are renewed together: a batch of three takes little longer than one.
_GROUP = 8

#: Probability of an orbit in which nothing burns any more that ends a track.
_IN_ORBIT = 0.95

#: Codes of `Tracks.end`: none, impact, orbit.
_GOES_ON, _IMPACT, _ORBIT = range(3)


class _Latest(NamedTuple):
    """The latest forecast of a track."""

    tick_s: float
    is_dark: bool
    given_launch: FloatArray
    impact: FloatArray
    covariance: FloatArray
    sigmas: FloatArray
    regions: tuple[ImpactRegion, ...]
    probability_relights: float
    probability_comes_down: float
    in_orbit: float


@frozen(eq=False)
class LaunchForecasts:
    """The latest forecasts of tracks (n,), given that they were launched.

    `given_launch` (n, H) are over the hypotheses: zero but for launches and `none`, each row sums
    to one. The other columns are those of `Tracks`; `end` says of which tracks nothing new can
    come, and why.
    """

    given_launch: FloatArray
    impact: FloatArray
    impact_covariance: FloatArray
    impact_sigmas: FloatArray
    impact_regions: ObjectArray
    probability_burning: FloatArray
    probability_relights: FloatArray
    probability_comes_down: FloatArray
    end: IntArray


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

    def launch_forecasts(
        self,
        tracks: Tracks,
        estimates: ModeEstimates,
        log_likelihood: FloatArray,
        is_launch: BoolArray | None = None,
    ) -> LaunchForecasts:
        """Return the forecasts of tracks (n,), given their estimates (same rows); to be called at
        each tick.

        `log_likelihood` (n, H) is that of what sensors reported. Tracks that are no launch by
        `is_launch` (n,) have no forecast: the prior of hypotheses, and no region.
        """
        wanted = np.ones(len(tracks), dtype=np.bool_) if is_launch is None else is_launch
        numbers = tracks.track.tolist()
        tick_s = float(tracks.tick_s[0]) if numbers else 0.0
        launch_sigma_s = np.sqrt(tracks.launch_covariance[:, 2, 2])
        history = self._history.of(tracks.track, tick_s)
        self._history = history.updated(estimates, tracks.launch[:, 2], launch_sigma_s, tick_s)
        silent_s = estimates.detection_rate[:, 2].tolist()
        dark = (estimates.weight[:, 0] <= 0.5).tolist()
        due = [
            row
            for row, number in enumerate(numbers)
            if wanted[row] and self._is_due(number, tick_s, silent_s[row], dark[row])
        ]
        if due:
            self._renew(np.array(due), tracks, estimates, log_likelihood)
        nothing = self._nothing()
        self._latest = {
            number: self._latest[number] for number in numbers if number in self._latest
        }
        latest = [
            self._latest.get(number, nothing) if wanted[row] else nothing
            for row, number in enumerate(numbers)
        ]
        return self._columns(latest, estimates, tick_s, np.array(silent_s))

    def _nothing(self) -> _Latest:
        """Return the forecast of what has none."""
        place = np.full(3, np.nan)
        return _Latest(
            -np.inf,
            False,
            self._outcomes.prior,
            place,
            np.full((3, 3), np.nan),
            place,
            (),
            0.0,
            np.nan,
            0.0,
        )

    def _columns(
        self, latest: list[_Latest], estimates: ModeEstimates, tick_s: float, silent_s: FloatArray
    ) -> LaunchForecasts:
        count = len(latest)
        size = len(self._outcomes.hypotheses)
        regions = np.empty(count, dtype=np.object_)
        for row, one in enumerate(latest):
            regions[row] = one.regions
        impact = np.array([one.impact for one in latest]).reshape(count, 3)
        in_orbit = np.array([one.in_orbit for one in latest])
        silent = silent_s > LONGEST_GAP_S
        end = np.where(silent & (in_orbit > _IN_ORBIT), _ORBIT, _GOES_ON)
        down = (
            impact[:, 2] + 3.0 * np.sqrt(np.array([one.covariance[2, 2] for one in latest]))
            < tick_s
        )
        end = np.where(silent & down, _IMPACT, end)
        return LaunchForecasts(
            np.array([one.given_launch for one in latest]).reshape(count, size),
            impact,
            np.array([one.covariance for one in latest]).reshape(count, 3, 3),
            np.array([one.sigmas for one in latest]).reshape(count, 3),
            regions,
            estimates.weight[:, 0],
            np.array([one.probability_relights for one in latest]),
            np.array([one.probability_comes_down for one in latest]),
            end,
        )

    def _is_due(self, number: int, tick_s: float, silent_s: float, is_dark: bool) -> bool:
        """Return whether a track needs a new forecast: the longer it is silent, the less often; not
        for ever.
        """
        latest = self._latest.get(number)
        if latest is None or is_dark != latest.is_dark:
            return True
        since_s = tick_s - latest.tick_s
        # Tracks of a group have the same periods, so one batch renews them; groups take turns, so
        # no tick renews all.
        turn_s = number // _GROUP + 1e-6
        is_new = (tick_s + turn_s) // self._every_s > (latest.tick_s + turn_s) // self._every_s
        return (
            is_new
            and since_s >= _SILENT_SHARE * silent_s - 1e-6
            and silent_s - since_s < LONGEST_GAP_S
        )

    def _renew(
        self, rows: IntArray, tracks: Tracks, estimates: ModeEstimates, log: FloatArray
    ) -> None:
        from opir_trackers.forecast.forecast import forecasts

        tick_s = float(tracks.tick_s[0])
        part = estimates.take(rows)
        history = self._history.take(rows)
        hits, spell, silent_s = part.detection_rate.T
        # The burn ended when detections did, if these are of plumes; or when the filter said so.
        quiet_s = np.maximum(silent_s - spell / np.maximum(hits, 1.0), 0.0)
        dark_s = np.where(np.isfinite(history.dark_since_s), tick_s - history.dark_since_s, quiet_s)
        found = forecasts(
            self._outcomes,
            part,
            history,
            dark_s,
            tracks.launch[rows],
            log[rows],
            tick_s,
            self._forces,
        )
        dark = (part.weight[:, 0] <= 0.5).tolist()
        for row, number in enumerate(tracks.track[rows].tolist()):
            self._latest[number] = _Latest(
                tick_s,
                dark[row],
                found.given_launch[row],
                found.impact[row],
                found.covariance[row],
                found.sigmas[row],
                found.regions[row],
                float(found.probability_relights[row]),
                float(found.probability_comes_down[row]),
                float(found.in_orbit[row]),
            )
