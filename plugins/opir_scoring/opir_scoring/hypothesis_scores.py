"""Scores of the hypotheses that tracks weigh: log and Brier scores, reliability, recognition of
unknown classes.
"""

from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
from attrs import frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.interfaces import Columns
from opir_core.planning import Targets
from opir_core.plugin import EMITTER_TYPES
from opir_scoring.containments import mean, share
from opir_scoring.evidence import Ownership, RunEvidence
from opir_scoring.proper_scores import (
    brier_scores,
    log_scores,
    open_set_rate,
    reliability,
    share_above,
)

#: Ages of a track, s since its first estimate, at which its probabilities are scored; then its last
#: estimate.
AGES_S = (0.0, 5.0, 10.0, 20.0, 40.0)
AGES = (*(f"{age_s:g} s" for age_s in AGES_S), "last estimate")

#: The hypotheses of no launch, by name: of false alarms, bolides and all other sources.
_NOISE = "noise"
_BOLIDE = "bolide"
_GROUND = "ground source"

#: The type of sources that resemble none.
_OTHER = "other"


@frozen(eq=False, repr=False)
class HypothesisScores(Columns):
    """Scores of the probabilities of hypotheses, one row per track and age that it reaches.

    `age` are numbers into `AGES`, `truth` and `best` the true and the most probable hypothesis by
    number, `confidence` the probability of the latter. `is_unknown` marks tracks whose truth is
    "none of these", of which `none` is the probability; `known` is the greatest probability of any
    other hypothesis, and `is_known_right` whether it is the truth. `launch` is the probability of
    anything that was launched, `is_launch` the truth of it.
    """

    age: IntArray
    truth: IntArray
    best: IntArray
    confidence: FloatArray
    log_score: FloatArray
    brier: FloatArray
    none: FloatArray
    is_unknown: BoolArray
    known: FloatArray
    is_known_right: BoolArray
    launch: FloatArray
    is_launch: BoolArray


def true_hypotheses(
    evidence: RunEvidence, owners: Ownership, unknown: Collection[str] = ()
) -> IntArray:
    """Return the numbers (tracks,) of the hypotheses that are true of tracks.

    That of a launch has the name of its target class, that of false alarms is noise; other sources
    are bolides or stand on the ground. "None of these" is true of classes that are no hypothesis,
    or are named as `unknown` to the tracker, and of kinds of sources that resemble none.
    """
    plan = evidence.plan
    names = [hypothesis.name for hypothesis in plan.hypotheses]
    excluded = {*unknown, _NOISE, _BOLIDE, _GROUND}
    number = {name: place for place, name in enumerate(names) if name not in excluded}
    launched = [
        number.get(name, len(names) - 1)
        for name in plan.targets.class_names[: len(plan.scene.targets)]
    ]
    places = [
        len(names) - 1 if name is None else names.index(name)
        for name in _source_hypotheses(plan.targets, len(launched))
    ]
    return np.array([*launched, *places, names.index(_NOISE)], dtype=np.int64)[owners.source]


def _source_hypotheses(targets: Targets, launches: int) -> list[str | None]:
    """Return the true hypotheses of the sources after a number of launches, by the types that they
    resemble; None for "none of these".
    """
    resembled = [EMITTER_TYPES[code] for code in targets.type_code[launches:].tolist()]
    kinds = zip(targets.class_names[launches:], resembled, strict=True)
    return [
        None if resembles == _OTHER != kind else _BOLIDE if resembles == _BOLIDE else _GROUND
        for kind, resembles in kinds
    ]


