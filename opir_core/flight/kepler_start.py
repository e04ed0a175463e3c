"""The start of two-body arcs as Kepler's equation wants it: scaled, without whole turns, followed forward."""

from math import pi
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from opir_core.arrays import BoolArray, FloatArray
from opir_core.flight.kepler_equation import Arcs

#: More turns than this leave no digit of the phase.
_MOST_TURNS = 2.0**50


class Start(NamedTuple):
    """Starts of arcs: columns of the state, and the arc in units of the start's distance and circular speed."""

    x: FloatArray
    y: FloatArray
    z: FloatArray
    vx: FloatArray
    vy: FloatArray
    vz: FloatArray
    rate: FloatArray  #: circular speed over distance, 1/s
    back: FloatArray  #: -1 where the arc is followed back in time, its velocity then turned round, else 1
    sigma: FloatArray
    alpha: FloatArray
    time: FloatArray  #: without whole turns, never negative; nan where the turns are too many

    def arcs(self) -> Arcs[np.float64]:
        """Return what Kepler's equation needs."""
        return Arcs(np.ones_like(self.sigma), self.sigma, self.alpha, self.time)

    def flies_by(self) -> BoolArray:
        """Return where the arc comes in on a hyperbola from beyond three times a e, and gets about half way in."""
        x = -self.alpha
        eccentricity_squared = 1.0 + x * (2.0 + x - self.sigma * self.sigma)
        return (x > 1.0) & (self.time * self.sigma < -0.5) & (x * x > 9.0 * eccentricity_squared)

    def scales(self) -> tuple[FloatArray, FloatArray]:
        """Return each start's distance, m, and what scales its velocity to circular speeds in the sense followed."""
        distance = np.sqrt(self.x * self.x + self.y * self.y + self.z * self.z)
        return distance, self.back / (distance * self.rate)

    def is_well(self) -> BoolArray:
        """Return where all numbers are finite."""
        return np.isfinite(self.sigma + self.alpha + self.time + self.rate)

    def at(self, index: NDArray[np.intp]) -> "Start":
        """Return the starts at these indices."""
        return Start(*(column[index] for column in self))


def start_of(position_m: FloatArray, velocity_m_s: FloatArray, duration_s: FloatArray, mu_m3_s2: float) -> Start:
    """Return the starts of arcs from states (n, 3), to be followed for durations (n,)."""
    x, y, z = (position_m[:, axis].copy() for axis in range(3))
    vx, vy, vz = (velocity_m_s[:, axis].copy() for axis in range(3))
    distance = np.sqrt(x * x + y * y + z * z)
    speed = np.sqrt(mu_m3_s2 / distance)
    rate = speed / distance
    sigma = (x * vx + y * vy + z * vz) / (distance * speed)
    alpha = 2.0 - (vx * vx + vy * vy + vz * vz) / (speed * speed)
    time = _without_turns(duration_s * rate, alpha)
    back = np.copysign(1.0, time)
    return Start(x, y, z, vx, vy, vz, rate, back, sigma * back, alpha, np.abs(time))


def _without_turns(time: FloatArray, alpha: FloatArray) -> FloatArray:
    """Return the time less the whole turns of closed orbits nearest to it: at most half a period, either sign."""
    per_time = np.abs(alpha) * np.sqrt(np.abs(alpha)) * (0.5 / pi)
    turns = np.rint(time * per_time)
    turns[alpha <= 0.0] = 0.0
    if not turns.any():
        return time
    whole = turns / np.where(turns != 0.0, per_time, 1.0)
    return np.where(np.abs(turns) > _MOST_TURNS, np.nan, time - whole)
