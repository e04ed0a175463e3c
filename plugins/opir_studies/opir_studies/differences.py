"""How far the answers of a run are from those of an exact reference run with the same seed.

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

#: What each error says; all are 0 where the runs agree, and infinite where only one of them has an
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
    """What a user reads of a run: detections with their P_d, and for each launch the estimates, nan
    where none.
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
    known = {
        "position_km": answers.ticks,
        "launch_km": answers.launch[np.isfinite(answers.launch)],
        "impact_km": answers.impact[np.isfinite(answers.impact)],
        "region_contains": answers.contained[np.isfinite(answers.contained)],
        "impact_area": answers.area_km2[np.isfinite(answers.area_km2)],
        "truth_m": answers.truth[np.isfinite(answers.truth)],
        "latency_s": answers.first_s[np.isfinite(answers.first_s)],
        "p_d": answers.looks,
    }
    needs_detections = (
        {"counts", "line_of_sight_urad", "confidence", "type"}
        if not len(answers.detections)
        else set()
    )
    return needs_detections | {name for name, values in known.items() if not len(values)}


@frozen(eq=False)
class TrackAnswers:
    """What tracks say: of each target's last row the launch (n, 3), impact (n, 3), area (n,), km2,
    and whether it contains the truth (n,); of each row in force the number of its tick and target
    (m,), the position (m, 3) and its error (m, 3), m.
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
    truths = run.plan.targets.truth()
    impacts = np.array([place_of(each.get("impact")) for each in truths]).reshape(-1, 3)
    launches = np.array([place_of(each.get("launch")) for each in truths]).reshape(-1, 3)
    tracks = _answers_of_tracks(run)
    errors_m = (
        np.linalg.norm(tracks.errors, axis=1),
        _distances(tracks.launch, launches, np.nan),
        _distances(tracks.impact, impacts, np.nan),
    )
    are_estimated = (
        (np.isin(np.arange(count), tracks.ticks % max(count, 1)), launches),
        (np.isfinite(tracks.launch[:, 0]), launches),
        (np.isfinite(tracks.impact[:, 0]), impacts),
    )
    return RunAnswers(
        detections,
        *_probabilities(run, rows),
        first_s,
        impacts[:, :2],
        tracks.ticks,
        tracks.positions,
        tracks.launch,
        tracks.impact,
        tracks.area_km2,
        tracks.contained,
        {name: 1e-3 * _rms_of_known(each) for name, each in zip(OF_TRUTH, errors_m, strict=True)},
        {
            name: _share_of_launches(*each)
            for name, each in zip(OF_TRUTH, are_estimated, strict=True)
        },
    )


def _answers_of_tracks(run: Run) -> TrackAnswers:
    count = len(run.plan.targets.ids)
    launch = np.full((count, 3), np.nan)
    impact = np.full((count, 3), np.nan)
    area_km2 = np.full(count, np.nan)
    contained = np.full(count, np.nan)
    if not len(run.tracks):
        nothing = np.empty((0, 3))
        ticks = np.empty(0, dtype=np.int64)
        return TrackAnswers(launch, impact, area_km2, contained, ticks, nothing, nothing)
    evidence = evidence_of_run(run, run.plan)
    owners = ownership(evidence)
    last = last_rows(evidence, owners)
    targets = owners.target[np.searchsorted(owners.track, run.tracks.track[last])]
    launch[targets] = run.tracks.launch[last]
    impact[targets] = run.tracks.impact[last]
    scores = impact_scores(evolve(evidence, tracks=run.tracks.take(last)), owners)
    area_km2[scores.target] = scores.area_km2[:, -1]
    contained[scores.target] = scores.contained[:, -1]
    rows = rows_in_force(evidence, owners)
    tick_s = run.tracks.tick_s[rows]
    targets = owners.target[np.searchsorted(owners.track, run.tracks.track[rows])]
    ticks = np.rint(tick_s * 1e3).astype(np.int64) * count + targets
    positions = run.tracks.state[rows, :3]
    truth = true_states_ecef(run.plan, targets.astype(np.int32), tick_s)[:, :3]
    return TrackAnswers(launch, impact, area_km2, contained, ticks, positions, positions - truth)


def _share_of_launches(has_estimate: BoolArray, truth: FloatArray) -> float:
    """Return the share with an estimate of targets (n,) whose truth (n, 3) is known; nan without
    any.
    """
    known = np.isfinite(truth[:, 0])
    return float(has_estimate[known].mean()) if known.any() else np.nan


def _probabilities(run: Run, mine: IntArray) -> tuple[IntArray, FloatArray]:
    """Return keys of looks and their P_d: of every n-th scan for a model of signals, else of what
    was detected.

    A detection's own P_d says little of a model that is wrong where it detects nothing.
    """
    plan = run.plan
    model = run.plan.detection
    count = len(plan.targets.ids)
    every = Looks.between(plan.pairs, 0, plan.end_ns)
    first = plan.look_geometry().exposures(every.pair[:1], every.scan[:1])
    if not len(first) or model.response(first) is None:
        detected = run.detections.take(mine)
        return _look_keys(
            detected.sensor, run.truth.target[mine], detected.scan, count
        ), run.truth.probability[mine]
    stride = 1 << max(0, math.ceil(math.log2(max(len(every.pair), 1) / LOOKS)))
    kept = np.flatnonzero(every.scan % stride == 0)
    pair = every.pair[kept]
    scan = every.scan[kept]
    if model.probability_tolerance is None:
        probability = model.probability(plan.look_geometry().exposures(pair, scan))
    else:
        whole = ProbabilityInterpolant.of(plan.look_geometry(), model, model.probability_tolerance)
        probability = whole.over(every).probability()[kept]
    return _look_keys(plan.pairs.sensor[pair], plan.pairs.target[pair], scan, count), probability


def _look_keys(sensor: IndexArray, target: IndexArray, scan: IntArray, targets: int) -> IntArray:
    keys: IntArray = (sensor.astype(np.int64) * targets + target << 36) + scan
    return keys


def differences(run: RunAnswers, reference: RunAnswers) -> dict[str, float]:
    """Return the errors of a run, by the names of `MEASURES`."""
    ours, theirs = _matched(_keys(run.detections), _keys(reference.detections))
    here = run.detections.take(ours)
    there = reference.detections.take(theirs)
    across = np.linalg.norm(here.line_of_sight_ecef - there.line_of_sight_ecef, axis=1)
    row, other = _matched(run.ticks, reference.ticks)
    apart = np.linalg.norm(run.states[row] - reference.states[other], axis=1)
    look, same = _matched(run.looks, reference.looks)
    wanted = len(reference.detections)
    has_same_tracks = np.array_equal(_tracked(run), _tracked(reference))
    has_same_regions = np.array_equal(np.isfinite(run.contained), np.isfinite(reference.contained))
    return {
        "p_d": _largest(run.probability[look] - reference.probability[same]),
        "counts": (len(run.detections) - wanted) / wanted
        if wanted
        else float(len(run.detections) > 0),
        "latency_s": _largest(_both(run.first_s, reference.first_s)),
        "line_of_sight_urad": 1e6 * _largest(across),
        "confidence": _largest(here.confidence - there.confidence),
        "type": float(np.mean(here.reported_type != there.reported_type)) if len(here) else 0.0,
        "truth_m": _largest(_distances(run.truth, reference.truth)),
        "position_km": 1e-3 * _rms(apart)
        if has_same_tracks and (len(row) or not len(reference.ticks))
        else np.inf,
        "launch_km": 1e-3 * _rms(_distances(run.launch, reference.launch)),
        "impact_km": 1e-3 * _rms(_distances(run.impact, reference.impact)),
        "region_contains": _share(run.contained) - _share(reference.contained)
        if has_same_regions
        else np.inf,
        "impact_area": _rms(
            _both(run.area_km2, reference.area_km2) / np.nan_to_num(reference.area_km2, nan=1.0)
        ),
    }


def _tracked(answers: RunAnswers) -> IntArray:
    """Return the launches that a run has tracked positions of."""
    return np.unique(answers.ticks % len(answers.first_s)) if len(answers.ticks) else answers.ticks


def over_runs(found: list[dict[str, float]]) -> dict[str, float]:
    """Return the errors of several runs as one: mean, root mean square or largest, by measure."""
    return {name: _over_runs(name, np.array([each[name] for each in found])) for name in MEASURES}


def from_truth_over_runs(found: list[Mapping[str, float]]) -> dict[str, float]:
    """Return the errors from the truth of several runs as one: root mean squares over those that
    have any.

    `estimated` of the runs belongs beside them.
    """
    return {name: _rms_of_known(np.array([each[name] for each in found])) for name in OF_TRUTH}


def _over_runs(name: str, values: FloatArray) -> float:
    if name in _MEANS:
        return float(abs(values.mean()))
    return float(np.sqrt(np.mean(values**2))) if name in _ROOT_MEAN_SQUARES else float(values.max())


def _keys(detections: Detections) -> Any:
    return np.ascontiguousarray(detections.detection_id).view("V16").ravel()


def _matched(ours: Any, theirs: Any) -> tuple[IntArray, IntArray]:
    _, row, other = np.intersect1d(ours, theirs, return_indices=True)
    return row, other


def _both(ours: FloatArray, theirs: FloatArray) -> FloatArray:
    """Return differences where both are known, 0 where none is, infinity where one is."""
    known = np.isfinite(ours)
    wanted = np.isfinite(theirs)
    apart = np.where(known, ours, 0.0) - np.where(wanted, theirs, 0.0)
    return np.where(known != wanted, np.inf, np.where(known, apart, 0.0))


def _distances(ours: FloatArray, theirs: FloatArray, of_one: float = np.inf) -> FloatArray:
    """Return ground distances, m, between places (n, 2+) of latitude and longitude, rad: `of_one`
    where only one is known, 0 where none is.
    """
    known = np.isfinite(ours[:, 0])
    wanted = np.isfinite(theirs[:, 0])
    pair = known & wanted
    found = np.where(known != wanted, of_one, 0.0)
    if pair.any():
        found[pair] = np.linalg.norm(
            ground_error(_ground(ours[pair]), _ground(theirs[pair])), axis=1
        )
    return found


def _ground(places: FloatArray) -> FloatArray:
    return np.column_stack([places[:, :2], np.zeros(len(places))])


def _share(contained: FloatArray) -> float:
    known = contained[np.isfinite(contained)]
    return float(known.mean()) if len(known) else 0.0


def _largest(values: FloatArray) -> float:
    return float(np.abs(values).max(initial=0.0))


def _rms_of_known(values: FloatArray) -> float:
    known = values[np.isfinite(values)]
    return _rms(known) if len(known) else math.nan


def _rms(values: FloatArray) -> float:
    return float(np.sqrt(np.mean(np.square(values)))) if len(values) else 0.0
