"""Free flight through the air, in the inertial frame: what `motion` has for a fall, and drag.

A step is half a kick of drag, a fall, and the other half (Strang, SIAM J. Numer. Anal. 5, 1968, 506). What the tracker
knows of a target's drag is the scene's ballistic coefficient, and a target may bring its own: the velocity's noise
grows with the drag. Units m, s.
"""

import numpy as np
from attrs import field, frozen

from opir_core.flight.atmosphere_density import LOWEST_HEIGHT_M, density_kg_m3
from opir_core.flight.ellipsoidal_height import height_m
from opir_core.flight.forces import Drag
from opir_core.records import FloatArray
from opir_core.tracking.filter.motion import COAST, Motion, noises
from opir_core.tracking.rays import dot

#: The longest step, s: a density that changes by e in two of them leaves 2 % of a step's drag.
_LONGEST_STEP_S = 1.0

#: How fast the velocity wanders, as a share of the drag, 1/√s: a coefficient off by a tenth for a second.
_DOUBT = 0.1

#: The density's slope is that over this difference of height, m.
_APART_M = 100.0


@frozen(eq=False)
class DraggedFall:
    """A fall with drag: states (n, 6), position and velocity."""

    fall: Motion
    drag: Drag
    size: int = field(default=COAST, init=False)

    def propagated(self, state: FloatArray, step_s: FloatArray) -> FloatArray:
        """Return states (n, 6) after steps (n,), s."""
        pieces = max(1, int(np.ceil(np.max(np.abs(step_s), initial=0.0) / _LONGEST_STEP_S)))
        step_s, half = step_s / pieces, 0.5 * step_s[:, None] / pieces
        state = state.copy()
        for _ in range(pieces):
            state[:, 3:] += half * self.slowed(state)
            state = self.fall.stepped(state, step_s)
            state[:, 3:] += half * self.slowed(state)
        return state

    def slowed(self, state: FloatArray) -> FloatArray:
        """Return the accelerations (n, 3) of drag, m/s²."""
        wind = self._wind(state)
        return -(self._rate(state, 0.0) * np.sqrt(dot(wind, wind)))[:, None] * wind

    def _wind(self, state: FloatArray) -> FloatArray:
        spin = self.drag.air_rotation_rad_s
        wind: FloatArray = state[:, 3:] - np.array([-spin, spin, 0.0]) * state[:, [1, 0, 2]]
        return wind

    def _rate(self, state: FloatArray, higher_m: float) -> FloatArray:
        """Return ρ / 2β (n,), 1/m, so much higher than states; below where the air is known, as where it ends."""
        place = np.ascontiguousarray(state[:, :3].T)
        height = height_m(place, 1.0 / np.sqrt(np.sum(place * place, axis=0)))
        density = density_kg_m3(np.maximum(height + higher_m, LOWEST_HEIGHT_M), self.drag.atmosphere)
        rate: FloatArray = density / (2.0 * self.drag.ballistic_coefficient_kg_m2)
        return rate

    def transition(self, state: FloatArray, step_s: FloatArray) -> FloatArray:
        """Return the transition matrices (n, 6, 6) of steps (n,): those of the fall between two halves of the drag's.

        The density changes along the radius, and how the air's motion changes with the position is left out.
        """
        wind, up = self._wind(state), state[:, :3] / np.sqrt(dot(state[:, :3], state[:, :3]))[:, None]
        speed = np.sqrt(dot(wind, wind) + 1e-12)
        rate, higher = self._rate(state, 0.0), self._rate(state, _APART_M)
        kick = np.zeros((len(state), COAST, COAST))
        kick[:, 3:, :3] = -((higher - rate) / _APART_M * speed)[:, None, None] * wind[:, :, None] * up[:, None, :]
        kick[:, 3:, 3:] = -(rate / speed)[:, None, None] * wind[:, :, None] * wind[:, None, :]
        kick[:, 3:, 3:] -= (rate * speed)[:, None, None] * np.eye(3)
        half = np.eye(COAST) + 0.5 * step_s[:, None, None] * kick
        moved: FloatArray = half @ self.fall.transition(state, step_s) @ half
        return moved

    def noise_root(self, step_s: FloatArray, state: FloatArray) -> FloatArray:
        """Return L (n, 6, 6) with L Lᵀ the covariance of the noise gathered in steps (n,) from states on."""
        push = self.slowed(state)
        wander = np.sqrt(self.fall.noise**2 + _DOUBT**2 * dot(push, push))
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
