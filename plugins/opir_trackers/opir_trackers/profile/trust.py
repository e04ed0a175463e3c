"""What is told of a target that may fly as no family does: the fit and a filter that knows no family, mixed.

Of what two sensors see the filter is the surer the less the family holds; of what one sees it is far less sure than a
fit that holds, and right where a fit does not. What is told is the mixture of both, by the chance that the target flies
otherwise: where the two differ while that is open, the covariance holds what they differ by.

Of two estimates that both are right, the surer is the other's best part: what they differ by has the difference of
their covariances (Hausman, Econometrica 46, 1978, 1251). Where they differ by far more, the family does not hold.
"""

import numpy as np
from attrs import evolve

from opir_core.arrays import BoolArray, FloatArray
from opir_core.interfaces.records import Tracks
from opir_core.scene.scene import UNKNOWN_TYPE
from opir_trackers.profile.flight import off_ground, on_ground
from opir_trackers.range_types import ranges_m, type_probabilities
from opir_trackers.stereo.report import LONGEST_STAGING_S

#: Chances below this are none: a mixture with little of what is far less certain says less than it knows. Of what one
#: sensor alone sees the filter is less certain by far.
_LEAST_CHANCE, _LEAST_ALONE = 0.1, 0.2

#: No type is ruled out by a range: flights may be lofted, or end early.
_LEAST_TYPE = 1e-3

#: How many times as wide as it says the fit of a target that flies otherwise is off; the most log odds that may tell.
_WIDE, _MOST = 8.0, 12.0

#: Estimates that share their looks differ by at least this part of the filter's covariance; and by rounding.
_LEAST_LEFT, _ROUNDING = 0.25, 1e-12


def chances(log_odds: FloatArray, alone: BoolArray) -> FloatArray:
    """Return the chances (n,) that targets fly otherwise, of their log odds; 0 of those that are small.

    `alone` (n,) are those that one sensor alone has seen.
    """
    chance = 1.0 / (1.0 + np.exp(-log_odds))
    counts: FloatArray = np.where(chance < np.where(alone, _LEAST_ALONE, _LEAST_CHANCE), 0.0, chance)
    return counts


def blended(fitted: Tracks, filtered: Tracks, chance: FloatArray, time_since_last_s: FloatArray) -> Tracks:
    """Return the tracks of both, row by row, as mixtures in which the filter's have these chances (n,).

    The radii of impacts' ellipses are the fit's where nothing is mixed in. A burn that has stages may go on: of targets
    that more likely than not fly otherwise, no impact is told before they have been dark (n,) long enough, nor an end
    of the burn.
    """
    heavy = chance > 0.5
    state, spread = _mixed(fitted.state, fitted.state_covariance, filtered.state, filtered.state_covariance, chance)
    launch, launch_spread = _mixed_places(
        fitted.launch, fitted.launch_covariance, filtered.launch, filtered.launch_covariance, chance, heavy
    )
    impact, impact_spread = _mixed_places(
        fitted.impact, fitted.impact_covariance, filtered.impact, filtered.impact_covariance, chance, heavy
    )
    early = heavy & (time_since_last_s <= LONGEST_STAGING_S)
    is_mixed = (chance > 0.0) & np.isfinite(filtered.impact).all(axis=1) | heavy
    return evolve(
        fitted,
        state=state,
        state_covariance=spread,
        launch=launch,
        launch_covariance=launch_spread,
        impact=_hidden(impact, early),
        impact_covariance=_hidden(impact_spread, early),
        burnout=_hidden(fitted.burnout, heavy),
        burnout_covariance=_hidden(fitted.burnout_covariance, heavy),
        impact_sigmas=_hidden(fitted.impact_sigmas, is_mixed),
        state_sigmas=_hidden(fitted.state_sigmas, chance > 0.0),
        type_probability=_between(fitted.type_probability, filtered.type_probability, chance),
    )


