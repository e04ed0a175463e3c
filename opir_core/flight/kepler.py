"""Two-body propagation of position and velocity: every conic, forward and back, any number of
turns.

Each state is scaled by its own distance and circular speed, solved for its universal anomaly
(`universal_anomaly`) and propagated by Lagrange's f and g (Danby, Fundamentals of Celestial
Mechanics, 2nd ed. 1988, §6.9; Battin, An Introduction to the Mathematics and Methods of
Astrodynamics, revised ed. 1999, §4.5).

From a distant start on an incoming hyperbola Kepler's equation is a difference of exponentials:
solving it loses (r / a e)² where the problem only loses r / a e. Such arcs are solved from their
pericentre, where all terms have one sign. The end point then follows from the pericentre too,
except while the arc is still far out on its way in: there the start is the better reference.
"""

from collections.abc import Callable
from math import isfinite, pi
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from opir_core.arrays import BoolArray, FloatArray, RowArray
from opir_core.constants import EARTH_MU_M3_S2
from opir_core.flight.universal_anomaly import (
    UniversalArcs,
    cross,
    dot,
    solve_bracketed,
    solve_fast,
    universal_functions,
)
from opir_core.geometry.vectors import FloatPair, floats


class ArcStart(NamedTuple):
    """Starts of arcs: columns of the state, and the arc in units of the start's distance and
    circular speed.
    """

    x: FloatArray
    y: FloatArray
    z: FloatArray
    vx: FloatArray
    vy: FloatArray
    vz: FloatArray
    rate: FloatArray  #: circular speed over distance, 1/s
    back: FloatArray  #: -1 for propagation back in time, with the velocity reversed, else 1
    sigma: FloatArray
    alpha: FloatArray
    time: FloatArray  #: without whole turns, never negative; nan where the turns are too many

    def arcs(self) -> UniversalArcs[np.float64]:
        """Return the arguments of Kepler's equation."""
        return UniversalArcs(np.ones_like(self.sigma), self.sigma, self.alpha, self.time)

    def is_inbound_hyperbola(self) -> BoolArray:
        """Return the arcs that come in on a hyperbola from beyond 3 a e and cover about half of the
        way in.
        """
        x = -self.alpha
        eccentricity_squared = 1.0 + x * (2.0 + x - self.sigma * self.sigma)
        return (x > 1.0) & (self.time * self.sigma < -0.5) & (x * x > 9.0 * eccentricity_squared)

    def scales(self) -> FloatPair:
        """Return the distance of each start, m, and the signed factor from its velocity to circular
        speeds.
        """
        distance = np.sqrt(self.x * self.x + self.y * self.y + self.z * self.z)
        return distance, self.back / (distance * self.rate)

    def is_finite(self) -> BoolArray:
        """Return where all numbers are finite."""
        return np.isfinite(self.sigma + self.alpha + self.time + self.rate)

    def at(self, index: RowArray) -> "ArcStart":
        """Return the starts at these indices."""
        return ArcStart(*(column[index] for column in self))


def start_of(
    position_m: FloatArray, velocity_m_s: FloatArray, duration_s: FloatArray, mu_m3_s2: float
) -> ArcStart:
    """Return the starts of arcs from states (n, 3), for durations (n,)."""
    x, y, z = (position_m[:, axis].copy() for axis in range(3))
    vx, vy, vz = (velocity_m_s[:, axis].copy() for axis in range(3))
    distance = np.sqrt(x * x + y * y + z * z)
    speed = np.sqrt(mu_m3_s2 / distance)
    rate = speed / distance
    sigma = (x * vx + y * vy + z * vz) / (distance * speed)
    alpha = 2.0 - (vx * vx + vy * vy + vz * vz) / (speed * speed)
    time = _without_turns(duration_s * rate, alpha)
    back = np.copysign(1.0, time)
    return ArcStart(x, y, z, vx, vy, vz, rate, back, sigma * back, alpha, np.abs(time))


def _without_turns(time: FloatArray, alpha: FloatArray) -> FloatArray:
    """Return the time less the nearest whole turns of closed orbits: at most half a period, of
    either sign.
    """
    per_time = np.abs(alpha) * np.sqrt(np.abs(alpha)) * (0.5 / pi)
    turns = np.rint(time * per_time)
    turns[alpha <= 0.0] = 0.0
    if not turns.any():
        return time
    turned = turns / np.where(turns != 0.0, per_time, 1.0)
    # Beyond this number of turns double precision holds no digit of the phase.
    return np.where(np.abs(turns) > 2.0**50, np.nan, time - turned)


