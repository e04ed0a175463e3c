"""Time and place of the launch of a target that is first seen in flight, given the law of boosts.

A path that is followed back for longer than it was seen misses how a boost begins: upright, slowly,
and then turning. Ascents of the law (`ascents`) that pass the height of the target as fast, and as
steeply, say how long it has flown, and how far. Its velocity is best known in the middle of its
lines of sight, whatever force acts.
"""

from functools import lru_cache
from typing import NamedTuple

import numpy as np
from opir_estimation import SPIN

from opir_core.arrays import FloatArray
from opir_core.geometry import ecef_to_geodetic, local_axes
from opir_forecast.ascents import AscentRows, BoostAscents
from opir_forecast.kernel_regression import LAW, hidden_moments, squared_distances
from opir_forecast.launch_points import AT_ONCE, EDGES_S, SITES, site_shares
from opir_forecast.planar_boost import RADIUS_M


class InFlight(NamedTuple):
    """A target in flight, `since_s` after its first detection, in ECEF.

    `state` (6,) is position, m, and velocity over the ground, m/s, with `covariance` (6, 6).
    `at_once` (times,) is the prior of the time in which a target without clouds is detected, over
    the intervals of `EDGES_S`; `inland` the share of sites that are as high as land is.
    """

    state: FloatArray
    covariance: FloatArray
    since_s: float
    at_once: FloatArray
    inland: float


class _LaunchMotion(NamedTuple):
    """Unit vectors up, forwards over the ground and across (3, 3), and height, climb and level
    speed by the state (3,).

    `covariance` (3, 3) is that of the latter, `shift` (3,) the change of the position with the
    height, m per m, and `residual` (3, 3) the covariance of the position given the height. `drift`
    is the error of the direction, rad.
    """

    axes: FloatArray
    values: FloatArray
    covariance: FloatArray
    shift: FloatArray
    residual: FloatArray
    drift: float


class _Passes(NamedTuple):
    """Passes (n,) of ascents through drawn heights of the target.

    `rows` (8, n) are those of `AscentRows` at `since_s` after ignition, `height_m` the heights,
    `raised_m` their differences from the target's, and `site_m` those of the launch sites.
    """

    rows: FloatArray
    since_s: FloatArray
    height_m: FloatArray
    raised_m: FloatArray
    site_m: FloatArray
    log_prior: FloatArray


def launch_of(ascents: BoostAscents, target: InFlight) -> tuple[FloatArray, FloatArray] | None:
    """Return place of launch, m in ECEF, and time since then, s, (4,), and covariance (4, 4); None
    if no ascent fits.

    Each ascent is taken where it reaches the height of the target, a draw of it, from a site of a
    drawn height.
    """
    motion = _motion(target)
    passes = _passes(ascents, target, motion)
    difference, noise = _differences(passes, motion)
    speed = float(np.hypot(*motion.values[1:]))
    scale = np.full(2, LAW.speed_share * max(speed, LAW.slowest_m_s))
    distance = squared_distances(difference, LAW.choice * scale, noise)
    is_possible = np.isfinite(passes.log_prior)
    if not np.count_nonzero(is_possible & (distance < LAW.gate)):
        return None
    nearest = np.argsort(0.5 * distance - passes.log_prior)[: LAW.compared]
    nearest = nearest[is_possible[nearest]]
    closest = _Passes(*(column[..., nearest] for column in passes))
    start = _starts(closest, motion, target.state[:3])
    hidden = np.column_stack([start, closest.since_s])
    moments = hidden_moments(difference[nearest], hidden, scale, noise, closest.log_prior)
    if moments is None:
        return None
    mean, covariance, _ = moments
    covariance[:3, :3] += motion.residual
    covariance[:3, :3] += _turned_covariance(closest, motion)
    mean[:3] += target.state[:3]
    return mean, covariance


def _differences(passes: _Passes, motion: _LaunchMotion) -> tuple[FloatArray, FloatArray]:
    """Return the differences (n, 2), m/s, of climb and level speed of passes from the target's at
    their height, and the covariance (2, 2) of these.
    """
    rows = AscentRows(*passes.rows)
    variance = float(np.sqrt(motion.covariance[0, 0])) ** 2
    follows = motion.covariance[1:, 0] / variance
    difference = np.array([rows.climb, rows.level]).T - motion.values[1:]
    noise = motion.covariance[1:, 1:] - np.outer(follows, follows) * variance
    return difference - passes.raised_m[:, None] * follows, noise


def _turned_covariance(passes: _Passes, motion: _LaunchMotion) -> FloatArray:
    """Return the covariance (3, 3), m², of the place by the error of the direction."""
    angle = AscentRows(*passes.rows).angle
    across = min(motion.drift, 1.0) * RADIUS_M * float(np.sqrt(np.mean(angle**2)))
    return across**2 * np.outer(motion.axes[2], motion.axes[2])


def _passes(ascents: BoostAscents, target: InFlight, motion: _LaunchMotion) -> _Passes:
    """Return the passes of ascents through the target's height, with their log prior."""
    draws = _draws(len(ascents.log_weight))
    site_m = _site_heights_m(draws, target.inland)
    raised_m = float(np.sqrt(motion.covariance[0, 0])) * draws[0]
    height_m = motion.values[0] + raised_m
    since_s = ascents.reaching(np.maximum(height_m - site_m, 0.0))
    rows, burns = ascents.at(since_s)
    first_s = since_s - target.since_s
    log_prior = np.where(burns, _log_prior(ascents, first_s, draws[3], target), -np.inf)
    climb = np.maximum(AscentRows(*rows).climb, LAW.least_climb_m_s)
    log_prior += ascents.log_weight - np.log(climb)
    return _Passes(rows, since_s, height_m, raised_m, site_m, log_prior)


