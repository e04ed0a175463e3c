"""The record that forecasts are made from: what any tracker knows of its tracks at a time."""

from typing import Self

import numpy as np
from attrs import evolve, frozen
from opir_estimation import COAST, air_velocity, dot, information_root, law_parameters

from opir_core.arrays import BoolArray, FloatArray, IntArray
from opir_core.interfaces import Columns

LAW = law_parameters("opir_forecast", "estimates")

#: States of a burn: inertial position, velocity and specific force, and its relative growth.
BURN_STATES = 10

#: Kinds of a burn: steady, with a stage that begins at present, and with thrust in any direction.
BURN_KINDS = 3


@frozen(eq=False, repr=False)
class BoostEstimates(Columns):
    """Estimates of tracks (n,) at a time, by any tracker.

    `track` (n,) are the track numbers, ascending; `is_launch` (n,) says which tracks are forecast.
    `burning` (n,) is the probability of a present burn. If the target burns, it is of a kind (steady,
    staging, free) with the probabilities `burn_share` (n, 3), and has the mean `burn_mean`
    (n, 3, 10): inertial position, m, velocity, m/s, specific force, m/s², and its relative growth,
    1/s; if it coasts, the mean `coast_mean` (n, 6). `burn_root` (n, 3, 10, 10) and `coast_root`
    (n, 6, 6) are upper triangular information roots R: RᵀR is the inverse of the covariance.
    `silent_s` (n,) is the time since the last detection, `pause_s` (n,) the mean time between
    detections while the target burned. `launch` (n, 3) is latitude, rad, longitude, rad, and time, s,
    nan where unknown, with the covariance `launch_covariance` (n, 3, 3) in m and s, east, north and
    time. `log_likelihood` (n, hypotheses) is that of sensors' reports, zeros where they say nothing.
    """

    track: IntArray
    is_launch: BoolArray
    burning: FloatArray
    burn_share: FloatArray
    burn_mean: FloatArray
    burn_root: FloatArray
    coast_mean: FloatArray
    coast_root: FloatArray
    silent_s: FloatArray
    pause_s: FloatArray
    launch: FloatArray
    launch_covariance: FloatArray
    log_likelihood: FloatArray

    @classmethod
    def of_moments(
        cls,
        track: IntArray,
        mean: FloatArray,
        covariance: FloatArray,
        burning: FloatArray,
        silent_s: FloatArray,
        pause_s: FloatArray,
        hypotheses: int,
    ) -> Self:
        """Return the record of a tracker without modes, for a number of hypotheses: launches, at
        unknown places.

        `mean` (n, d) and `covariance` (n, d, d), d from 6 to 10, are of the first d states of a burn,
        inertial; the others have their prior. Raises `numpy.linalg.LinAlgError` for a covariance that
        is not positive definite.
        """
        count, size = mean.shape
        states = _with_prior(mean)
        root = np.zeros((count, BURN_STATES, BURN_STATES))
        root[:, :size, :size] = _information_roots(covariance)
        unknown = range(size, BURN_STATES)
        sigmas = np.array([LAW.force_sigma_m_s2] * 3 + [LAW.growth_sigma_per_s])
        root[:, unknown, unknown] = 1.0 / sigmas[size - COAST :]
        share = np.zeros((count, BURN_KINDS))
        share[:, 0] = 1.0
        return cls(
            track,
            np.ones(count, dtype=np.bool_),
            burning,
            share,
            np.repeat(states[:, None], BURN_KINDS, axis=1),
            np.repeat(root[:, None], BURN_KINDS, axis=1),
            mean[:, :COAST],
            _information_roots(covariance[:, :COAST, :COAST]),
            silent_s,
            pause_s,
            np.full((count, 3), np.nan),
            np.full((count, 3, 3), np.nan),
            np.zeros((count, hypotheses)),
        )

    def with_coasts(self, mean: FloatArray, covariance: FloatArray) -> Self:
        """Return the record with other moments, (n, 6) and (n, 6, 6), of targets that coast."""
        return evolve(self, coast_mean=mean, coast_root=_information_roots(covariance))


def _information_roots(covariance: FloatArray) -> FloatArray:
    """Return the information roots (n, d, d) of covariances."""
    side = np.asarray(np.linalg.cholesky(covariance), dtype=np.float64)
    return information_root(side)


def _with_prior(mean: FloatArray) -> FloatArray:
    """Return states (n, 10) of means (n, d): the force along the velocity and its growth have their
    prior means where they are not among them.
    """
    count, size = mean.shape
    velocity = air_velocity(mean)
    speed = np.sqrt(dot(velocity, velocity))[:, None]
    states = np.empty((count, BURN_STATES))
    states[:, 6:9] = LAW.force_m_s2 * velocity / np.maximum(speed, 1.0)
    states[:, 9] = LAW.growth_per_s
    states[:, :size] = mean
    return states


def burning_probability(
    silent_s: FloatArray, pause_s: FloatArray, detection_probability: FloatArray
) -> FloatArray:
    """Return the probabilities (n,) that targets of a tracker without modes still burn.

    Burns end at the rate 1/T of an exponential law of their length, and a burnt-out target is not
    detected; a burning one misses each of the looks, one every `pause_s` (n,) times P_d, with 1 - P_d.
    Of a target silent for k looks the odds of a burn that has ended are the sum over looks j = 1 … k
    of h (1 - P_d)^(j - 1 - k), where h = look interval / T: it ended before one of them.
    """
    look_s = pause_s * detection_probability
    missed = np.floor(silent_s / np.maximum(look_s, 1e-3))
    log_miss = np.log1p(-np.minimum(detection_probability, 0.999))
    log_odds = np.minimum(-missed * log_miss, 50.0)
    growth = -np.expm1(log_miss)
    ended = look_s / LAW.burn_s * np.expm1(log_odds) / growth
    return 1.0 / (1.0 + ended)


def launch_probability(velocity_m_s: FloatArray, covariance: FloatArray) -> FloatArray:
    """Return the probabilities (n,) that sources are launches, and do not stand on the ground.

    `velocity_m_s` (n, 3), relative to the Earth, has the covariance (n, 3, 3). That of a source on the
    ground is zero, that of a launch is normal about zero; the ratio of their densities multiplies the
    prior odds (a Bayes factor).
    """
    variances = covariance, covariance + LAW.launch_speed_m_s**2 * np.eye(3)
    ground, launch = (
        -0.5 * dot(velocity_m_s, np.linalg.solve(variance, velocity_m_s[..., None])[..., 0])
        - 0.5 * np.linalg.slogdet(variance)[1]
        for variance in variances
    )
    log_odds = launch - ground - np.log(LAW.ground_sources)
    return np.asarray(1.0 / (1.0 + np.exp(-np.clip(log_odds, -50.0, 50.0))))