class Flybys(NamedTuple):
    """Incoming hyperbolas by their pericentre; units of each start (distance and mu are 1), vectors
    (3, n).
    """

    position: FloatArray
    velocity: FloatArray
    alpha: FloatArray
    time: FloatArray
    eccentricity: FloatArray
    pericentre: FloatArray  #: distance
    to_pericentre: FloatArray  #: unit vector to the pericentre
    sideways: FloatArray  #: velocity there times the distance; zero on a straight line
    approach: FloatArray  #: universal anomaly from the start to the pericentre
    later: FloatArray  #: time since the pericentre; negative before it

    def arcs(self) -> UniversalArcs[np.float64]:
        """Return the arguments of Kepler's equation, from the pericentre, without sign."""
        return UniversalArcs(
            self.pericentre, np.zeros_like(self.later), self.alpha, np.abs(self.later)
        )

    def states(self, solution: FloatArray) -> FloatPair:
        """Return positions and velocities, (3, n), at the solved anomalies."""
        s, g0, g1, g2 = solution
        g1 = np.copysign(g1, self.later)
        r = self.pericentre * g0 + g2
        position = (self.pericentre - g2) * self.to_pericentre + g1 * self.sideways
        velocity = (g0 * self.sideways - g1 * self.to_pericentre) / r
        # Within this many a e of the centre on the way in, the pericentre is as good a reference
        # as the start.
        at = np.flatnonzero((self.later < 0.0) & (-self.alpha * r > 3.0 * self.eccentricity))
        if at.size:
            position[:, at], velocity[:, at] = self._on_the_way_in(at, s[at], r[at])
        return position, velocity

    def _on_the_way_in(self, at: RowArray, s: FloatArray, r: FloatArray) -> FloatPair:
        """Return positions and velocities of some arcs from their starts, by Lagrange's f and g."""
        _, g1, g2, g3 = universal_functions(self.alpha[at], self.approach[at] - s)
        position = self.position[:, at]
        velocity = self.velocity[:, at]
        moved = (1.0 - g2) * position + (self.time[at] - g3) * velocity
        return moved, (1.0 - g2 / r) * velocity - g1 / r * position


def flybys(
    position: FloatArray, velocity: FloatArray, alpha: FloatArray, time: FloatArray
) -> Flybys:
    """Return the incoming hyperbolas (`alpha` < 0) from these states (3, n), for `time` >= 0.

    The vector to the pericentre is v × h - r / |r|: with cross products it keeps its accuracy on
    nearly straight lines.
    """
    momentum = cross(position, velocity)
    momentum_squared = dot(momentum, momentum)
    eccentricity = np.sqrt(1.0 - alpha * momentum_squared)
    to_pericentre = (cross(velocity, momentum) - position) / eccentricity
    k = np.sqrt(-alpha)
    rise = -dot(position, velocity) * k
    approach = np.arcsinh(rise / eccentricity)
    later = time - (rise - approach) / (k * k * k)
    pericentre = momentum_squared / (1.0 + eccentricity)
    sideways = cross(momentum, to_pericentre)
    return Flybys(
        position,
        velocity,
        alpha,
        time,
        eccentricity,
        pericentre,
        to_pericentre,
        sideways,
        approach / k,
        later,
    )


Solver = Callable[[UniversalArcs[np.float64]], tuple[FloatArray, BoolArray]]

#: States per block: few enough for the arrays of a block to stay in the cache.
_BLOCK = 16384


def propagate_kepler(
    position_m: ArrayLike,
    velocity_m_s: ArrayLike,
    duration_s: ArrayLike,
    mu_m3_s2: float = EARTH_MU_M3_S2,
) -> FloatPair:
    """Return position, m, and velocity, m/s, after `duration_s` on the two-body arc through the
    given state.

    Position and velocity have shape (..., 3), in any inertial frame centred on the attracting body;
    leading axes broadcast with the shape of `duration_s`, which may be negative. `mu_m3_s2` is one
    positive number. Ellipses over any number of turns, parabolas, hyperbolas and straight lines; a
    straight line through the centre is reflected, the limit of thin ellipses.

    The relative error of the position is below 1e-12, or below ten times the effect of rounding
    each input to double precision. `nan` where an input is not finite, where the arc starts or ends
    in the centre of attraction, where squares or products of the inputs leave the range of double
    precision, and beyond 2^50 turns, which leave no digit of the phase. An element has the same
    bits alone and in any batch.
    """
    if not (isfinite(mu_m3_s2) and mu_m3_s2 > 0.0):
        raise ValueError(f"mu_m3_s2 must be positive and finite, got {mu_m3_s2}")
    position, velocity, duration, shape = flat_states(position_m, velocity_m_s, duration_s)
    with np.errstate(all="ignore"):
        end = _in_blocks(position, velocity, duration, float(mu_m3_s2))
    return end[0].reshape(*shape, 3), end[1].reshape(*shape, 3)


