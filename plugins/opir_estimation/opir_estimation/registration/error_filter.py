"""One Kalman filter of all sensors' shared errors, for each of several scales of unstated errors.

Each angle of a sensor is a Gauss–Markov process about 0 with the variance b² + s²: b is its stated
bias, s a scale that all sensors share and no sensor states. It is 0 with a prior probability of
0.96, or one of a few values, evenly spaced in the logarithm; the misfits decide between them by
their marginal likelihood (type II: Good, 1965; MacKay, 1992). So sensors that are as stated pay
nothing, and a bias that is not stated is found. The offset of a clock is constant, with a stated
standard deviation. Where none is stated, one of the sensors may have a clock that is off: a
hypothesis for each sensor and scale, beside those of biases. A bias turns all lines of sight alike;
a clock moves each along the motion of its target.
"""

from typing import NamedTuple

import numpy as np
from attrs import evolve, frozen

from opir_core.arrays import FloatArray
from opir_estimation.directions import matvec
from opir_estimation.law_files import law_parameters
from opir_estimation.registration.misfits import Misfits
from opir_estimation.registration.shared_errors import ERRORS

LAW = law_parameters("opir_estimation.registration", "registration")

#: Scales of unstated offsets of one clock, s.
CLOCK_SCALES_S = np.geomspace(LAW.least_clock_s, LAW.largest_clock_s, LAW.clock_scales)

#: Scales of unstated biases, rad.
SCALES_RAD = np.append(0.0, np.geomspace(LAW.least_scale_rad, LAW.largest_scale_rad, LAW.scales))


class Moments(NamedTuple):
    """Mean (q,) and covariance (q, q) of all sensors' errors: rad, rad, s of each."""

    mean: FloatArray
    covariance: FloatArray


