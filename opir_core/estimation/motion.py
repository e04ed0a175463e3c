"""Motion models between looks, in the inertial frame: boost with nearly constant jerk, and free
flight.

A boost state (12) is position, velocity, specific force (all but gravity) and jerk; a coast state
(6) is position and velocity. Gravity is that of the scene's forces. White noise drives the jerk in
boost and the velocity in coast; `opir_trackers.filter.dynamics` adds drag to a free flight. Units
m, s; the inertial frame is ECEF frozen at the scene epoch.

The `_one` functions compute a single state with plain numbers: the same operations in the same
order, so the same bits, without numpy's overhead per call.
"""

from collections.abc import Callable, Sequence
from functools import lru_cache
from math import ceil, factorial, sqrt

import numpy as np
from attrs import Factory, field, frozen

from opir_core.arrays import FloatArray
from opir_core.estimation.directions import FEW_ROWS, dot
from opir_core.flight.forces import Forces
from opir_core.flight.gravity_and_drag import Gravity

#: Gravitational acceleration at x, y and z; the fourth number is not used.
GravityFunction = Callable[[float, float, float], tuple[float, float, float, float]]


def gradient_of_one(place: Sequence[float], mu_m3_s2: float) -> list[float]:
    """Return the gravity gradient of a point mass, 9 numbers by row."""
    x, y, z = place
    square = x * x + y * y + z * z
    scale = mu_m3_s2 / (square * sqrt(square))
    factor = 3.0 * scale / square
    wx = x * factor
    wy = y * factor
    wz = z * factor
    return [
        wx * x - scale,
        wx * y,
        wx * z,
        wy * x,
        wy * y - scale,
        wy * z,
        wz * x,
        wz * y,
        wz * z - scale,
    ]


def transition_of_one(place: Sequence[float], step: float, mu_m3_s2: float) -> list[float]:
    """Return the transition matrix of a free fall, 36 numbers by row."""
    bent = gradient_of_one(place, mu_m3_s2)
    rows = (bent[:3], bent[3:6], bent[6:])
    columns = (bent[::3], bent[1::3], bent[2::3])
    second = step * (step / 2.0)
    third = second * (step / 3.0)
    fourth = third * (step / 4.0)
    above: list[float] = []
    below: list[float] = []
    for k, (x, y, z) in enumerate(rows):
        place_row = [second * x, second * y, second * z]
        speed_row = [third * x, third * y, third * z]
        place_row[k] += 1.0
        speed_row[k] += step
        below += (step * x, step * y, step * z, *place_row)
        above += [
            near + fourth * (x * p + y * q + z * r)
            for near, (p, q, r) in zip(place_row, columns, strict=True)
        ]
        above += speed_row
    return above + below


def stepped_one(
    state: Sequence[float], step: float, pull: GravityFunction, gravity: Sequence[float]
) -> list[float]:
    """Return a state of 6, or of 12 with specific force and jerk, after one Nyström step.

    `gravity` is the value of `pull` at the start of the step.
    """
    half = 0.5 * step
    x, y, z, u, v, w = state[:6]
    mx = x + half * u
    my = y + half * v
    mz = z + half * w
    ex = x + step * u
    ey = y + step * v
    ez = z + step * w
    rest = list(state[6:])
    if rest:
        fx, fy, fz, jx, jy, jz = rest
        sixth = half / 6.0
        near = half * half
        far = step * step
        mx = mx + near * (0.5 * fx + sixth * jx)
        my = my + near * (0.5 * fy + sixth * jy)
        mz = mz + near * (0.5 * fz + sixth * jz)
        sixth = step / 6.0
        ex = ex + far * (0.5 * fx + sixth * jx)
        ey = ey + far * (0.5 * fy + sixth * jy)
        ez = ez + far * (0.5 * fz + sixth * jz)
        u = u + step * (fx + half * jx)
        v = v + step * (fy + half * jy)
        w = w + step * (fz + half * jz)
        rest[:3] = fx + step * jx, fy + step * jy, fz + step * jz
    ax, ay, az, _ = gravity
    bent = 0.5 * half * half
    bx, by, bz, _ = pull(mx + bent * ax, my + bent * ay, mz + bent * az)
    fall = half * step
    cx, cy, cz, _ = pull(ex + fall * bx, ey + fall * by, ez + fall * bz)
    sixth = step * step / 6.0
    share = step / 6.0
    place = [
        ex + sixth * (ax + 2.0 * bx),
        ey + sixth * (ay + 2.0 * by),
        ez + sixth * (az + 2.0 * bz),
    ]
    speed = [
        u + share * (ax + 4.0 * bx + cx),
        v + share * (ay + 4.0 * by + cy),
        w + share * (az + 4.0 * bz + cz),
    ]
    return [*place, *speed, *rest]


