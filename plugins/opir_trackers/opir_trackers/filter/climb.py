"""The prior of a boost's climb: how fast boosts rise, given how fast they move over the ground.

One sensor alone does not observe the velocity along its line of sight, and the thrust along the velocity multiplies
what is not known of it. Boosts climb: a prior about no velocity would let such an estimate sink.
"""

from math import exp
from typing import NamedTuple

import numpy as np

from opir_core.arrays import FloatArray, IntArray
from opir_core.estimation import dot, square_root
from opir_trackers.filter.thrust import air_velocity

#: Over the burns of 240 flights of the tracker's own law of boosts (`benchmarks/prior_flights.py`) the vertical
#: velocity is about `_FASTEST` (1 - exp(-(v + `_FIRST`) / `_SCALE`)), m/s, at a velocity v over the ground, and its
#: standard deviation `_SPREAD` times that. Missiles alone climb faster, launchers more slowly: with the missiles'
#: 2 200 m/s one sensor errs by more on 18 flights of all classes.
_FASTEST_M_S, _FIRST_M_S, _SCALE_M_S, _SPREAD = 1500.0, 150.0, 600.0, 0.9

#: Standard deviation of the climb of a boost that stands over one place: none is less.
_LEAST_M_S = _SPREAD * _FASTEST_M_S * (1.0 - exp(-_FIRST_M_S / _SCALE_M_S))


def uncertain_climbs(state: FloatArray, covariance: FloatArray) -> IntArray:
    """Return the rows of states (n, 6) whose vertical velocity is less known, by (n, 6, 6), than before any look."""
    rows = (covariance[:, 3, 3] + covariance[:, 4, 4] + covariance[:, 5, 5] > _LEAST_M_S**2).nonzero()[0]
    if not rows.size:
        return rows
    climb = _climb(state[rows], covariance[rows, 3:, 3:])
    spread = (climb.row[:, None] @ covariance[rows, 3:, 3:] @ climb.row[:, :, None])[:, 0, 0]
    return rows[spread > np.square(_SPREAD * climb.wanted)]


def with_climb_prior(mean: FloatArray, root: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return means (n, d) and information roots whose vertical velocity is known as well as before any look.

    Where it is less known, the mean moves as by a look at the prior's mean with the variance that leads to the bound.
    """
    side = square_root.inverse_root(root)
    climb = _climb(mean, square_root.gram(side[:, 3:6]))
    seen = (climb.row[:, None] @ side[:, 3:6])[:, 0]
    variance, limit = dot(seen, seen), np.square(_SPREAD * climb.wanted)
    kept = np.sqrt(np.minimum(limit / variance, 1.0))
    shift = (side @ seen[:, :, None])[:, :, 0] / variance[:, None]
    after = mean + shift * ((1.0 - kept * kept) * climb.lacking)[:, None]
    # The error of the prior is the same at all times: the place is no better known.
    shift[:, :3] = 0.0
    return after, square_root.information_root(side - ((1.0 - kept)[:, None] * shift)[:, :, None] * seen[:, None])


class _Climb(NamedTuple):
    """The prior mean (n,) of the vertical velocity, what is lacking to it, and its slope (n, 3) by the velocity."""

    wanted: FloatArray
    lacking: FloatArray
    row: FloatArray


def _climb(state: FloatArray, spread: FloatArray) -> _Climb:
    """Return the climb of states (n, d) whose velocities have covariances (n, 3, 3)."""
    place, velocity = state[:, :3], air_velocity(state)
    up = place / np.sqrt(dot(place, place))[:, None]
    rise = dot(velocity, up)
    level = velocity - rise[:, None] * up
    aside = np.trace(spread, axis1=1, axis2=2) - dot((up[:, None] @ spread)[:, 0], up)
    speed = np.sqrt(dot(level, level) + aside + 1.0)
    left = _FASTEST_M_S * np.exp(-(speed + _FIRST_M_S) / _SCALE_M_S)
    wanted = _FASTEST_M_S - left
    return _Climb(wanted, wanted - rise, up - (left / _SCALE_M_S / speed)[:, None] * level)