def _hidden(values: FloatArray, rows: BoolArray) -> FloatArray:
    """Return values (n, ...) with nan in rows (n,)."""
    return np.where(rows.reshape(-1, *(1,) * (values.ndim - 1)), np.nan, values)


def _between(one: FloatArray, other: FloatArray, share: FloatArray) -> FloatArray:
    """Return means (n, d) of two, of which the other counts for shares (n,)."""
    return one + share[:, None] * (other - one)


def typed(filtered: Tracks) -> Tracks:
    """Return tracks of the filter with what the ranges of those with an impact say of their types.

    That is the ranges of the generic classes, with the longer semi-axis of the impact as the error, beside what the
    sensors have reported, which is all that the filter knows of types.
    """
    rows = np.flatnonzero(np.isfinite(filtered.launch).all(axis=1) & np.isfinite(filtered.impact).all(axis=1))
    if not len(rows):
        return filtered
    range_m = ranges_m(filtered.launch[rows], filtered.impact[rows])
    sigma_m = np.sqrt(np.linalg.eigvalsh(filtered.impact_covariance[rows, :2, :2])[:, -1])
    types = filtered.type_probability.copy()
    reported, is_silent = types[rows], types[rows, UNKNOWN_TYPE] > 0.5
    reported[is_silent] = 1.0
    share = np.maximum(type_probabilities(range_m, sigma_m), _LEAST_TYPE) * reported
    share[:, UNKNOWN_TYPE] = 0.0
    types[rows] = share / share.sum(axis=1, keepdims=True)
    return evolve(filtered, type_probability=types)


def apart(fitted: Tracks, filtered: Tracks) -> FloatArray:
    """Return by how much (n,) what the states of both differ by raises the log odds of flying otherwise, 0 or more.

    The fits of targets that fly otherwise are off by what is _WIDE times as wide, in each of six directions.
    """
    sigma = np.sqrt(np.diagonal(filtered.state_covariance, axis1=1, axis2=2))
    scale = sigma[:, :, None] * sigma[:, None]
    root = np.linalg.cholesky(filtered.state_covariance / scale + _ROUNDING * np.eye(6))
    away = np.linalg.solve(root, ((filtered.state - fitted.state) / sigma)[:, :, None])[:, :, 0]
    half = np.linalg.solve(root, fitted.state_covariance / scale)
    share, axes = np.linalg.eigh(np.linalg.solve(root, half.transpose(0, 2, 1)))
    along = np.sum(axes * away[:, :, None], axis=1)
    square = np.sum(np.square(along) / np.maximum(1.0 - share, _LEAST_LEFT), axis=1)
    gain: FloatArray = np.clip(0.5 * square - 6.0 * np.log(_WIDE), 0.0, _MOST)
    return gain


def _mixed(
    mean: FloatArray, spread: FloatArray, other: FloatArray, other_spread: FloatArray, chance: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return means (n, d) and covariances (n, d, d) of mixtures of two normal distributions."""
    away, share = other - mean, chance[:, None, None]
    apart = share * (1.0 - share) * (away[:, :, None] * away[:, None, :])
    return _between(mean, other, chance), (1.0 - share) * spread + share * other_spread + apart


def _mixed_places(
    place: FloatArray,
    spread: FloatArray,
    other: FloatArray,
    other_spread: FloatArray,
    chance: FloatArray,
    heavy: BoolArray,
) -> tuple[FloatArray, FloatArray]:
    """Return mixtures of places on the ground and times (n, 3); where one is unknown, the likelier, known or not."""
    away = on_ground(other, place)
    both: BoolArray = np.asarray(np.isfinite(away).all(axis=1))
    mean, total = _mixed(np.zeros_like(away), spread, np.where(both[:, None], away, 0.0), other_spread, chance)
    told, told_spread = np.where(heavy[:, None], other, place), np.where(heavy[:, None, None], other_spread, spread)
    told[both], told_spread[both] = off_ground(mean[both], place[both]), total[both]
    return told, told_spread
