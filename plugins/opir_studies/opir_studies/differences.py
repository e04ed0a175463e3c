"""Differences of the answers of a run from those of an exact reference run with the same seed.

Detections of both runs are matched by their ids, which depends on seed, sensor, target and scan
alone: so measurement noise is the same in both, and differences are those of the settings.
"""

import math
from collections.abc import Mapping
from typing import Any

import numpy as np
from attrs import evolve, frozen
from opir_scoring import (
    evidence_of_run,
    ground_error,
    impact_scores,
    last_rows,
    ownership,
    place_of,
    rows_in_force,
    true_states_ecef,
)

from opir_core import Run
from opir_core.arrays import BoolArray, FloatArray, IndexArray, IntArray
from opir_core.planning import Looks
from opir_core.plugin import Detections
from opir_core.simulation import ProbabilityInterpolant

#: Meaning of each error; all are 0 where the runs agree, and infinite where only one of them has an
#: answer.
MEASURES: Mapping[str, str] = {
    "p_d": "largest error of the probability of detection of a look",
    "counts": "relative error of the number of detections",
    "latency_s": "largest error of the time from ignition to the first detection, s",
    "line_of_sight_urad": "largest error of a measured line of sight, µrad",
    "confidence": "largest error of a detection's confidence",
    "type": "share of detections whose reported type differs",
    "truth_m": "largest error of a true impact point, m",
    "position_km": "error of tracked positions at the same ticks, root mean square, km",
    "launch_km": "error of the last launch estimates, root mean square over launches, km",
    "impact_km": "error of the last predicted impact points, root mean square over launches, km",
    "region_contains": "difference of the share of last 95 % impact regions that contain the true"
    " impact",
    "impact_area": "relative error of the areas of the last 95 % impact regions, root mean square"
    " over launches",
}

#: Those of estimates: a scene without a tracker has none.
OF_TRACKS = {"position_km", "launch_km", "impact_km", "region_contains", "impact_area"}

#: Those whose truth is known: the error is that from the truth where this is less (`Trial.error`).
OF_TRUTH = ("position_km", "launch_km", "impact_km")

#: Those that are averaged as root mean squares over runs; the others are the largest, or the mean
#: (`counts`, `type`).
_ROOT_MEAN_SQUARES = {"position_km", "launch_km", "impact_km", "impact_area"}
_MEANS = {"counts", "type", "region_contains"}


#: Approximate number of looks whose P_d are compared.
LOOKS = 20_000


@frozen(eq=False)
class RunAnswers:
    """Answers of a run: detections with their P_d, and for each launch the estimates, nan without
    one.
    """

    detections: Detections
    #: Keys of looks, and their P_d.
    looks: IntArray
    probability: FloatArray
    first_s: FloatArray
    truth: FloatArray
    ticks: IntArray
    states: FloatArray
    launch: FloatArray
    impact: FloatArray
    area_km2: FloatArray
    contained: FloatArray
    #: Root mean square errors from the truth, by the names of `OF_TRUTH`; nan without an estimate.
    from_truth: Mapping[str, float]
    #: The share of launches with known truth that these errors are of, by the same names; nan
    #: without any.
    estimated: Mapping[str, float]


def unanswered(answers: RunAnswers) -> set[str]:
    """Return the measures of which a run has no answer: their errors are 0 whatever the
    settings.
    """
    detections = answers.detections.sensor
    values: dict[str, Any] = {
        **dict.fromkeys(("counts", "line_of_sight_urad", "confidence", "type"), detections),
        "position_km": answers.ticks,
        "launch_km": answers.launch,
        "impact_km": answers.impact,
        "region_contains": answers.contained,
        "impact_area": answers.area_km2,
        "truth_m": answers.truth,
        "latency_s": answers.first_s,
        "p_d": answers.looks,
    }
    return {name for name, column in values.items() if not np.isfinite(column).any()}


@frozen(eq=False)
class TrackAnswers:
    """Answers of tracks: of each target's last row the launch (n, 3), impact (n, 3), area (n,),
    km2, and whether it contains the truth (n,); of each row in force the number of its tick and
    target (m,), the position (m, 3) and its error (m, 3), m.
    """

    launch: FloatArray
    impact: FloatArray
    area_km2: FloatArray
    contained: FloatArray
    ticks: IntArray
    positions: FloatArray
    errors: FloatArray


