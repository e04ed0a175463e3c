"""Motion models between looks, in the inertial frame: boost with nearly constant jerk, and free
flight.

A boost state (12) is position, velocity, specific force (all but gravity) and jerk; a coast state
(6) is position and velocity. Gravity is that of the scene's forces. White noise drives the jerk in
boost and the velocity in coast; `opir_estimation.filter.dynamics` adds drag to a free flight. Units
m, s; the inertial frame is ECEF frozen at the scene epoch.
"""

from collections.abc import Callable
from functools import lru_cache
from math import ceil, factorial
from typing import Any

import numpy as np
from attrs import Factory, field, frozen

from opir_core.arrays import FloatArray
from opir_core.flight import Forces, Gravity
from opir_estimation.directions import FEW_ROWS
from opir_estimation.formulas import Arithmetic, Functions, Vector, arithmetic

#: State sizes.
BOOST = 12
COAST = 6

#: Up to this number of states are computed one by one, with plain numbers.
FEW_STATES = 4

#: Longest step, s: with mean motion n the error is (n h)⁵ r / 120 < 0.1 mm in low orbits.
_LONGEST_STEP_S = 10.0

_UNIT = np.eye(3)


def gravity_gradient(position: Vector, mu_m3_s2: float, functions: Functions) -> list[Any]:
    """Return the gravity gradient of a point mass, 1/s², 9 elements by row."""
    px, py, pz = position[:3]
    square = px * px + py * py + pz * pz
    scale = mu_m3_s2 / (square * functions.sqrt(square))
    factor = 3.0 * scale / square
    x = factor * px
    y = factor * py
    z = factor * pz
    row = (x * px - scale, x * py, x * pz)
    next_row = (y * px, y * py - scale, y * pz)
    return [*row, *next_row, z * px, z * py, z * pz - scale]


def stepped_state(state: Vector, step: Any, functions: Functions) -> list[Any]:
    """Return a state of 6, or of 12 with specific force and jerk, after one Nyström step."""
    half = 0.5 * step
    x, y, z, u, v, w = state[:6]
    mx = x + half * u
    my = y + half * v
    mz = z + half * w
    ex = x + step * u
    ey = y + step * v
    ez = z + step * w
    derivatives: list[Any] = []
    if len(state) > COAST:
        pushes, derivatives = _pushes(state, step)
        mx = mx + pushes[0]
        my = my + pushes[1]
        mz = mz + pushes[2]
        ex = ex + pushes[3]
        ey = ey + pushes[4]
        ez = ez + pushes[5]
        u = u + pushes[6]
        v = v + pushes[7]
        w = w + pushes[8]
    gravity = functions.gravity
    ax, ay, az = gravity(x, y, z)[:3]
    eighth = 0.5 * half * half
    bx, by, bz = gravity(mx + eighth * ax, my + eighth * ay, mz + eighth * az)[:3]
    push = half * step
    cx, cy, cz = gravity(ex + push * bx, ey + push * by, ez + push * bz)[:3]
    share = step * step / 6.0
    sixth = step / 6.0
    position = (ex + share * (ax + 2.0 * bx), ey + share * (ay + 2.0 * by))
    speed = (u + sixth * (ax + 4.0 * bx + cx), v + sixth * (ay + 4.0 * by + cy))
    return [
        *position,
        ez + share * (az + 2.0 * bz),
        *speed,
        w + sixth * (az + 4.0 * bz + cz),
        *derivatives,
    ]


def _pushes(state: Vector, step: Any) -> tuple[list[Any], list[Any]]:
    """Return what specific force and jerk of a state of 12 add to the position in the middle of a
    step, to that at its end and to the velocity (9), and the force and the jerk at its end (6).
    """
    half = 0.5 * step
    square = step * step
    quarter = half * half
    third = step / 6.0
    sixth = half / 6.0
    jerks = state[9:12]
    components = [*zip(state[6:9], jerks, strict=True)]
    middle = [quarter * (0.5 * force + sixth * jerk) for force, jerk in components]
    end = [square * (0.5 * force + third * jerk) for force, jerk in components]
    speed = [step * (force + half * jerk) for force, jerk in components]
    forces = [force + step * jerk for force, jerk in components]
    return [*middle, *end, *speed], [*forces, *jerks]