def _motion(target: InFlight) -> _LaunchMotion:
    """Return the motion of a target over the ground."""
    position = target.state[:3]
    velocity = target.state[3:]
    up = local_axes(position[None])[0, 2]
    level = velocity - (velocity @ up) * up
    speed = float(np.linalg.norm(level))
    course = level / max(speed, 1e-9)
    across = np.cross(up, course)
    rows = _measured_rows(up, course)
    covariance = rows @ target.covariance @ rows.T
    shift, residual = _given_height(target.covariance[:3, :3], up, covariance[0, 0])
    drift = float(np.sqrt(across @ target.covariance[3:, 3:] @ across)) / max(speed, 1.0)
    height_m = float(ecef_to_geodetic(position[None]).height_m[0])
    values = np.array([height_m, velocity @ up, speed])
    return _LaunchMotion(np.array([up, course, across]), values, covariance, shift, residual, drift)


def _measured_rows(up: FloatArray, course: FloatArray) -> FloatArray:
    """Return the rows (3, 6) that take height, climb and level speed from a state."""
    rows = np.zeros((3, 6))
    rows[0, :3] = up
    rows[1, 3:] = up
    rows[2, 3:] = course
    return rows


def _given_height(
    covariance: FloatArray, up: FloatArray, variance: float
) -> tuple[FloatArray, FloatArray]:
    """Return how a place shifts with its height, and its covariance once that is known."""
    shift = covariance @ up / variance
    return shift, covariance - np.outer(shift, shift) * variance


def _log_prior(
    ascents: BoostAscents, first_s: FloatArray, scan: FloatArray, target: InFlight
) -> FloatArray:
    """Return the log densities (n,), 1/s, of a first detection at times since ignition (n,).

    `scan` (n,) are uniform draws of the time from the edge of a cloud to the detection.
    """
    interval = np.clip(np.searchsorted(EDGES_S, first_s) - 1, 0, len(target.at_once) - 1)
    clear = np.where(first_s < EDGES_S[-1], (target.at_once / np.diff(EDGES_S))[interval], 0.0)
    cloudy = _cloud_exits(ascents, first_s, scan, target)
    any_time = 1.0 / np.maximum(ascents.burning_s, 1.0)
    delayed = LAW.cloudy * cloudy + (1.0 - LAW.cloudy) * any_time
    with np.errstate(divide="ignore"):
        return np.log(np.where(first_s > 0.0, AT_ONCE * clear + (1.0 - AT_ONCE) * delayed, 0.0))


def _cloud_exits(
    ascents: BoostAscents, first_s: FloatArray, scan: FloatArray, target: InFlight
) -> FloatArray:
    """Return the rates (n,), 1/s, at which ascents climb out of cloud, before the wait for a look
    that ends at times since ignition (n,)."""
    chance = np.concatenate([[0.0], np.cumsum(target.at_once)])
    wait_s = np.interp(scan * chance[-1], chance, EDGES_S)
    edge, _ = ascents.at(np.maximum(first_s - wait_s, 0.0))
    cleared = AscentRows(*edge)
    leaving = np.maximum(cleared.climb, 0.0) / LAW.cloud_top_m
    return np.where(cleared.height < LAW.cloud_top_m, leaving, 0.0)


def _starts(passes: _Passes, motion: _LaunchMotion, position_m: FloatArray) -> FloatArray:
    """Return the displacements (n, 3), m, from a position back to the starts of ascents.

    The Earth's rotation has moved them, and has turned their headings since they began (Coriolis).
    """
    up, course, across = motion.axes
    rows = AscentRows(*passes.rows[:, :, None])
    radius_m = float(np.linalg.norm(position_m))
    start_radius = radius_m - (passes.height_m - passes.site_m)[:, None]
    start = start_radius * (up * np.cos(rows.angle) - course * np.sin(rows.angle)) - radius_m * up
    turned = 2.0 * start @ SPIN.T @ across / max(float(motion.values[2]), LAW.slowest_m_s)
    shift = RADIUS_M * rows.angle * turned[:, None] * across
    # By the Coriolis force, m.
    deflection = 2.0 * (rows.distance_s * course + rows.height_s * up) @ SPIN.T
    return start + shift + deflection + passes.raised_m[:, None] * motion.shift


def _site_heights_m(draws: FloatArray, inland: float) -> FloatArray:
    """Return drawn heights (n,) of launch sites, m."""
    shares = np.cumsum(site_shares(inland))
    kind = np.minimum(np.searchsorted(shares, draws[1]), len(SITES) - 1)
    return SITES[kind, 0] + SITES[kind, 1] * draws[2]


@lru_cache(maxsize=2)
def _draws(count: int) -> FloatArray:
    """Return draws (4, n), the same for all tracks: normal, uniform, normal, uniform."""
    rng = np.random.default_rng(13)
    return np.array(
        [rng.normal(size=count), rng.random(count), rng.normal(size=count), rng.random(count)]
    )
