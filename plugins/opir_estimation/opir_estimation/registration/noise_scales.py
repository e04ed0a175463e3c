"""The scale of each sensor's noise: a distribution over a grid of scales, from looks at any rate.

**Many looks a slice.** Three and more looks of one sensor on one track within a slice scatter about
a straight line by the noise alone, whatever track and bias are: their squares are chi-squared.

**Few looks.** The innovation of a look is normal with the variance of prediction and noise together.
A filter that assumes another noise has other covariances too: the variance of the prediction under
another scale is that of the alpha-beta filter in steady state (Kalata, IEEE Transactions on
Aerospace and Electronic Systems 20(2), 1984, 174), whose tracking index is the target's own. As the
prediction's covariance is not known to be right, an innovation counts with the share of noise in
its variance. Of the looks some are outliers.

A sensor is probably as stated; else its scale is log-Laplacian. Evidence is forgotten with further
looks, and a sensor changes now and then to a scale of the prior.
"""

from functools import cached_property

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray, IntArray
from opir_estimation.gating import GatedPairs
from opir_estimation.law_files import law_parameters

LAW = law_parameters("opir_estimation.registration", "registration")

#: Natural logarithms (g,) of scales, evenly spaced; one is 0.
LOG_SCALES = LAW.noise_step * np.arange(
    np.rint(np.log(LAW.least_noise) / LAW.noise_step),
    np.rint(np.log(LAW.largest_noise) / LAW.noise_step) + 1.0,
)
_SQUARES = np.exp(2.0 * LOG_SCALES)
_AS_STATED = np.abs(LOG_SCALES) <= LAW.noise_tolerance


def _prior() -> FloatArray:
    """Return the prior probabilities (g,) of the scales."""
    stated = np.exp(-0.5 * np.square(LOG_SCALES / LAW.noise_sigma))
    unstated = np.exp(-np.abs(LOG_SCALES))
    return (1.0 - LAW.unstated) * stated / stated.sum() + LAW.unstated * unstated / unstated.sum()


_PRIOR = _prior()
_LOG_PRIOR = np.log(_PRIOR)


@frozen(eq=False)
class NoiseScales:
    """The probabilities (s, g) of the scales of each sensor's noise, and the `degrees` (s,) of
    freedom that they are from.
    """

    probability: FloatArray
    degrees: FloatArray

    @classmethod
    def of(cls, sensors: int) -> "NoiseScales":
        """Return those before the first look."""
        return cls(np.tile(_PRIOR, (sensors, 1)), np.zeros(sensors))

    def at(self, step_s: float) -> "NoiseScales":
        """Return those a step later, in which a sensor may have changed."""
        lasting = np.exp(-step_s / LAW.noise_change_s)
        changed = lasting * self.probability + (1.0 - lasting) * _PRIOR
        return NoiseScales(changed, lasting * self.degrees)

    def after(
        self, sensor: IntArray, log_likelihood: FloatArray, degrees: FloatArray
    ) -> "NoiseScales":
        """Return those after looks (m,) by sensor with log likelihoods (m, g) of the scales and
        degrees of freedom (m,).
        """
        count = len(self.degrees)
        gained = np.bincount(sensor, degrees, count)
        log = np.zeros_like(self.probability)
        np.add.at(log, sensor, log_likelihood)
        lasting = np.exp(-gained / LAW.noise_degrees)
        log += _LOG_PRIOR + lasting[:, None] * (np.log(self.probability) - _LOG_PRIOR)
        chance = np.exp(log - log.max(axis=1, keepdims=True)) + np.finfo(np.float64).tiny
        chance /= chance.sum(axis=1, keepdims=True)
        return NoiseScales(chance, lasting * self.degrees + gained)

    @cached_property
    def posterior(self) -> FloatArray:
        """The probabilities (s, g) of the scales if a sensor may have the scale of another one, as
        from the same table.
        """
        weight = np.where(np.eye(len(self.degrees)) > 0.0, 0.0, self.degrees)
        weight *= LAW.noise_shared / (weight.sum(axis=1, keepdims=True) + LAW.shown_degrees)
        prior = weight @ self.probability + (1.0 - weight.sum(axis=1))[:, None] * _PRIOR
        chance = self.probability / _PRIOR * prior
        posterior: FloatArray = chance / chance.sum(axis=1, keepdims=True)
        return posterior

    @property
    def log_mean(self) -> FloatArray:
        """The mean (s,) of the logarithm of the scale."""
        return self.posterior @ LOG_SCALES

    @property
    def log_sigma(self) -> FloatArray:
        """The standard deviation (s,) of the logarithm of the scale."""
        square = self.posterior @ np.square(LOG_SCALES) - np.square(self.log_mean)
        return np.sqrt(np.maximum(square, 0.0))

    @property
    def believed(self) -> FloatArray:
        """The scale (s,) that is assumed: 1 where the noise is probably as stated, else the root
        mean square of a log-normal distribution, or, of less noise than stated, the upper end of its
        95 % interval.
        """
        is_stated = self.posterior[:, _AS_STATED].sum(axis=1) >= 1.0 - LAW.neglected
        upper = np.minimum(np.exp(self.log_mean + 2.0 * self.log_sigma), 1.0)
        mean = np.exp(self.log_mean + np.square(self.log_sigma))
        return np.where(is_stated, 1.0, np.maximum(mean, upper))