def taylor_series(state: Vector, mu_m3_s2: float, functions: Functions) -> list[Any]:
    """Return the position derivatives of order 0 to 4 of a state of 6 or 12, 15 components.

    The gradient times a vector u is k (3 (r·u) r / r² - u), with k = mu / r³; its growth along the
    path, times the velocity, is 3 k / r² (v² r + 2 (r·v) v - 5 (r·v)²/r² r).
    """
    x, y, z, u, v, w = state[:6]
    a, b, c = functions.gravity(x, y, z)[:3]
    square = x * x + y * y + z * z
    scale = mu_m3_s2 / (square * functions.sqrt(square))
    climb = x * u + y * v + z * w
    share = climb / square
    third = 3.0 * share
    gx = scale * (third * x - u)
    gy = scale * (third * y - v)
    gz = scale * (third * z - w)
    if len(state) > COAST:
        fx, fy, fz, jx, jy, jz = state[6:12]
        a = a + fx
        b = b + fy
        c = c + fz
        gx = gx + jx
        gy = gy + jy
        gz = gz + jz
    speeds = u * u + v * v + w * w
    inward = (x * a + y * b + z * c + speeds - 5.0 * climb * share) / square
    near = 3.0 * inward
    along = 6.0 * share
    bx = scale * (near * x + along * u - a)
    by = scale * (near * y + along * v - b)
    bz = scale * (near * z + along * w - c)
    return [x, y, z, u, v, w, a, b, c, gx, gy, gz, bx, by, bz]


