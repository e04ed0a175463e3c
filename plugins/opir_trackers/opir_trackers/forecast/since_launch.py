"""When and where what is first seen in flight was launched, given the law of boosts.

A path that is followed back for longer than it was seen misses how a boost begins: upright, slowly,
and then turning. Ascents of the law (`ascents`) that pass the height of the target as fast, and as
steeply, say how long it has flown, and how far. Its velocity is best known in the middle of its
lines of sight, whatever force acts.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np

from opir_core.arrays import FloatArray
from opir_core.geometry import ecef_to_geodetic, local_axes
from opir_trackers.forecast.ascents import (
    ABOVE_S,
    AHEAD_S,
    ANGLE,
    CLIMB,
    HEIGHT,
    LEVEL,
    BoostAscents,
)
from opir_trackers.forecast.kernel_regression import hidden_moments, squared_distances
from opir_trackers.forecast.planar_boost import RADIUS_M
from opir_trackers.launch_points import AT_ONCE, EDGES_S, SITES, site_shares
from opir_trackers.lines_of_sight import SPIN

#: Share of the launches not seen at once that are hidden by clouds, with tops up to a height, m,
#: that no thunderstorm much exceeds; others are seen late at any time of the burn, as when a sensor
#: begins to look. Notional.
_CLOUDY = 0.8
_TOP_M = 20e3

#: Most ascents that are compared closely, width of the narrowest kernel as a share of the speed,
#: and least speed, m/s; multiple of it for the first choice.
_MOST = 400
_SHARE = 0.06
_SLOWEST_M_S = 100.0
_CHOICE = 2.0

#: Gate, squared distance of the ascent that is most like the target: as for starts from rest.
_LIKE = 25.0

#: Least climb, m/s: what hardly climbs stays at its height for long.
_LEAST_CLIMB_M_S = 5.0


class InFlight(NamedTuple):
    """A target in flight, `since_s` after its first detection, in ECEF.

    `state` (6,) is position, m, and velocity over the ground, m/s, with `covariance` (6, 6).
    `at_once` (times,) is the prior of the time in which what is not hidden is detected, over the
    intervals of `EDGES_S`; `inland` the share of sites that are as high as land is.
    """

    state: FloatArray
    covariance: FloatArray
    since_s: float
    at_once: FloatArray
    inland: float


class _Motion(NamedTuple):
    """Unit vectors up, ahead over the ground and across (3, 3), and height, climb and level speed
    by the state (3,).

    `covariance` (3, 3) is that of the latter, `shift` (3,) how the position follows the height, m
    per m, and `rest` (3, 3) the covariance of the position given the height. `drift` is the error
    of the direction, rad.
    """

    axes: FloatArray
    values: FloatArray
    covariance: FloatArray
    shift: FloatArray
    rest: FloatArray
    drift: float


def launch_of(ascents: BoostAscents, target: InFlight) -> tuple[FloatArray, FloatArray] | None:
    """Return place of launch, m in ECEF, and time since then, s, (4,), and covariance (4, 4); None
    if none fits.

    Each ascent is taken where it reaches the height of the target, a draw of it, from a site of a
    drawn height.
    """
    motion = _motion(target)
    draws = _draws(len(ascents.log_weight))
    site_m = _site_heights_m(draws, target.inland)
    sigma_m = float(np.sqrt(motion.covariance[0, 0]))
    raised_m = sigma_m * draws[0]
    height_m = motion.values[0] + raised_m
    since_s = ascents.reaching(np.maximum(height_m - site_m, 0.0))
    rows, burns = ascents.at(since_s)
    log_prior = np.where(
        burns, _log_prior(ascents, since_s - target.since_s, draws[3], target), -np.inf
    )
    log_prior += ascents.log_weight - np.log(np.maximum(rows[CLIMB], _LEAST_CLIMB_M_S))
    follows = motion.covariance[1:, 0] / sigma_m**2
    seen = rows[[CLIMB, LEVEL]].T - motion.values[1:] - raised_m[:, None] * follows
    noise = motion.covariance[1:, 1:] - np.outer(follows, follows) * sigma_m**2
    scale = np.full(2, _SHARE * max(float(np.hypot(*motion.values[1:])), _SLOWEST_M_S))
    apart = squared_distances(seen, _CHOICE * scale, noise)
    if not np.count_nonzero(np.isfinite(log_prior) & (apart < _LIKE)):
        return None
    near = np.argsort(0.5 * apart - log_prior)[:_MOST]
    near = near[np.isfinite(log_prior[near])]
    start = _starts(rows[:, near], motion, target.state[:3], height_m[near], site_m[near])
    start += raised_m[near, None] * motion.shift
    found = hidden_moments(
        seen[near], np.column_stack([start, since_s[near]]), scale, noise, log_prior[near]
    )
    if found is None:
        return None
    mean, covariance, _ = found
    covariance[:3, :3] += motion.rest
    aside = min(motion.drift, 1.0) * RADIUS_M * float(np.sqrt(np.mean(rows[ANGLE, near] ** 2)))
    covariance[:3, :3] += aside**2 * np.outer(motion.axes[2], motion.axes[2])
    mean[:3] += target.state[:3]
    return mean, covariance


def _motion(target: InFlight) -> _Motion:
    """Return how a target moves over the ground."""
    position = target.state[:3]
    velocity = target.state[3:]
    up = local_axes(position[None])[0, 2]
    level = velocity - (velocity @ up) * up
    speed = float(np.linalg.norm(level))
    ahead = level / max(speed, 1e-9)
    across = np.cross(up, ahead)
    by = np.zeros((3, 6))
    by[0, :3] = up
    by[1, 3:] = up
    by[2, 3:] = ahead
    covariance = by @ target.covariance @ by.T
    shift = target.covariance[:3, :3] @ up / covariance[0, 0]
    rest = target.covariance[:3, :3] - np.outer(shift, shift) * covariance[0, 0]
    drift = float(np.sqrt(across @ target.covariance[3:, 3:] @ across)) / max(speed, 1.0)
    height_m = float(ecef_to_geodetic(position[None]).height_m[0])
    values = np.array([height_m, velocity @ up, speed])
    return _Motion(np.array([up, ahead, across]), values, covariance, shift, rest, drift)


def _log_prior(
    ascents: BoostAscents, first_s: FloatArray, scan: FloatArray, target: InFlight
) -> FloatArray:
    """Return the log densities (n,), 1/s, of a first detection at times since ignition (n,).

    `scan` (n,) are uniform draws of the time from the edge of a cloud to the detection.
    """
    interval = np.clip(np.searchsorted(EDGES_S, first_s) - 1, 0, len(target.at_once) - 1)
    soon = np.where(first_s < EDGES_S[-1], (target.at_once / np.diff(EDGES_S))[interval], 0.0)
    chance = np.concatenate([[0.0], np.cumsum(target.at_once)])
    cleared = ascents.at(
        np.maximum(first_s - np.interp(scan * chance[-1], chance, EDGES_S), 0.0)
    ).rows
    cloudy = np.where(cleared[HEIGHT] < _TOP_M, np.maximum(cleared[CLIMB], 0.0) / _TOP_M, 0.0)
    any_time = 1.0 / np.maximum(ascents.burning_s, 1.0)
    late = _CLOUDY * cloudy + (1.0 - _CLOUDY) * any_time
    with np.errstate(divide="ignore"):
        return np.log(np.where(first_s > 0.0, AT_ONCE * soon + (1.0 - AT_ONCE) * late, 0.0))


def _starts(
    rows: FloatArray,
    motion: _Motion,
    position_m: FloatArray,
    height_m: FloatArray,
    site_m: FloatArray,
) -> FloatArray:
    """Return from a position, where ascents (8, m) begin (m, 3), m, that have led there to a height
    (m,).

    The Earth's rotation has moved them, and has turned their headings since they began (Coriolis).
    """
    up, ahead, across = motion.axes
    above_s = rows[ABOVE_S, :, None]
    ahead_s = rows[AHEAD_S, :, None]
    angle = rows[ANGLE, :, None]
    radius_m = float(np.linalg.norm(position_m))
    fallen = radius_m - (height_m - site_m)[:, None]
    start = fallen * (up * np.cos(angle) - ahead * np.sin(angle)) - radius_m * up
    turned = 2.0 * start @ SPIN.T @ across / max(float(motion.values[2]), _SLOWEST_M_S)
    aside = RADIUS_M * angle * turned[:, None] * across
    return start + aside + 2.0 * (ahead_s * ahead + above_s * up) @ SPIN.T


def _site_heights_m(draws: FloatArray, inland: float) -> FloatArray:
    """Return drawn heights (n,) of launch sites, m."""
    shares = np.cumsum(site_shares(inland))
    kind = np.minimum(np.searchsorted(shares, draws[1]), len(SITES) - 1)
    return np.asarray(SITES[kind, 0] + SITES[kind, 1] * draws[2])


@lru_cache(maxsize=2)
def _draws(count: int) -> FloatArray:
    """Return draws (4, n), the same for all tracks: normal, uniform, normal, uniform."""
    rng = np.random.default_rng(13)
    return np.array(
        [rng.normal(size=count), rng.random(count), rng.normal(size=count), rng.random(count)]
    )
