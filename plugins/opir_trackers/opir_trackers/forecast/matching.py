"""Which boosts of the prior a track may fly: their probabilities, and the track's state given each.

A boost that burns is compared at every instant of its burns, one that is dark at the end of a burn: by the time since
ignition, height, speed, flight-path angle and specific force. With the filter's normal density of the state x, whose
features are f(x), and a kernel of covariance B about the features of a boost, the posterior is a mixture over boosts:
the weight is N(f_boost; f(x), H P Hᵀ + B), and each part is the filter's density updated by f_boost with noise B
(Alspach and Sorenson, "Nonlinear Bayesian estimation using Gaussian sum approximations", IEEE Trans. Automatic Control
17(4), 1972). Boosts between those of the prior are as likely as these: that is what the kernel says.
"""

from collections.abc import Callable, Sequence
from typing import NamedTuple

import numpy as np

from opir_core.arrays import FloatArray, IntArray
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_ROTATION_RAD_S
from opir_core.estimation import COAST
from opir_trackers.forecast.prior_boosts import Instants, PriorBoosts

#: Widths of the kernel: of height and speed, a share and a least value, m and m/s; angle, rad; share of the force.
HEIGHT, SPEED, ANGLE_RAD, FORCE = (0.06, 500.0), (0.05, 20.0), 0.05, 0.1

#: Standard deviation of the time since ignition from the grid of instants, s, and of an unknown time of ignition.
GRID_S, UNKNOWN_S = 1.0, 60.0

#: Instants further away in time than this many standard deviations do not count.
TIME_GATE = 3.0

#: A position known to this, m, has linear features; else its density is cut into parts of this share of its standard
#: deviation, up to this many deviations away.
LINEAR_M, NARROW, REACH = 5e3, 0.5, 3.0

#: Gauss-Newton steps of a draw, and the shift for their slopes, standard deviations.
ITERATIONS, SHIFT = 3, 0.1

#: The kernel is widened, twice each time, until this many boosts share the probability.
LEAST_BOOSTS, WIDEST = 25.0, 16.0


class Part(NamedTuple):
    """A normal part of a track's density: mean (d,), covariance root (d, d), log weight, features and their changes."""

    state: FloatArray
    side: FloatArray
    log_weight: float
    features: FloatArray
    changes: FloatArray


class Matches(NamedTuple):
    """Instants of the prior's boosts (rows of `Instants`) by part of a track, probabilities, width of the kernel."""

    part: IntArray
    row: IntArray
    probability: FloatArray
    width: float


def features_of(state: FloatArray) -> FloatArray:
    """Return height m, speed m/s and angle rad of the flight through the air, and the force along it (..., 4)."""
    place = state[..., :3]
    radius = np.sqrt(np.sum(place * place, axis=-1))
    velocity = air_velocity(state)
    speed = np.sqrt(np.sum(velocity * velocity, axis=-1))
    climb = np.sum(place * velocity, axis=-1) / np.maximum(radius * speed, 1.0)
    force = np.zeros(radius.shape)
    if state.shape[-1] > COAST:
        force = np.sum(state[..., 6:9] * velocity, axis=-1) / np.maximum(speed, 1.0)
    height = radius - local_radius_m(place, radius)
    return np.stack([height, speed, np.arcsin(np.clip(climb, -1.0, 1.0)), force], axis=-1)


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


def parts_of(
    state: FloatArray, side: FloatArray, moved: Callable[[FloatArray], FloatArray] | None = None
) -> list[Part]:
    """Return the parts of a normal density with mean (d,) and covariance root (d, d).

    Features are linear in a state that is known to kilometres. Along a single line of sight it is not: there the
    density is a sum of narrower ones, at equal steps along the longest axis of the position. `moved` is applied to
    states (n, d) before their features.
    """
    _, size, axes = np.linalg.svd(side[:3])
    longest = float(size[0])
    if longest < LINEAR_M:
        return [_part(state, side, 0.0, moved)]
    along = axes[0]
    narrow = side - (1.0 - NARROW) * np.outer(side @ along, along)
    steps = np.arange(-REACH, REACH + 0.5 * NARROW, NARROW)
    # Narrow densities at steps of their own width, of a total variance of one.
    log = -0.5 * steps * steps / (1.0 - NARROW * NARROW)
    return [
        _part(state + side @ along * step, narrow, weight, moved)
        for step, weight in zip(steps.tolist(), log.tolist(), strict=True)
    ]


def _part(
    state: FloatArray, side: FloatArray, log_weight: float, moved: Callable[[FloatArray], FloatArray] | None
) -> Part:
    points = np.concatenate([state[None] + side.T, state[None] - side.T, state[None]])
    found = features_of(points if moved is None else moved(points))
    count = side.shape[1]
    return Part(state, side, log_weight, found[-1], 0.5 * (found[:count] - found[count:-1]))


def kernel_variance(features: FloatArray, used: int) -> FloatArray:
    """Return the variances (used,) of the kernel about features (4,)."""
    height = HEIGHT[0] * max(features[0], 0.0) + HEIGHT[1]
    speed = SPEED[0] * features[1] + SPEED[1]
    # The angle of a slow velocity is open.
    angle = ANGLE_RAD * (1.0 + 300.0 / max(features[1], 30.0))
    variance: FloatArray = np.square([height, speed, angle, FORCE * abs(features[3]) + 1.0])[:used]
    return variance


