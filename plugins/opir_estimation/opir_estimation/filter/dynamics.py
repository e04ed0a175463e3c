"""What the IMM filter requires of a motion model, and free flight with drag.

A step of `AtmosphericDescent` is a drag kick of half a step, a fall, and another half kick (Strang
splitting, SIAM J. Numer. Anal. 5, 1968, 506). The tracker uses the scene's ballistic coefficient; a
target may have its own, so the process noise of the velocity grows with the drag. Inertial frame;
units m, s.
"""

from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np
from attrs import evolve, field, frozen

from opir_core.arrays import FloatArray
from opir_core.flight import LOWEST_HEIGHT_M, Drag, density_kg_m3, height_m
from opir_estimation.directions import dot
from opir_estimation.filter.ground import up_and_sigma
from opir_estimation.law_files import law_parameters
from opir_estimation.motion import COAST, Motion, noise_roots


class Dynamics(Protocol):
    """What the IMM filter requires of a mode: motion and measurement model of states (n, d)."""

    @property
    def size(self) -> int:
        """Return the state size."""
        ...

    @property
    def about(self) -> "Callable[[FloatArray, FloatArray], Dynamics] | None":
        """Return a function of means (n, d) and information roots (n, d, d) to the motion model for
        these estimates.

        None if the motion model does not depend on the covariance.
        """
        ...

    def propagated(self, state: FloatArray, step_s: FloatArray) -> FloatArray:
        """Return states after steps (n,), s."""
        ...

    def transition(self, state: FloatArray, step_s: FloatArray) -> FloatArray:
        """Return the transition matrices (n, d, d) of steps (n,) about states."""
        ...

    def noise_root(self, step_s: FloatArray, state: FloatArray) -> FloatArray | None:
        """Return a root (n, d, k) of the process-noise covariance of steps (n,), or None."""
        ...

    def taylor(self, state: FloatArray) -> FloatArray:
        """Return the position derivatives (n, 5, 3)."""
        ...

    def measurement_rows(
        self, slope: FloatArray, weight: FloatArray, state: FloatArray
    ) -> FloatArray:
        """Return the Jacobian (m, 2, d) by the state from that by the position (m, 2, 3)."""
        ...

    def derivative_roots(self, state: FloatArray, side: FloatArray) -> FloatArray:
        """Return covariance roots (n, 12, 12) of the first four position derivatives."""
        ...


LAW = law_parameters("opir_estimation.filter", "descent")

#: Outer nodes of the three-point Gauss–Hermite rule, standard deviations, each with weight 1/6.
_NODE = np.sqrt(3.0)


class _Air(NamedTuple):
    """Drag over squared speed, ρ / 2β (n,), 1/m, about states: mean, slope with height, and
    residual.

    Statistical linearisation over the height distribution (Särkkä, Bayesian Filtering and
    Smoothing, 2013, 5.4), by three Gauss–Hermite nodes.
    """

    rate: FloatArray
    slope: FloatArray
    residual: FloatArray


