"""Boost with thrust along the velocity: a gravity turn whose specific force slowly grows, in the
inertial frame.

A state (10) is position, velocity, specific force f (all but gravity) and its relative growth rate
κ, 1/s. The force turns with the velocity relative to the rotating air (drag acts along it too).
Across the velocity f is an Ornstein–Uhlenbeck process of time constant τ and standard deviation
tan(tilt) |f|, more while it pitches over; along it, a random walk about its growth (Bar-Shalom, Li
and Kirubarajan, "Estimation with Applications to Tracking and Navigation", 2001, 8.2). Units m, s.
"""

from math import sqrt, tan
from typing import Any

import numpy as np
from attrs import Factory, field, frozen

from opir_core.arrays import FloatArray
from opir_core.constants import EARTH_ROTATION_RAD_S
from opir_core.flight import Forces
from opir_estimation.filter.motion_model import (
    KINEMATICS,
    LONGEST_STEP_S,
    MOST_GROWTH,
    THRUST,
    MotionModel,
)
from opir_estimation.formulas import Functions, Vector
from opir_estimation.motion import (
    COAST,
    Motion,
    chain_roots,
    gravity_gradient,
    stepped_state,
    substeps,
    taylor_series,
)

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

_SPIN = EARTH_ROTATION_RAD_S


#: Of a state: direction of the velocity relative to the air, acceleration relative to the air,
#: specific force, squared speed, speed, 1 / (v² + `SLOW_M_S`²), and force and acceleration along
#: the velocity.
_Course = tuple[Vector, Vector, Vector, Any, Any, Any, Any, Any]


#: Of the slopes of the force's rate: a basis of three vectors, the velocity's direction, its rate
#: and the force across it; the elements of matrices W in this basis that are not 0; and multiples
#: of the unit matrix. Slopes by velocity, and by force, are Bᵀ W B + c I.
_SlopeTerms = tuple[Vector, Vector, Vector, tuple[Any, ...], Any, Any]


def _course(state: Vector, functions: Functions) -> _Course:
    x, y, z, vx, vy, vz, *force = state[:9]
    ax, ay, az = functions.gravity(x, y, z)[:3]
    push = ax + force[0] + _SPIN * vy, ay + force[1] - _SPIN * vx, az + force[2]
    vx = vx + _SPIN * y
    vy = vy - _SPIN * x
    square = vx * vx + vy * vy + vz * vz
    speed = functions.sqrt(square + 1.0)
    unit = vx / speed, vy / speed, vz / speed
    soft = 1.0 / (square + SLOW_M_S * SLOW_M_S)
    ux, uy, uz = unit
    force_along = force[0] * ux + force[1] * uy + force[2] * uz
    push_along = push[0] * ux + push[1] * uy + push[2] * uz
    return unit, push, force, square, speed, soft, force_along, push_along


def across_share_at(steady: float, square_speed: Any) -> Any:
    """Return the process-noise density of the force across the velocity, as a share of the force,
    1/√s.

    It is `steady` for a fast boost, and more for one that pitches over: `PITCH_OVER_SHARE`.
    `square_speed` is the squared speed, m²/s².
    """
    return steady + PITCH_OVER_SHARE / (1.0 + (square_speed / PITCH_OVER_M_S**2) ** 2)


def _jacobian(other_slopes: FloatArray, force_slopes: FloatArray) -> FloatArray:
    """Return Jacobians (n, 10, 10) of gravity gradients with slopes of the growth's rate (n, 10), and
    slopes of the force's rate (n, 3, 7).
    """
    rate = KINEMATICS.repeat(len(other_slopes), axis=0)
    rate[:, 3:6, :3] = other_slopes[:, :9].reshape(-1, 3, 3)
    rate[:, 6:9, 3:] = force_slopes
    rate[:, 9, 9] = other_slopes[:, 9]
    return rate


