"""Whose tracks are whose: each track belongs to the target that most of its detections came from."""

import numpy as np
from attrs import frozen

from opir_core.records import BoolArray, FloatArray, IntArray
from opir_core.scoring.evidence import Evidence


@frozen(eq=False)
class Ownership:
    """One row a track, by number: its target (-1: noise or a source that is no launch), purity, and mono or stereo.

    `purity` is the share of the track's detections that came from its target; `is_best` marks, of several tracks of one
    target, the one that holds most of its detections.
    """

    track: IntArray
    target: IntArray
    purity: FloatArray
    detections: IntArray
    is_stereo: BoolArray
    is_best: BoolArray


def ownership(evidence: Evidence) -> Ownership:
    """Return the owners of all tracks that were ever told."""
    numbers = np.unique(evidence.tracks.track)
    held = np.flatnonzero(evidence.track >= 0)
    row = np.searchsorted(numbers, evidence.track[held])
    targets = len(evidence.plan.targets.ids)
    count = np.zeros((len(numbers), targets + 1), dtype=np.int64)
    np.add.at(count, (row, evidence.target[held] + 1), 1)
    total = count.sum(axis=1)
    owner = count.argmax(axis=1) - 1
    of_owner = count.max(axis=1, initial=0)
    is_launch = np.append(evidence.is_launch, False)
    target = np.where((total > 0) & is_launch[owner], owner, -1)
    return Ownership(
        track=numbers,
        target=target,
        purity=np.where(total > 0, of_owner / np.maximum(total, 1), 0.0),
        detections=total,
        is_stereo=_sensors(evidence, row, held, len(numbers)) > 1,
        is_best=_best(target, of_owner),
    )


def _sensors(evidence: Evidence, row: IntArray, held: IntArray, tracks: int) -> IntArray:
    """Return how many different sensors each track has detections of."""
    seen = np.zeros((tracks, len(evidence.plan.sensors)), dtype=np.bool_)
    seen[row, evidence.sensor[held]] = True
    count: IntArray = seen.sum(axis=1)
    return count


def _best(target: IntArray, of_owner: IntArray) -> BoolArray:
    """Return which tracks hold the most of their target's detections, the earliest of equals."""
    order = np.lexsort((np.arange(len(target)), -of_owner, target))
    first = np.append(True, np.diff(target[order]) != 0) if len(target) else np.empty(0, dtype=np.bool_)
    best = np.zeros(len(target), dtype=np.bool_)
    best[order[first]] = True
    return best & (target >= 0)
