"""Thrust in any direction: a specific force that is constant but for white noise of its rate, in
the inertial frame.

No direction is preferred, so it fits burns that the model of thrust along the velocity (`thrust`)
excludes: against the motion, across it, or turned after the dark. The state (10) is that of
`thrust`, so that both can be mixed; the relative growth has no effect here and only wanders. Units
m, s.
"""

import numpy as np
from attrs import Factory, field, frozen

from opir_core.arrays import FloatArray
from opir_core.flight import Forces
from opir_estimation.filter.motion_model import THRUST
from opir_estimation.motion import BOOST, Motion, noise_roots

#: Position, velocity and force.
_PUSHED = 9


@frozen(eq=False)
class FreeThrust:
    """The motion model of a force in any direction, a random walk of `noise_m_s2`, m/s²/√s, on each
    axis.

    `growth_noise`, 1/s/√s, is that of the relative growth.
    """

    #: States move alike however well they are known.
    about = None

    noise_m_s2: float
    growth_noise: float
    forces: Forces
    size: int = field(default=THRUST, init=False)
    #: Flight with a given force, whose rate is nothing here.
    pushed: Motion = field(
        default=Factory(lambda self: Motion(BOOST, 0.0, self.forces), takes_self=True), init=False
    )

    def propagated(self, state: FloatArray, step_s: FloatArray) -> FloatArray:
        """Return states (n, 10) after steps (n,), s."""
        moved = state.copy()
        moved[:, :_PUSHED] = self.pushed.propagated(_path(state), step_s)[:, :_PUSHED]
        return moved

    def transition(self, state: FloatArray, step_s: FloatArray) -> FloatArray:
        """Return the transition matrices (n, 10, 10) of steps (n,)."""
        matrix = np.zeros((len(state), THRUST, THRUST))
        matrix[:, :_PUSHED, :_PUSHED] = self.pushed.transition(state[:, :3], step_s)[
            :, :_PUSHED, :_PUSHED
        ]
        matrix[:, _PUSHED, _PUSHED] = 1.0
        return matrix

    def noise_root(self, step_s: FloatArray, state: FloatArray) -> FloatArray:
        """Return L (n, 10, 10) with L Lᵀ the process-noise covariance of steps (n,)."""
        step = np.abs(step_s)
        root = np.zeros((len(step), THRUST, THRUST))
        root[:, :_PUSHED, :_PUSHED] = self.noise_m_s2 * noise_roots(step, 3)
        root[:, _PUSHED, _PUSHED] = self.growth_noise * np.sqrt(step)
        return root

    def taylor(self, state: FloatArray) -> FloatArray:
        """Return the position derivatives (n, 5, 3) of order 0 to 4."""
        return self.pushed.taylor(_path(state))

    def measurement_rows(
        self, slope: FloatArray, weight: FloatArray, state: FloatArray
    ) -> FloatArray:
        """Return the whitened Jacobian (m, 2, 10) by the state from that by the position (m, 2, 3),
        1/m.

        `weight` (m, 5) are the Taylor weights of the looks.
        """
        rows = np.zeros((len(slope), 2, THRUST))
        rows[:, :, :_PUSHED] = (slope[:, :, None, :] * weight[:, None, :3, None]).reshape(
            -1, 2, _PUSHED
        )
        return rows

    def derivative_roots(self, state: FloatArray, side: FloatArray) -> FloatArray:
        """Return covariance roots (n, 12, 12) of four position derivatives from those of states,
        (n, 10, 10).
        """
        out = np.zeros((len(state), BOOST, BOOST))
        out[:, :_PUSHED, :THRUST] = side[:, :_PUSHED]
        return out


def _path(state: FloatArray) -> FloatArray:
    """Return states (n, 12) with a constant force."""
    return np.concatenate([state[:, :_PUSHED], np.zeros((len(state), 3))], axis=1)
