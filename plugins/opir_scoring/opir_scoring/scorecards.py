"""The scorecard: a tracker's figures over runs, each with its interval, by sensor geometry."""

from collections.abc import Iterable, Mapping, Sequence
from typing import Any

import numpy as np
from attrs import frozen

from opir_core import Plan
from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.plugin import REPORTED_TYPES, TARGET_TYPES, TargetClass
from opir_scoring.containments import (
    FARTHEST_M,
    Innovations,
    consistency,
    consistent,
    contained,
    energy,
    innovations,
    mean,
    of_some,
    over,
    plain,
    proportion,
    rms,
    share,
)
from opir_scoring.errors import PointErrors, StateErrors, last_rows, point_errors, state_errors
from opir_scoring.evidence import Ownership, RunEvidence, ownership
from opir_scoring.hypothesis_scores import HypothesisScores, hypothesis_figures, hypothesis_scores
from opir_scoring.impacts import ImpactScores, phase_figures, phase_scores
from opir_scoring.recognition import Recognition, recognition, recognition_figures
from opir_scoring.sensor_coverage import Coverage, GospaSettings, coverage, gospa_parts, mean_gospa

_STATE_FREEDOM = 6
_DIRECTION_FREEDOM = 2
#: Sensor geometries: whether several sensors saw the target, and whether one of them has a bias.
GEOMETRIES: Mapping[str, tuple[bool, bool]] = {
    "mono": (False, False),
    "stereo": (True, False),
    "mono_biased": (False, True),
    "stereo_biased": (True, True),
}
#: Errors are divided by bounds where the position bound is below this, m: above, directions hardly
#: determine the position.
LARGEST_BOUND_M = 100e3
#: More targets than a scene can have.
_MANY = 10**9


@frozen(kw_only=True)
class ScoreSettings(GospaSettings):
    """Settings of a score: GOSPA's parameters, bins of time since ignition, and what counts as
    recognised.

    A track with a probability of a launch above `launch_probability` is taken as one. Target
    classes named as `unknown` are none of the hypotheses: "none of these" is right for them.
    """

    bin_s: float = 20.0
    launch_probability: float = 0.5
    unknown: tuple[str, ...] = ()


#: The default settings.
USUAL_SETTINGS = ScoreSettings()


@frozen(eq=False)
class Scorecard:
    """A tracker's figures over runs, as plain values."""

    figures: Mapping[str, Any]

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


def scorecard(
    evidences: Iterable[RunEvidence], settings: ScoreSettings = USUAL_SETTINGS
) -> Scorecard:
    """Return the scorecard of runs of one scene and one tracker; runs are scored one at a time."""
    return scorecard_of([scored_run(evidence, settings) for evidence in evidences], settings)


def scorecard_of(runs: Sequence[ScoredRun], settings: ScoreSettings) -> Scorecard:
    """Return the scorecard of scored runs with the same settings."""
    geometry = {name: _geometry(runs, *seen, settings) for name, seen in GEOMETRIES.items()}
    biased = any(each.is_biased for each in runs)
    return Scorecard(
        {
            "runs": len(runs),
            "seeds": [each.seed for each in runs],
            "sensors_biased": biased,
            **_counts(runs),
            **geometry,
            "gospa": _gospa(runs, settings),
            **_reported_types(runs),
            **_hypotheses(runs),
        }
    )


