"""The associator `jpda`, joint probabilistic data association: a line of sight within the gates of
several tracks updates each of them, weighted by the probability that it belongs to that track. All
scans of a slice are weighed together.

A track that shares no line with another one, and has at most one line a scan, takes its lines.
"""

from typing import Any

import numpy as np
from attrs import frozen
from opir_estimation import (
    GatedPairs,
    SharedLooks,
    cheapest_assignment,
    components,
    equivalent_pairs,
    label_posterior,
)

from opir_core.arrays import BoolArray, IntArray
from opir_trackers.association import ambiguous_tracks, scan_groups
from opir_trackers.parts import Association, AssociationProblem, Associator, PartContext


@frozen
class JointAssociator(Associator):
    """Joint probabilistic data association; `light_time` says whether light takes time."""

    light_time: bool

    def associate(self, problem: AssociationProblem) -> Association:
        """Return the association of a slice's lines with the predicted tracks."""
        nearest = problem.nearest
        lines = problem.lines
        certain = Association(lines=lines, owner=nearest.owner, pairs=nearest.assigned)
        if not nearest.is_ambiguous:
            return certain
        doubtful = ambiguous_tracks(problem.pairs, lines)
        if not doubtful.size:
            return certain
        moving = _beside_moving(problem, doubtful)
        is_moving = np.isin(problem.pairs.track, moving)
        lone = nearest.assigned
        lone = lone.take(np.flatnonzero(~np.isin(lone.track, moving)))
        if not moving.size:
            return Association(lines=lines, owner=nearest.owner, pairs=lone, doubtful=doubtful)
        looks = _looks(problem, problem.pairs.take(np.flatnonzero(is_moving)))
        posterior = label_posterior(looks, problem.path, light_time=self.light_time)
        choice = cheapest_assignment(looks.look, looks.pairs.line, -posterior.log_ratio)
        chosen = looks.pairs.take(np.flatnonzero(choice))
        owner = _owners(lines.scan.size, lone, chosen)
        equivalent = equivalent_pairs(looks, posterior)
        return Association(
            lines=lines,
            owner=owner,
            pairs=GatedPairs.concatenate([lone, equivalent]),
            single=GatedPairs.concatenate([lone, chosen]),
            doubtful=doubtful,
        )

    def labels(self, problem: AssociationProblem, eligible: BoolArray) -> IntArray:
        """Return the track rows (m,) of lines of the next tick by global nearest neighbour: lines
        of other instants may not be there yet.
        """
        return problem.nearest.owner


def _beside_moving(problem: AssociationProblem, doubtful: IntArray) -> IntArray:
    """Return those tracks among `doubtful` that share lines, over any number of others, with one
    that need not stand.
    """
    if problem.stands is None or not problem.stands[doubtful].any():
        return doubtful
    pairs = problem.pairs
    group, count = components(pairs.track, pairs.line)
    moves = np.bincount(group, ~problem.stands[pairs.track], count) > 0.0
    return np.intersect1d(doubtful, pairs.track[moves[group]])


def _looks(problem: AssociationProblem, pairs: GatedPairs) -> SharedLooks:
    """Return pairs of the problem as looks of tracks."""
    sensor = problem.lines.sensor.take(pairs.line)
    look = scan_groups(pairs, problem.lines)
    return SharedLooks(pairs, look, problem.model.log_odds.take(sensor), sensor)


def _owners(count: int, *assigned: GatedPairs) -> IntArray:
    """Return the track rows (count,) of lines by assigned pairs, -1 for none."""
    owner = np.full(count, -1, dtype=np.int64)
    for pairs in assigned:
        owner[pairs.line] = pairs.track
    return owner


def joint_associator(_config: Any, context: PartContext) -> JointAssociator:
    """Return the associator `jpda`."""
    return JointAssociator(context.tracker.light_time)
