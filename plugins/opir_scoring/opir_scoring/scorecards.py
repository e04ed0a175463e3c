"""The scorecard: a tracker's figures over runs, each with its interval, by sensor geometry."""

from collections.abc import Iterable, Mapping, Sequence
from html import escape
from importlib import import_module
from typing import Any

import numpy as np
from attrs import frozen

from opir_core import Plan, Run
from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.errors import number_of
from opir_core.plugin import REPORTED_TYPES, TARGET_TYPES, TargetClass
from opir_scoring.containments import (
    FARTHEST_M,
    Innovations,
    consistency,
    consistent,
    contained,
    energy,
    figure,
    innovations,
    mean,
    of_some,
    over,
    plain,
    proportion,
    rms,
)
from opir_scoring.errors import PointErrors, StateErrors, last_rows, point_errors, state_errors
from opir_scoring.evidence import Ownership, RunEvidence, evidence_of_run, ownership
from opir_scoring.hypothesis_scores import HypothesisScores, hypothesis_figures, hypothesis_scores
from opir_scoring.impacts import ImpactScores, phase_figures, phase_scores
from opir_scoring.launch_recognition import Recognition, recognition, recognition_figures
from opir_scoring.sensor_coverage import Coverage, GospaSettings, coverage, gospa_parts, mean_gospa

#: Sensor geometries: whether several sensors detected the target, and whether one of them has a
#: bias.
GEOMETRIES: Mapping[str, tuple[bool, bool]] = {
    "mono": (False, False),
    "stereo": (True, False),
    "mono_biased": (False, True),
    "stereo_biased": (True, True),
}
#: Errors are divided by bounds where the position bound is below this, m: above, directions hardly
#: determine the position.
LARGEST_BOUND_M = 100e3


@frozen(kw_only=True)
class ScoreSettings(GospaSettings):
    """Settings of a score: GOSPA's parameters, bins of time since ignition, and recognition.

    A track with a probability of a launch above `launch_probability` is taken as one. Target
    classes named as `unknown` are none of the hypotheses: "none of these" is right for them.
    Without `distribution_tests` the figures `distribution_p` are nan.
    """

    bin_s: float = 20.0
    launch_probability: float = 0.5
    unknown: tuple[str, ...] = ()
    distribution_tests: bool = True


#: The default settings.
USUAL_SETTINGS = ScoreSettings()


@frozen(eq=False)
class Scorecard:
    """A tracker's figures over runs, as plain values."""

    figures: Mapping[str, Any]

    def __repr__(self) -> str:
        """Return the number of runs and figures, in one line."""
        runs = number_of("run", self.figures.get("runs", 0))
        return f"<Scorecard: {runs}, {len(self.figures)} figures>"

    def _repr_html_(self) -> str:
        """Return the scores as a notebook shows them."""
        text = import_module("opir_scoring.scorecard_tables").scorecard_text({"score": self})
        return f"<pre>{escape(text)}</pre>"

    def as_plain(self) -> Any:
        """Return the figures for JSON, with null for unknown values."""
        return plain(self.figures)


@frozen(eq=False)
class ScoredRun:
    """The scored data of one run: errors row by row, and counts."""

    seed: int
    is_biased: bool
    states: StateErrors
    points: PointErrors
    impact_phase: IntArray
    impacts: ImpactScores
    innovations: Innovations
    owners: Ownership
    launches: int
    coverage: Coverage
    gospa_parts: FloatArray
    confusion: Mapping[str, IntArray]
    right_types: Mapping[str, str]
    hypotheses: tuple[str, ...]
    hypothesis_scores: HypothesisScores
    recognition: Recognition
    detections: int
    track_updates: int
    tracking_s: float


def scorecard_of_run(run: Run, **settings: Any) -> Scorecard:
    """Return the scorecard of a run in memory; `settings` are those of `ScoreSettings`."""
    return scorecard([evidence_of_run(run, run.plan)], ScoreSettings(**settings))


def scorecard(
    evidences: Iterable[RunEvidence], settings: ScoreSettings = USUAL_SETTINGS
) -> Scorecard:
    """Return the scorecard of runs of one scene and one tracker; runs are scored one at a time."""
    return scorecard_of([scored_run(evidence, settings) for evidence in evidences], settings)


