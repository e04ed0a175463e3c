"""Motion models of a burning target: all that a filter asks follows from the rate of the specific
force and its process noise.

A state (10) is inertial position, velocity, specific force (all but gravity) and its relative
growth rate κ, 1/s. Units m, s.
"""

from abc import abstractmethod

import numpy as np

from opir_core.arrays import FloatArray
from opir_core.flight import Forces
from opir_core.interfaces import PluginPart
from opir_estimation.directions import matvec
from opir_estimation.motion import BOOST, Motion, substeps

#: State size.
THRUST = 10

#: Up to this growth, 1/s, thrust and mass flow are constant: κ' = κ². A stage of 40 s whose
#: acceleration triples ends with it; beyond, κ stays: carried on in the dark, a stage would burn up
#: all its mass.
MOST_GROWTH = 0.05

#: Longest step, s: with τ of 15 s, the trapezoidal error of the decay towards the velocity is below
#: 1e-3.
LONGEST_STEP_S = 2.5


class MotionModel(PluginPart):
    """Motion of a burning target, from the rate of its specific force.

    Steps are by Nyström's rule, with the trapezoidal rule for the force; the derivatives of the
    force's rate are central differences. A model may override any method for speed.

    >>> from opir_estimation import MotionModel
    >>> class Straight(MotionModel):
    ...     def force_rate(self, state):
    ...         return state[:, 9:] * state[:, 6:9]
    ...
    ...     def noise_root(self, step_s, state):
    ...         root = np.zeros((len(state), 10, 4))
    ...         root[:, range(6, 9), range(3)] = 2.0 * np.sqrt(np.abs(step_s))[:, None]
    ...         root[:, 9, 3] = 1e-3 * np.sqrt(np.abs(step_s))
    ...         return root
    """

    #: States move alike however well they are known.
    about = None
    size = THRUST

    forces: Forces

    def __init__(self, forces: Forces) -> None:
        self.forces = forces
        self._path = Motion(BOOST, 0.0, forces)

    @abstractmethod
    def force_rate(self, state: FloatArray) -> FloatArray:
        """Return the rates (n, 3) of the specific forces of states (n, 10), m/s³."""

    @abstractmethod
    def noise_root(self, step_s: FloatArray, state: FloatArray) -> FloatArray:
        """Return L (n, 10, k) with L Lᵀ the process-noise covariance of steps (n,) from states."""

    def step(
        self, state: FloatArray, step_s: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return states (n, 10) after steps (n,), the transition matrices back (n, 10, 10), and the
        roots of the process noise (n, 10, k).
        """
        after = self.propagated(state, step_s)
        back = self.transition(0.5 * (state + after), -step_s)
        return after, back, self.noise_root(step_s, after)

    def propagated(self, state: FloatArray, step_s: FloatArray) -> FloatArray:
        """Return states (n, 10) after steps (n,), s."""
        pieces = substeps(step_s, LONGEST_STEP_S)
        step_s = step_s / pieces
        for _ in range(pieces):
            state = self._after(state, step_s)
        return state

    def _after(self, state: FloatArray, step_s: FloatArray) -> FloatArray:
        """Return states after one step each; the rate of the force is linear over it."""
        rate = self.force_rate(state)
        path = self._path.stepped(np.concatenate([state[:, :9], rate], axis=1), step_s)[:, :9]
        after = np.concatenate([path, _grown(state[:, 9], step_s)[:, None]], axis=1)
        change = self.force_rate(after) - rate
        step = step_s[:, None]
        after[:, :3] += step**3 / 24.0 * change
        after[:, 3:6] += step**2 / 6.0 * change
        after[:, 6:9] += step / 2.0 * change
        return after

    def transition(self, state: FloatArray, step_s: FloatArray) -> FloatArray:
        """Return the transition matrices (n, 10, 10) of steps (n,): the exponential series with a
        constant Jacobian.
        """
        return self.series(self.slopes(state), step_s)

    def series(self, product: FloatArray, step_s: FloatArray) -> FloatArray:
        """Return the exponential series (n, 10, 10) of Jacobians, overwritten, times steps (n,)."""
        product *= step_s[:, None, None]
        square = product @ product
        remainder = square / 24.0
        remainder += product / 6.0
        remainder += _HALF
        series: FloatArray = square @ remainder
        series += product
        series += _IDENTITY
        return series

    def slopes(self, state: FloatArray) -> FloatArray:
        """Return the Jacobian (n, 10, 10) of the state's rate, 1/s."""
        rate = KINEMATICS.repeat(len(state), axis=0)
        rate[:, 3:6, :3] = self._path.gradient(state[:, :3])
        rate[:, 6:9, 3:] = self.force_slopes(state)
        rate[:, 9, 9] = np.where(state[:, 9] < MOST_GROWTH, 2.0 * state[:, 9], 0.0)
        return rate

    def force_slopes(self, state: FloatArray) -> FloatArray:
        """Return the Jacobian (n, 3, 7) of `force_rate` by velocity, force and growth."""
        slopes = np.empty((len(state), 3, len(_STEPS)))
        for column, step in enumerate(_STEPS):
            shift = np.zeros(THRUST)
            shift[3 + column] = step
            slopes[:, :, column] = self.force_rate(state + shift) - self.force_rate(state - shift)
        return slopes / (2.0 * _STEPS)

    def taylor(self, state: FloatArray) -> FloatArray:
        """Return the position derivatives (n, 5, 3) of order 0 to 4."""
        return self._path.taylor(np.concatenate([state[:, :9], self.force_rate(state)], axis=1))

    def measurement_rows(
        self, slope: FloatArray, weight: FloatArray, state: FloatArray
    ) -> FloatArray:
        """Return the whitened Jacobian (m, 2, 10) by the state from that by the position (m, 2, 3),
        1/m.

        `weight` (m, 5) are the Taylor weights of the looks, `state` (m, 10) the states of their
        tracks, or (1, 10) one for all.
        """
        rows = np.empty((slope.shape[0], 2, THRUST))
        by_path = slope[:, :, None, :] * weight[:, None, :3, None]
        rows[:, :, :9] = by_path.reshape(-1, 2, 9)
        if state.shape[0] == 1:
            by_force = (slope.reshape(-1, 3) @ state[0, 6:9]).reshape(-1, 2)
        else:
            by_force = matvec(slope, state[:, 6:9])
        rows[:, :, 9] = by_force * weight[:, 3, None]
        return rows

    def derivative_roots(self, state: FloatArray, side: FloatArray) -> FloatArray:
        """Return covariance roots (n, 12, 12) of four position derivatives from those of states,
        (n, 10, 10).
        """
        roots = np.zeros((len(state), BOOST, BOOST))
        roots[:, :9, :THRUST] = side[:, :9]
        roots[:, 9:, :THRUST] = self.force_slopes(state) @ side[:, 3:]
        return roots


#: Steps of the central differences: of velocity, m/s, force, m/s², and growth, 1/s.
_STEPS = np.array([1.0, 1.0, 1.0, 0.01, 0.01, 0.01, 1e-4])

_IDENTITY = np.eye(THRUST)
_HALF = 0.5 * np.eye(THRUST)

#: The Jacobian (1, 10, 10) of the kinematic part.
KINEMATICS = np.eye(THRUST, k=3)[None] * (np.arange(THRUST) < 6)[:, None]


def _grown(growth: FloatArray, step_s: FloatArray) -> FloatArray:
    """Return relative growths (n,) of the force after steps, 1/s."""
    grown = np.minimum(growth / (1.0 - growth * step_s), MOST_GROWTH)
    return np.where(growth < MOST_GROWTH, grown, growth)
