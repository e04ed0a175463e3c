"""Boost with thrust along the velocity: a gravity turn whose specific force slowly grows, in the
inertial frame.

A state (10) is position, velocity, specific force f (all but gravity) and its relative growth rate
κ, 1/s. The force turns with the velocity relative to the rotating air (drag acts along it too).
Across the velocity f is an Ornstein–Uhlenbeck process of time constant τ and standard deviation
tan(tilt) |f|, more while it pitches over; along it, a random walk about its growth (Bar-Shalom, Li
and Kirubarajan, "Estimation with Applications to Tracking and Navigation", 2001, 8.2). Units m, s.

The `_of_one` functions compute a single state with plain numbers, as in
`opir_core.estimation.motion`: the same operations in the same order give the same bits.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache
from math import sqrt, tan
from typing import Any

import numpy as np
from attrs import Factory, field, frozen

from opir_core.arrays import FloatArray
from opir_core.constants import EARTH_ROTATION_RAD_S
from opir_core.estimation import (
    BOOST,
    COAST,
    FEW_STATES,
    GravityFunction,
    Motion,
    dot,
    gradient_of_one,
    integrator_noise,
    matvec,
    stepped_one as stepped_motion,
    substeps,
    taylor_of_one as taylor_of_motion,
)
from opir_core.flight import Forces

#: Below this speed, m/s, the direction of the velocity says little about that of the thrust; at
#: rest, nothing: 1 m²/s² is added to squared speeds.
SLOW_M_S = 100.0

#: Process-noise density across the velocity, as a share of the force, 1/√s, that a pitch-over adds
#: below about this speed, m/s. Under the tracker's law of boosts the thrust is off the velocity by
#: 7 to 8.5° (root mean square) at 100 to 400 m/s with a correlation time of 14 s, by 3.6° at 700
#: m/s, and by 2.5° beyond 1 km/s for longer: with the usual tilt its noise is within a third of
#: this curve from 50 to 1 200 m/s (`docs/design/pitch_over.py`).
PITCH_OVER_SHARE = 0.045
PITCH_OVER_M_S = 600.0

#: Up to this growth, 1/s, thrust and mass flow are constant: κ' = κ². A stage of 40 s whose
#: acceleration triples ends with it; beyond, κ stays: carried on in the dark, a stage would burn up
#: all its mass.
MOST_GROWTH = 0.05

_SPIN = EARTH_ROTATION_RAD_S


def jerk_of_one(
    numbers: Sequence[Any], tilt_s: float, root: Callable[[Any], Any]
) -> tuple[Any, Any, Any]:
    """Return the rate of the specific force from a state and its gravity, 13 numbers or columns
    (n,), the same bits.

    ḟ = κ f + (f·u) u̇ - w/τ (f - (f·u) u), with u̇ the rate of the velocity's direction and w the
    weight of a slow velocity.
    """
    x, y, _, vx, vy, vz, fx, fy, fz, growth, gx, gy, gz = numbers
    ax = gx + fx + _SPIN * vy
    ay = gy + fy - _SPIN * vx
    az = gz + fz
    vx = vx + _SPIN * y
    vy = vy - _SPIN * x
    square = vx * vx + vy * vy + vz * vz
    speed = root(square + 1.0)
    ux = vx / speed
    uy = vy / speed
    uz = vz / speed
    soft = 1.0 / (square + SLOW_M_S * SLOW_M_S)
    lift = fx * ux + fy * uy + fz * uz
    ahead = ax * ux + ay * uy + az * uz
    turn = lift * speed * soft
    pull = square * soft / tilt_s
    own = growth - pull
    back = pull * lift - turn * ahead
    return (
        own * fx + turn * ax + back * ux,
        own * fy + turn * ay + back * uy,
        own * fz + turn * az + back * uz,
    )


def stepped_one(
    state: Sequence[float], step: float, tilt_s: float, pull: GravityFunction
) -> list[float]:
    """Return a state of 10 after one step, the same bits as `Thrust`."""
    gravity = pull(*state[:3])
    early = jerk_of_one((*state, *gravity[:3]), tilt_s, sqrt)
    after = stepped_motion([*state[:9], *early], step, pull, gravity)[:9]
    growth = state[9]
    if growth < MOST_GROWTH:
        growth = min(growth / (1.0 - growth * step), MOST_GROWTH)
    late = jerk_of_one((*after, growth, *pull(*after[:3])[:3]), tilt_s, sqrt)
    x, y, z, vx, vy, vz, fx, fy, fz = after
    bx = late[0] - early[0]
    by = late[1] - early[1]
    bz = late[2] - early[2]
    far = step**3 / 24.0
    fast = step**2 / 6.0
    more = step / 2.0
    place = (x + bx * far, y + by * far, z + bz * far)
    speed = (vx + bx * fast, vy + by * fast, vz + bz * fast)
    return [*place, *speed, fx + bx * more, fy + by * more, fz + bz * more, growth]


def taylor_of_one(
    state: Sequence[float], tilt_s: float, pull: GravityFunction, mu_m3_s2: float
) -> list[float]:
    """Return the position derivatives of order 0 to 4 of a state of 10, the same bits as
    `Thrust`.
    """
    gravity = pull(*state[:3])
    rate = jerk_of_one((*state, *gravity[:3]), tilt_s, sqrt)
    return taylor_of_motion([*state[:9], *rate], gravity, mu_m3_s2)


def slopes_of_one(state: Sequence[float], tilt_s: float, gravity: Sequence[float]) -> list[float]:
    """Return the Jacobian of the force's rate by velocity, force and growth, three rows of seven.

    As `Thrust.force_slopes`, but for rounding.
    """
    x, y, _, wx, wy, vz, fx, fy, fz, growth = state
    vx = wx + _SPIN * y
    vy = wy - _SPIN * x
    pull = 1.0 / tilt_s
    square = vx * vx + vy * vy + vz * vz
    speed = sqrt(square + 1.0)
    soft = 1.0 / (square + SLOW_M_S * SLOW_M_S)
    turn = speed * soft
    fast = square * soft
    unit = ux, uy, uz = vx / speed, vy / speed, vz / speed
    px = gravity[0] + fx + _SPIN * wy
    py = gravity[1] + fy - _SPIN * wx
    pz = gravity[2] + fz
    ahead = ux * px + uy * py + uz * pz
    lift = ux * fx + uy * fy + uz * fz
    bend = bx, by, bz = px - ux * ahead, py - uy * ahead, pz - uz * ahead
    across = cx, cy, cz = fx - ux * lift, fy - uy * lift, fz - uz * lift
    same = lift * (turn * pull - soft * ahead)
    other = lift * turn - fast * pull
    first = lift * soft
    second = turn * pull
    third = lift * soft * (1.0 - 2.0 * fast)
    fourth = -2.0 * pull * turn * (1.0 - fast)
    own = growth + other
    rows: list[float] = []
    for k, (u, b, c, f) in enumerate(zip(unit, bend, across, (fx, fy, fz), strict=True)):
        p = third * b + fourth * c - same * u
        q = -first * u
        r = second * u + soft * b
        s = turn * b - other * u
        row = [
            p * ux + q * bx + r * cx,
            p * uy + q * by + r * cy,
            p * uz + q * bz + r * cz,
            s * ux,
            s * uy,
            s * uz,
            f,
        ]
        row[k] += same
        row[3 + k] += own
        rows += row
    return rows


def across_share_at(late: float, square_speed: Any) -> Any:
    """Return the process-noise density of the force across the velocity, as a share of the force,
    1/√s.

    It is `late` for a fast boost, and more for one that pitches over: `PITCH_OVER_SHARE`.
    `square_speed` is the squared speed, m²/s².
    """
    return late + PITCH_OVER_SHARE / (1.0 + (square_speed / PITCH_OVER_M_S**2) ** 2)


def side_of_one(state: Sequence[float], across_share: float, along_noise: float) -> list[float]:
    """Return a root of the force's process noise per second, 9 numbers by row.

    Across the velocity it is `across_share` of the force, along it `along_noise`, m/s²/√s.
    """
    x, y, _, wx, wy, vz, fx, fy, fz, _ = state
    velocity = wx + _SPIN * y, wy - _SPIN * x, vz
    square = velocity[0] ** 2 + velocity[1] ** 2 + velocity[2] ** 2
    across = across_share_at(across_share, square) * sqrt(fx * fx + fy * fy + fz * fz)
    share = (along_noise - across) / (square + 1.0)
    u, v, w = velocity
    xy = share * u * v
    xz = share * u * w
    yz = share * v * w
    return [
        share * u * u + across,
        xy,
        xz,
        xy,
        share * v * v + across,
        yz,
        xz,
        yz,
        share * w * w + across,
    ]


#: State size.
THRUST = 10

#: Longest step, s: with τ of 15 s, the trapezoidal error of the decay towards the velocity is below
#: 1e-3.
_LONGEST_STEP_S = 2.5

_UNIT = np.eye(3)
_WHOLE = np.eye(THRUST)
_HALF = 0.5 * np.eye(THRUST)


@frozen(eq=False)
class Thrust:
    """The motion model of a boost along its velocity.

    `tilt_rad` and `tilt_s` are the standard deviation and the correlation time of the angle between
    thrust and velocity; `noise_m_s2` is the process-noise density of the force along the velocity,
    m/s²/√s, `growth_noise` that of κ, 1/s/√s.
    """

    #: States move alike however well they are known.
    about = None

    tilt_rad: float
    tilt_s: float
    noise_m_s2: float
    growth_noise: float
    forces: Forces
    size: int = field(default=THRUST, init=False)
    #: Free flight, and flight with a given force, under the same gravity.
    fall: Motion = field(
        default=Factory(lambda self: Motion(COAST, 0.0, self.forces), takes_self=True), init=False
    )
    pushed: Motion = field(
        default=Factory(lambda self: Motion(BOOST, 0.0, self.forces), takes_self=True), init=False
    )

    @property
    def _pull(self) -> GravityFunction:
        return self.fall.field.alone_with_inverse_radius

    def propagated(self, state: FloatArray, step_s: FloatArray) -> FloatArray:
        """Return states (n, 10) after steps (n,), s."""
        pieces = substeps(step_s, _LONGEST_STEP_S)
        if pieces > 1:
            step_s = step_s / pieces
        for _ in range(pieces):
            state = self._stepped(state, step_s)
        return state

    def _stepped(self, state: FloatArray, step_s: FloatArray) -> FloatArray:
        """Return states after one step: Nyström for the path, the trapezoidal rule for the force.

        The rate of the force is linear from its value at the start to that where a constant rate
        leads.
        """
        if len(state) <= FEW_STATES:
            rows = zip(state.tolist(), step_s.tolist(), strict=True)
            return np.array([stepped_one(row, step, self.tilt_s, self._pull) for row, step in rows])
        early = self.jerk(state)
        path = np.concatenate([state[:, :9], early], axis=1)
        growth = state[:, 9]
        grown = np.minimum(growth / (1.0 - growth * step_s), MOST_GROWTH)
        growth = np.where(growth < MOST_GROWTH, grown, growth)
        after = np.concatenate([self.pushed.stepped(path, step_s)[:, :9], growth[:, None]], axis=1)
        bend = self.jerk(after) - early
        step = step_s[:, None]
        after[:, :3] += bend * (step**3 / 24.0)
        after[:, 3:6] += bend * (step**2 / 6.0)
        after[:, 6:9] += bend * (step / 2.0)
        return after

    def jerk(self, state: FloatArray) -> FloatArray:
        """Return the rates (n, 3) of the specific forces of states (n, 10), m/s³."""
        with_gravity = np.concatenate([state, self.fall.gravity(state[:, :3])], axis=1)
        columns: list[FloatArray] = list(np.ascontiguousarray(with_gravity.T))
        return np.stack(jerk_of_one(columns, self.tilt_s, np.sqrt), axis=1)

    def transition(self, state: FloatArray, step_s: FloatArray) -> FloatArray:
        """Return the transition matrices (n, 10, 10) of steps (n,): the exponential series with a
        constant Jacobian.
        """
        scaled = self.slopes(state)
        scaled *= step_s[:, None, None]
        square = scaled @ scaled
        later = square / 24.0
        later += scaled / 6.0
        later += _HALF
        series: FloatArray = square @ later
        series += scaled
        series += _WHOLE
        return series

    def slopes(self, state: FloatArray) -> FloatArray:
        """Return the Jacobian (n, 10, 10) of the state's rate, 1/s."""
        if len(state) == 1:
            return self._slopes_of_one(state[0].tolist())
        rate = np.zeros((len(state), THRUST, THRUST))
        rate[:, :3, 3:6] = rate[:, 3:6, 6:9] = _UNIT
        rate[:, 3:6, :3] = self.fall.gradient(state[:, :3])
        rate[:, 6:9, 3:] = self.force_slopes(state)
        rate[:, 9, 9] = np.where(state[:, 9] < MOST_GROWTH, 2.0 * state[:, 9], 0.0)
        return rate

    def _slopes_of_one(self, numbers: list[float]) -> FloatArray:
        place = numbers[:3]
        alone = slopes_of_one(numbers, self.tilt_s, self._pull(*place))
        alone += gradient_of_one(place, self.forces.gravity.mu_m3_s2)
        numbers_ = np.array(alone)
        rate = _KINEMATICS.copy()
        rate[0, 6:9, 3:] = numbers_[:21].reshape(3, 7)
        rate[0, 3:6, :3] = numbers_[21:].reshape(3, 3)
        rate[0, 9, 9] = 2.0 * numbers[9] if numbers[9] < MOST_GROWTH else 0.0
        return rate

    def force_slopes(self, state: FloatArray) -> FloatArray:
        """Return the Jacobian (n, 3, 7) of `jerk` by velocity, force and growth.

        In terms of the velocity's direction u, its rate b, and the force across it, all else is a
        multiple of the unit matrix. The dependence of the air's motion on the position is
        neglected.
        """
        if len(state) == 1:
            (numbers,) = state.tolist()
            alone = slopes_of_one(numbers, self.tilt_s, self._pull(*numbers[:3]))
            return np.array(alone).reshape(1, 3, THRUST - 3)
        count = len(state)
        pull = 1.0 / self.tilt_s
        velocity = air_velocity(state)
        force = state[:, 6:9]
        square = dot(velocity, velocity)
        speed = np.sqrt(square + 1.0)
        unit = velocity / speed[:, None]
        soft = 1.0 / (square + SLOW_M_S**2)
        turn = speed * soft
        fast = square * soft
        push = self.fall.gravity(state[:, :3]) + force - _AIR * state[:, [4, 3, 5]]
        ahead = dot(unit, push)
        lift = dot(unit, force)
        bend = push - unit * ahead[:, None]
        across = force - unit * lift[:, None]
        basis = np.stack([unit, bend, across], axis=1)
        same = lift * (turn * pull - soft * ahead)
        other = lift * turn - fast * pull
        weigh = np.zeros((2, count, 3, 3))
        weigh[0, :, 0, 0] = -same
        weigh[0, :, 0, 1] = -lift * soft
        weigh[0, :, 0, 2] = turn * pull
        weigh[0, :, 1, 0] = lift * soft * (1.0 - 2.0 * fast)
        weigh[0, :, 1, 2] = soft
        weigh[0, :, 2, 0] = -2.0 * pull * turn * (1.0 - fast)
        weigh[1, :, 0, 0] = -other
        weigh[1, :, 1, 0] = turn
        both = basis.transpose(0, 2, 1) @ (weigh @ basis)
        slopes = np.empty((count, 3, THRUST - 3))
        slopes[:, :, :3] = both[0] + same[:, None, None] * _UNIT
        slopes[:, :, 3:6] = both[1] + (state[:, 9] + other)[:, None, None] * _UNIT
        slopes[:, :, 6] = force
        return slopes

    def noise_root(self, step_s: FloatArray, state: FloatArray) -> FloatArray:
        """Return L (n, 10, 10) with L Lᵀ the process-noise covariance of steps (n,) from states."""
        if len(state) == 1:
            return self._noise_root_of_one(abs(float(step_s[0])), state)
        velocity = air_velocity(state)
        force = state[:, 6:9]
        square = dot(velocity, velocity)
        share = across_share_at(tan(self.tilt_rad) * sqrt(2.0 / self.tilt_s), square)
        across = share * np.sqrt(dot(force, force))
        along_it = (self.noise_m_s2 - across) / (square + 1.0)
        side = (
            along_it[:, None, None] * velocity[:, :, None] * velocity[:, None, :]
            + across[:, None, None] * _UNIT
        )
        step = np.abs(step_s)
        small = (step[:, None] ** _POWERS)[:, :, None] * _CHAIN
        root = np.zeros((len(state), THRUST, THRUST))
        root[:, :9, :9] = (small[:, :, None, :, None] * side[:, None, :, None, :]).reshape(
            len(state), 9, 9
        )
        root[:, 9, 9] = self.growth_noise * np.sqrt(step)
        return root

    def _noise_root_of_one(self, step_s: float, state: FloatArray) -> FloatArray:
        share = tan(self.tilt_rad) * sqrt(2.0 / self.tilt_s)
        side = np.array(side_of_one(state[0].tolist(), share, self.noise_m_s2)).reshape(3, 1, 3)
        root = np.zeros((1, THRUST, THRUST))
        np.multiply(_chain(step_s), side, out=root[0, :9, :9].reshape(3, 3, 3, 3))
        root[0, 9, 9] = self.growth_noise * sqrt(step_s)
        return root

    def taylor(self, state: FloatArray) -> FloatArray:
        """Return the position derivatives (n, 5, 3) of order 0 to 4."""
        if len(state) <= FEW_STATES:
            pull = self._pull
            mu = self.forces.gravity.mu_m3_s2
            rows = [taylor_of_one(row, self.tilt_s, pull, mu) for row in state.tolist()]
            return np.array(rows).reshape(-1, 5, 3)
        path = np.concatenate([state[:, :9], self.jerk(state)], axis=1)
        return self.pushed.taylor(path)

    def measurement_rows(
        self, slope: FloatArray, weight: FloatArray, state: FloatArray
    ) -> FloatArray:
        """Return the whitened Jacobian (m, 2, 10) by the state from that by the position (m, 2, 3),
        1/m.

        `weight` (m, 5) are the Taylor weights of the looks, `state` (m, 10) the states of their
        tracks, or (1, 10) one for all.
        """
        rows = np.empty((len(slope), 2, THRUST))
        rows[:, :, :9] = (slope[:, :, None, :] * weight[:, None, :3, None]).reshape(
            len(slope), 2, 9
        )
        if len(state) == 1:
            rows[:, :, 9] = (slope.reshape(-1, 3) @ state[0, 6:9]).reshape(-1, 2) * weight[
                :, 3, None
            ]
        else:
            rows[:, :, 9] = matvec(slope, state[:, 6:9]) * weight[:, 3, None]
        return rows

    def derivative_roots(self, state: FloatArray, side: FloatArray) -> FloatArray:
        """Return covariance roots (n, 12, 12) of four position derivatives from those of states,
        (n, 10, 10).
        """
        out = np.zeros((len(state), BOOST, BOOST))
        out[:, :9, :THRUST] = side[:, :9]
        out[:, 9:, :THRUST] = self.force_slopes(state) @ side[:, 3:]
        return out


def air_velocity(state: FloatArray) -> FloatArray:
    """Return the velocity (n, 3) of states relative to the rotating air."""
    velocity: FloatArray = state[:, 3:6] - _AIR * state[:, [1, 0, 2]]
    return velocity


def _kinematics() -> FloatArray:
    """Return the Jacobian (1, 10, 10) of the kinematic part."""
    rate = np.zeros((1, THRUST, THRUST))
    rate[0, :3, 3:6] = rate[0, 3:6, 6:9] = _UNIT
    return rate


_KINEMATICS = _kinematics()


#: The velocity of the air at (x, y, z) is this times (y, x, z).
_AIR = np.array([-_SPIN, _SPIN, 0.0])

_POWERS = np.array([2.5, 1.5, 0.5])
_CHAIN = integrator_noise(3)


@lru_cache(maxsize=64)
def _chain(step_s: float) -> FloatArray:
    """Return the noise root of a chain of integrators per axis over a step, (3, 1, 3, 1)."""
    chain: FloatArray = ((step_s**_POWERS)[:, None] * _CHAIN)[:, None, :, None]
    chain.flags.writeable = False
    return chain