def scatter_log_likelihood(
    square: FloatArray, degrees: FloatArray, least: FloatArray
) -> FloatArray:
    """Return the log likelihoods (m, g) of the scales from sums (m,) of squares in stated variances,
    with degrees of freedom (m,); `least` (m,) are the least variances of looks, in stated ones.
    """
    variance = np.maximum(_SQUARES, least[:, None])
    return -0.5 * (degrees[:, None] * np.log(variance) + square[:, None] / variance)


def innovation_log_likelihood(
    pairs: GatedPairs, stated: FloatArray, assumed: FloatArray, least: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the log likelihoods (m, g) of the scales from innovations of pairs (m,), and their
    degrees of freedom (m,).

    `stated` (m,) are the stated variances of the looks, `assumed` (m,) those within the covariances
    of the innovations, and `least` (m,) the least ones, rad².
    """
    trace = np.maximum(pairs.trace - 2.0 * assumed, 0.0)
    noise = np.maximum(stated[:, None] * _SQUARES, least[:, None])
    reach = LAW.outlier_sigmas**2 * (np.minimum(stated, assumed) + 0.5 * trace)
    outlier = 2.0 * LAW.noise_outliers / reach
    density = (1.0 - LAW.noise_outliers) * _densities(pairs, assumed, trace, noise)
    look = LAW.extrapolated * np.maximum(stated, assumed)
    weight = 1.0 / (1.0 + np.square(0.5 * trace / look))
    return weight[:, None] * np.log(density + outlier[:, None]), 2.0 * weight


def _densities(
    pairs: GatedPairs, assumed: FloatArray, trace: FloatArray, noise: FloatArray
) -> FloatArray:
    """Return the densities (m, g) of innovations under noise (m, g), times 2π; predictions have
    traces (m,) under the assumed noise (m,).
    """
    area = np.exp(pairs.log_volume)
    square = np.sum(pairs.measured * pairs.measured, axis=1)
    volume = np.maximum(area - assumed * pairs.trace + assumed * assumed, 0.0)
    adjoint = np.maximum(pairs.distance * area - assumed * square, 0.0)
    share = prediction_shares(0.5 * trace, assumed, noise)
    determinant = share * (share * volume[:, None] + noise * trace[:, None]) + noise * noise
    distance = (share * adjoint[:, None] + noise * square[:, None]) / determinant
    density: FloatArray = np.exp(-0.5 * distance) / np.sqrt(determinant)
    return density


def prediction_shares(variance: FloatArray, assumed: FloatArray, noise: FloatArray) -> FloatArray:
    """Return the variances (m, g) of predictions under other noise (m, g), over those (m,) under
    the assumed one.
    """
    gain = np.sqrt(1.0 + variance / assumed)
    index = 0.5 * np.square(gain - 1.0) / gain * np.sqrt(assumed)
    ratio = index[:, None] / np.sqrt(noise)
    other_gain = 1.0 + ratio + np.sqrt(ratio * (2.0 + ratio))
    other = noise * (np.square(other_gain) - 1.0)
    smallest = np.finfo(np.float64).tiny
    return other / np.maximum(variance, smallest)[:, None]
