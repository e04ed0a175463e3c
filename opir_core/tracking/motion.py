"""How targets move between looks: boost with a nearly constant jerk, and free flight, in the inertial frame.

A state of boost (12) is position, velocity, specific force a (all but gravity) and its rate; of coast (6) position and
velocity. Both fall under the gravity of the scene's forces. White noise drives the rate of the specific force in boost,
and the velocity in coast. Units m, s; the inertial frame is ECEF frozen at the scene's epoch.
"""

from math import factorial

import numpy as np
from attrs import frozen

from opir_core.flight.forces import Forces
from opir_core.flight.gravity import Gravity
from opir_core.records import FloatArray
from opir_core.tracking.rays import along

#: Sizes of the states.
BOOST, COAST = 12, 6

#: The longest step, s: with a mean motion n, it leaves (n h)⁵ r / 120 < 0.1 mm in low orbits.
_LONGEST_STEP_S = 10.0

_UNIT = np.eye(3)


@frozen(eq=False)
class Motion:
    """The motion of one mode: the size of its state and the intensity of the noise, as a standard deviation per √s.

    `noise` has the unit of the state's last derivative per √s: m/s³ for boost, m/s for coast.
    """

    size: int
    noise: float
    forces: Forces

    def gravity(self, position_m: FloatArray) -> FloatArray:
        """Return the acceleration of gravity (n, 3), m/s², at positions (n, 3)."""
        field = Gravity(self.forces.gravity, self.forces.zonal)
        down: FloatArray = np.ascontiguousarray(field(np.ascontiguousarray(position_m.T)).T)
        return down

    def gradient(self, position_m: FloatArray) -> FloatArray:
        """Return the gradient (n, 3, 3), 1/s², of the point mass; the zonal part, 1e-3 of it, is left out."""
        square = np.sum(position_m * position_m, axis=1)
        outer = position_m[:, :, None] * position_m[:, None, :] / square[:, None, None]
        scale = self.forces.gravity.mu_m3_s2 / (square * np.sqrt(square))
        gradient: FloatArray = scale[:, None, None] * (3.0 * outer - _UNIT)
        return gradient

    def propagated(self, state: FloatArray, step_s: FloatArray) -> FloatArray:
        """Return states (n, d) after steps (n,), s."""
        pieces = max(1, int(np.ceil(np.max(np.abs(step_s), initial=0.0) / _LONGEST_STEP_S)))
        for _ in range(pieces):
            state = self._stepped(state, step_s / pieces)
        return state

    def _stepped(self, state: FloatArray, step_s: FloatArray) -> FloatArray:
        """Return states after one step of a Nyström method of order 4, its nodes placed by the Taylor series."""
        path, count, step = self.taylor(state), len(state), step_s[:, None]
        nodes = [followed(path, weights_at(step_s * share)) for share in (0.5, 1.0)]
        pull = self.gravity(np.concatenate([state[:, :3], *nodes]))
        start, middle, end = pull[:count], pull[count : 2 * count], pull[2 * count :]
        after = state.copy()
        after[:, :3] += step * state[:, 3:6] + step * step / 6.0 * (start + 2.0 * middle)
        after[:, 3:6] += step / 6.0 * (start + 4.0 * middle + end)
        if self.size == BOOST:
            force, jerk = state[:, 6:9], state[:, 9:12]
            after[:, :3] += step**2 / 2.0 * force + step**3 / 6.0 * jerk
            after[:, 3:6] += step * force + step**2 / 2.0 * jerk
            after[:, 6:9] += step * jerk
        return after

    def transition(self, position_m: FloatArray, step_s: FloatArray) -> FloatArray:
        """Return the transition matrices (n, d, d) of steps (n,): the exponential series with a constant gradient."""
        gradient, blocks = self.gradient(position_m), self.size // 3
        power = np.concatenate([weights_at(step_s), np.zeros((len(step_s), 1))], axis=1)
        straight, bent = (power[:, table[:blocks, :blocks]] for table in (_STRAIGHT, _BENT))
        matrix = (
            straight[:, :, None, :, None] * _UNIT[:, None, :] + bent[:, :, None, :, None] * gradient[:, None, :, None]
        )
        matrix[:, 0, :, 0] += power[:, 4, None, None] * (gradient @ gradient)
        return matrix.reshape(len(step_s), self.size, self.size)

    def noise_root(self, step_s: FloatArray) -> FloatArray | None:
        """Return L (n, d, d) with L Lᵀ the covariance of the noise gathered in steps (n,); None where there is none."""
        if self.noise == 0.0:
            return None
        blocks = self.size // 3
        powers = np.arange(blocks - 1, -1, -1)
        scale = self.noise * np.abs(step_s)[:, None] ** (powers + 0.5)
        small = scale[:, :, None] * _integrator_noise(blocks)
        whole: FloatArray = (small[:, :, None, :, None] * _UNIT[:, None, :]).reshape(len(step_s), self.size, self.size)
        return whole

    def taylor(self, state: FloatArray) -> FloatArray:
        """Return the derivatives (n, 5, 3) of the position, from the zeroth to the fourth."""
        position, velocity = state[:, :3], state[:, 3:6]
        gradient = self.gradient(position)
        derivative = np.zeros((len(state), 5, 3))
        derivative[:, 0], derivative[:, 1] = position, velocity
        derivative[:, 2] = self.gravity(position)
        derivative[:, 3] = along(gradient, velocity)
        if self.size == BOOST:
            derivative[:, 2] += state[:, 6:9]
            derivative[:, 3] += state[:, 9:12]
        derivative[:, 4] = along(gradient, derivative[:, 2]) + self._gradient_rate(position, velocity)
        return derivative

    def _gradient_rate(self, position: FloatArray, velocity: FloatArray) -> FloatArray:
        """Return what the gradient changes along the way, times the velocity: 3 mu/r⁵ (v² r + 2 s v - 5 s²/r² r)."""
        square = _dot(position, position)
        climb = _dot(position, velocity)
        scale = 3.0 * self.forces.gravity.mu_m3_s2 / (square * square * np.sqrt(square))
        inward = _dot(velocity, velocity) - 5.0 * climb * climb / square
        rate: FloatArray = scale[:, None] * (inward[:, None] * position + (2.0 * climb)[:, None] * velocity)
        return rate