def scorecard_of(runs: Sequence[ScoredRun], settings: ScoreSettings) -> Scorecard:
    """Return the scorecard of scored runs with the same settings."""
    return Scorecard(
        {
            "runs": len(runs),
            "seeds": [run.seed for run in runs],
            "sensors_biased": any(run.is_biased for run in runs),
            **_counts(runs),
            **{
                name: _geometry(runs, is_stereo, is_biased, settings)
                for name, (is_stereo, is_biased) in GEOMETRIES.items()
            },
            "gospa": _gospa(runs, settings),
            **_reported_types(runs),
            **_hypotheses(runs),
        }
    )


def scored_run(
    evidence: RunEvidence, settings: ScoreSettings, states: StateErrors | None = None
) -> ScoredRun:
    """Return the scored data of a run; `states` are its `state_errors`, if they are known."""
    owners = ownership(evidence)
    impact_phase, impacts = phase_scores(evidence, owners)
    return ScoredRun(
        seed=evidence.plan.scene.seed,
        is_biased=evidence.plan.bias is not None,
        states=state_errors(evidence, owners) if states is None else states,
        points=point_errors(evidence, owners),
        impact_phase=impact_phase,
        impacts=impacts,
        innovations=innovations(evidence, owners),
        owners=owners,
        launches=len(evidence.plan.scene.targets),
        coverage=coverage(evidence, owners),
        gospa_parts=gospa_parts(evidence, owners, settings),
        confusion=_types(evidence, owners),
        right_types=_right_types(evidence.plan),
        hypotheses=tuple(hypothesis.name for hypothesis in evidence.plan.hypotheses),
        hypothesis_scores=hypothesis_scores(evidence, owners, settings.unknown),
        recognition=recognition(evidence, owners, settings.launch_probability),
        detections=len(evidence.time_s),
        track_updates=len(evidence.tracks),
        tracking_s=evidence.tracking_s,
    )


def _right_types(plan: Plan) -> Mapping[str, str]:
    """Return the right type to report for each class that a plan launches."""
    launched = plan.targets.class_names[: len(plan.scene.targets)]
    return {
        name: plan.host.component(TargetClass, name).reported_type
        for name in dict.fromkeys(launched)
    }


def _types(evidence: RunEvidence, owners: Ownership) -> Mapping[str, IntArray]:
    """Return, by target class, counts (reported types,) of the last reported type of each
    launch.
    """
    tracks = evidence.tracks.take(last_rows(evidence, owners))
    target = owners.target[np.searchsorted(owners.track, tracks.track)]
    rows = np.flatnonzero(np.isfinite(tracks.type_probability).all(axis=1))
    likeliest = tracks.type_probability[rows].argmax(axis=1)
    counts: dict[str, IntArray] = {}
    for row, reported in zip(target[rows].tolist(), likeliest.tolist(), strict=True):
        name = evidence.plan.targets.class_names[row]
        counts.setdefault(name, np.zeros(len(REPORTED_TYPES), dtype=np.int64))[reported] += 1
    return counts


def _counts(runs: Sequence[ScoredRun]) -> dict[str, Any]:
    launches = sum(run.launches for run in runs)
    purities = [run.owners.purity[run.owners.target >= 0] for run in runs]
    coverage = _coverage_figures([run.coverage for run in runs], launches)
    return {
        "launches_tracked": coverage["launches_tracked"],
        "tracks_a_launch": coverage["tracks_a_launch"],
        "false_tracks_a_run": mean(
            np.array([np.count_nonzero(run.owners.target < 0) for run in runs])
        ),
        "purity": mean(np.concatenate(purities), 1.0),
        "completeness": coverage["completeness"],
        "first_track_after_s": coverage["first_track_after_s"],
        "tracking_us_a_detection": _pace(runs, [run.detections for run in runs]),
        "tracking_us_a_track_update": _pace(runs, [run.track_updates for run in runs]),
    }


