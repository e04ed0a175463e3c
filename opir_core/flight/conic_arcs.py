"""Two-body arcs as functions of the universal anomaly: point, time, height above the ellipsoid, cuts with spheres."""

from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from opir_core.arrays import FloatArray
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_POLAR_RADIUS_M
from opir_core.flight.column_vectors import cross, dot, length
from opir_core.flight.stumpff import universal_functions
from opir_core.geometry.foot import height_along_normal, normal_at_foot

#: Below this alpha T², two terms of the series of the arctangent are exact enough to bracket with.
_SERIES = 1e-6


class ConicArcs(NamedTuple):
    """Arcs from states at universal anomaly 0, in units of each start (its distance and mu are 1); vectors (3, n)."""

    position: FloatArray
    velocity: FloatArray
    sigma: FloatArray  #: position · velocity
    alpha: FloatArray  #: reciprocal of the semi-major axis
    momentum: FloatArray  #: angular momentum
    length_m: FloatArray  #: the unit of length
    second_s: FloatArray  #: the unit of time

    def at(self, index: NDArray[np.intp]) -> "ConicArcs":
        """Return the arcs at these indices, in order; of them all, the arcs themselves."""
        if len(index) == len(self.sigma):
            return self
        return ConicArcs(*(column[..., index] for column in self))

    def times_and_positions(self, s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return times since the start, s, and positions (3, n), m."""
        _, g1, g2, g3 = universal_functions(self.alpha, s)
        positions = ((1.0 - g2) * self.position + (g1 + self.sigma * g2) * self.velocity) * self.length_m
        return (g1 + self.sigma * g2 + g3) * self.second_s, positions

    def heights_m(self, s: FloatArray) -> FloatArray:
        """Return geodetic heights, m."""
        return self.heights_and_slopes(s)[0]

    def heights_and_slopes(self, s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return geodetic heights, m, and their derivatives in the anomaly."""
        g0, g1, g2, _ = universal_functions(self.alpha, s)
        x, y, z = ((1.0 - g2) * self.position + (g1 + self.sigma * g2) * self.velocity) * self.length_m
        rates = ((g0 + self.sigma * g1) * self.velocity - g1 * self.position) * self.length_m
        rho = np.sqrt(x * x + y * y)
        sine, cosine = normal_at_foot(rho, z, EARTH_EQUATORIAL_RADIUS_M, EARTH_POLAR_RADIUS_M)
        heights = height_along_normal(rho, z, sine, cosine, EARTH_EQUATORIAL_RADIUS_M, EARTH_POLAR_RADIUS_M)
        outward = (x * rates[0] + y * rates[1]) / np.where(rho > 0.0, rho, 1.0)
        return heights, cosine * outward + sine * rates[2]

    def turns(self) -> FloatArray:
        """Return the anomaly of a whole turn, `nan` where the arc does not close."""
        turn: FloatArray = 2.0 * np.pi / np.sqrt(self.alpha)
        return np.where(np.isfinite(turn), turn, np.nan)

    def radial_squared(self, radius: FloatArray) -> FloatArray:
        """Return (r·v)² where the arc is at a distance; negative where it never is."""
        return radius * (2.0 - self.alpha * radius) - self.momentum * self.momentum

    def first_descent(self, radius: FloatArray) -> FloatArray:
        """Return the first anomaly >= 0 at which the arc descends through a distance; `nan` where it never does.

        The half-angle tangent T of the way there satisfies T (sigma + sigma_end) = r_end - r_start, or equally
        T (alpha (r_start + r_end) - 2) = sigma_start - sigma_end: the one of the two that does not cancel is taken.
        """
        end = -np.sqrt(self.radial_squared(radius))
        rising = self.sigma > 0.0
        over = np.where(rising, self.sigma - end, 1.0 - radius)
        under = np.where(rising, self.alpha * (radius + 1.0) - 2.0, -self.sigma - end)
        return self.anomalies(over, under)

    def anomalies(self, over: FloatArray, under: FloatArray) -> FloatArray:
        """Return the anomaly in [0, a turn) whose half-angle tangent G1(s/2) / G0(s/2) is over / under.

        `nan` where an open arc has none ahead.
        """
        k = np.sqrt(np.abs(self.alpha))
        half = np.arctan2(k * over, under)
        closed = 2.0 * np.where(half < 0.0, half + np.pi, half) / k
        tangent = over / under
        z = self.alpha * tangent * tangent
        series = 2.0 * tangent * (1.0 - z * (1.0 / 3.0))
        slight = np.where((self.alpha > 0.0) & (series < 0.0), closed, series)
        open_ = np.where(np.abs(z) < _SERIES, slight, 2.0 * np.arctanh(k * tangent) / k)
        s = np.where((self.alpha > 0.0) & (np.abs(z) >= _SERIES), closed, open_)
        return np.where(s >= 0.0, s, np.nan)


def conic_arcs(position_m: FloatArray, velocity_m_s: FloatArray, mu_m3_s2: float) -> ConicArcs:
    """Return the arcs from states (n, 3)."""
    position, velocity = np.ascontiguousarray(position_m.T), np.ascontiguousarray(velocity_m_s.T)
    distance = length(position)
    speed = np.sqrt(mu_m3_s2 / distance)
    position, velocity = position / distance, velocity / speed
    momentum, alpha = length(cross(position, velocity)), 2.0 - dot(velocity, velocity)
    return ConicArcs(position, velocity, dot(position, velocity), alpha, momentum, distance, distance / speed)