@frozen(eq=False)
class ErrorFilter:
    """Means (g, q) and covariances (g, q, q) of the errors for each scale, and the scales' log
    weights (g,).

    `prior` (g, q) are the variances of the errors before the first look, `correlation_s` is that of
    the angles. `comparisons` is the number of targets and slices whose misfits were used,
    `rejected` the running mean of the share that was rejected as outliers.
    """

    prior: FloatArray
    correlation_s: float
    mean: FloatArray
    covariance: FloatArray
    log_weight: FloatArray
    comparisons: int = 0
    rejected: float = 0.0

    @classmethod
    def of(
        cls, bias_sigma_rad: FloatArray, clock_sigma_s: float, correlation_s: float
    ) -> "ErrorFilter":
        """Return the filter of sensors with stated biases (s,) before the first look."""
        sensors = len(bias_sigma_rad)
        clock_variance = _clock_variances(0 if clock_sigma_s else sensors)
        biases = len(SCALES_RAD)
        prior = np.zeros((biases + len(clock_variance), sensors, ERRORS))
        prior[:, :, :2] = np.square(bias_sigma_rad)[:, None]
        prior[:biases, :, :2] += np.square(SCALES_RAD)[:, None, None]
        prior[:biases, :, 2] = clock_sigma_s**2
        if len(clock_variance):
            prior[biases:, :, 2] = clock_variance
        return cls.of_prior(prior.reshape(len(prior), -1), correlation_s)

    @classmethod
    def of_prior(cls, prior: FloatArray, correlation_s: float) -> "ErrorFilter":
        """Return the filter with prior variances (g, q) before the first look: of biases by scale,
        then of clocks, which count once their sensors are compared.
        """
        biases = len(SCALES_RAD) - 1
        log_weight = np.full(len(prior), -np.inf)
        log_weight[0] = np.log(1.0 - LAW.unstated)
        log_weight[1 : biases + 1] = np.log(LAW.unstated / biases)
        covariance = prior[:, :, None] * np.eye(prior.shape[1])
        return cls(prior, correlation_s, np.zeros_like(prior), covariance, log_weight)

    @property
    def weight(self) -> FloatArray:
        """The probabilities (g,) of the scales."""
        weight = np.exp(self.log_weight - self.log_weight.max())
        return weight / weight.sum()

    def predicted(self, step_s: float) -> "ErrorFilter":
        """Return the filter a step later."""
        if not self.comparisons:
            return self
        decay = np.ones(self.prior.shape[1])
        decay[np.arange(len(decay)) % ERRORS < 2] = np.exp(-step_s / self.correlation_s)
        covariance = self.covariance * (decay[:, None] * decay)
        axis = range(len(decay))
        covariance[:, axis, axis] += (1.0 - decay * decay) * self.prior
        return evolve(self, mean=self.mean * decay, covariance=covariance)

    def moments(self) -> Moments:
        """Return the moments over all scales."""
        weight = self.weight
        mean = weight @ self.mean
        deviation = self.mean - mean
        spread = deviation.T @ (weight[:, None] * deviation)
        return Moments(mean, np.tensordot(weight, self.covariance, 1) + spread)

    def mean_prior(self) -> FloatArray:
        """Return the prior variances (q,) of the errors, by the scales' present probabilities."""
        return self.weight @ self.prior

    def reported(self) -> Moments:
        """Return the moments that count: those of sensors as stated, if anything else is
        improbable.
        """
        is_stated = self.weight[0] >= 1.0 - LAW.neglected
        return Moments(self.mean[0], self.covariance[0]) if is_stated else self.moments()

    def updated(self, misfits: Misfits) -> "ErrorFilter":
        """Return the filter after the misfits of targets (k,), without implausible ones.

        It begins anew if it rejects most targets.
        """
        if not len(misfits.track):
            return self
        limit = LAW.gate * (1.0 + misfits.degrees)
        plausible = np.flatnonzero(distances(misfits, self.moments()) <= limit)
        count = len(plausible)
        share = 1.0 - count / len(misfits.track)
        rejected = self.rejected + LAW.forgetting * (share - self.rejected)
        if rejected > LAW.most_rejected:
            return ErrorFilter.of_prior(self.prior, self.correlation_s)
        updated = self
        if count:
            updated = self._informed(
                misfits.matrix[plausible].sum(axis=0), misfits.vector[plausible].sum(axis=0)
            )
        return evolve(updated, comparisons=self.comparisons + count, rejected=rejected)

    def _informed(self, matrix: FloatArray, vector: FloatArray) -> "ErrorFilter":
        """Return the filter after a matrix (q, q) and a vector (q,) of information."""
        gain = np.eye(len(vector)) + matrix @ self.covariance
        covariance = self._covariance_after(gain)
        turned = matvec(np.broadcast_to(matrix, covariance.shape), self.mean)
        residual = vector - turned
        step = matvec(covariance, residual)
        log = np.sum(self.mean * (vector - 0.5 * turned) + 0.5 * residual * step, axis=1)
        log_weight = self._open_weight(matrix) + (log - 0.5 * np.linalg.slogdet(gain)[1])
        return evolve(
            self,
            mean=self.mean + step,
            covariance=covariance,
            log_weight=log_weight - log_weight.max(),
        )

    def _open_weight(self, matrix: FloatArray) -> FloatArray:
        """Return the log weights (g,) with those of clocks that information (q, q) shows for the
        first time: until then they predict what sensors as stated do.
        """
        is_new = np.isneginf(self.log_weight)
        if not is_new.any():
            return self.log_weight
        shown = self.prior[:, ERRORS - 1 :: ERRORS] @ np.diagonal(matrix)[ERRORS - 1 :: ERRORS]
        odds = LAW.unstated_clock / len(CLOCK_SCALES_S) / (1.0 - LAW.unstated)
        weight = self.log_weight[0] + np.log(odds)
        return np.where(is_new & (shown > 0.0), weight, self.log_weight)

    def _covariance_after(self, gain: FloatArray) -> FloatArray:
        """Return the covariances (g, q, q) after information with gains (g, q, q)."""
        covariance = self.covariance @ np.linalg.inv(gain)
        covariance = 0.5 * (covariance + covariance.mT)
        # An assumed error stays so: rounding must not give it a variance.
        is_assumed = self.prior == 0.0
        covariance[is_assumed[:, :, None] | is_assumed[:, None]] = 0.0
        return covariance


def _clock_variances(sensors: int) -> FloatArray:
    """Return the prior variances (h, s) of clocks, one of which is off; none of a lone sensor, which
    is compared with no other.
    """
    if sensors < 2:
        return np.zeros((0, sensors))
    return (np.square(CLOCK_SCALES_S)[:, None, None] * np.eye(sensors)).reshape(-1, sensors)


def distances(misfits: Misfits, errors: Moments) -> FloatArray:
    """Return the squared misfits (k,) of targets, in variances, given moments of the errors."""
    vector = misfits.vector - misfits.matrix @ errors.mean
    square = misfits.square - (misfits.vector + vector) @ errors.mean
    inner = np.eye(len(errors.mean)) + misfits.matrix @ errors.covariance
    expected = errors.covariance @ np.linalg.solve(inner, vector[:, :, None])
    return square - np.sum(vector * expected[:, :, 0], axis=1)
