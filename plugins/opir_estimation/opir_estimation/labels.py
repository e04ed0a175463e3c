"""Lines of sight of unknown labels: what those of a slice say of tracks, with the labels summed out.

A slice holds several scans of each sensor. Where tracks share lines, the probability of each label
depends on where the tracks are, and the reverse. Both are found together: a track's lines, weighted
by their probabilities, move it within the slice; the probabilities of a scan follow from where all
other lines of the slice leave the track (expectation propagation: Minka, UAI 2001; with one scan it
is JPDA: Fortmann, Bar-Shalom and Scheffe, IEEE J. Oceanic Engineering 8(3), 1983), one to one by
belief propagation (Williams and Lau, IEEE Trans. Aerospace and Electronic Systems 50, 2014).

The information of a look is that of the likelihood with labels summed out: Σ β / σ² less the spread
of the lines over σ⁴ (Louis, J. Royal Statistical Society B 44, 1982). A line that one track loses to
another one moves both: what the lines say of their difference is less by twice the spread, and so
much is taken off each.
"""

from typing import NamedTuple

import numpy as np
from attrs import evolve

from opir_core.arrays import FloatArray, IndexArray, IntArray
from opir_estimation.assignment import belief_propagation, group_sums, ranks
from opir_estimation.directions import dot, matvec
from opir_estimation.filter.estimates import PredictedMeasurements
from opir_estimation.gating import GatedPairs, squared_distances
from opir_estimation.law_files import law_parameters
from opir_estimation.lines_of_sight import emission_s
from opir_estimation.triangulation import FAR_M

LAW = law_parameters("opir_estimation", "labels")

#: Position, velocity and acceleration, of which a path bends within a slice.
_SIZE = 9


class SharedLooks(NamedTuple):
    """Gated pairs (k,), the look of each: a track in a scan, and the log odds of a detection over
    a miss and a false alarm in 2π sr; `sensor` (k,) is that of the lines.
    """

    pairs: GatedPairs
    look: IntArray
    log_odds: FloatArray
    sensor: IndexArray
    newcomers: float = LAW.newcomers


class LabelPosterior(NamedTuple):
    """Probabilities (k,) of pairs, their log likelihood ratios (k,) to a miss and a false alarm, and
    residuals (k, 2), rad, about where the lines of the slice leave the tracks.
    """

    probability: FloatArray
    log_ratio: FloatArray
    residual: FloatArray


def label_posterior(
    looks: SharedLooks, path: PredictedMeasurements, *, light_time: bool
) -> LabelPosterior:
    """Return the probabilities of the pairs of tracks with predicted paths."""
    pairs = looks.pairs
    motion = _PathDeviations.of(pairs, path, light_time=light_time)
    variance = np.square(pairs.sigma_rad)
    mean = np.zeros(motion.prior.shape[:2])
    covariance = motion.prior
    residual = pairs.measured
    pull = np.zeros((len(residual), 3))
    for _ in range(LAW.rounds):
        spread = motion.slope @ covariance[motion.track] @ motion.slope.mT
        cavity, offset = _without_look(spread, pull)
        log_ratio, probability = _probabilities(looks, residual + offset, cavity)
        weight = probability / variance
        before = mean
        mean, covariance = motion.updated(weight, pairs.measured)
        residual = pairs.measured - matvec(motion.slope, mean[motion.track])
        pull = _look_sums(looks.look, weight, residual)[looks.look]
        if np.abs(mean[:, :3] - before[:, :3]).max() < LAW.settled_m:
            break
    return LabelPosterior(probability, log_ratio, residual)


def place_probabilities(
    looks: SharedLooks, path: PredictedMeasurements, *, light_time: bool
) -> FloatArray:
    """Return the probabilities (k,) of the pairs by predicted paths alone, whatever the lines of the
    slice say of them.
    """
    motion = _PathDeviations.of(looks.pairs, path, light_time=light_time)
    spread = motion.slope @ motion.prior[motion.track] @ motion.slope.mT
    return _probabilities(looks, looks.pairs.measured, spread)[1]


