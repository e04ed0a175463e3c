"""Hypotheses of a track's class and heading: how probable they are, which rows are theirs, where they begin.

What a bank remembers, with which hypotheses are linearised anew anywhere else.
"""

from typing import NamedTuple

import numpy as np
from attrs import evolve, frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.geometry import intersection_with_ellipsoid
from opir_trackers.profile import fit
from opir_trackers.profile.family import START, TURN_EAST, TURN_NORTH, Anchors, Family, Priors, natural
from opir_trackers.profile.fit import Hypotheses, Solved
from opir_trackers.profile.rows import Rows
from opir_trackers.profile.seen import TrackHistory

#: The chance below which a hypothesis is given up.
GIVEN_UP = 1e-3

#: A turn whose better known component has less than this share of its length as standard deviation may be bent.
_BEND = 0.35

#: Two modes of a class that differ by less than this, standard deviations squared, are one.
_SAME = 4.0

#: Light takes no longer than this from a burning target to a sensor, s.
_LIGHT_S = 0.2


class HypothesisPath(NamedTuple):
    """The likeliest paths of tracks: positions at the times of rows, read or, for many rows, by parabolas."""

    track: IntArray
    family: Family
    nodes_s: FloatArray
    positions_m: FloatArray

    @classmethod
    def of(cls, hypotheses: Hypotheses, priors: Priors, rows: Rows | None) -> "HypothesisPath":
        """Return the paths; of those of which `rows` hold many, as parabolas over all their times."""
        likely = likeliest(hypotheses)
        family = fit.family_of(likely, priors)
        if rows is None or len(rows) < 3 * len(likely):
            return cls(likely.track, family, np.empty((0, 3)), np.empty((0, 3, 3)))
        place = np.searchsorted(likely.track, rows.track)
        first, last = np.full(len(likely), np.inf), np.full(len(likely), -np.inf)
        np.minimum.at(first, place, rows.time_s - _LIGHT_S)
        np.maximum.at(last, place, rows.time_s + 1e-3)
        first, last = np.where(np.isfinite(first), first, 0.0), np.where(np.isfinite(last), last, 1.0)
        nodes = np.stack([first, 0.5 * (first + last), last], axis=1)
        every = np.repeat(np.arange(len(likely)), 3)
        positions = family.places(every, nodes.ravel()).position_m
        return cls(likely.track, family, nodes, positions.reshape(-1, 3, 3))

    def at(self, rows: Rows) -> FloatArray:
        """Return the positions (m, 3) at which rows' tracks are expected."""
        row = np.searchsorted(self.track, rows.track)
        if not len(self.nodes_s):
            return self.family.places(row, rows.time_s).position_m
        t = rows.time_s
        a, b, c = self.nodes_s[row].T
        weights = (
            (t - b) * (t - c) / ((a - b) * (a - c)),
            (t - a) * (t - c) / ((b - a) * (b - c)),
            (t - a) * (t - b) / ((c - a) * (c - b)),
        )
        total = np.zeros((len(t), 3))
        for node, weight in enumerate(weights):
            total += weight[:, None] * self.positions_m[row, node]
        return total


def probability(hypotheses: Hypotheses) -> FloatArray:
    """Return the probabilities (n,) of the hypotheses of each track.

    Where even the best of them fits worse than the rows' errors say, the rows say as much less.
    """
    evidence = np.nan_to_num(hypotheses.evidence, nan=-np.inf)
    _, row = np.unique(hypotheses.track, return_inverse=True)
    count = int(row.max(initial=-1)) + 1
    most, misfit = np.full(count, -np.inf), np.full(count, np.inf)
    np.maximum.at(most, row, evidence)
    np.minimum.at(misfit, row, hypotheses.misfit)
    share = np.exp((evidence - most[row]) / misfit[row])
    normalised: FloatArray = share / np.bincount(row, share)[row]
    return normalised


def likeliest(hypotheses: Hypotheses) -> Hypotheses:
    """Return the likeliest hypothesis of each track, by track."""
    order = np.lexsort((-hypotheses.evidence, hypotheses.track))
    chosen = hypotheses.take(order)
    return chosen.take(np.append(True, np.diff(chosen.track) != 0)[: len(chosen)])


def joined(track: IntArray, of_rows: IntArray) -> tuple[IntArray, IntArray]:
    """Return all pairs of rows and hypotheses of one track: rows (m,) and hypotheses (m,)."""
    order = np.argsort(of_rows, kind="stable")
    begin, end = (np.searchsorted(of_rows[order], track, side) for side in ("left", "right"))
    count = end - begin
    hypothesis = np.repeat(np.arange(len(track)), count)
    within = np.arange(int(count.sum())) - np.repeat(np.cumsum(count) - count, count)
    return order[np.repeat(begin, count) + within], hypothesis


