"""Hyperbolas that come in from afar: Kepler's equation is solved from the pericentre, where nothing cancels.

From a distant start, Kepler's equation is a difference of exponentials: solving it loses (r / a e)² where the problem
only loses r / a e. Counted from the pericentre, all its terms have one sign. The end point then follows from the
pericentre too, except while the arc is still on its far way in: there the start is the better reference.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from opir_core.arrays import FloatArray
from opir_core.flight.column_vectors import cross, dot
from opir_core.flight.kepler_equation import Arcs
from opir_core.flight.stumpff import universal_functions

#: Within so many a e of the centre on the way in, the pericentre is as good a reference as the start.
_NEAR = 3.0


class Flybys(NamedTuple):
    """Incoming hyperbolas, told from the pericentre; units of each start (distance and mu are 1), vectors (3, n)."""

    position: FloatArray
    velocity: FloatArray
    alpha: FloatArray
    time: FloatArray
    eccentricity: FloatArray
    pericentre: FloatArray  #: distance
    ahead: FloatArray  #: unit vector to the pericentre
    sideways: FloatArray  #: velocity there times the distance; zero on a straight line
    approach: FloatArray  #: universal anomaly from the start to the pericentre
    later: FloatArray  #: time asked for, since the pericentre; negative before it

    def arcs(self) -> Arcs[np.float64]:
        """Return what Kepler's equation needs; the anomaly counts from the pericentre, without sign."""
        return Arcs(self.pericentre, np.zeros_like(self.later), self.alpha, np.abs(self.later))

    def states(self, solution: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return positions and velocities, (3, n), at the solved anomalies."""
        s, g0, g1, g2 = solution
        g1 = np.copysign(g1, self.later)
        r = self.pericentre * g0 + g2
        position = (self.pericentre - g2) * self.ahead + g1 * self.sideways
        velocity = (g0 * self.sideways - g1 * self.ahead) / r
        at = np.flatnonzero((self.later < 0.0) & (-self.alpha * r > _NEAR * self.eccentricity))
        if at.size:
            position[:, at], velocity[:, at] = self._on_the_way_in(at, s[at], r[at])
        return position, velocity

    def _on_the_way_in(self, at: NDArray[np.intp], s: FloatArray, r: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return positions and velocities of some, from their starts by Lagrange's f and g."""
        _, g1, g2, g3 = universal_functions(self.alpha[at], self.approach[at] - s)
        position, velocity = self.position[:, at], self.velocity[:, at]
        moved = (1.0 - g2) * position + (self.time[at] - g3) * velocity
        return moved, (1.0 - g2 / r) * velocity - g1 / r * position


def flybys(position: FloatArray, velocity: FloatArray, alpha: FloatArray, time: FloatArray) -> Flybys:
    """Return the arcs followed for `time` >= 0 from these states, (3, n), on incoming hyperbolas (`alpha` < 0).

    The vector to the pericentre is v × h - r / |r|: with cross products it keeps its accuracy on nearly straight lines.
    """
    momentum = cross(position, velocity)
    momentum_squared = dot(momentum, momentum)
    eccentricity = np.sqrt(1.0 - alpha * momentum_squared)
    ahead = (cross(velocity, momentum) - position) / eccentricity
    k = np.sqrt(-alpha)
    rise = -dot(position, velocity) * k
    approach = np.arcsinh(rise / eccentricity)
    later = time - (rise - approach) / (k * k * k)
    pericentre = momentum_squared / (1.0 + eccentricity)
    sideways = cross(momentum, ahead)
    return Flybys(position, velocity, alpha, time, eccentricity, pericentre, ahead, sideways, approach / k, later)
