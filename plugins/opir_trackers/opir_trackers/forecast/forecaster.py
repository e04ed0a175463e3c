"""When impacts of tracks are forecast anew, and the tracks with the latest forecast."""

from typing import NamedTuple

import numpy as np
from attrs import evolve

from opir_core.arrays import FloatArray
from opir_core.flight.forces import Forces
from opir_core.interfaces.impact_regions import ImpactRegion
from opir_core.interfaces.records import Tracks
from opir_trackers.filter.estimates import ModeEstimates


class _Latest(NamedTuple):
    """The latest forecast of a track."""

    tick_s: float
    is_burning: bool
    impact: FloatArray
    covariance: FloatArray
    sigmas: FloatArray
    regions: tuple[ImpactRegion, ...]
    probability_relights: float


class Forecaster:
    """The latest forecasts of tracks, renewed every `every_s` and where a target stops or starts to burn."""

    def __init__(self, every_s: float, forces: Forces) -> None:
        self._every_s, self._forces = every_s, forces
        self._latest: dict[int, _Latest] = {}

    def with_impacts(self, tracks: Tracks, estimates: ModeEstimates, types: FloatArray) -> Tracks:
        """Return tracks with impacts, regions and probabilities, given their estimates (same rows).

        `types` (n, types) are the log likelihoods of reported types.
        """
        if not len(tracks):
            self._latest.clear()
            return tracks
        numbers, burning = tracks.track.tolist(), (estimates.weight[:, 0] > 0.5).tolist()
        due = [
            row
            for row, (number, burns) in enumerate(zip(numbers, burning, strict=True))
            if self._is_due(number, float(tracks.tick_s[row]), burns)
        ]
        if due:
            self._renew(tracks.take(np.array(due)), estimates.take(np.array(due)), types[due])
        self._latest = {number: self._latest[number] for number in numbers}
        latest = [self._latest[number] for number in numbers]
        found = np.empty(len(latest), dtype=np.object_)
        for row, one in enumerate(latest):
            found[row] = one.regions
        return evolve(
            tracks,
            impact=np.array([one.impact for one in latest]),
            impact_covariance=np.array([one.covariance for one in latest]),
            impact_sigmas=np.array([one.sigmas for one in latest]),
            impact_regions=found,
            probability_burning=estimates.weight[:, 0],
            probability_relights=np.array([one.probability_relights for one in latest]),
        )

    def _is_due(self, number: int, tick_s: float, burns: bool) -> bool:
        latest = self._latest.get(number)
        return latest is None or tick_s - latest.tick_s >= self._every_s - 1e-6 or latest.is_burning != burns

    def _renew(self, tracks: Tracks, estimates: ModeEstimates, types: FloatArray) -> None:
        from opir_trackers.forecast.forecast import forecasts

        tick_s = float(tracks.tick_s[0])
        sigma_s = np.sqrt(tracks.launch_covariance[:, 2, 2])
        found = forecasts(estimates, tracks.launch, sigma_s, types, tick_s, self._forces)
        for row, number in enumerate(tracks.track.tolist()):
            self._latest[number] = _Latest(
                tick_s,
                bool(estimates.weight[row, 0] > 0.5),
                found.impact[row],
                found.covariance[row],
                found.sigmas[row],
                found.regions[row],
                float(found.probability_relights[row]),
            )
