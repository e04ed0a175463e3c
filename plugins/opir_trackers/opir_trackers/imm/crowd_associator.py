"""The associator `crowds`: global nearest neighbour; tracks that share lines of sight are followed in
the sensors' focal planes.
"""

from typing import Any

import numpy as np
from attrs import evolve, frozen
from opir_estimation import GatedPairs

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.plugin import Sensor
from opir_trackers.association import ambiguous_tracks, associate_nearest, unassigned
from opir_trackers.imm import crowds as crowd
from opir_trackers.imm.crowds import CrowdPairs, Crowds, SensorView
from opir_trackers.imm.refiltering import Refiltering
from opir_trackers.imm.renewal import CrowdedTracks, renewed
from opir_trackers.parts import (
    Association,
    AssociationProblem,
    Associator,
    PartContext,
    Settled,
    TrackPicture,
)
from opir_trackers.track_priors import filter_of


@frozen(eq=False)
class CrowdAssociator(Associator):
    """Global nearest neighbour, and crowds. The memory are the `Crowds`, None without any."""

    sensors: tuple[Sensor, ...]
    period_s: FloatArray
    refiltering: Refiltering

    def associate(self, problem: AssociationProblem) -> Association:
        """Return the association of a slice's lines with the predicted tracks."""
        crowds: Crowds | None = problem.memory
        pairs = problem.pairs
        if crowds is None and problem.number.size == 1:
            return _outside_crowds(problem, pairs)
        if crowds is not None:
            follows = crowds.follows(problem.number, problem.seen.shape[1])
            rows = ~follows[pairs.track, problem.lines.sensor[pairs.line]]
            pairs = pairs.take(rows.nonzero()[0])
        crowds = self._with_contested(problem, pairs, crowds)
        if crowds is None:
            return _outside_crowds(problem, pairs)
        return self._in_crowds(problem, pairs, crowds)

    def _with_contested(
        self, problem: AssociationProblem, pairs: GatedPairs, crowds: Crowds | None
    ) -> Crowds | None:
        """Return the crowds with the tracks outside whose pairing gated pairs leave open; None
        without any.
        """
        number = problem.number
        sensor = problem.lines.sensor[pairs.line]
        rows = crowd.contested_tracks(pairs.track, pairs.line, sensor, problem.seen)
        if crowds is not None:
            rows = rows[~crowds.holds(number[rows])]
        if not rows.size:
            return crowds
        view = self._view(problem.bias_sigma_rad)
        crowds = crowds or Crowds(errors=problem.known_errors)
        return crowd.joined(crowds, number, rows, problem.path, problem.seen, view)

    def _view(self, bias_sigma_rad: FloatArray) -> SensorView:
        """Return the sensors, what is left of their errors, and whether light takes time."""
        return SensorView(self.sensors, bias_sigma_rad, self.refiltering.light_time)

    def _paired(self, problem: AssociationProblem, crowds: Crowds) -> CrowdPairs:
        """Return the focal-plane tracks and their pairs with the lines."""
        start_s = problem.end_s - problem.span_s
        gate = self.refiltering.config.gate_sigma
        return crowd.paired(crowds.tracks, start_s, problem.lines, problem.span_s, gate)

    def _in_crowds(
        self, problem: AssociationProblem, pairs: GatedPairs, crowds: Crowds
    ) -> Association:
        """Return the association where some tracks are in crowds: these take their lines first."""
        lines = problem.lines
        number = problem.number
        view = self._view(problem.bias_sigma_rad)
        update = crowd.updated_crowds(
            crowds,
            self._paired(problem, crowds),
            lines,
            problem.end_s,
            problem.model,
            self.refiltering.config.gate_sigma,
            view,
        )
        has_owner = update.number >= 0
        follows = update.crowds.follows(number, problem.seen.shape[1])
        is_taken = follows[pairs.track, lines.sensor[pairs.line]] | has_owner[pairs.line]
        association = _outside_crowds(problem, pairs.take((~is_taken).nonzero()[0]))
        # Those that join now were alone in this slice.
        sharing = np.unique(pairs.track[has_owner[pairs.line]])
        crowds = _with_joining(problem, association, update.crowds, sharing, view)
        light_time = self.refiltering.light_time
        equivalent = crowd.equivalent_pairs(update, number, problem.path, light_time)
        rows = np.searchsorted(number, update.number)
        return evolve(
            association,
            owner=np.where(has_owner, rows, association.owner),
            pairs=GatedPairs.concatenate([association.pairs, equivalent]),
            sensor=np.append(association.sensor, update.equivalent.sensor),
            memory=crowds,
        )

    def labels(self, problem: AssociationProblem, eligible: BoolArray) -> IntArray:
        """Return the track rows (m,) of lines; those of crowds by their focal-plane tracks."""
        crowds: Crowds | None = problem.memory
        pairs = problem.pairs
        if crowds is not None:
            follows = crowds.follows(problem.number, problem.seen.shape[1])
            lone = ~follows[pairs.track, problem.lines.sensor[pairs.line]]
            focal_pairs = self._paired(problem, crowds)
            labels = crowd.label_pairs(focal_pairs, problem.number, problem.lines)
            labels = labels.take(eligible[labels.track].nonzero()[0])
            pairs = GatedPairs.concatenate([pairs.take(lone.nonzero()[0]), labels])
        return associate_nearest(pairs, problem.lines, problem.model).owner

    def settled(self, tracks: TrackPicture, memory: Any) -> Settled:
        """Return the crowds with new tracks near others, or without those that ended and paired anew
        every few seconds.
        """
        view = self._view(tracks.bias_sigma_rad)
        crowds = crowd.corrected_crowds(
            memory or Crowds(errors=tracks.known_errors), tracks.known_errors, view
        )
        if not tracks.is_pruned:
            crowds = self._with_neighbours(tracks, crowds, view)
            return Settled(memory=crowds if crowds.are_there else None, mixtures=crowds.mixtures)
        crowds = crowds.without(np.setdiff1d(crowds.tracks.number, tracks.number))
        crowds = crowd.pruned(crowds, tracks.time_s, self.period_s)
        if not crowds.are_there:
            return Settled(memory=None)
        state = CrowdedTracks(tracks.time_s, tracks.table, crowds)
        state = renewed(state, view, self.refiltering)
        crowds = state.crowds
        mixtures = crowds.mixtures if crowds.mixtures.number.size else None
        return Settled(memory=crowds, table=state.table, mixtures=mixtures)

    def _with_neighbours(self, tracks: TrackPicture, crowds: Crowds, view: SensorView) -> Crowds:
        """Return the crowds with the tracks that began, and those near them, where several are
        near.
        """
        table = tracks.table
        count = int(np.count_nonzero(table.begun_s == tracks.time_s))
        if not count:
            return crowds
        rows = crowd.begun_near(table.estimates.likelier_position_m, count, table.seen)
        rows = rows[~crowds.holds(table.number[rows])]
        if not rows.size:
            return crowds
        path = self.refiltering.filter.predicted_measurements(table.estimates, tracks.time_s)
        return crowd.joined(crowds, table.number, rows, path, table.seen, view)


