"""Weights of measurements by expectation maximisation: lines shared by several tracks, and outliers.

**Ambiguous measurements.** Two targets closer than a look's error are not resolved by hard assignment: each track would
get the lines on its own side, and the estimates would repel. So an ambiguous line counts for each track with its
association probability, which is recomputed with the updated tracks (EM: Dempster, Laird and Rubin, J. Royal
Statistical Society B 39(1), 1977; Streit and Luginbuhl, "Probabilistic multi-hypothesis tracking", 1995), with one line
per track and scan. Each iteration increases the likelihood of all lines, summed over all hypotheses.

**Outliers.** A line belongs to its track, with the stated error, or is an outlier, uniform about the track within a
gate of that error alone: the track's own uncertainty says nothing about the density of outliers. Lines are weighted by
EM as above. The information of the slice is then the observed information (Louis, J. Royal Statistical Society B 44(2),
1982, 226), which is less than the weights suggest. The outlier fraction of a track follows from the likelihood of all
its lines so far, over a grid of fractions: a running mean of weights would retain the first belief (Titterington, J.
Royal Statistical Society B 46(2), 1984, 257). Tracks without an improbable line are not reweighted.
"""

from typing import NamedTuple

import numpy as np
from attrs import evolve, frozen

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.estimation import dot, matvec
from opir_core.interfaces import Columns
from opir_trackers.assignment import marginals, ranks
from opir_trackers.filter.estimates import ModeEstimates, PredictedMeasurements
from opir_trackers.filter.switching import ImmFilter
from opir_trackers.gating import GatedPairs
from opir_trackers.lines_of_sight import AngleMeasurements

#: Lines with a lower association probability, considering only rivals for the line, are not a track's.
_LEAST_SHARE = 5e-3

#: Weight of a measurement that is most probably unassigned.
LEAST_WEIGHT = 1e-6


@frozen(eq=False, repr=False)
class AmbiguousMeasurements(Columns):
    """Lines that may be part of measurements, one row each: measurement, line and scan.

    `measured` (n, 2), rad, is the line in the tangent plane of the measurement; `log_odds` (n,) the log likelihood
    ratio of a line on the track to a miss and a false alarm, per solid angle in units of its variance; `weight` (n,)
    the last association probability; `end_s` (n,) the end of the line's slice.
    """

    measurement: IntArray
    line: IntArray
    scan: IntArray
    measured: FloatArray
    sigma_rad: FloatArray
    log_odds: FloatArray
    weight: FloatArray
    end_s: FloatArray

    @classmethod
    def empty(cls) -> "AmbiguousMeasurements":
        """Return an empty record."""
        whole, none = np.empty(0, dtype=np.int64), np.empty(0)
        return cls(whole, whole, whole, np.empty((0, 2)), none, none, none, none)

    def with_probabilities(self, track: IntArray, expected: FloatArray) -> "AmbiguousMeasurements":
        """Return the lines with association probabilities, one line per track and scan and one track per line.

        `track` (m,) are the tracks of the measurements, `expected` (m, 2) their predicted directions.
        """
        apart = self.measured - expected.take(self.measurement, axis=0)
        log = self.log_odds - 0.5 * dot(apart, apart) / np.square(self.sigma_rad)
        ratio = np.exp(np.minimum(log, 300.0))
        likely = np.flatnonzero(ratio > _LEAST_SHARE * (1.0 + np.bincount(self.line, ratio)[self.line]))
        scan = ranks(track[self.measurement[likely]] * (int(self.scan.max(initial=0)) + 1) + self.scan[likely])
        weight = np.zeros(len(self))
        weight[likely] = marginals(scan, self.line[likely], ratio[likely])
        return evolve(self, weight=weight)

    def gathered(self, measurements: AngleMeasurements) -> tuple[AngleMeasurements, IntArray]:
        """Return measurements with the weighted means of their lines, and which rows changed."""
        sharp = np.maximum(self.weight, LEAST_WEIGHT) / np.square(self.sigma_rad)
        total = np.bincount(self.measurement, sharp, len(measurements))
        mine = np.flatnonzero(total)
        measured, whitener = measurements.measured.copy(), measurements.whitener.copy()
        for axis in (0, 1):
            measured[mine, axis] = (
                np.bincount(self.measurement, sharp * self.measured[:, axis], len(measurements))[mine] / total[mine]
            )
        whitener[mine] = np.sqrt(total[mine])[:, None, None] * np.eye(2)
        return evolve(measurements, measured=measured, whitener=whitener), mine

    def without(self, gone: BoolArray, measurement: IntArray) -> "AmbiguousMeasurements":
        """Return the rest after measurements (m,) are removed, the others being renumbered `measurement` (m,).

        A line that was theirs with some probability counts less for others.
        """
        left = gone[self.measurement]
        size = int(self.line.max(initial=-1)) + 1
        theirs = np.bincount(self.line[left], self.weight[left], size)
        log_odds = self.log_odds + np.log(np.maximum(1.0 - theirs[self.line], LEAST_WEIGHT))
        return evolve(self, log_odds=log_odds, measurement=measurement[self.measurement]).take(np.flatnonzero(~left))