def matched(
    instants: Instants | PriorBoosts,
    log_prior: FloatArray,
    parts: Sequence[Part],
    since_s: tuple[float, float],
    used: int,
) -> Matches:
    """Return the boosts that a track of some parts may fly, of instants with logarithms of their prior (m,).

    `since_s` are mean and standard deviation of the time since ignition; nan if unknown. The first `used` features
    count.
    """
    when_s, sigma_s = since_s if np.isfinite(since_s[0]) else (100.0, UNKNOWN_S)
    sigma_s = float(np.hypot(sigma_s, GRID_S))
    first, last = np.searchsorted(
        instants.time_s, [when_s - TIME_GATE * sigma_s, when_s + TIME_GATE * sigma_s]
    ).tolist()
    here = slice(first, last)
    if first == last or not np.isfinite(log_prior[here]).any():
        return Matches(*(np.empty(0, dtype=np.int64),) * 2, np.empty(0), 1.0)
    early = (instants.time_s[here] - when_s) / sigma_s
    log = log_prior[here] - 0.5 * early * early
    fits = [_Fit(part, instants.features[here, :used]) for part in parts]
    width = 1.0
    while True:
        logs = np.concatenate([fit.log_likelihood(width) + log for fit in fits])
        share = np.exp(logs - logs.max())
        share /= share.sum()
        each = np.bincount(np.tile(instants.boost[here], len(parts)), share)
        if width >= WIDEST or 1.0 / np.sum(each * each) >= LEAST_BOOSTS:
            break
        width *= 2.0
    kept = np.flatnonzero(share > 1e-5 * share.max())
    part, row = np.divmod(kept, last - first)
    return Matches(part, row + first, share[kept] / share[kept].sum(), width)


class _Fit:
    """How well a part fits features (m, used), for any width of the kernel.

    Features are turned and scaled so that the part's own covariance and the kernel's are both diagonal (Golub and Van
    Loan, Matrix Computations, 4th ed., 8.7): the kernel's to one, the part's to `_own` (used,).
    """

    def __init__(self, part: Part, features: FloatArray) -> None:
        used = features.shape[1]
        sigma = np.sqrt(kernel_variance(part.features, used))
        changes = part.changes[:, :used] / sigma
        self._own, axes = np.linalg.eigh(changes.T @ changes)
        self._own = np.maximum(self._own, 0.0)
        self._square = np.square((features - part.features[:used]) @ (axes / sigma[:, None]))
        self._log = part.log_weight - float(np.log(sigma).sum())

    def log_likelihood(self, width: float) -> FloatArray:
        """Return the log likelihood (m,)."""
        variance = self._own + width * width
        log: FloatArray = self._log - 0.5 * float(np.log(variance).sum()) - self._square @ (0.5 / variance)
        return log


def drawn_states(
    parts: Sequence[Part],
    part: IntArray,
    chosen: FloatArray,
    normal: FloatArray,
    width: float,
    moved: Callable[[FloatArray], FloatArray] | None = None,
) -> FloatArray:
    """Return states (p, d), each drawn from a part (p,) given features (p, used) of a chosen boost.

    `normal` (p, d + used) are standard normal numbers. A draw of the prior, moved by its own innovation, is a draw of
    the posterior if features are linear. Where they are not (several parts), the most probable state for the draw's own
    prior and features is sought by Gauss-Newton steps (Oliver, He and Reynolds, "Conditioning permeability fields to
    pressure data", ECMOR V, 1996: randomized maximum likelihood). `moved` is as in `parts_of`.
    """
    used = chosen.shape[1]
    states = np.empty((len(part), len(parts[0].state)))
    for number in np.unique(part).tolist():
        mine, one = np.flatnonzero(part == number), parts[number]
        changes = one.changes[:, :used]
        variance = width * width * kernel_variance(one.features, used)
        free = normal[mine, : len(one.state)]
        goal = chosen[mine] + normal[mine, -used:] * np.sqrt(variance)
        gain = np.linalg.solve(changes.T @ changes + np.diag(variance), changes.T)
        whitened = free + (goal - one.features[:used] - free @ changes) @ gain
        for _ in range(ITERATIONS if len(parts) > 1 else 0):
            whitened = _closer(one, free, whitened, goal, variance, moved)
        states[mine] = one.state + whitened @ one.side.T
    return states


def _closer(
    part: Part,
    free: FloatArray,
    whitened: FloatArray,
    goal: FloatArray,
    variance: FloatArray,
    moved: Callable[[FloatArray], FloatArray] | None,
) -> FloatArray:
    """Return whitened states (p, d) after a Gauss-Newton step from `whitened`, with priors about `free`."""
    used, size = goal.shape[1], free.shape[1]
    shifts = SHIFT * np.concatenate([np.eye(size), -np.eye(size), np.zeros((1, size))])
    points = part.state + (whitened[:, None] + shifts) @ part.side.T
    found = features_of(points if moved is None else moved(points.reshape(-1, points.shape[2])).reshape(points.shape))
    found = found[:, :, :used]
    slopes = (found[:, :size] - found[:, size:-1]) / (2.0 * SHIFT)
    spread = slopes.transpose(0, 2, 1) @ slopes + np.diag(variance)
    off = goal - found[:, -1] - np.einsum("pdu,pd->pu", slopes, free - whitened)
    closer: FloatArray = free + np.einsum("pdu,pu->pd", slopes, np.linalg.solve(spread, off[:, :, None])[:, :, 0])
    return closer
