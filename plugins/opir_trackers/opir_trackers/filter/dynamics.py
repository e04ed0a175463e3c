"""What the switching filter asks of a mode.

Free flight through the air, in the inertial frame: what `motion` has for a fall, and drag.

A step is half a kick of drag, a fall, and the other half (Strang, SIAM J. Numer. Anal. 5, 1968, 506). What the tracker
knows of a target's drag is the scene's ballistic coefficient, and a target may bring its own: the velocity's noise
grows with the drag. Units m, s.
"""

from collections.abc import Callable
from typing import NamedTuple, Protocol

import numpy as np
from attrs import evolve, field, frozen

from opir_core.arrays import FloatArray
from opir_core.estimation.lines_of_sight import dot
from opir_core.estimation.motion import COAST, Motion, noises
from opir_core.estimation.square_root import spread
from opir_core.flight.atmosphere_density import LOWEST_HEIGHT_M, density_kg_m3
from opir_core.flight.forces import Drag
from opir_core.flight.gravity_and_drag import height_m


class Dynamics(Protocol):
    """What the switching filter asks of a mode: how its states (n, d) move, and how looks see them."""

    @property
    def size(self) -> int:
        """Return the size of the state."""
        ...

    @property
    def about(self) -> "Callable[[FloatArray, FloatArray], Dynamics] | None":
        """Return what tells of means (n, d) and roots (n, d, d) of information how states move that are known so well.

        None says that they move alike however well they are known.
        """
        ...

    def propagated(self, state: FloatArray, step_s: FloatArray) -> FloatArray:
        """Return states after steps (n,), s."""
        ...

    def transition(self, state: FloatArray, step_s: FloatArray) -> FloatArray:
        """Return the transition matrices (n, d, d) of steps (n,) about states."""
        ...

    def noise_root(self, step_s: FloatArray, state: FloatArray) -> FloatArray | None:
        """Return a root (n, d, k) of the covariance of the noise gathered in steps (n,), or None."""
        ...

    def taylor(self, state: FloatArray) -> FloatArray:
        """Return the derivatives (n, 5, 3) of the position."""
        ...

    def seen(self, slope: FloatArray, weight: FloatArray, state: FloatArray) -> FloatArray:
        """Return what looks gain a unit of state (m, 2, d) from what they gain a metre (m, 2, 3)."""
        ...

    def sides(self, state: FloatArray, side: FloatArray) -> FloatArray:
        """Return the spreads (n, 12, 12) of the first four derivatives of the position."""
        ...


#: The longest step, s: a density that changes by e in two of them leaves 2 % of a step's drag.
_LONGEST_STEP_S = 1.0

#: How fast the velocity wanders, as a share of the drag, 1/√s: a coefficient off by a tenth for a second.
_DOUBT = 0.1

#: Heights count as known no better than this, m: it is what the density's slope is taken over.
_LEAST_SIGMA_M = 50.0

#: Gauss and Hermite's outer nodes, standard deviations, each of weight 1/6.
_NODE = np.sqrt(3.0)

#: For how long what a straight line leaves of the drag stays the same, s.
_LASTS_S = 10.0

#: Back in time drag speeds up without limit: no step multiplies a speed by more than the inverse of this.
_LEAST_KEPT = 0.1


class _Air(NamedTuple):
    """Drag over the square of the speed, ρ / 2β (n,), 1/m, about states: mean, slope with height, and what is left.

    Of a state whose height is not well known these are its mean over the height's distribution, the slope of the best
    straight line and the deviation from it (statistical linearisation: Särkkä, Bayesian Filtering and Smoothing, 2013,
    5.4), by Gauss and Hermite's three nodes.
    """

    rate: FloatArray
    slope: FloatArray
    left: FloatArray


