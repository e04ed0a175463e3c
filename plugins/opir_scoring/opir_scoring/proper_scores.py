"""Proper scores of stated distributions, as functions of arrays: energy score, log score, Brier
score, calibration.

A score is proper if its expected value is best for whoever states what they believe: neither a
bolder nor a vaguer statement gains (Gneiting and Raftery, J. Am. Stat. Assoc. 102 (2007), 359). All
of these are losses: less is better.
"""

from functools import cache
from itertools import pairwise
from typing import Any, Literal

import numpy as np

from opir_core.arrays import BoolArray, FloatArray, IntArray, RowArray
from opir_core.interfaces import TRACK_CONTAINMENTS
from opir_scoring.containments import nees, share
from opir_scoring.quantiles import chi_square_quantiles

#: Reported probabilities below this count as this: tracks files round, and a single zero would
#: outweigh all else.
LEAST_PROBABILITY = 1e-6

#: Edges of the bins of stated probabilities; the last ones are where warnings are given.
RELIABILITY_EDGES = (0.0, 0.1, 0.3, 0.5, 0.7, 0.9, 0.95, 0.99, 1.0)


def energy_scores(
    error: FloatArray,
    covariance: FloatArray,
    sigmas: FloatArray | None = None,
    components: slice = slice(None),
) -> FloatArray:
    """Return energy scores (n,) of estimates with errors (n, d) and covariances (n, d, d), in the
    unit of the error.

    The score is E|X - y| - E|X - X'| / 2 for the truth y and independent draws X and X' of the
    stated distribution (Gneiting and Raftery, equation 22 with exponent 1); in one dimension it is
    the CRPS. That of a normal distribution is an integral over one variable, good to 1e-7. Where
    the radii `sigmas` (n, 3) of the ellipsoids of `TRACK_CONTAINMENTS` are reported, the difference
    to the normal distribution is sampled at fixed points, to about 1 %. `components` are those
    that are scored. Without a covariance the estimate is a point: its score is the length of its
    error. nan where the error is unknown.
    """
    score = np.sqrt(np.sum(np.square(error[:, components]), axis=1))
    is_known = np.isfinite(error).all(axis=1) & np.isfinite(covariance).all(axis=(1, 2))
    score[is_known] = _normal_energies(
        error[is_known][:, components], covariance[is_known][:, components, components]
    )
    if sigmas is not None:
        has_radii = np.asarray(np.isfinite(sigmas).all(axis=1))
        for rows in _blocks(is_known & has_radii):
            score[rows] += _gain_of_radii(error[rows], covariance[rows], sigmas[rows], components)
    return score


