"""Outliers: weights of measurements by expectation maximisation.

A line belongs to its track, with the stated error, or is an outlier, uniform about the track within
a gate of that error alone: the track's own uncertainty says nothing about the density of outliers.
Lines are weighted by their inlier probability, which is recomputed with the updated track (EM:
Dempster, Laird and Rubin, J. Royal Statistical Society B 39(1), 1977). The information of the slice
is then the observed information (Louis, J. Royal Statistical Society B 44(2), 1982, 226), which is
less than the weights suggest. The outlier fraction of a track follows from the likelihood of all
its lines so far, over a grid of fractions: a running mean of weights would retain the first belief
(Titterington, J. Royal Statistical Society B 46(2), 1984, 257). Tracks without an improbable line
are not reweighted.
"""

from typing import NamedTuple

import numpy as np
from attrs import evolve, frozen
from opir_estimation import (
    AngleMeasurements,
    GatedPairs,
    ImmFilter,
    ModeEstimates,
    PredictedMeasurements,
    matvec,
)

from opir_core.arrays import FloatArray, IntArray


@frozen
class OutlierLaw:
    """Priors and thresholds of outliers."""

    #: Weight of a measurement that is most probably unassigned.
    least_weight: float = 1e-6

    #: Prior mean of the outlier fraction, and its weight in lines.
    prior_share: float = 0.01
    prior_lines: float = 3.0

    #: Squared distance exceeded with probability 10⁻³.
    improbable: float = 13.8

    #: The least outlier fraction that is considered.
    least_share: float = 0.02

    #: EM iterations at most, the change of weights at which they stop, and the least information of
    #: a slice relative to these.
    max_iterations: int = 4
    tolerance: float = 0.02
    least_information: float = 0.2


LAW = OutlierLaw()


def predicted_directions(path: PredictedMeasurements, pairs: GatedPairs) -> FloatArray:
    """Return the predicted directions (n, 2) of pairs, each in its tangent plane."""
    local = matvec(pairs.axes, path.positions(pairs.track, pairs.time_s) - pairs.origin_m)
    return local[:, :2] / local[:, 2:]


#: Outlier fractions, evenly spaced in log odds: 0, and from 0.01 to 0.9.
FRACTIONS = np.append(0.0, 1.0 / (1.0 + np.exp(-np.arange(-4.6, 2.3, 0.2))))

#: Below this fraction, tracks without an improbable line are not counted; so onsets of outliers are
#: seen.
FEW = 1e-3


class SliceSpan(NamedTuple):
    """End and length of a slice, s, and its gate, standard deviations."""

    end_s: float
    long_s: float
    gate: float


def _prior_log() -> FloatArray:
    """Return the log prior (fractions,) of the outlier fraction: a beta distribution.

    Its density per log odds is proportional to (1 - q)^`prior_lines` from the first fraction on;
    the rest is at 0.
    """
    lines = LAW.prior_lines
    prior = LAW.prior_share * lines * 0.2 * (1.0 - FRACTIONS[1:]) ** lines
    return np.log(np.append(1.0 - prior.sum(), prior))


_LOG_PRIOR = _prior_log()
_CLEAN = np.log1p(-FRACTIONS)


class OutlierFractions(NamedTuple):
    """Log likelihoods (n, fractions) of the outlier fraction of each track, at most 0."""

    log: FloatArray

    @property
    def share(self) -> FloatArray:
        """Return the posterior mean (n,)."""
        chance = np.exp(self.log + _LOG_PRIOR)
        return np.add.reduce(chance * FRACTIONS, axis=1) / np.add.reduce(chance, axis=1)

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
    suspicious = (assigned.distance > LAW.improbable) | (
        share.take(assigned.track) > LAW.least_share
    )
    tracks = assigned.track[suspicious]
    return np.unique(tracks) if len(tracks) else tracks


def clean_log_likelihood(
    assigned: GatedPairs, outlier: OutlierFractions, gate: float
) -> FloatArray:
    """Return the log likelihoods (n, fractions) of lines none of which is improbable.

    Each counts with the probability that an outlier in its place would have been improbable.
    """
    within = (
        LAW.improbable / gate**2 * np.exp(0.5 * assigned.log_volume) / np.square(assigned.sigma_rad)
    )
    return (
        np.bincount(assigned.track, np.maximum(1.0 - within, 0.0), outlier.log.shape[0])[:, None]
        * _CLEAN
    )