def answers_of(run: Run) -> RunAnswers:
    """Return the answers of a run."""
    count = len(run.plan.targets.ids)
    rows = np.flatnonzero(run.truth.target >= 0)
    detections = run.detections.take(rows)
    first_s = np.full(count, np.inf)
    np.minimum.at(first_s, run.truth.target[rows], detections.time_s)
    targets = run.plan.targets.truth()
    launches, impacts = (
        np.array([place_of(target.get(name)) for target in targets]).reshape(-1, 3)
        for name in ("launch", "impact")
    )
    tracks = _answers_of_tracks(run)
    errors_m = (
        np.linalg.norm(tracks.errors, axis=1),
        _distances(tracks.launch, launches, np.nan),
        _distances(tracks.impact, impacts, np.nan),
    )
    shares = (
        _share_of_launches(np.isin(np.arange(count), tracks.ticks % max(count, 1)), launches),
        _share_of_launches(np.isfinite(tracks.launch[:, 0]), launches),
        _share_of_launches(np.isfinite(tracks.impact[:, 0]), impacts),
    )
    looks, probability = _probabilities(run, rows)
    return RunAnswers(
        detections=detections,
        looks=looks,
        probability=probability,
        first_s=first_s,
        truth=impacts[:, :2],
        ticks=tracks.ticks,
        states=tracks.positions,
        launch=tracks.launch,
        impact=tracks.impact,
        area_km2=tracks.area_km2,
        contained=tracks.contained,
        from_truth=dict(zip(OF_TRUTH, (1e-3 * _rms_of_known(e) for e in errors_m), strict=True)),
        estimated=dict(zip(OF_TRUTH, shares, strict=True)),
    )


def _answers_of_tracks(run: Run) -> TrackAnswers:
    count = len(run.plan.targets.ids)
    answers = TrackAnswers(
        np.full((count, 3), np.nan),
        np.full((count, 3), np.nan),
        np.full(count, np.nan),
        np.full(count, np.nan),
        np.empty(0, dtype=np.int64),
        np.empty((0, 3)),
        np.empty((0, 3)),
    )
    if not len(run.tracks):
        return answers
    evidence = evidence_of_run(run, run.plan)
    owners = ownership(evidence)
    rows = last_rows(evidence, owners)
    targets = owners.target[np.searchsorted(owners.track, run.tracks.track[rows])]
    answers.launch[targets] = run.tracks.launch[rows]
    answers.impact[targets] = run.tracks.impact[rows]
    scores = impact_scores(evolve(evidence, tracks=run.tracks.take(rows)), owners)
    answers.area_km2[scores.target] = scores.area_km2[:, -1]
    answers.contained[scores.target] = scores.contained[:, -1]
    rows = rows_in_force(evidence, owners)
    tick_s = run.tracks.tick_s[rows]
    targets = owners.target[np.searchsorted(owners.track, run.tracks.track[rows])]
    ticks = np.rint(tick_s * 1e3).astype(np.int64) * count + targets
    positions = run.tracks.state[rows, :3]
    truth = true_states_ecef(run.plan, targets.astype(np.int32), tick_s)[:, :3]
    return evolve(answers, ticks=ticks, positions=positions, errors=positions - truth)


def _share_of_launches(has_estimate: BoolArray, truth: FloatArray) -> float:
    """Return the share with an estimate of targets (n,) whose truth (n, 3) is known; nan without
    any.
    """
    is_known = np.isfinite(truth[:, 0])
    return float(has_estimate[is_known].mean()) if is_known.any() else np.nan


def _probabilities(run: Run, detected: IntArray) -> tuple[IntArray, FloatArray]:
    """Return keys of looks and their P_d: of every n-th scan for a model of signals, else of the
    detected ones.

    A detection's own P_d says little of a model that is wrong where it detects nothing.
    """
    plan = run.plan
    model = plan.detection
    count = len(plan.targets.ids)
    looks = Looks.between(plan.pairs, 0, plan.end_ns)
    geometry = plan.look_geometry()
    sample = geometry.exposures(looks.pair[:1], looks.scan[:1])
    if not len(sample) or model.response(sample) is None:
        detections = run.detections.take(detected)
        targets = run.truth.target[detected]
        keys = _look_keys(detections.sensor, targets, detections.scan, count)
        return keys, run.truth.probability[detected]
    stride = 1 << max(0, math.ceil(math.log2(max(len(looks.pair), 1) / LOOKS)))
    rows = np.flatnonzero(looks.scan % stride == 0)
    pair = looks.pair[rows]
    scan = looks.scan[rows]
    if model.probability_tolerance is None:
        probability = model.probability(geometry.exposures(pair, scan))
    else:
        interpolant = ProbabilityInterpolant.of(geometry, model, model.probability_tolerance)
        probability = interpolant.over(looks).probability()[rows]
    return _look_keys(plan.pairs.sensor[pair], plan.pairs.target[pair], scan, count), probability


def _look_keys(sensor: IndexArray, target: IndexArray, scan: IntArray, targets: int) -> IntArray:
    return (sensor.astype(np.int64) * targets + target << 36) + scan


def differences(run: RunAnswers, reference: RunAnswers) -> dict[str, float]:
    """Return the errors of a run, by the names of `MEASURES`."""
    rows, reference_rows = _matched(run.looks, reference.looks)
    probability = run.probability[rows] - reference.probability[reference_rows]
    return {
        "p_d": _largest(probability),
        "latency_s": _largest(_differences_of_known(run.first_s, reference.first_s)),
        "truth_m": _largest(_distances(run.truth, reference.truth)),
        **_detection_differences(run.detections, reference.detections),
        **_track_differences(run, reference),
    }