def _blocks(is_marked: BoolArray) -> list[RowArray]:
    """Return the marked rows in blocks of at most 256, whose samples are 20 MB."""
    rows = np.flatnonzero(is_marked)
    return np.array_split(rows, max(1, -(-len(rows) // 256)))


def _normal_energies(error: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the energy scores (n,) of normal distributions."""
    variance, axes = np.linalg.eigh(covariance)
    variance = np.maximum(variance, 0.0)
    across = np.sum(axes * error[:, :, None], axis=1)
    spread = _mean_length(np.zeros_like(across), 2.0 * variance)
    return _mean_length(across, variance) - 0.5 * spread


def _mean_length(mean: FloatArray, variance: FloatArray) -> FloatArray:
    """Return E|X| (n,) of normal vectors with independent components, their means and variances (n,
    d).

    |x| is the integral of (1 - exp(-t x²)) t^(-3/2) over t > 0, over 2 √π; the mean of exp(-t x²)
    has a closed form. Over ln t the integrand falls as exp(-|ln t| / 2), to 1e-8 at the ends, and
    the trapezoid rule errs by exp(-π² / step).
    """
    step = 0.5
    reach = 37.0
    square = np.sum(mean * mean + variance, axis=1)
    scale = np.where(square > 0.0, square, 1.0)[:, None]
    t = np.exp(np.arange(-reach, reach + step, step)) / scale
    log_mean = _log_mean_decay(t, mean, variance)
    length = step * np.sum(-np.expm1(log_mean) / np.sqrt(t), axis=1) / (2.0 * np.sqrt(np.pi))
    return np.where(square > 0.0, length, 0.0)


def _log_mean_decay(t: FloatArray, mean: FloatArray, variance: FloatArray) -> FloatArray:
    """Return ln E exp(-t x²) (n, k) of normal vectors at t (n, k)."""
    spread = 1.0 + 2.0 * t[:, :, None] * variance[:, None, :]
    falling = t[:, :, None] * (mean * mean)[:, None, :] / spread
    return np.asarray(np.sum(-0.5 * np.log(spread) - falling, axis=2))


@cache
def _normal_points(size: int) -> FloatArray:
    """Return fixed points (k, d) of a normal distribution, each with its opposite."""
    half = np.random.default_rng(20260401).normal(size=(256, size))
    return np.concatenate([half, -half])


def _gain_of_radii(
    error: FloatArray, covariance: FloatArray, sigmas: FloatArray, components: slice
) -> FloatArray:
    """Return the excess (n,) of the energy scores over those of normal distributions, for
    ellipsoids of these radii.
    """
    variance, axes = np.linalg.eigh(covariance)
    root = (axes * np.sqrt(np.maximum(variance, 0.0))[:, None, :])[:, components]
    points = _normal_points(error.shape[1])
    normal = points @ root.mT
    factor = _stretch(np.sqrt(np.sum(points * points, axis=1)), sigmas, error.shape[1])
    stated = factor[:, :, None] * normal
    return _sampled(stated, error[:, components]) - _sampled(normal, error[:, components])


def _stretch(radius: FloatArray, sigmas: FloatArray, freedom: int) -> FloatArray:
    """Return factors (n, k) on points (k,) of a normal distribution, the inverse of those of
    `on_normal_scale`.
    """
    usual = np.append(0.0, np.sqrt(chi_square_quantiles(TRACK_CONTAINMENTS, freedom)))
    stated = np.concatenate([np.zeros((len(sigmas), 1)), sigmas], axis=1)
    step = np.minimum(np.searchsorted(usual, radius, side="right") - 1, len(usual) - 2)
    slope = np.diff(stated, axis=1) / np.diff(usual)
    within = stated[:, step] + (radius - usual[step]) * slope[:, step]
    return np.where(radius > usual[-1], (sigmas[:, -1] / usual[-1])[:, None], within / radius)


def _sampled(points: FloatArray, error: FloatArray) -> FloatArray:
    """Return the energy scores (n,) of points (n, k, d) about estimates with errors (n, d)."""

    def mean_distance(offsets: FloatArray) -> FloatArray:
        return np.sqrt(np.sum(np.square(offsets), axis=2)).mean(axis=1)

    # 16 differences of each point with other points.
    shifts = np.linspace(1, points.shape[1] // 2 - 1, 16).astype(int).tolist()
    spread = [mean_distance(points - np.roll(points, shift, axis=1)) for shift in shifts]
    # The truth lies at minus the error.
    return mean_distance(points + error[:, None, :]) - 0.5 * np.mean(spread, axis=0)


def weighted_energy(weight: FloatArray, error: FloatArray, distance: FloatArray) -> float:
    """Return the energy score of weighted points (k,), with distances `error` (k,) to the truth and
    `distance` (k, k) to each other.
    """
    weight = weight / weight.sum()
    return float(weight @ error - 0.5 * weight @ distance @ weight)


def normal_log_scores(error: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return -ln of the normal densities (n,) at errors (n, d) with covariances (n, d, d); less is
    better.

    Scores of states add metres and metres per second: only differences mean something. nan where a
    covariance is unknown, inf where it is not positive definite.
    """
    score = 0.5 * nees(error, covariance)
    rows = np.flatnonzero(np.isfinite(score))
    sigma = np.sqrt(np.diagonal(covariance[rows], axis1=1, axis2=2))
    # By correlations: the determinant of a state's covariance itself loses digits.
    volume = np.linalg.slogdet(covariance[rows] / (sigma[:, :, None] * sigma[:, None, :]))[1]
    norm = 0.5 * error.shape[1] * np.log(2.0 * np.pi)
    score[rows] += 0.5 * volume + np.sum(np.log(sigma), axis=1) + norm
    return score


def log_scores(probability: FloatArray, truth: IntArray) -> FloatArray:
    """Return -ln of the probability (n, h) of the truth (n,), at most -ln of `LEAST_PROBABILITY`."""
    return -np.log(np.maximum(probability[np.arange(len(truth)), truth], LEAST_PROBABILITY))


def brier_scores(probability: FloatArray, truth: IntArray) -> FloatArray:
    """Return the Brier scores (n,) of probabilities (n, h), between 0 and 2 (Brier, Mon. Weather
    Rev. 78 (1950), 1).
    """
    is_true = np.arange(probability.shape[1]) == truth[:, None]
    return np.sum(np.square(probability - is_true), axis=1)


def reliability(stated: FloatArray, is_true: BoolArray) -> list[dict[str, Any]]:
    """Return a row for each bin of stated probabilities (n,): the count, their mean, and the share
    that is true.
    """
    number = np.digitize(stated, RELIABILITY_EDGES[1:-1])
    rows = []
    for place, edges in enumerate(pairwise(RELIABILITY_EDGES)):
        in_bin = np.flatnonzero(number == place)
        row: dict[str, Any] = {"stated": list(edges), "samples": len(in_bin)}
        row["stated_mean"] = float(stated[in_bin].mean()) if len(in_bin) else np.nan
        rows.append({**row, **share(is_true[in_bin])})
    return rows


def share_above(values: FloatArray, references: FloatArray) -> float:
    """Return the share of pairs in which a value is above a reference, ties half: the area under an
    ROC curve.
    """
    if not len(values) or not len(references):
        return np.nan
    ordered = np.sort(references)
    sides: tuple[Literal["left", "right"], ...] = ("left", "right")
    below = sum(np.searchsorted(ordered, values, side=side).sum() for side in sides)
    return float(below) / (2.0 * len(values) * len(references))


def open_set_rate(confidence: FloatArray, is_right: BoolArray, unknown: FloatArray) -> float:
    """Return the area under the open-set classification rate (OSCR), between 0 and 1; nan without
    known or unknown.

    `confidence` (n,) is the greatest probability of a known class for samples of known classes,
    `is_right` (n,) whether it is their class, and `unknown` (m,) the same probability for samples
    of no known class. The curve is the share of known samples that are classified correctly and
    above a threshold, against the share of unknown samples above it (Dhamija, Günther and Boult,
    "Reducing Network Agnostophobia", NeurIPS 2018).
    """
    if not len(confidence) or not len(unknown):
        return np.nan
    if not is_right.any():
        return 0.0
    return float(is_right.mean()) * share_above(confidence[is_right], unknown)