def reweighted(
    filter_: ImmFilter,
    prior: ModeEstimates,
    posterior: ModeEstimates,
    span: SliceSpan,
    assigned: GatedPairs,
    outlier: OutlierFractions,
) -> ReweightedEstimates:
    """Return estimates after a slice with its lines reweighted; the pairs `assigned` led from
    `prior` to `posterior`.
    """
    weight, _, square = _weights(filter_, posterior, span, assigned, outlier.share)
    log_likelihood = fraction_log_likelihood(square, span.gate, assigned.track, len(prior))
    doubted = np.zeros(len(prior), dtype=np.bool_)
    doubted[assigned.track[weight < 1.0 - LAW.tolerance]] = True
    rows = doubted.nonzero()[0]
    if not len(rows):
        return ReweightedEstimates(posterior, log_likelihood)
    pair_rows = doubted[assigned.track].nonzero()[0]
    pairs = assigned.take(pair_rows)
    pairs = evolve(pairs, track=(np.cumsum(doubted) - 1)[pairs.track])
    subset = _maximised(
        filter_,
        prior.take(rows),
        span,
        pairs,
        outlier.take(rows),
        weight[pair_rows],
        log_likelihood[rows],
    )
    log_likelihood[rows] = subset.outliers
    return ReweightedEstimates(posterior.put(rows, subset.estimates), log_likelihood)


def _maximised(
    filter_: ImmFilter,
    prior: ModeEstimates,
    span: SliceSpan,
    assigned: GatedPairs,
    outlier: OutlierFractions,
    weight: FloatArray,
    log_likelihood: FloatArray,
) -> ReweightedEstimates:
    """Return estimates after a slice by expectation maximisation from first weights (m,) of the
    lines.
    """
    for _ in range(LAW.max_iterations):
        previous = weight
        looks = _weighted(assigned, assigned.measured, weight)
        posterior = filter_.updated(prior, span.end_s, looks, span.long_s)
        share = outlier.after(log_likelihood).share
        weight, place, square = _weights(filter_, posterior, span, assigned, share)
        log_likelihood = fraction_log_likelihood(square, span.gate, assigned.track, len(prior))
        if np.max(np.abs(weight - previous)) < LAW.tolerance:
            break
    looks = _rescaled(assigned, place, weight, square, len(prior))
    posterior = filter_.updated(prior, span.end_s, looks, span.long_s)
    return ReweightedEstimates(posterior, log_likelihood)


def _rescaled(
    assigned: GatedPairs, place: FloatArray, weight: FloatArray, square: FloatArray, count: int
) -> AngleMeasurements:
    """Return measurements that move the estimates (count,) as far as those with weights (m,) do,
    with less information.

    `place` (m, 2) are the estimates' directions, `square` (m,) the squared distances.
    """
    share = _information_share(assigned.track, weight, square, count)
    measured = place + (assigned.measured - place) / share[:, None]
    return _weighted(assigned, measured, weight * share)


def _information_share(
    track: IntArray, weight: FloatArray, square: FloatArray, count: int
) -> FloatArray:
    """Return for each line (m,) the observed information of its track's lines, as a share of the
    sum of their weights.
    """
    total = np.bincount(track, weight, count)
    observed = np.bincount(track, weight * (1.0 - 0.5 * (1.0 - weight) * square), count)
    share = observed / np.maximum(total, LAW.least_weight)
    return np.maximum(share, LAW.least_information)[track]


def fraction_log_likelihood(
    square: FloatArray, gate: float, track: IntArray, count: int
) -> FloatArray:
    """Return the log likelihoods (count, fractions) of lines (m,) with squared distances, by track.

    Lines beyond the gate are outliers, and carry no information on how many lie within it.
    """
    ratio = 2.0 / gate**2 * np.exp(0.5 * np.minimum(square, gate**2))
    ratio = np.where(square > gate**2, 1.0, ratio)
    log = np.log1p(FRACTIONS * (ratio[:, None] - 1.0))
    log_likelihood = np.zeros((count, len(FRACTIONS)))
    np.add.at(log_likelihood, track, log)
    return log_likelihood


def _weights(
    filter_: ImmFilter,
    estimates: ModeEstimates,
    span: SliceSpan,
    assigned: GatedPairs,
    share: FloatArray,
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the inlier probabilities (m,) of lines, their predicted directions (m, 2) and squared
    distances (m,).
    """
    path = filter_.predicted_measurements(estimates, span.end_s)
    place = predicted_directions(path, assigned)
    sharp = 1.0 / np.square(assigned.sigma_rad)
    outlier = share[assigned.track]
    square = np.sum(np.square(assigned.measured - place), axis=1) * sharp
    inlier_density = (1.0 - outlier) * np.exp(-0.5 * square) * sharp / (2.0 * np.pi)
    outlier_density = outlier * sharp / (np.pi * span.gate**2)
    weight = inlier_density / (inlier_density + outlier_density)
    return np.maximum(weight, LAW.least_weight), place, square


def _weighted(
    assigned: GatedPairs, directions: FloatArray, weight: FloatArray
) -> AngleMeasurements:
    """Return pairs as measurements at directions (m, 2) with weights (m,)."""
    return assigned.measurements(
        directions, (np.sqrt(weight) / assigned.sigma_rad)[:, None, None] * np.eye(2)
    )
