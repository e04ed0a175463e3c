"""Whose tracks are whose: each track belongs to the target that most of its detections came from.

A target may have several tracks, side by side or, where one was lost, one after another. At every tick one of them is
*in force*: so what is told after a track was lost is judged too, and what two tracks tell at once is not counted twice.
"""

import numpy as np
from attrs import frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.scoring.evidence import RunEvidence


@frozen(eq=False)
class Ownership:
    """One row a track, by number: its target (-1: noise or a source that is no launch), purity, and who saw it.

    `held` counts the track's detections that came from its target, and `purity` is their share of all its detections.
    `is_stereo` says whether several sensors saw it, `is_biased` whether one that did has a line-of-sight bias.
    """

    track: IntArray
    target: IntArray
    purity: FloatArray
    held: IntArray
    is_stereo: BoolArray
    is_biased: BoolArray


def ownership(evidence: RunEvidence) -> Ownership:
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
    seen = _seen(evidence, row, held, len(numbers))
    biased = np.array([sensor.line_of_sight_bias_sigma_rad > 0.0 for sensor in evidence.plan.sensors], dtype=np.bool_)
    return Ownership(
        track=numbers,
        target=target,
        purity=np.where(total > 0, of_owner / np.maximum(total, 1), 0.0),
        held=of_owner,
        is_stereo=seen.sum(axis=1) > 1,
        is_biased=(seen & biased).sum(axis=1) > 0,
    )


def rows_in_force(evidence: RunEvidence, owners: Ownership) -> IntArray:
    """Return the rows of the run's tracks that are in force, one a launch and tick, by launch and then by tick.

    Of several tracks of a launch that are told at a tick that is the one that holds most of its detections, the
    earliest of equals.
    """
    owner = np.searchsorted(owners.track, evidence.tracks.track)
    target, tick_s = owners.target[owner], evidence.tracks.tick_s
    order = np.lexsort((owner, -owners.held[owner], tick_s, target))
    order = order[target[order] >= 0]
    first = np.ones(len(order), dtype=np.bool_)
    first[1:] = (np.diff(target[order]) != 0) | (np.diff(tick_s[order]) != 0.0)
    return order[first]


def _seen(evidence: RunEvidence, row: IntArray, held: IntArray, tracks: int) -> BoolArray:
    """Return which sensors each track has detections of, (tracks, sensors)."""
    seen = np.zeros((tracks, len(evidence.plan.sensors)), dtype=np.bool_)
    seen[row, evidence.sensor[held]] = True
    return seen
