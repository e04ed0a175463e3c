"""Metrics of tracks, from the scores of `opir_scoring`: completeness, accuracy, launch points,
impact regions.
"""

from collections.abc import Mapping
from functools import lru_cache
from typing import ClassVar

import numpy as np
from attrs import frozen
from opir_scoring import (
    OLDEST_S,
    PHASES,
    ImpactScores,
    Ownership,
    RunEvidence,
    coverage,
    evidence_of_run,
    impact_scores,
    ownership,
    phase_scores,
    point_errors,
    state_errors,
)

from opir_core import Run
from opir_core.arrays import FloatArray, IntArray
from opir_core.interfaces import TRACK_CONTAINMENTS
from opir_core.plugin import MetricContext, NoConfig
from opir_studies.configs import ImpactConfig
from opir_studies.metrics.detection_metrics import mean_of_known, share_of_known, time_words


@lru_cache(maxsize=1)
def run_evidence(run: Run) -> tuple[RunEvidence, Ownership]:
    """Return a run's evidence and the owners of its tracks; the metrics of a run share them."""
    evidence = evidence_of_run(run, run.plan)
    return evidence, ownership(evidence)


@frozen
class TracksMetric:
    """How completely the launches of a run are tracked, and how many tracks belong to none."""

    shares: ClassVar[Mapping[str, str]] = {
        "completeness": "share_with_ticks",
        "tracks_a_launch": "tracked",
        "first_track_s": "tracked",
    }

    @property
    def units(self) -> Mapping[str, str]:
        """Return the names of the figures with their units."""
        names = ("tracked", "completeness", "share_with_ticks", "false_tracks", "tracks_a_launch")
        return {**dict.fromkeys(names, ""), "first_track_s": "s"}

    def values(self, run: Run) -> Mapping[str, float]:
        """Return the figures; `first_track_s` counts from the first detection.

        `completeness` is over launches with a tick between first detection and burnout, which are
        `share_with_ticks`.
        """
        evidence, owners = run_evidence(run)
        covered = coverage(evidence, owners)
        launches = len(run.plan.scene.targets)
        return {
            "tracked": np.count_nonzero(covered.tracks) / launches if launches else np.nan,
            "completeness": mean_of_known(covered.share),
            "share_with_ticks": share_of_known(covered.share, launches),
            "false_tracks": float(np.count_nonzero(owners.target < 0)),
            "tracks_a_launch": mean_of_known(covered.tracks[covered.tracks > 0].astype(np.float64)),
            "first_track_s": mean_of_known(covered.first_track_s),
        }


def tracks_metric(_config: NoConfig, _context: MetricContext) -> TracksMetric:
    """Return the metric `tracks`."""
    return TracksMetric()


@frozen
class AccuracyMetric:
    """Errors of the tracks' states, root mean square over the ticks at which the true state is
    known.

    They are of the launches with such a tick, `share_with_state`; `completeness` of `tracks` says
    how many ticks have an estimate.
    """

    shares: ClassVar[Mapping[str, str]] = dict.fromkeys(
        ("position_rmse_m", "velocity_rmse_m_s"), "share_with_state"
    )

    @property
    def units(self) -> Mapping[str, str]:
        """Return the names of the figures with their units."""
        return {"position_rmse_m": "m", "velocity_rmse_m_s": "m/s", "share_with_state": ""}

    def values(self, run: Run) -> Mapping[str, float]:
        """Return both errors, nan without tracks, and the share of launches that they are of."""
        errors = state_errors(*run_evidence(run))
        launches = len(run.plan.scene.targets)
        return {
            "position_rmse_m": _rms(errors.position_m),
            "velocity_rmse_m_s": _rms(errors.velocity_m_s),
            "share_with_state": len(np.unique(errors.target)) / launches if launches else np.nan,
        }


def accuracy_metric(_config: NoConfig, _context: MetricContext) -> AccuracyMetric:
    """Return the metric `accuracy`."""
    return AccuracyMetric()


@frozen
class LaunchErrorMetric:
    """Errors of the last launch estimates, root mean square over the launches that have one."""

    shares: ClassVar[Mapping[str, str]] = dict.fromkeys(
        ("launch_error_m", "launch_time_error_s"), "share_with_launch"
    )

    @property
    def units(self) -> Mapping[str, str]:
        """Return the names of the figures with their units."""
        return {"launch_error_m": "m", "launch_time_error_s": "s", "share_with_launch": ""}

    def values(self, run: Run) -> Mapping[str, float]:
        """Return both errors, nan without launch estimates, and the share of launches that they are
        of.
        """
        errors = point_errors(*run_evidence(run))
        return {
            "launch_error_m": _rms(errors.launch_m),
            "launch_time_error_s": _rms(errors.launch_time_s),
            "share_with_launch": share_of_known(errors.launch_m, len(run.plan.scene.targets)),
        }