@frozen(eq=False)
class AtmosphericDescent:
    """Free flight with drag: states (n, 6), position and velocity, with heights known to
    `height_sigma_m` (n,).
    """

    fall: Motion
    drag: Drag
    height_sigma_m: FloatArray | float = 0.0
    size: int = field(default=COAST, init=False)

    def about(self, mean: FloatArray, root: FloatArray) -> "AtmosphericDescent":
        """Return the motion model for means (n, 6) and information roots (n, 6, 6)."""
        return evolve(self, height_sigma_m=up_and_sigma(mean, root)[1])

    def propagated(self, state: FloatArray, step_s: FloatArray) -> FloatArray:
        """Return states (n, 6) after steps (n,), s."""
        pieces = max(1, int(np.ceil(np.max(np.abs(step_s), initial=0.0) / LAW.longest_step_s)))
        half = 0.5 * step_s / pieces
        step_s = step_s / pieces
        state = state.copy()
        for _ in range(pieces):
            state[:, 3:] += self._kicked(state, half)
            state = self.fall.stepped(state, step_s)
            state[:, 3:] += self._kicked(state, half)
        return state

    def _kicked(self, state: FloatArray, step_s: FloatArray) -> FloatArray:
        """Return the velocity change (n, 3) by drag in steps (n,): w' = -k |w| w with constant
        k.
        """
        wind = self._wind(state)
        remaining = _remaining_speed(self._air(state).rate * np.sqrt(dot(wind, wind)) * step_s)
        return (remaining - 1.0)[:, None] * wind

    def slowed(self, state: FloatArray) -> FloatArray:
        """Return the drag acceleration (n, 3), m/s²."""
        wind = self._wind(state)
        return -(self._air(state).rate * np.sqrt(dot(wind, wind)))[:, None] * wind

    def _wind(self, state: FloatArray) -> FloatArray:
        """Return the velocity (n, 3) relative to the air."""
        spin = self.drag.air_rotation_rad_s
        return state[:, 3:] - np.array([-spin, spin, 0.0]) * state[:, [1, 0, 2]]

    def _air(self, state: FloatArray) -> _Air:
        """Return the air at states; below the lowest tabulated height, that at this height."""
        place = np.ascontiguousarray(state[:, :3].T)
        height = height_m(place, 1.0 / np.sqrt(np.sum(place * place, axis=0)))
        sigma = np.maximum(self.height_sigma_m, LAW.least_height_sigma_m) + 0.0 * height
        nodes = np.maximum(height + np.outer([0.0, _NODE, -_NODE], sigma), LOWEST_HEIGHT_M)
        density = density_kg_m3(nodes, self.drag.atmosphere) / (
            2.0 * self.drag.ballistic_coefficient_kg_m2
        )
        density_at, above, below = density
        rate = (4.0 * density_at + above + below) / 6.0
        slope = (above - below) / (2.0 * _NODE * sigma)
        square = (4.0 * density_at**2 + above**2 + below**2) / 6.0
        return _Air(rate, slope, np.sqrt(np.maximum(square - rate**2 - (slope * sigma) ** 2, 0.0)))

    def transition(self, state: FloatArray, step_s: FloatArray) -> FloatArray:
        """Return the transition matrices (n, 6, 6) of steps (n,): the fall between two half kicks.

        The density changes along the radius; the dependence of the air's motion on the position is
        neglected.
        """
        wind = self._wind(state)
        up = state[:, :3] / np.sqrt(dot(state[:, :3], state[:, :3]))[:, None]
        speed = np.sqrt(dot(wind, wind) + 1e-12)
        air = self._air(state)
        half_s = 0.5 * step_s
        remaining = _remaining_speed(air.rate * speed * half_s)
        half = np.broadcast_to(np.eye(COAST), (len(state), COAST, COAST)).copy()
        half[:, 3:, :3] = (
            -(remaining**2 * half_s * air.slope * speed)[:, None, None]
            * wind[:, :, None]
            * up[:, None, :]
        )
        half[:, 3:, 3:] = remaining[:, None, None] * np.eye(3)
        half[:, 3:, 3:] -= (
            (remaining**2 * half_s * air.rate / speed)[:, None, None]
            * wind[:, :, None]
            * wind[:, None, :]
        )
        return half @ self.fall.transition(state, step_s) @ half

    def noise_root(self, step_s: FloatArray, state: FloatArray) -> FloatArray:
        """Return L (n, 6, 6) with L Lᵀ the process-noise covariance of steps (n,) from states."""
        wind = self._wind(state)
        air = self._air(state)
        square = dot(wind, wind)
        wander = np.sqrt(
            self.fall.noise**2
            + ((LAW.drag_uncertainty * air.rate) ** 2 + LAW.residual_time_s * air.residual**2)
            * square**2
        )
        return wander[:, None, None] * noise_roots(np.abs(step_s), COAST // 3)

    def taylor(self, state: FloatArray) -> FloatArray:
        """Return the position derivatives (n, 5, 3) of order 0 to 4; drag is in the second."""
        derivative = self.fall.taylor(state)
        derivative[:, 2] += self.slowed(state)
        return derivative

    def measurement_rows(
        self, slope: FloatArray, weight: FloatArray, state: FloatArray
    ) -> FloatArray:
        """Return the Jacobian (m, 2, 6) by the state from that by the position (m, 2, 3)."""
        return self.fall.measurement_rows(slope, weight, state)

    def derivative_roots(self, state: FloatArray, side: FloatArray) -> FloatArray:
        """Return covariance roots (n, 12, 12) of the first four position derivatives."""
        return self.fall.derivative_roots(state, side)


def _remaining_speed(share: FloatArray) -> FloatArray:
    """Return the share of the speed that remains after a step in which the initial drag would
    remove `share`.
    """
    return 1.0 / np.maximum(1.0 + share, LAW.least_speed_share)