def _outside_crowds(problem: AssociationProblem, pairs: GatedPairs) -> Association:
    """Return the association of tracks that are in no crowd."""
    lines = problem.lines
    if not pairs.track.size:
        return Association(lines=lines, owner=unassigned(lines.scan.size), pairs=pairs)
    nearest = associate_nearest(pairs, lines, problem.model)
    if not nearest.is_ambiguous:
        return Association(lines=lines, owner=nearest.owner, pairs=nearest.assigned)
    doubtful = ambiguous_tracks(pairs, lines)
    return Association(lines=lines, owner=nearest.owner, pairs=nearest.assigned, doubtful=doubtful)


def _with_joining(
    problem: AssociationProblem,
    association: Association,
    crowds: Crowds,
    sharing: IntArray,
    view: SensorView,
) -> Crowds:
    """Return the crowds with the tracks `sharing` lines with them, and in the sensors that newly
    detected tracks of theirs.
    """
    number = problem.number
    seen = problem.seen
    rows = sharing[~crowds.holds(number[sharing])]
    if rows.size:
        crowds = crowd.joined(crowds, number, rows, problem.path, seen, view)
    detected = np.zeros(seen.shape, dtype=bool)
    detected[association.pairs.track, association.sensor] = True
    detected &= crowds.holds(number)[:, None] & ~crowds.follows(number, seen.shape[1])
    rows = np.flatnonzero(detected.any(axis=1))
    if rows.size:
        crowds = crowd.joined(crowds, number, rows, problem.path, detected, view)
    return crowds


def crowd_associator(_config: Any, context: PartContext) -> CrowdAssociator:
    """Return the associator `crowds`."""
    tracker = context.tracker
    filter_ = filter_of(context.settings, tracker)
    period_s = np.array([sensor.scan.period_ns * 1e-9 for sensor in tracker.sensors])
    refiltering = Refiltering(filter_, tracker.light_time, context.settings)
    return CrowdAssociator(tracker.sensors, period_s, refiltering)