def launch_error_metric(_config: NoConfig, _context: MetricContext) -> LaunchErrorMetric:
    """Return the metric `launch_error`."""
    return LaunchErrorMetric()


@frozen
class ImpactRegionMetric:
    """Predicted impact regions of one containment at phases of the flight and at times since
    ignition.

    For each instant: the median area over launches, the share of regions that contain the true
    impact, and the share of launches with a true impact for which a region is predicted.
    """

    place: int
    phases: tuple[str, ...]
    times_s: tuple[float, ...]

    @property
    def units(self) -> Mapping[str, str]:
        """Return the names of the figures with their units."""
        return {
            name: unit
            for words in self._instants
            for name, unit in zip(_names(words), ("km2", "", ""), strict=True)
        }

    @property
    def shares(self) -> Mapping[str, str]:
        """Return the figures whose launches areas and containments are of: those with a region."""
        names = map(_names, self._instants)
        return {
            figure: predicted
            for area, contained, predicted in names
            for figure in (area, contained)
        }

    def values(self, run: Run) -> Mapping[str, float]:
        """Return the figures of every instant; nan for those that no track reaches."""
        evidence, owners = run_evidence(run)
        truth = evidence.plan.targets.truth()[: len(run.plan.scene.targets)]
        landing = sum(bool(target.get("impact")) for target in truth)
        figures: dict[str, float] = {}
        phase, scores = phase_scores(evidence, owners)
        for name in self.phases:
            figures |= self._figures(
                _phase_words(name), scores.take(phase == PHASES.index(name)), landing
            )
        scores_at_ticks = impact_scores(evidence, owners) if self.times_s else scores
        for time_s in self.times_s:
            figures |= self._figures(
                f"at_{time_words(time_s)}",
                scores_at_ticks.take(_rows_at(evidence, scores_at_ticks, time_s)),
                landing,
            )
        return figures

    @property
    def _instants(self) -> list[str]:
        return [
            *map(_phase_words, self.phases),
            *(f"at_{time_words(time_s)}" for time_s in self.times_s),
        ]

    def _figures(self, words: str, scores: ImpactScores, landing: int) -> dict[str, float]:
        scores = scores.take(scores.has_impact)
        area_km2 = scores.area_km2[:, self.place]
        contained = scores.contained[:, self.place]
        finite = area_km2[np.isfinite(area_km2)]
        values = (
            float(np.median(finite)) if len(finite) else np.nan,
            mean_of_known(contained),
            share_of_known(area_km2, landing),
        )
        return dict(zip(_names(words), values, strict=True))


def impact_region_metric(config: ImpactConfig, _context: MetricContext) -> ImpactRegionMetric:
    """Return the metric `impact_region`."""
    place = int(
        np.argmin(np.abs(np.array(TRACK_CONTAINMENTS) - config.containment_percent / 100.0))
    )
    return ImpactRegionMetric(place, config.phases, config.times_s)


def _names(words: str) -> tuple[str, str, str]:
    return f"impact_area_{words}_km2", f"impact_contained_{words}", f"impact_predicted_{words}"


def _phase_words(phase: str) -> str:
    return phase.replace(" % ", "_").replace(" ", "_")


def _rows_at(evidence: RunEvidence, scores: ImpactScores, time_s: float) -> IntArray:
    """Return the rows of the last estimates of each target up to a time since its ignition, none
    that is too old.
    """
    oldest_s = max(OLDEST_S, evidence.plan.make_tracker().cadence_s or 0.0)
    since_s = scores.tick_s - evidence.plan.targets.ignition_s[scores.target]
    rows = np.flatnonzero((since_s <= time_s) & (since_s >= time_s - oldest_s))
    # Rows are sorted by target and tick: the last one of each target.
    return rows[np.append(np.diff(scores.target[rows]) != 0, True)] if len(rows) else rows


def _rms(values: FloatArray) -> float:
    finite = values[np.isfinite(values)]
    return float(np.sqrt(np.mean(np.square(finite)))) if len(finite) else np.nan