def taylor_of_one(state: Sequence[float], gravity: Sequence[float], mu_m3_s2: float) -> list[float]:
    """Return the position derivatives of order 0 to 4 of a state of 6 or 12, 15 numbers.

    `gravity` is the value at the state's position, as `GravityFunction` returns it.
    """
    x, y, z, u, v, w = state[:6]
    square = x * x + y * y + z * z
    scale = mu_m3_s2 / (square * sqrt(square))
    a, b, c, _ = gravity
    climb = x * u + y * v + z * w
    share = climb / square
    third = 3.0 * share
    rate = scale * (third * x - u), scale * (third * y - v), scale * (third * z - w)
    if len(state) > 6:
        a = a + state[6]
        b = b + state[7]
        c = c + state[8]
        rate = rate[0] + state[9], rate[1] + state[10], rate[2] + state[11]
    inward = (x * a + y * b + z * c + (u * u + v * v + w * w) - 5.0 * climb * share) / square
    near = 3.0 * inward
    along = 6.0 * share
    bend = (
        scale * (near * x + along * u - a),
        scale * (near * y + along * v - b),
        scale * (near * z + along * w - c),
    )
    return [x, y, z, u, v, w, a, b, c, *rate, *bend]


#: State sizes.
BOOST = 12
COAST = 6

#: State count up to which gravity is computed one by one: the same operations without numpy's
#: overhead.
FEW_STATES = 4

#: Longest step, s: with mean motion n the error is (n h)⁵ r / 120 < 0.1 mm in low orbits.
_LONGEST_STEP_S = 10.0

