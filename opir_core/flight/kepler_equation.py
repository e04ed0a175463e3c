"""Kepler's equation in universal variables: time, distance and their slopes along arcs of any conic.

In units with mu = 1 an arc is three numbers at its start: distance `rho`, `sigma` = r·v and `alpha` = 1 / a. Kepler's
equation is  t = rho G1 + sigma G2 + G3  with the universal functions of `stumpff`. Its derivatives in s are the
distance r = rho G0 + sigma G1 + G2 >= 0, r' = sigma G0 + (1 - alpha rho) G1 and r'' = 1 - alpha r: time rises
monotonically with s (Danby, Fundamentals of Celestial Mechanics, 2nd ed. 1988, §6.9).
"""

from typing import Generic, NamedTuple

import numpy as np
from numpy.typing import NDArray

from opir_core.arrays import FloatArray
from opir_core.flight.stumpff import Functions, Real

_EPSILON = float(np.finfo(float).eps)


class Arcs(NamedTuple, Generic[Real]):
    """Starts of arcs, and the times >= 0 to follow them; one-dimensional arrays in units with mu = 1.

    On closed orbits the time is at most a period.
    """

    rho: NDArray[Real]
    sigma: NDArray[Real]
    alpha: NDArray[Real]
    time: NDArray[Real]

    def at(self, index: NDArray[np.intp]) -> "Arcs[Real]":
        """Return the arcs at these indices."""
        return Arcs(self.rho[index], self.sigma[index], self.alpha[index], self.time[index])


def derivatives(arcs: Arcs[Real], functions: Functions[Real]) -> tuple[NDArray[Real], NDArray[Real], NDArray[Real]]:
    """Return by how much the anomaly is reached later than the arc's time, and the first two derivatives, r and r'."""
    g0, g1, g2, g3 = functions
    rho, sigma, alpha, time = arcs
    excess = rho * g1
    excess += sigma * g2
    excess += g3
    excess -= time
    r = rho * g0
    r += sigma * g1
    r += g2
    slope = alpha * rho
    np.subtract(1.0, slope, out=slope)
    slope *= g1
    slope += sigma * g0
    return excess, r, slope


def laguerre_step(arcs: Arcs[Real], functions: Functions[Real]) -> NDArray[Real]:
    """Return Laguerre's step towards the anomaly, for degree 5 (Conway, Celestial Mechanics 39, 1986, 199-211)."""
    step, r, slope = derivatives(arcs, functions)
    step /= r
    slope /= r
    slope *= step
    slope *= 20.0
    np.subtract(16.0, slope, out=slope)
    np.abs(slope, out=slope)
    np.sqrt(slope, out=slope)
    slope += 1.0
    step *= -5.0
    step /= slope
    return step


def excess_and_noise(arcs: Arcs[np.float64], functions: Functions[np.float64]) -> tuple[FloatArray, FloatArray]:
    """Return by how much the anomaly is reached later than the arc's time, and the rounding error of that."""
    _, g1, g2, g3 = functions
    excess = arcs.rho * g1 + arcs.sigma * g2 + g3 - arcs.time
    return excess, 2.0 * _EPSILON * (arcs.rho * np.abs(g1) + np.abs(arcs.sigma) * g2 + g3 + arcs.time)