#: The power of time with which the unit matrix and the gradient enter the blocks of the exponential series; 5 for none.
_STRAIGHT = np.array([[0, 1, 2, 3], [5, 0, 1, 2], [5, 5, 0, 1], [5, 5, 5, 0]])
_BENT = np.array([[2, 3, 4, 5], [1, 2, 3, 4], [5, 5, 5, 5], [5, 5, 5, 5]])


def _dot(first: FloatArray, second: FloatArray) -> FloatArray:
    total: FloatArray = first[:, 0] * second[:, 0] + first[:, 1] * second[:, 1] + first[:, 2] * second[:, 2]
    return total


def _integrator_noise(blocks: int) -> FloatArray:
    """Return the Cholesky factor of the covariance of a chain of integrators driven by unit noise for one second.

    Its elements are 1 / (a! b! (a + b + 1)) for the a-th and b-th integrals.
    """
    powers = range(blocks - 1, -1, -1)
    unit = np.array([[1.0 / (factorial(a) * factorial(b) * (a + b + 1)) for b in powers] for a in powers])
    return np.linalg.cholesky(unit)


def weights_at(offset_s: FloatArray) -> FloatArray:
    """Return 1, τ, τ²/2, τ³/6, τ⁴/24 for offsets (n,), as (n, 5)."""
    power = np.ones((len(offset_s), 5))
    for order in range(1, 5):
        power[:, order] = power[:, order - 1] * offset_s / order
    return power


def followed(derivative: FloatArray, weight: FloatArray) -> FloatArray:
    """Return positions (n, 3) from derivatives (n, 5, 3) and the weights (n, 5) of the times."""
    position = derivative[:, 0].copy()
    for order in range(1, 5):
        position += derivative[:, order] * weight[:, order, None]
    return position