@frozen(eq=False)
class DraggedFall:
    """A fall with drag: states (n, 6), position and velocity, whose heights are known to `height_sigma_m` (n,)."""

    fall: Motion
    drag: Drag
    height_sigma_m: FloatArray | float = 0.0
    size: int = field(default=COAST, init=False)

    def about(self, mean: FloatArray, root: FloatArray) -> "DraggedFall":
        """Return the fall of states known so well: means (n, 6) and roots (n, 6, 6) of information."""
        up = mean[:, :3] / np.sqrt(dot(mean[:, :3], mean[:, :3]))[:, None]
        side = (up[:, None, :] @ spread(root)[:, :3])[:, 0]
        return evolve(self, height_sigma_m=np.sqrt(dot(side, side)))

    def propagated(self, state: FloatArray, step_s: FloatArray) -> FloatArray:
        """Return states (n, 6) after steps (n,), s."""
        pieces = max(1, int(np.ceil(np.max(np.abs(step_s), initial=0.0) / _LONGEST_STEP_S)))
        step_s, half = step_s / pieces, 0.5 * step_s / pieces
        state = state.copy()
        for _ in range(pieces):
            state[:, 3:] += self._kicked(state, half)
            state = self.fall.stepped(state, step_s)
            state[:, 3:] += self._kicked(state, half)
        return state

    def _kicked(self, state: FloatArray, step_s: FloatArray) -> FloatArray:
        """Return what drag alone adds to velocities (n, 3) in steps (n,): w' = -k |w| w, solved for a constant k."""
        wind = self._wind(state)
        kept = _kept(self._air(state).rate * np.sqrt(dot(wind, wind)) * step_s)
        return (kept - 1.0)[:, None] * wind

    def slowed(self, state: FloatArray) -> FloatArray:
        """Return the accelerations (n, 3) of drag, m/s²."""
        wind = self._wind(state)
        return -(self._air(state).rate * np.sqrt(dot(wind, wind)))[:, None] * wind

    def _wind(self, state: FloatArray) -> FloatArray:
        spin = self.drag.air_rotation_rad_s
        wind: FloatArray = state[:, 3:] - np.array([-spin, spin, 0.0]) * state[:, [1, 0, 2]]
        return wind

    def _air(self, state: FloatArray) -> _Air:
        """Return the air about states; below where it is known, as where it ends."""
        place = np.ascontiguousarray(state[:, :3].T)
        height = height_m(place, 1.0 / np.sqrt(np.sum(place * place, axis=0)))
        sigma = np.maximum(self.height_sigma_m, _LEAST_SIGMA_M) + 0.0 * height
        nodes = np.maximum(height + np.outer([0.0, _NODE, -_NODE], sigma), LOWEST_HEIGHT_M)
        density = density_kg_m3(nodes, self.drag.atmosphere) / (2.0 * self.drag.ballistic_coefficient_kg_m2)
        there, above, below = density
        rate = (4.0 * there + above + below) / 6.0
        slope = (above - below) / (2.0 * _NODE * sigma)
        square = (4.0 * there**2 + above**2 + below**2) / 6.0
        return _Air(rate, slope, np.sqrt(np.maximum(square - rate**2 - (slope * sigma) ** 2, 0.0)))

    def transition(self, state: FloatArray, step_s: FloatArray) -> FloatArray:
        """Return the transition matrices (n, 6, 6) of steps (n,): those of the fall between two halves of the drag's.

        The density changes along the radius, and how the air's motion changes with the position is left out.
        """
        wind, up = self._wind(state), state[:, :3] / np.sqrt(dot(state[:, :3], state[:, :3]))[:, None]
        speed, air, half_s = np.sqrt(dot(wind, wind) + 1e-12), self._air(state), 0.5 * step_s
        kept = _kept(air.rate * speed * half_s)
        half = np.broadcast_to(np.eye(COAST), (len(state), COAST, COAST)).copy()
        half[:, 3:, :3] = -(kept**2 * half_s * air.slope * speed)[:, None, None] * wind[:, :, None] * up[:, None, :]
        half[:, 3:, 3:] = kept[:, None, None] * np.eye(3)
        half[:, 3:, 3:] -= (kept**2 * half_s * air.rate / speed)[:, None, None] * wind[:, :, None] * wind[:, None, :]
        moved: FloatArray = half @ self.fall.transition(state, step_s) @ half
        return moved

    def noise_root(self, step_s: FloatArray, state: FloatArray) -> FloatArray:
        """Return L (n, 6, 6) with L Lᵀ the covariance of the noise gathered in steps (n,) from states on."""
        wind, air = self._wind(state), self._air(state)
        square = dot(wind, wind)
        wander = np.sqrt(self.fall.noise**2 + ((_DOUBT * air.rate) ** 2 + _LASTS_S * air.left**2) * square**2)
        root: FloatArray = wander[:, None, None] * noises(np.abs(step_s), COAST // 3)
        return root

    def taylor(self, state: FloatArray) -> FloatArray:
        """Return the derivatives (n, 5, 3) of the position, from the zeroth to the fourth; drag is in the second."""
        derivative = self.fall.taylor(state)
        derivative[:, 2] += self.slowed(state)
        return derivative

    def seen(self, slope: FloatArray, weight: FloatArray, state: FloatArray) -> FloatArray:
        """Return what looks gain a unit of state (m, 2, 6) from what they gain a metre (m, 2, 3)."""
        return self.fall.seen(slope, weight, state)

    def sides(self, state: FloatArray, side: FloatArray) -> FloatArray:
        """Return the spreads (n, 12, 12) of the first four derivatives of the position."""
        return self.fall.sides(state, side)


def _kept(share: FloatArray) -> FloatArray:
    """Return which part of the speed drag leaves in a step in which it would take a share at its first rate."""
    return 1.0 / np.maximum(1.0 + share, _LEAST_KEPT)
