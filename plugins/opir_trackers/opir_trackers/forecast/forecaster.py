"""When impacts of tracks are forecast anew, and the tracks with the latest forecast."""

from typing import NamedTuple

import numpy as np
from attrs import evolve

from opir_core.arrays import FloatArray
from opir_core.flight import Forces
from opir_core.plugin import TARGET_TYPES, ImpactRegion, Tracks
from opir_core.scene import UNKNOWN_TYPE
from opir_trackers.filter.estimates import ModeEstimates
from opir_trackers.forecast.prior_boosts import longest_gap_s


class _Latest(NamedTuple):
    """The latest forecast of a track."""

    tick_s: float
    dark_since_s: float
    impact: FloatArray
    covariance: FloatArray
    sigmas: FloatArray
    regions: tuple[ImpactRegion, ...]
    probability_relights: float
    by_class: FloatArray


class Forecaster:
    """The latest forecasts of tracks, renewed every `every_s` and where a target stops or starts to burn."""

    def __init__(self, every_s: float, forces: Forces) -> None:
        self._every_s, self._forces = every_s, forces
        self._latest: dict[int, _Latest] = {}

    def with_impacts(self, tracks: Tracks, estimates: ModeEstimates, types: FloatArray) -> Tracks:
        """Return tracks with impacts, regions and probabilities, given their estimates (same rows).

        `types` (n, types) are the log likelihoods of reported types. Types follow from the ranges of the forecast; of a
        track without a launch point or a forecast, those of the reports remain.
        """
        if not len(tracks):
            self._latest.clear()
            return tracks
        numbers = tracks.track.tolist()
        silent_s, dark = estimates.detection_rate[:, 2].tolist(), (estimates.weight[:, 0] <= 0.5).tolist()
        tick_s = float(tracks.tick_s[0])
        due = [row for row, number in enumerate(numbers) if self._is_due(number, tick_s, silent_s[row], dark[row])]
        if due:
            rows = np.array(due)
            self._renew(tracks.take(rows), estimates.take(rows), types[rows])
        self._latest = {number: self._latest[number] for number in numbers}
        latest = [self._latest[number] for number in numbers]
        found = np.empty(len(latest), dtype=np.object_)
        for row, one in enumerate(latest):
            found[row] = one.regions
        by_class = np.array([one.by_class for one in latest])
        type_probability = tracks.type_probability.copy()
        known = by_class.any(axis=1) & np.isfinite(tracks.launch[:, 0])
        type_probability[known, : len(TARGET_TYPES)], type_probability[known, UNKNOWN_TYPE] = by_class[known], 0.0
        return evolve(
            tracks,
            impact=np.array([one.impact for one in latest]),
            impact_covariance=np.array([one.covariance for one in latest]),
            impact_sigmas=np.array([one.sigmas for one in latest]),
            impact_regions=found,
            type_probability=type_probability,
            probability_burning=estimates.weight[:, 0],
            probability_relights=np.array([one.probability_relights for one in latest]),
        )

    def _is_due(self, number: int, tick_s: float, silent_s: float, is_dark: bool) -> bool:
        """Return whether a track needs a new forecast: not one that nothing can change any more."""
        latest = self._latest.get(number)
        if latest is None or is_dark != (latest.dark_since_s < np.inf):
            return True
        since_s = tick_s - latest.tick_s
        return since_s >= self._every_s - 1e-6 and silent_s - since_s < longest_gap_s()

    def _renew(self, tracks: Tracks, estimates: ModeEstimates, types: FloatArray) -> None:
        from opir_trackers.forecast.forecast import forecasts

        tick_s = float(tracks.tick_s[0])
        sigma_s = np.sqrt(tracks.launch_covariance[:, 2, 2])
        hits, spell, silent_s = estimates.detection_rate.T
        # The burn ended when detections did, if these are of plumes; or when the filter said so.
        dark_s = np.maximum(silent_s - spell / np.maximum(hits, 1.0), 0.0)
        since_s = np.where(estimates.weight[:, 0] > 0.5, np.inf, tick_s - dark_s)
        for row, number in enumerate(tracks.track.tolist()):
            known = self._latest.get(number)
            if known is not None:
                since_s[row] = min(since_s[row], known.dark_since_s) if np.isfinite(since_s[row]) else np.inf
        dark_s = np.where(np.isfinite(since_s), tick_s - since_s, dark_s)
        found = forecasts(estimates, dark_s, tracks.launch, sigma_s, types, tick_s, self._forces)
        for row, number in enumerate(tracks.track.tolist()):
            self._latest[number] = _Latest(
                tick_s,
                float(since_s[row]),
                found.impact[row],
                found.covariance[row],
                found.sigmas[row],
                found.regions[row],
                float(found.probability_relights[row]),
                found.by_class[row],
            )