@frozen(eq=False)
class Thrust(MotionModel):
    """The motion model of a boost along its velocity.

    `tilt_rad` and `tilt_s` are the standard deviation and the correlation time of the angle between
    thrust and velocity; `noise_m_s2` is the process-noise density of the force along the velocity,
    m/s²/√s, `growth_noise` that of κ, 1/s/√s.
    """

    tilt_rad: float
    tilt_s: float
    noise_m_s2: float
    growth_noise: float
    forces: Forces
    #: Process-noise density of the force across a fast velocity, as a share of the force, 1/√s.
    _steady: float = field(
        default=Factory(lambda self: tan(self.tilt_rad) * sqrt(2.0 / self.tilt_s), takes_self=True),
        init=False,
    )
    #: Free flight under the same gravity.
    fall: Motion = field(
        default=Factory(lambda self: Motion(COAST, 0.0, self.forces), takes_self=True), init=False
    )

    def propagated(self, state: FloatArray, step_s: FloatArray) -> FloatArray:
        """Return states (n, 10) after steps (n,), s."""
        pieces = substeps(step_s, LONGEST_STEP_S)
        if pieces > 1:
            step_s = step_s / pieces
        for _ in range(pieces):
            state = self.fall.arithmetic.values(self._stepped, state, step_s)
        return state

    def _stepped(self, state: Vector, step: Any, functions: Functions) -> list[Any]:
        """Return a state after one step: Nyström for the path, the trapezoidal rule for the force.

        The rate of the force is linear from its value at the start to that where a constant rate
        leads.
        """
        jx, jy, jz = self._force_rate(state, functions)
        path = stepped_state([*state[:9], jx, jy, jz], step, functions)
        growth = state[9]
        grown = functions.least(growth / (1.0 - growth * step), MOST_GROWTH)
        growth = functions.where(growth < MOST_GROWTH, grown, growth)
        path[9] = growth
        ex, ey, ez = self._force_rate(path, functions)
        ex = ex + -1.0 * jx
        ey = ey + -1.0 * jy
        ez = ez + -1.0 * jz
        by_position = step**3 / 24.0
        by_velocity = step**2 / 6.0
        by_force = step / 2.0
        x, y, z, u, v, w, fx, fy, fz = path[:9]
        position = (x + by_position * ex, y + by_position * ey, z + by_position * ez)
        velocity = (u + by_velocity * ex, v + by_velocity * ey, w + by_velocity * ez)
        force = (fx + by_force * ex, fy + by_force * ey, fz + by_force * ez)
        return [*position, *velocity, *force, growth]

    def across_share(self, square_speed: FloatArray) -> FloatArray:
        """Return the process-noise densities (n,) of the force across the velocity, as shares of the
        force, 1/√s, at squared speeds through the air.
        """
        return np.asarray(across_share_at(self._steady, square_speed))

    def force_rate(self, state: FloatArray) -> FloatArray:
        """Return the rates (n, 3) of the specific forces of states (n, 10), m/s³."""
        return self.fall.arithmetic.values(self._force_rate, state)

    def _force_rate(self, state: Vector, functions: Functions) -> Vector:
        """Return ḟ = κ f + (f·u) u̇ - w/τ (f - (f·u) u), with u̇ the rate of the velocity's
        direction and w the weight of a slow velocity.
        """
        unit, push, force, square, speed, soft, force_along, push_along = _course(state, functions)
        turn = force_along * speed * soft
        pull = square * soft / self.tilt_s
        grown = state[9] - pull
        back = pull * force_along - turn * push_along
        fx, fy, fz = force
        ax, ay, az = push
        ux, uy, uz = unit
        return (
            grown * fx + turn * ax + back * ux,
            grown * fy + turn * ay + back * uy,
            grown * fz + turn * az + back * uz,
        )

    def step(
        self, state: FloatArray, step_s: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return states after steps, transition matrices back, and roots of the process noise; those
        of a lone state and a short step by one formula.
        """
        if state.shape[0] > 1 or abs(step_s[0]) > LONGEST_STEP_S:
            return super().step(state, step_s)
        numbers = self.fall.arithmetic.numbers
        lone = self._step_values(state[0].tolist(), step_s.item(), numbers)
        values = np.array(lone)
        rate = _jacobian(values[None, 10:20], values[20:41].reshape(3, 7))
        back = self.series(rate, -step_s)
        return values[None, :10].copy(), back, self._noise_root(np.abs(step_s), values[None, 41:])

    def _step_values(self, state: Vector, step: Any, functions: Functions) -> list[Any]:
        """Return a state after a step (10), the slopes half way (10 and 21) and the noise (9)."""
        after = self._stepped(state, step, functions)
        middle = [0.5 * (start + end) for start, end in zip(state, after, strict=True)]
        return [
            *after,
            *self._other_slopes(middle, functions),
            *self._slope_rows(middle, functions),
            *self._noise_side(after, functions),
        ]

    def slopes(self, state: FloatArray) -> FloatArray:
        """Return the Jacobian (n, 10, 10) of the state's rate, 1/s."""
        values = self.fall.arithmetic.values(self._other_slopes, state)
        return _jacobian(values, self.force_slopes(state))

    def _other_slopes(self, state: Vector, functions: Functions) -> list[Any]:
        """Return the gravity gradient, and the slope of the growth's rate."""
        gradient = gravity_gradient(state, self.forces.gravity.mu_m3_s2, functions)
        return [*gradient, functions.where(state[9] < MOST_GROWTH, 2.0 * state[9], 0.0)]

    def force_slopes(self, state: FloatArray) -> FloatArray:
        """Return the Jacobian (n, 3, 7) of `force_rate` by velocity, force and growth."""
        if len(state) == 1:
            return self.fall.arithmetic.values(self._slope_rows, state).reshape(1, 3, 7)
        terms = self.fall.arithmetic.values(self._flat_terms, state)
        basis = terms[:, :9].reshape(-1, 3, 3)
        weights = terms[:, 9:27].reshape(-1, 2, 3, 3).swapaxes(0, 1)
        slopes = np.empty((len(state), 3, 7))
        slopes[:, :, :6] = np.concatenate(basis.mT @ (weights @ basis), axis=2)
        slopes[:, range(3), range(3)] += terms[:, 27:28]
        slopes[:, range(3), range(3, 6)] += terms[:, 28:]
        slopes[:, :, 6] = state[:, 6:9]
        return slopes

    def _slope_terms(self, state: Vector, functions: Functions) -> _SlopeTerms:
        """Return the slopes' parts. The dependence of the air's motion on the position is
        neglected.
        """
        unit, push, force, square, speed, soft, force_along, push_along = _course(state, functions)
        pull = 1.0 / self.tilt_s
        turn = speed * soft
        fast = square * soft
        bent = force_along * soft
        by_velocity = force_along * (turn * pull - soft * push_along)
        by_force = force_along * turn - fast * pull
        ux, uy, uz = unit
        ax, ay, az = push
        fx, fy, fz = force
        bend = ax - push_along * ux, ay - push_along * uy, az - push_along * uz
        across = fx - force_along * ux, fy - force_along * uy, fz - force_along * uz
        of_rate = bent * (1.0 - 2.0 * fast)
        of_across = -2.0 * pull * turn * (1.0 - fast)
        weights = (-by_velocity, -bent, turn * pull, of_rate, soft, of_across, -by_force, turn)
        return unit, bend, across, weights, by_velocity, state[9] + by_force

    def _flat_terms(self, state: Vector, functions: Functions) -> list[Any]:
        """Return the basis B (9), the matrices W by velocity and by force (18), and the multiples
        of I.
        """
        unit, bend, across, weights, by_velocity, by_force = self._slope_terms(state, functions)
        uu, ub, ua, bu, ba, au, force_uu, force_bu = weights
        zero = 0.0 * uu
        rows = (uu, ub, ua, bu, zero, ba, au, zero, zero)
        force_rows = (force_uu, zero, zero, force_bu, *[zero] * 5)
        return [*unit, *bend, *across, *rows, *force_rows, by_velocity, by_force]

    def _slope_rows(self, state: Vector, functions: Functions) -> list[Any]:
        """Return three rows of seven, for a lone state: products of few numbers, without zeros."""
        unit, bend, across, weights, by_velocity, by_force = self._slope_terms(state, functions)
        uu, ub, ua, bu, ba, au, force_uu, force_bu = weights
        ux, uy, uz = unit
        bx, by, bz = bend
        cx, cy, cz = across
        rows: list[Any] = []
        for u, b, c, f in zip(unit, bend, across, state[6:9], strict=True):
            p = bu * b + au * c + uu * u
            q = ub * u
            r = ua * u + ba * b
            s = force_bu * b + force_uu * u
            rows += [p * ux + q * bx + r * cx, p * uy + q * by + r * cy, p * uz + q * bz + r * cz]
            rows += [s * ux, s * uy, s * uz, f]
        for diagonal in (0, 8, 16):
            rows[diagonal] += by_velocity
            rows[diagonal + 3] += by_force
        return rows

    def noise_root(self, step_s: FloatArray, state: FloatArray) -> FloatArray:
        """Return L (n, 10, 10) with L Lᵀ the process-noise covariance of steps (n,) from states."""
        side = self.fall.arithmetic.values(self._noise_side, state)
        return self._noise_root(np.abs(step_s), side)

    def _noise_root(self, step: FloatArray, side: FloatArray) -> FloatArray:
        """Return roots of steps (n,) from those of the force's noise per second (n, 9)."""
        if side.shape[0] == 1:
            side = side.take(_UPPER, axis=1)
        root = np.zeros((side.shape[0], THRUST, THRUST))
        side = side.reshape(-1, 1, 3, 1, 3)
        root[:, :9, :9] = (chain_roots(step, 3)[:, :, None, :, None] * side).reshape(-1, 9, 9)
        root[:, 9, 9] = self.growth_noise * np.sqrt(step)
        return root

    def _noise_side(self, state: Vector, functions: Functions) -> list[Any]:
        """Return a root of the force's process noise per second, 9 elements by row."""
        x, y, _, vx, vy, vz, fx, fy, fz = state[:9]
        vx = vx + _SPIN * y
        vy = vy - _SPIN * x
        square = vx * vx + vy * vy + vz * vz
        across = across_share_at(self._steady, square) * functions.sqrt(fx * fx + fy * fy + fz * fz)
        share = (self.noise_m_s2 - across) / (square + 1.0)
        sx = share * vx
        sy = share * vy
        sz = share * vz
        row = (sx * vx + across, sx * vy, sx * vz)
        return [*row, sy * vx, sy * vy + across, sy * vz, sz * vx, sz * vy, sz * vz + across]

    def taylor(self, state: FloatArray) -> FloatArray:
        """Return the position derivatives (n, 5, 3) of order 0 to 4."""
        return self.fall.arithmetic.values(self._taylor, state).reshape(-1, 5, 3)

    def _taylor(self, state: Vector, functions: Functions) -> list[Any]:
        path = [*state[:9], *self._force_rate(state, functions)]
        return taylor_series(path, self.forces.gravity.mu_m3_s2, functions)


def air_velocity(state: FloatArray) -> FloatArray:
    """Return the velocity (n, 3) of states relative to the rotating air."""
    return state[:, 3:6] - _AIR * state[:, [1, 0, 2]]


#: The velocity of the air at (x, y, z) is this times (y, x, z).
_AIR = np.array([-_SPIN, _SPIN, 0.0])

#: The elements of a matrix (9), with those below the diagonal from above it.
_UPPER = np.array([0, 1, 2, 1, 4, 5, 2, 5, 8])
