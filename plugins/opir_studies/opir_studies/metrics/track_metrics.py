"""Metrics of tracks, from the scores of `opir_scoring`: completeness, accuracy, launch points,
impact regions.
"""

from collections.abc import Mapping
from functools import lru_cache
from typing import Any, ClassVar

import numpy as np
from attrs import frozen
from opir_scoring import (
    OLDEST_S,
    PHASES,
    RECOGNITION_PROBABILITY,
    ImpactScores,
    Ownership,
    RunEvidence,
    coverage,
    evidence_of_run,
    impact_scores,
    ownership,
    phase_scores,
    point_errors,
    recognition,
    state_errors,
)

from opir_core import Run
from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.interfaces import TRACK_CONTAINMENTS
from opir_core.plugin import MetricContext, NoConfig
from opir_studies.configs import ImpactConfig
from opir_studies.metrics.detection_metrics import mean_of_known, share_of_known, time_words


@lru_cache(maxsize=1)
def run_evidence(run: Run) -> tuple[RunEvidence, Ownership]:
    """Return a run's evidence and the owners of its tracks; the metrics of a run share them."""
    evidence = evidence_of_run(run, run.plan)
    return evidence, ownership(evidence)


def first_tracked_s(run: Run) -> FloatArray:
    """Return the scene times (launches,) at which the first estimate of each launch is available;
    inf without one.
    """
    evidence, owners = run_evidence(run)
    target = owners.target[np.searchsorted(owners.track, evidence.tracks.track)]
    rows = np.flatnonzero(target >= 0)
    available_s = np.fmax(evidence.tracks.available_s, evidence.tracks.tick_s)
    tracked_s = np.full(len(run.plan.scene.targets), np.inf)
    np.minimum.at(tracked_s, target[rows], available_s[rows])
    return tracked_s


@frozen
class TracksMetric:
    """How completely the launches of a run are tracked, and how many tracks belong to none."""

    shares: ClassVar[Mapping[str, str]] = {
        "completeness": "share_with_ticks",
        "tracks_a_launch": "tracked",
        "first_track_s": "tracked",
    }
    launch_units: ClassVar[Mapping[str, str]] = {"tracked_s": "s", "recognised_s": "s"}

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

    def launches(self, run: Run) -> Mapping[str, FloatArray]:
        """Return the times from ignition to the first estimate of a track, and to one with P(launch)
        above 0.95.

        The second is nan for a tracker that weighs no launches.
        """
        tracked_s = first_tracked_s(run)
        recognised = recognition(*run_evidence(run), RECOGNITION_PROBABILITY)
        return {
            "tracked_s": tracked_s - run.plan.targets.ignition_s[: len(tracked_s)],
            "recognised_s": recognised.recognised_after_s,
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
    launch_units: ClassVar[Mapping[str, str]] = {
        "launch_error_m": "m",
        "launch_time_error_s": "s",
    }

    @property
    def units(self) -> Mapping[str, str]:
        """Return the names of the figures with their units."""
        return {"launch_error_m": "m", "launch_time_error_s": "s", "share_with_launch": ""}

    def values(self, run: Run) -> Mapping[str, float]:
        """Return both errors, nan without launch estimates, and the share of launches that they are
        of.
        """
        errors = _last_errors(run)
        return {
            "launch_error_m": _rms(errors.launch_m),
            "launch_time_error_s": _rms(errors.launch_time_s),
            "share_with_launch": share_of_known(errors.launch_m, len(run.plan.scene.targets)),
        }

    def launches(self, run: Run) -> Mapping[str, FloatArray]:
        """Return both errors of each launch's last estimate, inf without one."""
        errors = _last_errors(run)
        launches = len(run.plan.scene.targets)
        values = zip(self.launch_units, (errors.launch_m, errors.launch_time_s), strict=True)
        return {
            name: by_launch(errors.target, np.where(np.isnan(column), np.inf, column), launches)
            for name, column in values
        }


@lru_cache(maxsize=1)
def _last_errors(run: Run) -> Any:
    return point_errors(*run_evidence(run))


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
        landing = int(comes_down(run).sum())
        figures: dict[str, float] = {}
        for words, scores in self._scores(run).items():
            figures |= self._figures(words, scores, landing)
        return figures

    @property
    def launch_units(self) -> Mapping[str, str]:
        """Return the columns of launches with their units."""
        columns = [_names(words)[:2] for words in self._instants]
        return {
            name: unit for pair in columns for name, unit in zip(pair, ("km2", ""), strict=True)
        }

    @property
    def launch_containments(self) -> Mapping[str, float]:
        """Return the stated containment of the columns that say whether a region held."""
        nominal = TRACK_CONTAINMENTS[self.place]
        return {_names(words)[1]: nominal for words in self._instants}

    def launches(self, run: Run) -> Mapping[str, FloatArray]:
        """Return the area of each launch's region at every instant, inf without one, and whether it
        contains the impact.

        nan for launches that do not come down, and for the second without a region.
        """
        landing = comes_down(run)
        columns: dict[str, FloatArray] = {}
        for words, scores in self._scores(run).items():
            of_landing = scores.take(scores.has_impact)
            area_km2 = of_landing.area_km2[:, self.place]
            area_km2 = by_launch(
                of_landing.target, np.where(np.isnan(area_km2), np.inf, area_km2), len(landing)
            )
            contained = by_launch(
                of_landing.target, of_landing.contained[:, self.place], len(landing)
            )
            area_name, contained_name, _ = _names(words)
            columns[area_name] = np.where(landing, area_km2, np.nan)
            columns[contained_name] = np.where(np.isfinite(area_km2), contained, np.nan)
        return columns

    def _scores(self, run: Run) -> Mapping[str, ImpactScores]:
        return _instant_scores(run, self.phases, self.times_s)

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


@lru_cache(maxsize=1)
def _instant_scores(
    run: Run, phases: tuple[str, ...], times_s: tuple[float, ...]
) -> Mapping[str, ImpactScores]:
    """Return the scores of the estimates at each instant, by its words."""
    evidence, owners = run_evidence(run)
    phase, scores = phase_scores(evidence, owners)
    at_instants = {_phase_words(name): scores.take(phase == PHASES.index(name)) for name in phases}
    scores_at_ticks = impact_scores(evidence, owners) if times_s else scores
    for time_s in times_s:
        rows = _rows_at(evidence, scores_at_ticks, time_s)
        at_instants[f"at_{time_words(time_s)}"] = scores_at_ticks.take(rows)
    return at_instants


def impact_region_metric(config: ImpactConfig, _context: MetricContext) -> ImpactRegionMetric:
    """Return the metric `impact_region`."""
    place = int(
        np.argmin(np.abs(np.array(TRACK_CONTAINMENTS) - config.containment_percent / 100.0))
    )
    return ImpactRegionMetric(place, config.phases, config.times_s)


def comes_down(run: Run) -> BoolArray:
    """Return which launches (n,) of a run have a true impact."""
    truth = run.plan.targets.truth()[: len(run.plan.scene.targets)]
    return np.array([bool(target.get("impact")) for target in truth], dtype=np.bool_)


def by_launch(target: IntArray, values: FloatArray, launches: int) -> FloatArray:
    """Return values (n,) of targets (n,) by launch (launches,), inf for those without one."""
    columns = np.full(launches, np.inf)
    columns[target] = values
    return columns


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