def _detection_differences(detections: Detections, reference: Detections) -> dict[str, float]:
    """Return the errors of the detections of a run, matched by their ids."""
    rows, reference_rows = _matched(_keys(detections), _keys(reference))
    count = len(reference)
    more = len(detections) - count
    matched = detections.take(rows)
    partner = reference.take(reference_rows)
    across = np.linalg.norm(matched.line_of_sight_ecef - partner.line_of_sight_ecef, axis=1)
    has_other_type = matched.reported_type != partner.reported_type
    return {
        "counts": more / count if count else float(more > 0),
        "line_of_sight_urad": 1e6 * _largest(across),
        "confidence": _largest(matched.confidence - partner.confidence),
        "type": float(np.mean(has_other_type)) if len(rows) else 0.0,
    }


def _track_differences(run: RunAnswers, reference: RunAnswers) -> dict[str, float]:
    """Return the errors of the estimates of a run; infinite where only one run has them."""
    rows, reference_rows = _matched(run.ticks, reference.ticks)
    distance = np.linalg.norm(run.states[rows] - reference.states[reference_rows], axis=1)
    are_alike = np.array_equal(_tracked(run), _tracked(reference))
    are_alike = are_alike and bool(len(rows) or not len(reference.ticks))
    has_same_regions = np.array_equal(np.isfinite(run.contained), np.isfinite(reference.contained))
    contained = _share(run.contained) - _share(reference.contained)
    area_km2 = _differences_of_known(run.area_km2, reference.area_km2)
    return {
        "position_km": 1e-3 * _rms(distance) if are_alike else np.inf,
        "launch_km": 1e-3 * _rms(_distances(run.launch, reference.launch)),
        "impact_km": 1e-3 * _rms(_distances(run.impact, reference.impact)),
        "region_contains": contained if has_same_regions else np.inf,
        "impact_area": _rms(area_km2 / np.nan_to_num(reference.area_km2, nan=1.0)),
    }


def _tracked(answers: RunAnswers) -> IntArray:
    """Return the launches that a run has tracked positions of."""
    return np.unique(answers.ticks % len(answers.first_s)) if len(answers.ticks) else answers.ticks


def over_runs(runs: list[dict[str, float]]) -> dict[str, float]:
    """Return the errors of several runs as one: mean, root mean square or largest, by measure."""
    return {
        name: _over_runs(name, np.array([errors[name] for errors in runs])) for name in MEASURES
    }


def from_truth_over_runs(runs: list[Mapping[str, float]]) -> dict[str, float]:
    """Return the errors from the truth of several runs as one: root mean squares over those that
    have any.

    `estimated` of the runs belongs beside them.
    """
    return {name: _rms_of_known(np.array([errors[name] for errors in runs])) for name in OF_TRUTH}


def _over_runs(name: str, values: FloatArray) -> float:
    if name in _MEANS:
        return float(abs(values.mean()))
    return float(np.sqrt(np.mean(values**2))) if name in _ROOT_MEAN_SQUARES else float(values.max())


def _keys(detections: Detections) -> Any:
    return np.ascontiguousarray(detections.detection_id).view("V16").ravel()


def _matched(keys: Any, reference: Any) -> tuple[IntArray, IntArray]:
    """Return the rows of both with the same key."""
    _, rows, reference_rows = np.intersect1d(keys, reference, return_indices=True)
    return rows, reference_rows


def _differences_of_known(values: FloatArray, reference: FloatArray) -> FloatArray:
    """Return differences where both are finite, 0 where neither is, infinity where one is."""
    is_finite = np.isfinite(values)
    has_reference = np.isfinite(reference)
    pair = is_finite & has_reference
    difference = np.where(pair, values, 0.0) - np.where(pair, reference, 0.0)
    return np.where(is_finite != has_reference, np.inf, difference)


def _distances(places: FloatArray, reference: FloatArray, missing: float = np.inf) -> FloatArray:
    """Return ground distances, m, between places (n, 2+) of latitude and longitude, rad: `missing`
    where only one is finite, 0 where neither is.
    """
    is_finite = np.isfinite(places[:, 0])
    has_reference = np.isfinite(reference[:, 0])
    distance = np.where(is_finite != has_reference, missing, 0.0)
    pair = is_finite & has_reference
    if pair.any():
        error = ground_error(_ground(places[pair]), _ground(reference[pair]))
        distance[pair] = np.linalg.norm(error, axis=1)
    return distance


def _ground(places: FloatArray) -> FloatArray:
    return np.column_stack([places[:, :2], np.zeros(len(places))])


def _share(contained: FloatArray) -> float:
    values = contained[np.isfinite(contained)]
    return float(values.mean()) if len(values) else 0.0


def _largest(values: FloatArray) -> float:
    return float(np.abs(values).max(initial=0.0))


def _rms_of_known(values: FloatArray) -> float:
    finite = values[np.isfinite(values)]
    return _rms(finite) if len(finite) else math.nan


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else 0.0