def predicted_directions(path: PredictedMeasurements, measurements: AngleMeasurements) -> FloatArray:
    """Return the predicted directions (n, 2) of measurements, each in its tangent plane."""
    local = matvec(measurements.axes, path.positions(measurements.track, measurements.time_s) - measurements.origin_m)
    seen: FloatArray = local[:, :2] / local[:, 2:]
    return seen


#: Outlier fractions, evenly spaced in log odds: 0, and from 0.01 to 0.9.
_STEP = 0.2
FRACTIONS = np.append(0.0, 1.0 / (1.0 + np.exp(-np.arange(-4.6, 2.3, _STEP))))

#: Prior mean of the outlier fraction, and its weight in lines.
_SHARE, _BELIEVED = 0.01, 3.0

#: Squared distance exceeded with probability 10⁻³, and the least outlier fraction that is considered.
_IMPROBABLE, _SOME = 13.8, 0.02

#: Below this fraction, tracks without an improbable line are not counted; so onsets of outliers are seen.
FEW = 1e-3

_NONE = np.empty(0, dtype=np.int64)

#: EM iterations, and the least information of a slice relative to its weights.
_TURNS, _LEAST_TOLD = 4, 0.2


class SliceSpan(NamedTuple):
    """End and length of a slice, s, and its gate, standard deviations."""

    end_s: float
    long_s: float
    gate: float


def _prior_log() -> FloatArray:
    """Return the log prior (fractions,) of the outlier fraction: a beta distribution.

    Its density per log odds is proportional to (1 - q)^`_BELIEVED` from the first fraction on; the rest is at 0.
    """
    some = _SHARE * _BELIEVED * _STEP * (1.0 - FRACTIONS[1:]) ** _BELIEVED
    return np.asarray(np.log(np.append(1.0 - some.sum(), some)))


_BEFORE, _CLEAN = _prior_log(), np.log1p(-FRACTIONS)


class OutlierFractions(NamedTuple):
    """Log likelihoods (n, fractions) of the outlier fraction of each track, at most 0."""

    log: FloatArray

    @property
    def share(self) -> FloatArray:
        """Return the posterior mean (n,)."""
        chance = np.exp(self.log + _BEFORE)
        share: FloatArray = np.add.reduce(chance * FRACTIONS, axis=1) / np.add.reduce(chance, axis=1)
        return share

    def take(self, rows: IntArray) -> "OutlierFractions":
        """Return those of some tracks."""
        return OutlierFractions(self.log[rows])

    def after(self, log_likelihood: FloatArray) -> "OutlierFractions":
        """Return those after more lines with log likelihoods (n, fractions)."""
        log = self.log + log_likelihood
        return OutlierFractions(log - np.maximum.reduce(log, axis=1, keepdims=True))


class ReweightedEstimates(NamedTuple):
    """Estimates after a slice, and the log likelihoods (n, fractions) of its lines."""

    estimates: ModeEstimates
    outliers: FloatArray