def _coverage_figures(runs: Sequence[Coverage], launches: int) -> dict[str, Any]:
    tracks = np.concatenate([run.tracks for run in runs])
    completeness = np.concatenate([run.share for run in runs])
    first_track_s = np.concatenate([run.first_track_s for run in runs])
    tracked = tracks[tracks > 0].astype(np.float64)
    return {
        "launches_tracked": figure(*proportion(len(tracked), launches)),
        "tracks_a_launch": of_some(mean(tracked), len(tracked), launches),
        "completeness": of_some(mean(completeness, 1.0), _finite_count(completeness), launches),
        "first_track_after_s": of_some(mean(first_track_s), _finite_count(first_track_s), launches),
    }


def _finite_count(values: FloatArray) -> int:
    return int(np.count_nonzero(np.isfinite(values)))


def _pace(runs: Sequence[ScoredRun], count: Sequence[int]) -> dict[str, Any]:
    """Return the processor time per count, µs, over runs."""
    tracking_s = np.array([run.tracking_s for run in runs])
    return mean(1e6 * tracking_s / np.maximum(np.array(count), 1))


def _geometry(
    runs: Sequence[ScoredRun], is_stereo: bool, is_biased: bool, settings: ScoreSettings
) -> dict[str, Any]:
    """Return the figures of the targets of one geometry."""

    def rows_of(errors: StateErrors | PointErrors | Innovations | ImpactScores) -> BoolArray:
        return (errors.is_stereo == is_stereo) & (errors.is_biased == is_biased)

    points = PointErrors.concatenate(run.points.take(rows_of(run.points)) for run in runs)
    impacts = ImpactScores.concatenate(run.impacts.take(rows_of(run.impacts)) for run in runs)
    impact_phase = np.concatenate([run.impact_phase[rows_of(run.impacts)] for run in runs])
    return {
        "by_time": _by_time(
            [run.states.take(rows_of(run.states)) for run in runs],
            Innovations.concatenate(run.innovations.take(rows_of(run.innovations)) for run in runs),
            settings,
        ),
        "targets": len(points),
        "launches_reported": _finite_count(points.launch_m),
        "impacts_reported": _finite_count(points.impact_m),
        "launch_m": rms(points.launch_m, limit=FARTHEST_M),
        "launch_energy_m": energy(points.launch_energy_m, limit=FARTHEST_M),
        "launch_time_s": rms(points.launch_time_s),
        "impact_m": rms(points.impact_m, limit=FARTHEST_M),
        "impact_time_s": rms(points.impact_time_s),
        "launch_containment": contained(points.launch_nees),
        "impact_containment": contained(points.impact_nees),
        "impact_by_phase": phase_figures(impact_phase, impacts),
    }


def _by_time(
    states_of_run: Sequence[StateErrors], innovations: Innovations, settings: ScoreSettings
) -> list[dict[str, Any]]:
    """Return the figures of each bin of time since ignition."""
    states = StateErrors.concatenate(states_of_run)
    run = np.repeat(np.arange(len(states_of_run)), [len(errors) for errors in states_of_run])
    bins = _bins(states.since_s, settings)
    nis_bins = _bins(innovations.since_s, settings)
    return [
        {
            "since_ignition_s": [number * settings.bin_s, (number + 1) * settings.bin_s],
            **_bin(states.take(bins == number), run[bins == number], settings),
            "nis": consistent(
                consistency(
                    innovations.nis[nis_bins == number], 2, has_test=settings.distribution_tests
                )
            ),
        }
        for number in np.unique(bins).tolist()
    ]


def _bins(since_s: FloatArray, settings: ScoreSettings) -> IntArray:
    return np.floor(since_s / settings.bin_s).astype(np.int64)


def _bin(states: StateErrors, run: IntArray, settings: ScoreSettings) -> dict[str, Any]:
    """Return the figures of one bin of time since ignition, with the NEES of each target's last
    tick only.

    Ticks of one target are dependent, which the χ² band assumes they are not.
    """
    # More targets than a scene can have.
    track = run * 10**9 + states.target
    predicted = _finite_count(states.impact_m)
    return {
        "samples": len(states),
        "position_m": rms(states.position_m, track),
        "velocity_m_s": rms(states.velocity_m_s, track),
        "position_energy_m": energy(states.position_energy_m, track),
        "velocity_energy_m_s": energy(states.velocity_energy_m_s, track),
        **_over_bounds(states, track, "", states.position_bound_m, states.velocity_bound_m_s),
        **_over_bounds(
            states, track, "free_", states.position_free_bound_m, states.velocity_free_bound_m_s
        ),
        "impact_m": of_some(rms(states.impact_m, track, FARTHEST_M), predicted, len(states)),
        "nees": consistent(
            consistency(states.nees[_is_last(states)], 6, has_test=settings.distribution_tests)
        ),
    }