_UNIT = np.eye(3)


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
    field: Gravity = field(
        default=Factory(
            lambda self: Gravity(self.forces.gravity, self.forces.zonal), takes_self=True
        ),
        init=False,
    )

    def gravity(self, position_m: FloatArray) -> FloatArray:
        """Return the gravitational acceleration (n, 3), m/s², at positions (n, 3)."""
        if len(position_m) <= FEW_STATES:
            pull = self.field.alone_with_inverse_radius
            return np.array([pull(x, y, z)[:3] for x, y, z in position_m.tolist()]).reshape(-1, 3)
        return np.ascontiguousarray(self.field(np.ascontiguousarray(position_m.T)).T)

    def gradient(self, position_m: FloatArray) -> FloatArray:
        """Return the gravity gradient (n, 3, 3), 1/s², of the point mass; the zonal part, 1e-3 of
        it, is neglected.
        """
        if len(position_m) <= FEW_STATES:
            mu = self.forces.gravity.mu_m3_s2
            return np.array([gradient_of_one(row, mu) for row in position_m.tolist()]).reshape(
                -1, 3, 3
            )
        square = dot(position_m, position_m)
        scale = self.forces.gravity.mu_m3_s2 / (square * np.sqrt(square))
        weighed = position_m * (3.0 * scale / square)[:, None]
        return weighed[:, :, None] * position_m[:, None, :] - scale[:, None, None] * _UNIT

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
        if len(state) <= FEW_STATES:
            pull = self.field.alone_with_inverse_radius
            rows = zip(state.tolist(), step_s.tolist(), strict=True)
            alone = [stepped_one(row, step, pull, pull(*row[:3])) for row, step in rows]
            return np.array(alone).reshape(state.shape)
        step = step_s[:, None]
        half = 0.5 * step_s[:, None]
        position = state[:, :3]
        velocity = state[:, 3:6]
        middle = position + half * velocity
        end = position + step * velocity
        after = state.copy()
        if self.size == BOOST:
            force = state[:, 6:9]
            jerk = state[:, 9:12]
            middle += half * half * (0.5 * force + half / 6.0 * jerk)
            end += step * step * (0.5 * force + step / 6.0 * jerk)
            after[:, 3:6] += step * (force + half * jerk)
            after[:, 6:9] += step * jerk
        start = self.gravity(position)
        midway = self.gravity(middle + 0.5 * half * half * start)
        last = self.gravity(end + half * step * midway)
        after[:, :3] = end + step * step / 6.0 * (start + 2.0 * midway)
        after[:, 3:6] += step / 6.0 * (start + 4.0 * midway + last)
        return after

    def transition(self, state: FloatArray, step_s: FloatArray) -> FloatArray:
        """Return the transition matrices (n, d, d) of steps (n,): an exponential series with
        constant gradient.

        Only the position of the states (n, d), or the positions (n, 3), are used.
        """
        if len(state) == 1 and self.size == COAST:
            numbers = transition_of_one(
                state[0, :3].tolist(), float(step_s[0]), self.forces.gravity.mu_m3_s2
            )
            return np.array(numbers).reshape(1, COAST, COAST)
        gradient = self.gradient(state[:, :3])
        blocks = self.size // 3
        straight, bent, fourth = _tables(step_s, blocks)
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
        if len(step_s) == 1:
            return _noise_alone(abs(float(step_s[0])), self.size // 3, self.noise)
        whole = self.noise * noise_roots(np.abs(step_s), self.size // 3)
        return np.broadcast_to(whole, (len(step_s), self.size, self.size))

    def taylor(self, state: FloatArray) -> FloatArray:
        """Return the position derivatives (n, 5, 3) of order 0 to 4."""
        if len(state) <= FEW_STATES:
            pull = self.field.alone_with_inverse_radius
            mu = self.forces.gravity.mu_m3_s2
            rows = [taylor_of_one(row, pull(*row[:3]), mu) for row in state.tolist()]
            return np.array(rows).reshape(-1, 5, 3)
        position = state[:, :3]
        velocity = state[:, 3:6]
        square = dot(position, position)
        scale = (self.forces.gravity.mu_m3_s2 / (square * np.sqrt(square)))[:, None]
        derivative = np.empty((len(state), 5, 3))
        derivative[:, 0] = position
        derivative[:, 1] = velocity
        derivative[:, 2] = self.gravity(position)
        if self.size == BOOST:
            derivative[:, 2] += state[:, 6:9]
        fall = derivative[:, 2]
        # The gradient times a vector u is scale (3 (r·u) r / r² - u); what it gains along the way,
        # times the velocity, is 3 scale / r² (v² r + 2 (r·v) v - 5 (r·v)²/r² r).
        climb = dot(position, velocity)
        share = climb / square
        derivative[:, 3] = scale * ((3.0 * share)[:, None] * position - velocity)
        if self.size == BOOST:
            derivative[:, 3] += state[:, 9:12]
        inward = (dot(position, fall) + dot(velocity, velocity) - 5.0 * climb * share) / square
        derivative[:, 4] = scale * (
            (3.0 * inward)[:, None] * position + (6.0 * share)[:, None] * velocity - fall
        )
        return derivative

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
        out = np.zeros((len(side), BOOST, BOOST))
        out[:, : self.size, : self.size] = side
        return out


def substeps(step_s: FloatArray, longest_s: float) -> int:
    """Return the number of equal substeps with which no step (n,) exceeds a limit."""
    if len(step_s) == 1:
        return max(1, ceil(abs(float(step_s[0])) / longest_s))
    return max(1, ceil(float(np.abs(step_s).max(initial=0.0)) / longest_s))


#: Powers of time with which the unit matrix and the gradient enter the blocks of the exponential
#: series; 5 for none.
_STRAIGHT = np.array([[0, 1, 2, 3], [5, 0, 1, 2], [5, 5, 0, 1], [5, 5, 5, 0]])
_BENT = np.array([[2, 3, 4, 5], [1, 2, 3, 4], [5, 5, 5, 5], [5, 5, 5, 5]])


def _tables(step_s: FloatArray, blocks: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the parts of the transition matrices that depend on steps (n,) only; one row if all
    steps are equal.
    """
    if len(step_s) == 1 or (len(step_s) and np.all(step_s == step_s[0])):
        return _tables_of_one(float(step_s[0]), blocks)
    power = np.concatenate([taylor_weights(step_s), np.zeros((len(step_s), 1))], axis=1)
    straight, bent = (power[:, table[:blocks, :blocks]] for table in (_STRAIGHT, _BENT))
    return straight[:, :, None, :, None] * _UNIT[:, None, :], bent, power[:, 4, None, None]


@lru_cache(maxsize=64)
def _tables_of_one(step_s: float, blocks: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    both = _tables(np.array([step_s, np.nan]), blocks)
    return _read_only(both[0][:1]), _read_only(both[1][:1]), _read_only(both[2][:1])


def noise_roots(step_s: FloatArray, blocks: int) -> FloatArray:
    """Return roots of the unit process-noise covariance of steps (n,); one row if all steps are
    equal.
    """
    if len(step_s) == 1 or (len(step_s) and np.all(step_s == step_s[0])):
        return _noise_of_one(float(step_s[0]), blocks)
    scale = step_s[:, None] ** (np.arange(blocks - 1, -1, -1) + 0.5)
    small = scale[:, :, None] * integrator_noise(blocks)
    return (small[:, :, None, :, None] * _UNIT[:, None, :]).reshape(
        len(step_s), 3 * blocks, 3 * blocks
    )


@lru_cache(maxsize=64)
def _noise_of_one(step_s: float, blocks: int) -> FloatArray:
    return _read_only(noise_roots(np.array([step_s, np.nan]), blocks)[:1])


@lru_cache(maxsize=64)
def _noise_alone(step_s: float, blocks: int, noise: float) -> FloatArray:
    return _read_only(np.asarray(noise * _noise_of_one(step_s, blocks)))


def _read_only(array: FloatArray) -> FloatArray:
    """Return an array, shared by callers, marked read-only."""
    array.flags.writeable = False
    return array


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


_ORDERS = np.arange(1.0, 5.0)


def taylor_weights(offset_s: FloatArray) -> FloatArray:
    """Return the Taylor weights 1, τ, τ²/2, τ³/6, τ⁴/24 of offsets (n,), as (n, 5)."""
    if len(offset_s) >= FEW_ROWS:
        power = np.empty((5, len(offset_s)))
        power[0] = 1.0
        power[1] = offset_s
        for order in range(2, 5):
            np.multiply(power[order - 1], offset_s / order, out=power[order])
        return power.T
    power = np.empty((len(offset_s), 5))
    power[:, 0] = 1.0
    np.divide(offset_s[:, None], _ORDERS, out=power[:, 1:])
    return np.multiply.accumulate(power, axis=1, out=power)


def taylor_positions(derivative: FloatArray, weight: FloatArray) -> FloatArray:
    """Return positions (n, 3) from derivatives (n, 5, 3) and Taylor weights (n, 5)."""
    return np.einsum("nk,nkc->nc", weight, derivative)