def suspect_tracks(assigned: GatedPairs, share: FloatArray) -> IntArray:
    """Return the rows (k,) of tracks that may have outliers, by their outlier fractions (n,)."""
    some = (assigned.distance > _IMPROBABLE) | (share.take(assigned.track) > _SOME)
    return np.unique(assigned.track[some]) if np.count_nonzero(some) else _NONE


def clean_log_likelihood(assigned: GatedPairs, outlier: OutlierFractions, gate: float) -> FloatArray:
    """Return the log likelihoods (n, fractions) of lines none of which is improbable.

    Each counts with the probability that an outlier in its place would have been improbable.
    """
    within = _IMPROBABLE / gate**2 * np.exp(0.5 * assigned.log_volume) / np.square(assigned.sigma_rad)
    clean: FloatArray = (
        np.bincount(assigned.track, np.maximum(1.0 - within, 0.0), outlier.log.shape[0])[:, None] * _CLEAN
    )
    return clean


def reweighted(
    filter_: ImmFilter,
    before: ModeEstimates,
    after: ModeEstimates,
    span: SliceSpan,
    assigned: GatedPairs,
    outlier: OutlierFractions,
) -> ReweightedEstimates:
    """Return estimates after a slice with its lines reweighted; the pairs `assigned` led from `before` to `after`."""
    share = outlier.share
    for turn in range(_TURNS + 1):
        weight, place, square = _weights(filter_.predicted_measurements(after, span.end_s), span, assigned, share)
        log_likelihood = fraction_log_likelihood(square, span.gate, assigned.track, len(before))
        if turn < _TURNS:
            after = filter_.updated(before, span.end_s, _weighted(assigned, assigned.measured, weight), span.long_s)
            share = outlier.after(log_likelihood).share
    most = np.bincount(assigned.track, weight, len(before))
    left = np.bincount(assigned.track, weight * (1.0 - 0.5 * (1.0 - weight) * square), len(before))
    part = np.maximum(left / np.maximum(most, LEAST_WEIGHT), _LEAST_TOLD)[assigned.track]
    # The rescaled measurements move the estimate as far as the weighted ones, with less information.
    seen = place + (assigned.measured - place) / part[:, None]
    after = filter_.updated(before, span.end_s, _weighted(assigned, seen, weight * part), span.long_s)
    return ReweightedEstimates(after, log_likelihood)


def fraction_log_likelihood(square: FloatArray, gate: float, track: IntArray, count: int) -> FloatArray:
    """Return the log likelihoods (count, fractions) of lines (m,) with squared distances, by track.

    Lines beyond the gate are outliers, and carry no information on how many lie within it.
    """
    ratio = 2.0 / gate**2 * np.exp(0.5 * np.minimum(square, gate**2))
    ratio = np.where(square > gate**2, 1.0, ratio)
    log, log_likelihood = np.log1p(FRACTIONS * (ratio[:, None] - 1.0)), np.zeros((count, len(FRACTIONS)))
    np.add.at(log_likelihood, track, log)
    return log_likelihood


def _weights(
    path: PredictedMeasurements, span: SliceSpan, assigned: GatedPairs, share: FloatArray
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the inlier probabilities (m,) of lines, their predicted directions (m, 2) and squared distances (m,)."""
    measurements = assigned.measurements(assigned.measured, np.zeros((len(assigned), 2, 2)))
    place, sharp, outlier = (
        predicted_directions(path, measurements),
        1.0 / np.square(assigned.sigma_rad),
        share[assigned.track],
    )
    square = np.sum(np.square(assigned.measured - place), axis=1) * sharp
    mine = (1.0 - outlier) * np.exp(-0.5 * square) * sharp / (2.0 * np.pi)
    others = outlier * sharp / (np.pi * span.gate**2)
    return np.maximum(mine / (mine + others), LEAST_WEIGHT), place, square


def _weighted(assigned: GatedPairs, seen: FloatArray, weight: FloatArray) -> AngleMeasurements:
    """Return pairs as measurements at directions (m, 2) with weights (m,)."""
    return assigned.measurements(seen, (np.sqrt(weight) / assigned.sigma_rad)[:, None, None] * np.eye(2))