class _PathDeviations(NamedTuple):
    """How pairs (k,) measure what tracks (n,) deviate from their predicted paths in position,
    velocity and acceleration: rows of `track` (k,), Jacobians (k, 2, 9), and covariances (n, 9, 9).
    """

    track: IntArray
    slope: FloatArray
    prior: FloatArray

    @classmethod
    def of(
        cls, pairs: GatedPairs, path: PredictedMeasurements, *, light_time: bool
    ) -> "_PathDeviations":
        """Return that of pairs with predicted paths."""
        emitted_s = emission_s(pairs.time_s, FAR_M, light_time)
        weight = path.weights(emitted_s)
        line = path.positions_with(pairs.track, weight) - pairs.origin_m
        axes = pairs.axes[:, :2] / np.sqrt(dot(line, line))[:, None, None]
        slope = weight[:, None, :3, None] * axes[:, :, None, :]
        tracks, track = np.unique(pairs.track, return_inverse=True)
        root = path.root[tracks, :_SIZE]
        prior = root @ root.mT
        return cls(track, slope.reshape(len(track), 2, _SIZE), prior)

    def updated(self, weight: FloatArray, measured: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return means (n, 9) and covariances (n, 9, 9) after innovations (k, 2) with weights (k,),
        1/rad².
        """
        back = weight[:, None, None] * self.slope.mT
        information = group_sums(self.track, (back @ self.slope).reshape(len(back), -1))
        gram = information.reshape(self.prior.shape)
        whole = np.eye(_SIZE) + self.prior @ gram
        covariance = np.linalg.solve(whole, self.prior).astype(np.float64, copy=False)
        return matvec(covariance, group_sums(self.track, matvec(back, measured))), covariance


def _look_sums(look: IntArray, weight: FloatArray, residual: FloatArray) -> FloatArray:
    """Return the sums (m, 3) of looks: weighted residuals, 1/rad, and weights, 1/rad²."""
    return group_sums(look, np.column_stack([weight[:, None] * residual, weight]))


def _without_look(spread: FloatArray, pull: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return covariances (k, 2, 2) of predicted directions without the lines of the look, and how
    far (k, 2) the prediction is from the one with them; `pull` (k, 3) are the look's `_look_sums`.
    """
    remaining = np.eye(2) - pull[:, 2, None, None] * spread
    turned = remaining.mT
    covariance = np.linalg.solve(turned, spread).astype(np.float64, copy=False)
    return covariance, matvec(covariance, np.ascontiguousarray(pull[:, :2]))


def _probabilities(
    looks: SharedLooks, residual: FloatArray, covariance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return log likelihood ratios (k,) and probabilities (k,) of pairs with residuals (k, 2) about
    predictions with covariances (k, 2, 2).
    """
    variance = np.square(looks.pairs.sigma_rad)
    errors = covariance + variance[:, None, None] * np.eye(2)
    distance, determinant = squared_distances(residual, errors)
    log_ratio = looks.log_odds - 0.5 * (distance + np.log(determinant))
    density = variance / np.sqrt(determinant) * np.exp(-0.5 * distance)
    ratio = np.minimum(np.exp(np.minimum(log_ratio, 300.0)), density / looks.newcomers)
    return log_ratio, belief_propagation(looks.look, looks.pairs.line, ratio, LAW.sweeps)


def equivalent_pairs(looks: SharedLooks, posterior: LabelPosterior) -> GatedPairs:
    """Return one pair for each look that is probably of its track: it moves the track as the lines
    of the look do, and leaves the covariance that they leave.

    The looks of a track and sensor share their information by their probabilities.
    """
    pairs = looks.pairs
    look = looks.look
    probability = posterior.probability
    residual = posterior.residual
    variance = np.square(pairs.sigma_rad)
    likeliest = np.lexsort((probability, look))[np.cumsum(np.bincount(look)) - 1]
    pull = _look_sums(look, probability / variance, residual)
    square = probability * dot(residual, residual) / np.square(variance)
    spread = 0.5 * (np.bincount(look, square) - dot(pull[:, :2], pull[:, :2]))
    spread *= 1.0 + _exchanged(looks, probability)
    total = np.bincount(look, probability)
    sensors = int(looks.sensor.max(initial=0)) + 1
    group = ranks((pairs.track * sensors + looks.sensor)[likeliest])
    labelled = np.bincount(group, pull[:, 2])
    information = np.bincount(group, pull[:, 2] - spread)
    share = np.maximum(information, LAW.least_information * labelled)[group]
    rows = np.flatnonzero(total > LAW.least_probability)
    weight = (share * pull[:, 2])[rows] / labelled[group[rows]]
    offset = pull[rows, :2] / weight[:, None]
    predicted = (pairs.measured - residual)[likeliest[rows]]
    return evolve(
        pairs.take(likeliest[rows]),
        measured=predicted + offset,
        sigma_rad=1.0 / np.sqrt(weight),
    )


def _exchanged(looks: SharedLooks, probability: FloatArray) -> FloatArray:
    """Return the share (m,) of the doubt in each look that is between tracks: 0 where a line is the
    track's or nobody's, 1 where it is the track's or another one's.
    """
    line = looks.pairs.line
    taken = np.bincount(line, probability)[line] - probability
    doubt = np.bincount(looks.look, probability * (1.0 - probability))
    between = np.bincount(looks.look, probability * np.minimum(taken, 1.0 - probability))
    return np.divide(between, doubt, out=np.zeros(len(doubt)), where=doubt > 0.0)