def first(lead: Rows, classes: int, sensors: int) -> Hypotheses:
    """Return hypotheses of every class for tracks whose first rows these are."""
    anchors = Anchors.at(on_the_ground(lead), lead.time_s - 1.0)
    again = np.repeat(np.arange(len(lead)), classes)
    anchors, kind = anchors.take(again), np.tile(np.arange(classes), len(lead))
    return evolve(
        fit.blank(len(again), sensors),
        track=lead.track[again],
        kind=kind,
        anchor_latitude_rad=anchors.latitude_rad,
        anchor_longitude_rad=anchors.longitude_rad,
        anchor_s=anchors.time_s,
    )


def may_bend(hypotheses: Hypotheses, priors: Priors) -> BoolArray:
    """Return which hypotheses know enough of their turn, whose prior has no direction, to give it one."""
    spread = hypotheses.spread[:, TURN_EAST : TURN_NORTH + 1, TURN_EAST : TURN_NORTH + 1]
    least = np.linalg.eigvalsh(spread)[:, 0]
    prior = priors.take(hypotheses.kind)
    lean_rad = prior.turn_rad * natural(hypotheses.parameters, prior).lean
    return np.asarray((least > 0.0) & (least < np.square(_BEND * lean_rad)))


def distinct(hypotheses: Hypotheses) -> Hypotheses:
    """Return the hypotheses without those whose class has a likelier one at the same place, through the same window."""
    order = np.lexsort((-np.nan_to_num(hypotheses.evidence, nan=-np.inf), hypotheses.kind, hypotheses.track))
    ranked = hypotheses.take(order)
    key = np.unique(np.column_stack([ranked.track, ranked.kind, ranked.window[:, 2]]), axis=0, return_inverse=True)[1]
    ranked, key = ranked.take(np.argsort(key, kind="stable")), np.sort(key)
    left = np.array(np.isfinite(ranked.evidence), ndmin=1)
    kept = np.zeros(len(key), dtype=np.bool_)
    while left.any():
        rows = np.flatnonzero(left)
        lead = rows[np.append(True, np.diff(key[rows]) != 0)]
        kept[lead] = True
        left[lead] = False
        rows = np.flatnonzero(left & np.isin(key, key[lead]))
        chief = lead[np.searchsorted(key[lead], key[rows])]
        left[rows[_distance(ranked.take(rows), ranked.take(chief)) < _SAME]] = False
    return ranked.take(kept)


def _distance(hypotheses: Hypotheses, others: Hypotheses) -> FloatArray:
    """Return the squared distances (n,) of start and turn from those of others, by the spread of the others."""
    columns = slice(START, TURN_NORTH + 1)
    away = (hypotheses.parameters - others.parameters)[:, columns]
    spread = others.spread[:, columns, columns]
    distance: FloatArray = np.sum(away * np.linalg.solve(spread, away[:, :, None])[:, :, 0], axis=1)
    return distance


def on_the_ground(rows: Rows) -> FloatArray:
    """Return the points (n, 3) of the ellipsoid that rows meet; where they miss, their nearest to the centre."""
    direction = rows.axes[:, 2]
    point = np.asarray(intersection_with_ellipsoid(rows.origin_ecef_m, direction))
    nearest = rows.origin_ecef_m - np.sum(rows.origin_ecef_m * direction, axis=1)[:, None] * direction
    met = np.asarray(np.isfinite(point).all(axis=1))
    return np.where(met[:, None], point, nearest)


@frozen(eq=False)
class FitMemory:
    """All rows of tracks, what was seen of them, the priors of their classes and the biases (sensors,) of sensors."""

    rows: Rows
    seen: TrackHistory
    priors: Priors
    bias_sigma_rad: FloatArray

    def linearised(self, hypotheses: Hypotheses) -> tuple[Hypotheses, Family, Solved]:
        """Return hypotheses with all their rows, linearised where they stand, their paths, and the solutions."""
        family = fit.family_of(hypotheses, self.priors)
        row, owner = joined(hypotheses.track, self.rows.track)
        found = fit.with_rows(hypotheses.cleared(), family, self.rows.take(row), owner, np.ones(len(row)))
        return found, family, fit.solved(found, self.priors, self.bias_sigma_rad)
