"""One Kalman filter of all sensors' shared errors, for each of several scales of unstated biases.

Each angle of a sensor is a Gauss–Markov process about 0 with the variance b² + s²: b is its stated
bias, s a scale that all sensors share and no sensor states. It is 0 with a prior probability of
0.96, or one of a few values, evenly spaced in the logarithm; the misfits decide between them by
their marginal likelihood (type II: Good, 1965; MacKay, 1992). So sensors that are as stated pay
nothing, and a bias that is not stated is found. The offset of a clock is constant, with a stated
standard deviation; 0 if it is assumed to be right.
"""

from typing import NamedTuple

import numpy as np
from attrs import evolve, frozen

from opir_core.arrays import FloatArray
from opir_core.estimation import matvec
from opir_trackers.registration.misfits import Misfits
from opir_trackers.registration.shared_errors import ERRORS

#: Scales of unstated biases, rad: from half of a look's error of the finest sensors to what moves a
#: target by 10 km from geostationary height; and the prior probability of all but the first
#: together: one constellation in twenty-five is not as stated. Notional.
SCALES_RAD = np.append(0.0, np.geomspace(10e-6, 320e-6, 6))
_UNSTATED = 0.04

#: That sensors are not as stated counts if it is more probable than this, as what 95 % regions
#: leave out.
_NEGLECTED = 0.05

#: Squared misfit of a target, in variances for each degree of freedom and one more, above which it
#: is not believed.
_GATE = 13.8


class Moments(NamedTuple):
    """Mean (q,) and covariance (q, q) of all sensors' errors: rad, rad, s of each."""

    mean: FloatArray
    covariance: FloatArray


@frozen(eq=False)
class ErrorFilter:
    """Means (g, q) and covariances (g, q, q) of the errors for each scale, and the scales' log
    weights (g,).

    `prior` (g, q) are the variances of the errors where nothing is known, `correlation_s` is that
    of the angles. `used` is the number of targets and slices whose misfits were used, `refused` the
    running mean of the share that was rejected as outliers.
    """

    prior: FloatArray
    correlation_s: float
    mean: FloatArray
    covariance: FloatArray
    log_weight: FloatArray
    used: int = 0
    refused: float = 0.0

    @classmethod
    def of(
        cls, bias_sigma_rad: FloatArray, clock_sigma_s: float, correlation_s: float
    ) -> "ErrorFilter":
        """Return the filter of sensors with stated biases (s,) before the first look."""
        scales = len(SCALES_RAD)
        prior = np.empty((scales, len(bias_sigma_rad), ERRORS))
        prior[:, :, :2] = (np.square(bias_sigma_rad) + np.square(SCALES_RAD)[:, None])[:, :, None]
        prior[:, :, 2] = clock_sigma_s**2
        return cls.of_prior(prior.reshape(scales, -1), correlation_s)

    @classmethod
    def of_prior(cls, prior: FloatArray, correlation_s: float) -> "ErrorFilter":
        """Return the filter with prior variances (g, q) before the first look."""
        scales = len(SCALES_RAD)
        weight = np.append(1.0 - _UNSTATED, np.full(scales - 1, _UNSTATED / (scales - 1)))
        every = np.zeros((scales, prior.shape[1], prior.shape[1]))
        every[:, range(prior.shape[1]), range(prior.shape[1])] = prior
        return cls(prior, correlation_s, np.zeros_like(prior), every, np.log(weight))

    @property
    def weight(self) -> FloatArray:
        """The probabilities (g,) of the scales."""
        weight = np.exp(self.log_weight - self.log_weight.max())
        return np.asarray(weight / weight.sum())

    def predicted(self, step_s: float) -> "ErrorFilter":
        """Return the filter a step later."""
        if not self.used:
            return self
        kept = np.ones(self.prior.shape[1])
        kept[np.arange(len(kept)) % ERRORS < 2] = np.exp(-step_s / self.correlation_s)
        covariance = self.covariance * (kept[:, None] * kept)
        axis = range(len(kept))
        covariance[:, axis, axis] += (1.0 - kept * kept) * self.prior
        return evolve(self, mean=self.mean * kept, covariance=covariance)

    def moments(self) -> Moments:
        """Return the moments over all scales."""
        weight = self.weight
        mean = weight @ self.mean
        apart = self.mean - mean
        covariance = np.tensordot(weight, self.covariance, 1) + apart.T @ (weight[:, None] * apart)
        return Moments(mean, covariance)

    def mean_prior(self) -> FloatArray:
        """Return the prior variances (q,) of the errors, by the scales' present probabilities."""
        return np.asarray(self.weight @ self.prior)

    def reported(self) -> Moments:
        """Return the moments that count: those of sensors as stated, if anything else is
        improbable.
        """
        return (
            self.moments()
            if self.weight[0] < 1.0 - _NEGLECTED
            else Moments(self.mean[0], self.covariance[0])
        )

    def updated(self, misfits: Misfits) -> "ErrorFilter":
        """Return the filter after the misfits of targets (k,), those left out that are not
        believed.
        """
        if not len(misfits.track):
            return self
        good = np.flatnonzero(distances(misfits, self.moments()) <= _GATE * (1.0 + misfits.degrees))
        share = len(good) / len(misfits.track)
        after = (
            self
            if not len(good)
            else self._taken(misfits.matrix[good].sum(axis=0), misfits.vector[good].sum(axis=0))
        )
        refused = self.refused + _FORGETTING * (1.0 - share - self.refused)
        if refused > _MOST_REFUSED:
            return self._anew()
        return evolve(after, used=self.used + len(good), refused=refused)

    def _anew(self) -> "ErrorFilter":
        """Return the filter before the first look: most targets say that what it believes is
        wrong.
        """
        return ErrorFilter.of_prior(self.prior, self.correlation_s)

    def _taken(self, matrix: FloatArray, vector: FloatArray) -> "ErrorFilter":
        """Return the filter after a matrix (q, q) and a vector (q,) of information."""
        size = len(vector)
        gain = np.eye(size) + matrix @ self.covariance
        covariance = self.covariance @ np.linalg.inv(gain)
        covariance = 0.5 * (covariance + covariance.transpose(0, 2, 1))
        # What is assumed stays so: rounding must not give it a variance.
        covariance[np.broadcast_to((self.prior == 0.0)[:, :, None], covariance.shape)] = 0.0
        covariance[np.broadcast_to((self.prior == 0.0)[:, None], covariance.shape)] = 0.0
        turned = matvec(np.broadcast_to(matrix, covariance.shape), self.mean)
        off = vector - turned
        step = matvec(covariance, off)
        log = np.sum(self.mean * (vector - 0.5 * turned) + 0.5 * off * step, axis=1)
        log -= 0.5 * np.linalg.slogdet(gain)[1]
        log_weight = self.log_weight + log
        return evolve(
            self,
            mean=self.mean + step,
            covariance=covariance,
            log_weight=log_weight - log_weight.max(),
        )


#: Share of the last slice in the running mean of what is not believed, and the mean at which all
#: begins anew.
_FORGETTING = 0.1
_MOST_REFUSED = 0.5


def distances(misfits: Misfits, known: Moments) -> FloatArray:
    """Return the squared misfits (k,) of targets, in variances, given what is known of the
    errors.
    """
    vector = misfits.vector - misfits.matrix @ known.mean
    square = misfits.square - (misfits.vector + vector) @ known.mean
    inner = np.eye(len(known.mean)) + misfits.matrix @ known.covariance
    expected = known.covariance @ np.linalg.solve(inner, vector[:, :, None])
    return np.asarray(square - np.sum(vector * expected[:, :, 0], axis=1))