def _over_bounds(
    states: StateErrors,
    track: IntArray,
    name: str,
    position_m: FloatArray,
    velocity_m_s: FloatArray,
) -> dict[str, Any]:
    """Return bounds and errors over them, at ticks with a bound below `LARGEST_BOUND_M`."""
    determined = position_m < LARGEST_BOUND_M
    count = int(np.count_nonzero(determined))
    figures = {}
    for quantity, unit, error, bound in (
        ("position", "m", states.position_m, position_m),
        ("velocity", "m_s", states.velocity_m_s, velocity_m_s),
    ):
        mean_bound = rms(bound[determined])["value"]
        figures[f"{quantity}_{name}bound_{unit}"] = mean_bound
        ratio = over(rms(error[determined], track[determined]), mean_bound)
        figures[f"{quantity}_over_{name}bound"] = of_some(ratio, count, len(determined))
    return figures


def _is_last(states: StateErrors) -> BoolArray:
    """Whether rows, sorted by track and time, are the last of their track in a bin."""
    if not len(states):
        return np.empty(0, dtype=np.bool_)
    changes = (np.diff(states.target) != 0) | (np.diff(states.since_s) <= 0.0)
    return np.append(changes, True)


def _gospa(runs: Sequence[ScoredRun], settings: ScoreSettings) -> dict[str, Any]:
    """Return the distances, averaged over the ticks of a run, and their parts, which are p-th
    powers.
    """
    means = np.array([mean_gospa(run.gospa_parts, settings.order) for run in runs]).reshape(-1, 5)
    names = ("mean_m", "a_target_m", "localisation_a_target", "missed_a_target", "false_a_target")
    return {
        "cutoff_m": settings.cutoff_m,
        "order": settings.order,
        "alpha": settings.alpha,
        **{name: mean(means[:, column]) for column, name in enumerate(names)},
    }


def _reported_types(runs: Sequence[ScoredRun]) -> dict[str, Any]:
    """Return the share of types reported correctly, and the confusion matrix."""
    count = _type_counts(runs)
    right_types = {name: right for run in runs for name, right in run.right_types.items()}
    right = sum(int(row[REPORTED_TYPES.index(right_types[name])]) for name, row in count.items())
    total = sum(int(row.sum()) for row in count.values())
    launches = sum(run.launches for run in runs)
    return {
        "type_right": of_some(figure(*proportion(right, total)), total, launches),
        "type_confusion": {
            name: dict(zip(REPORTED_TYPES, row.tolist(), strict=True))
            for name, row in count.items()
        },
    }


def _type_counts(runs: Sequence[ScoredRun]) -> dict[str, IntArray]:
    """Return, by target class, counts (reported types,) over runs."""
    zero = np.zeros(len(REPORTED_TYPES), dtype=np.int64)
    return {
        name: sum((run.confusion.get(name, zero) for run in runs), zero)
        for name in by_class(name for run in runs for name in run.confusion)
    }


def _hypotheses(runs: Sequence[ScoredRun]) -> dict[str, Any]:
    """Return the scores of hypotheses, and the recognition of launches."""
    scores = HypothesisScores.concatenate(run.hypothesis_scores for run in runs)
    recognitions = [run.recognition for run in runs]
    return {
        "hypotheses": hypothesis_figures(scores, runs[0].hypotheses if runs else ()),
        "recognition": recognition_figures(recognitions, [run.seed for run in runs]),
    }


def by_class(names: Iterable[str]) -> list[str]:
    """Return names of target classes, each once: the missile types first, then the others by
    name.
    """
    order = {name: place for place, name in enumerate(TARGET_TYPES)}
    return sorted(set(names), key=lambda name: (order.get(name, len(order)), name))