@frozen(eq=False)
class Motion:
    """The motion model of one mode: state size and noise intensity.

    `noise` is a standard deviation per √s in the unit of the last derivative of the state: m/s³ for
    boost, m/s for coast.
    """

    #: States move alike however well they are known.
    about = None

    size: int
    noise: float
    forces: Forces
    arithmetic: Arithmetic = field(
        default=Factory(
            lambda self: arithmetic(FEW_STATES, Gravity(self.forces.gravity, self.forces.zonal)),
            takes_self=True,
        ),
        init=False,
    )

    def gravity(self, position_m: FloatArray) -> FloatArray:
        """Return the gravitational acceleration (n, 3), m/s², at positions (n, 3)."""
        return self.arithmetic.values(
            lambda position, functions: functions.gravity(*position)[:3], position_m
        )

    def gradient(self, position_m: FloatArray) -> FloatArray:
        """Return the gravity gradient (n, 3, 3), 1/s², of the point mass; the zonal part, 1e-3 of
        it, is neglected.
        """
        return self.arithmetic.values(self._gradient, position_m).reshape(-1, 3, 3)

    def _gradient(self, position: Vector, functions: Functions) -> list[Any]:
        return gravity_gradient(position, self.forces.gravity.mu_m3_s2, functions)

    def _taylor(self, state: Vector, functions: Functions) -> list[Any]:
        return taylor_series(state, self.forces.gravity.mu_m3_s2, functions)

    def propagated(self, state: FloatArray, step_s: FloatArray) -> FloatArray:
        """Return states (n, d) after steps (n,), s."""
        pieces = substeps(step_s, _LONGEST_STEP_S)
        if pieces > 1:
            step_s = step_s / pieces
        for _ in range(pieces):
            state = self.stepped(state, step_s)
        return state

    def stepped(self, state: FloatArray, step_s: FloatArray) -> FloatArray:
        """Return states (n, d) after one Nyström step (n,), s."""
        return self.arithmetic.values(stepped_state, state, step_s)

    def transition(self, state: FloatArray, step_s: FloatArray) -> FloatArray:
        """Return the transition matrices (n, d, d) of steps (n,): an exponential series with
        constant gradient.

        Only the position of the states (n, d), or the positions (n, 3), are used.
        """
        gradient = self.gradient(state[:, :3])
        blocks = self.size // 3
        straight, bent, fourth = _at_equal_steps(_series_terms, step_s, blocks)
        matrix = straight + bent[:, :, None, :, None] * gradient[:, None, :, None, :]
        square = gradient[:, :, :1] * gradient[:, :1]
        for row in (1, 2):
            square += gradient[:, :, row, None] * gradient[:, row, None]
        matrix[:, 0, :, 0] += fourth * square
        return matrix.reshape(len(step_s), self.size, self.size)

    def noise_root(self, step_s: FloatArray, state: FloatArray | None = None) -> FloatArray | None:
        """Return L (n, d, d) with L Lᵀ the process-noise covariance of steps (n,); None without
        noise.

        It does not depend on the states.
        """
        if self.noise == 0.0:
            return None
        roots = self.noise * noise_roots(np.abs(step_s), self.size // 3)
        return roots if len(roots) == len(step_s) else roots.repeat(len(step_s), axis=0)

    def taylor(self, state: FloatArray) -> FloatArray:
        """Return the position derivatives (n, 5, 3) of order 0 to 4."""
        return self.arithmetic.values(self._taylor, state).reshape(-1, 5, 3)

    def measurement_rows(
        self, slope: FloatArray, weight: FloatArray, state: FloatArray
    ) -> FloatArray:
        """Return the whitened Jacobian (m, 2, d) by the state from that by the position (m, 2, 3),
        1/m.

        `weight` (m, 5) are the Taylor weights of the look times; the bending of the path by the
        gravity gradient within a slice is neglected.
        """
        rows: FloatArray = slope[:, :, None, :] * weight[:, None, : self.size // 3, None]
        return rows.reshape(len(slope), 2, self.size)

    def derivative_roots(self, state: FloatArray, side: FloatArray) -> FloatArray:
        """Return covariance roots (n, 12, 12) of four position derivatives from those of states,
        (n, d, d).
        """
        if self.size == BOOST:
            return side
        roots = np.zeros((len(side), BOOST, BOOST))
        roots[:, : self.size, : self.size] = side
        return roots


def substeps(step_s: FloatArray, longest_s: float) -> int:
    """Return the number of equal substeps with which no step (n,) exceeds a limit."""
    longest = abs(float(step_s[0])) if len(step_s) == 1 else np.abs(step_s).max(initial=0.0)
    return max(1, ceil(longest / longest_s))


def _at_equal_steps(
    function: Callable[[FloatArray, int], Any], step_s: FloatArray, blocks: int
) -> Any:
    """Return a function of steps (n,), of which the last are stored: one row if all are equal."""
    if len(step_s) == 1 or (len(step_s) and np.all(step_s == step_s[0])):
        return _at_step(function, float(step_s[0]), blocks)
    return function(step_s, blocks)


@lru_cache(maxsize=128)
def _at_step(function: Callable[[FloatArray, int], Any], step_s: float, blocks: int) -> Any:
    values = function(np.array([step_s]), blocks)
    for array in values if isinstance(values, tuple) else [values]:
        array.flags.writeable = False
    return values


#: Powers of time with which the unit matrix and the gradient enter the blocks of the exponential
#: series; 5 for none.
_STRAIGHT = np.array([[0, 1, 2, 3], [5, 0, 1, 2], [5, 5, 0, 1], [5, 5, 5, 0]])
_BENT = np.array([[2, 3, 4, 5], [1, 2, 3, 4], [5, 5, 5, 5], [5, 5, 5, 5]])


def _series_terms(step_s: FloatArray, blocks: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the parts of the transition matrices that depend on steps (n,) alone."""
    power = np.concatenate([taylor_weights(step_s), np.zeros((len(step_s), 1))], axis=1)
    straight, bent = (power[:, table[:blocks, :blocks]] for table in (_STRAIGHT, _BENT))
    return straight[:, :, None, :, None] * _UNIT[:, None, :], bent, power[:, 4, None, None]


def noise_roots(step_s: FloatArray, blocks: int) -> FloatArray:
    """Return roots of the unit process-noise covariance of steps (n,); one row if all steps are
    equal.
    """
    roots: FloatArray = _at_equal_steps(_noise_roots, step_s, blocks)
    return roots


def _noise_roots(step_s: FloatArray, blocks: int) -> FloatArray:
    chain = chain_roots(step_s, blocks)
    return (chain[:, :, None, :, None] * _UNIT[:, None, :]).reshape(-1, 3 * blocks, 3 * blocks)


def chain_roots(step_s: FloatArray, blocks: int) -> FloatArray:
    """Return roots (n, blocks, blocks) of the noise covariance of a chain of integrators; one row
    if all steps (n,) are equal.
    """
    roots: FloatArray = _at_equal_steps(_chain_roots, step_s, blocks)
    return roots


def _chain_roots(step_s: FloatArray, blocks: int) -> FloatArray:
    scale: FloatArray = step_s[:, None] ** (np.arange(blocks - 1, -1, -1) + 0.5)
    return scale[:, :, None] * integrator_noise(blocks)


def integrator_noise(blocks: int) -> FloatArray:
    """Return the Cholesky factor of the covariance of a chain of integrators driven by unit noise
    for 1 s.

    Its elements are 1 / (a! b! (a + b + 1)) for the a-th and b-th integrals.
    """
    powers = range(blocks - 1, -1, -1)
    unit = np.array(
        [[1.0 / (factorial(a) * factorial(b) * (a + b + 1)) for b in powers] for a in powers]
    )
    return np.linalg.cholesky(unit)


def taylor_weights(offset_s: FloatArray) -> FloatArray:
    """Return the Taylor weights 1, τ, τ²/2, τ³/6, τ⁴/24 of offsets (n,), as (n, 5)."""
    if offset_s.size >= FEW_ROWS:
        columns = np.ones((5, len(offset_s)))
        for order in range(1, 5):
            np.multiply(columns[order - 1], offset_s / order, out=columns[order])
        return columns.T
    power = np.empty((offset_s.size, 5))
    power[:, 0] = 1.0
    np.divide(offset_s[:, None], _ORDERS, out=power[:, 1:])
    return np.multiply.accumulate(power, axis=1, out=power)


_ORDERS = np.arange(1.0, 5.0)


def taylor_positions(derivative: FloatArray, weight: FloatArray) -> FloatArray:
    """Return positions (n, 3) from derivatives (n, 5, 3) and Taylor weights (n, 5)."""
    return np.einsum("nk,nkc->nc", weight, derivative)