def scored_run(evidence: RunEvidence, settings: ScoreSettings) -> ScoredRun:
    """Return the scored data of a run."""
    owners = ownership(evidence)
    impact_phase, impacts = phase_scores(evidence, owners)
    return ScoredRun(
        seed=evidence.plan.scene.seed,
        is_biased=evidence.plan.bias is not None,
        states=state_errors(evidence, owners),
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
    known = np.isfinite(tracks.type_probability).all(axis=1)
    likeliest = tracks.type_probability[known].argmax(axis=1)
    counts: dict[str, IntArray] = {}
    for row, reported in zip(target[known].tolist(), likeliest.tolist(), strict=True):
        name = evidence.plan.targets.class_names[row]
        counts.setdefault(name, np.zeros(len(REPORTED_TYPES), dtype=np.int64))[reported] += 1
    return counts


def _counts(runs: Sequence[ScoredRun]) -> dict[str, Any]:
    launches = sum(each.launches for each in runs)
    tracks, completeness, first_track_s = (
        np.concatenate([getattr(each.coverage, name) for each in runs])
        for name in ("tracks", "share", "first_track_s")
    )
    known = [int(np.count_nonzero(np.isfinite(each))) for each in (completeness, first_track_s)]
    tracked = int(np.count_nonzero(tracks))
    purity = np.concatenate([each.owners.purity[each.owners.target >= 0] for each in runs])
    return {
        "launches_tracked": share(*proportion(tracked, launches)),
        "tracks_a_launch": of_some(mean(tracks[tracks > 0].astype(np.float64)), tracked, launches),
        "false_tracks_a_run": mean(
            np.array([np.count_nonzero(each.owners.target < 0) for each in runs])
        ),
        "purity": mean(purity, 1.0),
        "completeness": of_some(mean(completeness, 1.0), known[0], launches),
        "first_track_after_s": of_some(mean(first_track_s), known[1], launches),
        "tracking_us_a_detection": _pace(runs, [each.detections for each in runs]),
        "tracking_us_a_track_update": _pace(runs, [each.track_updates for each in runs]),
    }


def _pace(runs: Sequence[ScoredRun], count: Sequence[int]) -> dict[str, Any]:
    """Return the processor time per count, µs, over runs."""
    taken = np.array([each.tracking_s for each in runs])
    return mean(1e6 * taken / np.maximum(np.array(count), 1))


def _geometry(
    runs: Sequence[ScoredRun], is_stereo: bool, is_biased: bool, settings: ScoreSettings
) -> dict[str, Any]:
    """Return the figures of the targets of one geometry."""
    states = StateErrors.concatenate(each.states for each in runs)
    points = PointErrors.concatenate(each.points for each in runs)
    innovations = Innovations.concatenate(each.innovations for each in runs)
    impacts = ImpactScores.concatenate(each.impacts for each in runs)
    impact_phase = np.concatenate([each.impact_phase for each in runs])
    run = np.repeat(np.arange(len(runs)), [len(each.states) for each in runs])
    state_rows, innovation_rows, point_rows, impact_rows = (
        (each.is_stereo == is_stereo) & (each.is_biased == is_biased)
        for each in (states, innovations, points, impacts)
    )
    states = states.take(state_rows)
    run = run[state_rows]
    points = points.take(point_rows)
    nis = innovations.nis[innovation_rows]
    nis_bin = _bins(innovations.since_s[innovation_rows], settings)
    bins = _bins(states.since_s, settings)
    return {
        "by_time": [
            {
                "since_ignition_s": [number * settings.bin_s, (number + 1) * settings.bin_s],
                **_bin(states.take(bins == number), run[bins == number]),
                "nis": consistent(consistency(nis[nis_bin == number], _DIRECTION_FREEDOM)),
            }
            for number in np.unique(bins).tolist()
        ],
        "targets": len(points),
        "launches_reported": int(np.count_nonzero(np.isfinite(points.launch_m))),
        "impacts_reported": int(np.count_nonzero(np.isfinite(points.impact_m))),
        "launch_m": rms(points.launch_m, most=FARTHEST_M),
        "launch_energy_m": energy(points.launch_energy_m, most=FARTHEST_M),
        "launch_time_s": rms(points.launch_time_s),
        "impact_m": rms(points.impact_m, most=FARTHEST_M),
        "impact_time_s": rms(points.impact_time_s),
        "launch_containment": contained(points.launch_nees),
        "impact_containment": contained(points.impact_nees),
        "impact_by_phase": phase_figures(impact_phase[impact_rows], impacts.take(impact_rows)),
    }


def _bins(since_s: FloatArray, settings: ScoreSettings) -> IntArray:
    return np.floor(since_s / settings.bin_s).astype(np.int64)


def _bin(states: StateErrors, run: IntArray) -> dict[str, Any]:
    """Return the figures of one bin of time since ignition, with the NEES of each target's last
    tick only.

    Ticks of one target are dependent, which the χ² band assumes they are not.
    """
    track = run * _MANY + states.target
    predicted = int(np.count_nonzero(np.isfinite(states.impact_m)))
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
        "nees": consistent(consistency(states.nees[_last_of_each(states)], _STATE_FREEDOM)),
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
    for what, unit, error, bound in (
        ("position", "m", states.position_m, position_m),
        ("velocity", "m_s", states.velocity_m_s, velocity_m_s),
    ):
        figures[f"{what}_{name}bound_{unit}"] = rms(bound[determined])["value"]
        ratio = over(rms(error[determined], track[determined]), rms(bound[determined])["value"])
        figures[f"{what}_over_{name}bound"] = of_some(ratio, count, len(determined))
    return figures


def _last_of_each(states: StateErrors) -> BoolArray:
    """Return which rows are the last of their track in a bin; rows are sorted by track and time."""
    if not len(states):
        return np.empty(0, dtype=np.bool_)
    changes = (np.diff(states.target) != 0) | (np.diff(states.since_s) <= 0.0)
    return np.append(changes, True)


def _gospa(runs: Sequence[ScoredRun], settings: ScoreSettings) -> dict[str, Any]:
    """Return the distances, averaged over the ticks of a run, and their parts, which are p-th
    powers.
    """
    means = np.array([mean_gospa(each.gospa_parts, settings.order) for each in runs]).reshape(-1, 5)
    names = ("mean_m", "a_target_m", "localisation_a_target", "missed_a_target", "false_a_target")
    return {
        "cutoff_m": settings.cutoff_m,
        "order": settings.order,
        "alpha": settings.alpha,
        **{name: mean(means[:, column]) for column, name in enumerate(names)},
    }


def _reported_types(runs: Sequence[ScoredRun]) -> dict[str, Any]:
    """Return the share of types reported correctly, and the confusion matrix."""
    found = {name for each in runs for name in each.confusion}
    none = np.zeros(len(REPORTED_TYPES), dtype=np.int64)
    count = {
        name: sum((each.confusion.get(name, none) for each in runs), none)
        for name in by_class(found)
    }
    right_types = {name: right for each in runs for name, right in each.right_types.items()}
    right = sum(int(row[REPORTED_TYPES.index(right_types[name])]) for name, row in count.items())
    confusion = {
        name: dict(zip(REPORTED_TYPES, row.tolist(), strict=True)) for name, row in count.items()
    }
    total = sum(int(row.sum()) for row in count.values())
    launches = sum(each.launches for each in runs)
    return {
        "type_right": of_some(share(*proportion(right, total)), total, launches),
        "type_confusion": confusion,
    }


def _hypotheses(runs: Sequence[ScoredRun]) -> dict[str, Any]:
    """Return the scores of hypotheses, and what was recognised as a launch."""
    scores = HypothesisScores.concatenate(each.hypothesis_scores for each in runs)
    return {
        "hypotheses": hypothesis_figures(scores, runs[0].hypotheses if runs else ()),
        "recognition": recognition_figures(
            [each.recognition for each in runs], [each.seed for each in runs]
        ),
    }


def by_class(names: Iterable[str]) -> list[str]:
    """Return names of target classes, each once: the missile types first, then the others by
    name.
    """
    order = {name: place for place, name in enumerate(TARGET_TYPES)}
    return sorted(set(names), key=lambda name: (order.get(name, len(order)), name))