def hypothesis_scores(
    evidence: RunEvidence, owners: Ownership, unknown: Collection[str] = ()
) -> HypothesisScores:
    """Return the scores of the tracks of a run by age; no rows where the tracker weighs no
    hypotheses.

    Of a track without detections, such as one of a flash between two ticks, nothing is known to be
    true: it is left out.
    """
    tracks = evidence.tracks
    groups = [hypothesis.group for hypothesis in evidence.plan.hypotheses]
    if tracks.hypothesis_probability.shape[1] != len(groups):
        return HypothesisScores.empty()
    rows, age = _rows_by_age(evidence, owners)
    probability = tracks.hypothesis_probability[rows]
    owner = np.searchsorted(owners.track, tracks.track[rows])
    truth = true_hypotheses(evidence, owners, unknown)[owner]
    best = probability.argmax(axis=1)
    none = len(groups) - 1
    of_classes = probability[:, :none]
    return HypothesisScores(
        age=age,
        truth=truth,
        best=best,
        confidence=probability.max(axis=1),
        log_score=log_scores(probability, truth),
        brier=brier_scores(probability, truth),
        none=probability[:, none],
        is_unknown=truth == none,
        known=of_classes.max(axis=1),
        is_known_right=of_classes.argmax(axis=1) == truth,
        launch=tracks.probability_launch[rows],
        is_launch=owners.target[owner] >= 0,
    )


def _rows_by_age(evidence: RunEvidence, owners: Ownership) -> tuple[IntArray, IntArray]:
    """Return rows (n,) of tracks, the newest at each age that they reach and the last, and the
    ages' numbers (n,).
    """
    tracks = evidence.tracks
    order = np.lexsort((tracks.tick_s, tracks.track))
    is_owned = owners.held[np.searchsorted(owners.track, tracks.track[order])] > 0
    order = order[is_owned & np.isfinite(tracks.hypothesis_probability[order]).all(axis=1)]
    if not len(order):
        return order, order
    rows = _newest_rows(tracks.track[order], tracks.tick_s[order])
    ages = np.repeat(np.arange(len(rows)), [len(of_age) for of_age in rows])
    return order[np.concatenate(rows)], ages


def _newest_rows(track: IntArray, tick_s: FloatArray) -> list[IntArray]:
    """Return the last rows of tracks at each age that they reach, and of all, of rows (n,) by track
    and time.
    """
    _, start, count = np.unique(track, return_index=True, return_counts=True)
    end = start + count - 1
    since_s = tick_s - np.repeat(tick_s[start], count)
    rows = list[IntArray]()
    for age_s in AGES_S:
        young = np.add.reduceat(since_s <= age_s, start)
        is_reached = since_s[end] >= age_s
        rows.append((start + young - 1)[is_reached])
    return [*rows, end]


def hypothesis_figures(scores: HypothesisScores, names: Sequence[str]) -> Mapping[str, Any]:
    """Return the figures of hypotheses by age, and reliability and confusion at the last
    estimates.
    """
    final = scores.take(scores.age == len(AGES_S))
    return {
        "by_age": [
            {"age": name, **_of_age(scores.take(scores.age == age))}
            for age, name in enumerate(AGES)
        ],
        "reliability": reliability(final.confidence, final.best == final.truth),
        "launch_reliability": reliability(final.launch, final.is_launch),
        "confusion": _confusion(final, names),
    }


def _of_age(scores: HypothesisScores) -> dict[str, Any]:
    of_classes = scores.take(~scores.is_unknown)
    unknown = scores.take(scores.is_unknown)
    return {
        "tracks": len(scores),
        "right": share(scores.best == scores.truth),
        "log_score": mean(scores.log_score),
        "brier": mean(scores.brier, 2.0),
        "none": mean(of_classes.none, 1.0),
        "unknown_tracks": len(unknown),
        "none_auroc": share_above(unknown.none, of_classes.none),
        "oscr": open_set_rate(of_classes.known, of_classes.is_known_right, unknown.known),
    }


def _confusion(scores: HypothesisScores, names: Sequence[str]) -> dict[str, dict[str, int]]:
    """Return, by true hypothesis, the counts of the most probable ones; hypotheses without any are
    left out.
    """
    count = np.zeros((len(names), len(names)), dtype=np.int64)
    np.add.at(count, (scores.truth, scores.best), 1)
    return {
        names[true]: {
            names[best]: int(count[true, best]) for best in np.flatnonzero(count[true]).tolist()
        }
        for true in np.flatnonzero(count.sum(axis=1)).tolist()
    }