def flat_states(
    vectors_1: ArrayLike, vectors_2: ArrayLike, scalar: ArrayLike
) -> tuple[FloatArray, FloatArray, FloatArray, tuple[int, ...]]:
    """Return two vectors (n, 3) and a number (n,) of each element, broadcast together, and their
    common shape.
    """
    vectors_1, vectors_2, scalars = (floats(x) for x in (vectors_1, vectors_2, scalar))
    for vectors in (vectors_1, vectors_2):
        if vectors.ndim == 0 or vectors.shape[-1] != 3:
            raise ValueError(
                f"expected vectors with a last axis of 3 (x, y, z), got shape {vectors.shape}"
            )
    shape = np.broadcast_shapes(vectors_1.shape[:-1], vectors_2.shape[:-1], scalars.shape)
    vectors_1, vectors_2 = (
        x if x.shape[:-1] == shape else np.broadcast_to(x, (*shape, 3))
        for x in (vectors_1, vectors_2)
    )
    return (
        vectors_1.reshape(-1, 3),
        vectors_2.reshape(-1, 3),
        np.broadcast_to(scalars, shape).reshape(-1),
        shape,
    )


def _in_blocks(
    position: FloatArray, velocity: FloatArray, duration: FloatArray, mu: float
) -> FloatArray:
    """Return the end states (2, n, 3): a fast pass in blocks, then the remaining states
    together.
    """
    end = np.empty((2, duration.size, 3))
    unsolved = [np.empty(0, np.intp)]
    for begin in range(0, duration.size, _BLOCK):
        block = slice(begin, begin + _BLOCK)
        start = start_of(position[block], velocity[block], duration[block], mu)
        unfinished = _propagate_with(start, solve_fast, end[:, block])
        if not np.isfinite(end[:, block].sum()):
            unfinished |= ~np.isfinite(end[:, block]).all(axis=(0, 2))
        unsolved.append(begin + np.flatnonzero(unfinished))
    at = np.concatenate(unsolved)
    for begin in range(0, at.size, _BLOCK):
        rows = at[begin : begin + _BLOCK]
        end[:, rows] = _bracketed(position[rows], velocity[rows], duration[rows], mu)
    return end


def _bracketed(
    position: FloatArray, velocity: FloatArray, duration: FloatArray, mu: float
) -> FloatArray:
    """Return end states (2, n, 3) of the states without a solution in the fast pass."""
    start = start_of(position, velocity, duration, mu)
    at = np.flatnonzero(start.is_finite())
    followed = np.empty((2, at.size, 3))
    _propagate_with(start.at(at), solve_bracketed, followed)
    end = np.full((2, duration.size, 3), np.nan)
    end[:, at] = followed
    end[:, ~np.isfinite(end).all(axis=(0, 2))] = np.nan
    return end


def _propagate_with(start: ArcStart, solver: Solver, end: FloatArray) -> BoolArray:
    """Write position and velocity at the end of each arc into `end` (2, n, 3); return the arcs
    without a solution.
    """
    arcs = start.arcs()
    at = np.flatnonzero(start.is_inbound_hyperbola())
    if not at.size:
        solution, unsolved = solver(arcs)
        _move(start, solution, end)
        return unsolved
    hyperbolas = start.at(at)
    distance, to_speed = hyperbolas.scales()
    by = flybys(
        np.stack(hyperbolas[:3]) / distance,
        np.stack(hyperbolas[3:6]) * to_speed,
        hyperbolas.alpha,
        hyperbolas.time,
    )
    arcs = UniversalArcs(*(column.copy() for column in arcs))
    for column, values in zip(arcs, by.arcs(), strict=True):
        column[at] = values
    solution, unsolved = solver(arcs)
    _move(start, solution, end)
    end_position, end_velocity = by.states(solution[:, at])
    end[0, at] = (end_position * distance).T
    end[1, at] = (end_velocity / to_speed).T
    return unsolved


def _move(start: ArcStart, solution: FloatArray, end: FloatArray) -> None:
    """Write position and velocity after the solved anomaly into `end`, (2, n, 3), by Lagrange's f
    and g.
    """
    x, y, z, vx, vy, vz, rate, back, sigma, _, _ = start
    _, g0, g1, g2 = solution
    radial = g0 + sigma * g1
    r = radial + g2
    f = 1.0 - g2
    g = (g1 + sigma * g2) * back / rate
    f_rate = g1 * back * rate / -r
    g_rate = radial / r
    for row, (from_position, from_velocity) in enumerate(((f, g), (f_rate, g_rate))):
        for axis, (start_position, start_velocity) in enumerate(((x, vx), (y, vy), (z, vz))):
            np.add(
                from_position * start_position,
                from_velocity * start_velocity,
                out=end[row, :, axis],
            )
