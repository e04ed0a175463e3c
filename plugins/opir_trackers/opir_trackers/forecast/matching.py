"""Which boosts of the prior a track may fly: their probabilities, and the track's state given each.

A boost that burns is compared at every instant of its burns, one that is dark at the end of a burn: by the time since
ignition, height, speed, flight-path angle and specific force. With the filter's normal density of the state x, whose
features are f(x), and a kernel of covariance B about the features of a boost, the posterior is a mixture over boosts:
the weight is N(f_boost; f(x), H P Hᵀ + B), and each part is the filter's density updated by f_boost with noise B
(Alspach and Sorenson, "Nonlinear Bayesian estimation using Gaussian sum approximations", IEEE Trans. Automatic Control
17(4), 1972). Boosts between those of the prior are as likely as these: that is what the kernel says.
"""

from typing import NamedTuple

import numpy as np

from opir_core.arrays import FloatArray, IntArray
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_ROTATION_RAD_S
from opir_trackers.forecast.prior_boosts import Instants, PriorBoosts

#: Widths of the kernel: of height and speed, a share and a least value, m and m/s; angle, rad; share of the force.
HEIGHT, SPEED, ANGLE_RAD, FORCE = (0.06, 500.0), (0.05, 20.0), 0.05, 0.1

#: Standard deviation of the time since ignition from the grid of instants, s, and of an unknown time of ignition.
GRID_S, UNKNOWN_S = 1.0, 60.0

#: The kernel is widened, twice each time, until this many boosts share the probability.
LEAST_BOOSTS, WIDEST = 25.0, 16.0


class Matches(NamedTuple):
    """Instants of the prior's boosts (rows of `Instants`) with probabilities, and the width of the kernel."""

    row: IntArray
    probability: FloatArray
    width: float


def features_of(state: FloatArray) -> FloatArray:
    """Return height m, speed m/s relative to the air, flight-path angle rad and specific force (..., 4) of states."""
    place = state[..., :3]
    radius = np.sqrt(np.sum(place * place, axis=-1))
    velocity = air_velocity(state)
    speed = np.sqrt(np.sum(velocity * velocity, axis=-1))
    climb = np.sum(place * velocity, axis=-1) / np.maximum(radius * speed, 1.0)
    force = np.sqrt(np.sum(state[..., 6:9] ** 2, axis=-1)) if state.shape[-1] > 6 else np.zeros(radius.shape)
    return np.stack(
        [radius - local_radius_m(place, radius), speed, np.arcsin(np.clip(climb, -1.0, 1.0)), force], axis=-1
    )


def local_radius_m(place: FloatArray, radius: FloatArray) -> FloatArray:
    """Return the radius of the ellipsoid (...), m, below places, to 50 m: a(1 - f sin² φ)."""
    sine = place[..., 2] / radius
    least: FloatArray = EARTH_EQUATORIAL_RADIUS_M * (1.0 - sine * sine / 298.257223563)
    return least


def air_velocity(state: FloatArray) -> FloatArray:
    """Return inertial velocities (..., 3) less that of the rotating Earth."""
    spin = EARTH_ROTATION_RAD_S * np.stack([-state[..., 1], state[..., 0], np.zeros(state.shape[:-1])], axis=-1)
    relative: FloatArray = state[..., 3:6] - spin
    return relative


def jacobian(state: FloatArray, side: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return the features (4,) of a mean state and their changes (d, 4) along the columns of its covariance root."""
    points = np.concatenate([state[None] + side.T, state[None] - side.T, state[None]])
    found = features_of(points)
    count = side.shape[1]
    return found[-1], 0.5 * (found[:count] - found[count:-1])


def kernel_variance(features: FloatArray, used: int) -> FloatArray:
    """Return the variances (used,) of the kernel about features (4,)."""
    height = HEIGHT[0] * max(features[0], 0.0) + HEIGHT[1]
    speed = SPEED[0] * features[1] + SPEED[1]
    # The angle of a slow velocity is open.
    angle = ANGLE_RAD * (1.0 + 300.0 / max(features[1], 30.0))
    variance: FloatArray = np.square([height, speed, angle, FORCE * features[3] + 1.0])[:used]
    return variance


def matched(
    instants: Instants | PriorBoosts,
    log_prior: FloatArray,
    features: FloatArray,
    changes: FloatArray,
    since_s: tuple[float, float],
    used: int,
) -> Matches:
    """Return the boosts that a track may fly, of instants with logarithms of their prior (m,).

    `changes` (d, 4) are those of the features along the columns of the root of the track's covariance, `since_s` mean
    and standard deviation of the time since ignition; nan if unknown. The first `used` features count.
    """
    when_s, sigma_s = since_s if np.isfinite(since_s[0]) else (100.0, UNKNOWN_S)
    sigma_s = float(np.hypot(sigma_s, GRID_S))
    first, last = np.searchsorted(instants.time_s, [when_s - 4.0 * sigma_s, when_s + 4.0 * sigma_s]).tolist()
    rows = np.arange(first, last)
    if not len(rows):
        return Matches(rows, np.empty(0), 1.0)
    away = instants.features[first:last, :used] - features[:used]
    early = (instants.time_s[first:last] - when_s) / sigma_s
    known = changes[:, :used].T @ changes[:, :used]
    width = 1.0
    while True:
        covariance = known + width * width * np.diag(kernel_variance(features, used))
        white = np.linalg.solve(np.linalg.cholesky(covariance), away.T)
        log = log_prior[first:last] - 0.5 * (np.sum(white * white, axis=0) + early * early)
        share = np.exp(log - log.max())
        share /= share.sum()
        each = np.bincount(instants.boost[first:last], share)
        if width >= WIDEST or 1.0 / np.sum(each * each) >= LEAST_BOOSTS:
            break
        width *= 2.0
    kept = np.flatnonzero(share > 1e-5 * share.max())
    share = share[kept]
    return Matches(rows[kept], share / share.sum(), width)


def drawn_states(
    state: FloatArray,
    side: FloatArray,
    features: FloatArray,
    changes: FloatArray,
    chosen: FloatArray,
    normal: FloatArray,
    width: float,
    used: int,
) -> FloatArray:
    """Return states (p, d) drawn from the filter's density given features (p, 4) of chosen boosts.

    `normal` (p, d + used) are standard normal numbers. The gain is that of a linear measurement of the features.
    """
    part = changes[:, :used]
    noise = width * np.sqrt(kernel_variance(features, used))
    covariance = part.T @ part + np.diag(noise * noise)
    gain = np.linalg.solve(covariance, part.T)
    size = side.shape[1]
    free = normal[:, :size]
    # A draw of the prior, moved by its own innovation, is a draw of the posterior.
    innovation = chosen[:, :used] + normal[:, size:] * noise - (features[:used] + free @ part)
    states: FloatArray = state + (free + innovation @ gain) @ side.T
    return states
