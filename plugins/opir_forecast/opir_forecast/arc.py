"""The forecaster `arc`: the Keplerian arc of a target that no longer burns, down to the ground.

A burning target flies on no such arc, so it has none. The impact is that of the mean of the free
flight; its covariance is that of the state, by the slopes of place and time.
"""

from typing import Any

import numpy as np
from opir_estimation import COAST
from opir_estimation.square_root import inverse_root

from opir_core.arrays import BoolArray, FloatArray
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M
from opir_core.flight import Forces
from opir_core.geometry import great_circle_m
from opir_core.interfaces import TRACK_CONTAINMENTS
from opir_forecast.configs import ArcConfig
from opir_forecast.estimates import BoostEstimates
from opir_forecast.fates import free_impacts
from opir_forecast.forecaster import Forecaster, outcomes_of, track_ends
from opir_forecast.launch_forecasts import LaunchForecasts
from opir_forecast.outcomes import Outcomes
from opir_forecast.particles import LAW

#: Radii of ellipses that hold a normal point of a plane in these shares, in standard deviations.
_RADII = np.sqrt(-2.0 * np.log1p(-np.array(TRACK_CONTAINMENTS)))


class ArcForecaster(Forecaster):
    """The forecaster `arc` for the hypotheses of some outcomes."""

    def __init__(self, outcomes: Outcomes) -> None:
        self._outcomes = outcomes

    def forecasts(self, estimates: BoostEstimates, time_s: float) -> LaunchForecasts:
        """Return the forecasts of tracks (n,); those that burn have the prior of hypotheses."""
        count = len(estimates)
        prior = self._outcomes.by_reports(estimates.log_likelihood)
        unknown = np.full(count, np.nan)
        result = LaunchForecasts.without_impacts(prior, estimates.burning, *[unknown] * 3)
        coasting = np.flatnonzero(estimates.is_launch & (estimates.burning <= 0.5))
        if not len(coasting):
            return result
        impact, covariance = impact_moments_of(estimates.take(coasting), time_s)
        falls = np.isfinite(impact[:, 2])
        result.impact[coasting] = impact
        result.impact_covariance[coasting] = covariance
        result.impact_sigmas[coasting] = np.where(falls[:, None], _RADII, np.nan)
        result.in_orbit[coasting] = ~falls
        range_m = great_circle_m(estimates.launch[coasting], impact)
        given_arc = self._given_arc(range_m, falls) * prior[coasting]
        result.given_launch[coasting] = given_arc / given_arc.sum(axis=1, keepdims=True)
        result.end[:] = track_ends(result, time_s, estimates.silent_s > LAW.longest_gap_s)
        return result

    def _given_arc(self, range_m: FloatArray, falls: BoolArray) -> FloatArray:
        """Return the likelihoods (n, H) of arcs over ranges (n,), m, nan where unknown, that fall or
        stay up: a missile class covers some ranges, and a space launch falls if it has failed.
        """
        outcomes = self._outcomes
        failure = outcomes.model.data["failure_probability"]
        likelihood = np.where(
            falls[:, None], 1.0, np.full(len(outcomes.hypotheses), LAW.none_orbits)
        )
        for group, falling in (("missile", 1.0), ("glide", 1.0), ("orbit", failure)):
            columns = outcomes.columns(group)
            likelihood[:, columns] = np.where(falls, falling, 1.0 - falling)[:, None]
        missiles = outcomes.columns("missile")
        covers = outcomes.missiles(range_m) > 0.0
        likelihood[:, missiles] *= covers | np.isnan(range_m)[:, None]
        return likelihood


def impact_moments_of(estimates: BoostEstimates, time_s: float) -> tuple[FloatArray, FloatArray]:
    """Return latitude, rad, longitude, rad, and time, s, (n, 3) of the impacts of free flights from a
    time, and covariances (n, 3, 3), east and north, m, and time, s; nan without an impact.
    """
    side = inverse_root(estimates.coast_root)
    states = np.concatenate(
        [estimates.coast_mean[:, None], estimates.coast_mean[:, None] + side], 1
    )
    rows = states.reshape(-1, COAST)
    place, when_s = free_impacts(rows, np.full(len(rows), time_s), Forces(zonal=()))
    points = np.column_stack([place, when_s]).reshape(len(states), -1, 3)
    mean = points[:, 0].copy()
    offset = points[:, 1:] - points[:, :1]
    turn = np.remainder(offset[..., 1] + np.pi, 2.0 * np.pi) - np.pi
    east = EARTH_EQUATORIAL_RADIUS_M * turn * np.cos(mean[:, :1])
    north = EARTH_EQUATORIAL_RADIUS_M * offset[..., 0]
    slopes = np.stack([east, north, offset[..., 2]], axis=1)
    covariance = slopes @ slopes.mT
    unknown = ~np.asarray(np.isfinite(covariance).all(axis=(1, 2)))
    mean[unknown] = np.nan
    covariance[unknown] = np.nan
    return mean, covariance


def arc_forecaster(config: ArcConfig, context: Any) -> ArcForecaster:
    """Return the forecaster `arc` for the context of a part."""
    return ArcForecaster(outcomes_of(context))
