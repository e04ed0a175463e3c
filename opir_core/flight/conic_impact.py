"""Impacts of two-body arcs: the first descent through the WGS 84 ellipsoid, or a surface of
constant height above it.

The Earth rotates about the axis of its ellipsoid, so the ellipsoid is fixed in an inertial frame.
The arc is cut with the two spheres that enclose the surface, in closed form; between those cuts a
steep arc meets the surface once. For arcs along the surface all cuts with the ellipsoid are
computed: with T the half-angle tangent along a conic, its point is a quadratic in T over 1 + alpha
T², so the cuts are the roots of a quartic. Its real and nearly real roots are where the height can
change sign. Newton's method within the bracket then solves for the geodetic height.
"""

from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike

from opir_core.arrays import BoolArray, FloatArray, RowArray
from opir_core.constants import (
    EARTH_EQUATORIAL_RADIUS_M,
    EARTH_FLATTENING,
    EARTH_MU_M3_S2,
    EARTH_POLAR_RADIUS_M,
)
from opir_core.flight.kepler import flat_states
from opir_core.flight.universal_anomaly import cross, dot, length, universal_functions
from opir_core.geometry.ellipsoid import height_along_normal, normal_at_foot
from opir_core.geometry.vectors import FloatPair

#: Below this alpha T², two terms of the series of the arctangent suffice for a bracket.
_SERIES = 1e-6


class ConicArcs(NamedTuple):
    """Arcs from states at universal anomaly 0, in units of each start (its distance and mu are 1);
    vectors (3, n).
    """

    position: FloatArray
    velocity: FloatArray
    sigma: FloatArray  #: position · velocity
    alpha: FloatArray  #: reciprocal of the semi-major axis
    momentum: FloatArray  #: angular momentum
    length_m: FloatArray  #: the unit of length
    second_s: FloatArray  #: the unit of time

    def at(self, index: RowArray) -> "ConicArcs":
        """Return the arcs at these indices, in order."""
        if len(index) == len(self.sigma):
            return self
        return ConicArcs(*(column[..., index] for column in self))

    def times_and_positions(self, s: FloatArray) -> FloatPair:
        """Return times since the start, s, and positions (3, n), m."""
        _, g1, g2, g3 = universal_functions(self.alpha, s)
        positions = (
            (1.0 - g2) * self.position + (g1 + self.sigma * g2) * self.velocity
        ) * self.length_m
        return (g1 + self.sigma * g2 + g3) * self.second_s, positions

    def heights_m(self, s: FloatArray) -> FloatArray:
        """Return geodetic heights, m."""
        return self.heights_and_slopes(s)[0]

    def heights_and_slopes(self, s: FloatArray) -> FloatPair:
        """Return geodetic heights, m, and their derivatives in the anomaly."""
        g0, g1, g2, _ = universal_functions(self.alpha, s)
        x, y, z = (
            (1.0 - g2) * self.position + (g1 + self.sigma * g2) * self.velocity
        ) * self.length_m
        rates = ((g0 + self.sigma * g1) * self.velocity - g1 * self.position) * self.length_m
        rho = np.sqrt(x * x + y * y)
        sine, cosine = normal_at_foot(rho, z, EARTH_EQUATORIAL_RADIUS_M, EARTH_POLAR_RADIUS_M)
        heights = height_along_normal(
            rho, z, sine, cosine, EARTH_EQUATORIAL_RADIUS_M, EARTH_POLAR_RADIUS_M
        )
        outward = (x * rates[0] + y * rates[1]) / np.where(rho > 0.0, rho, 1.0)
        return heights, cosine * outward + sine * rates[2]

    def turns(self) -> FloatArray:
        """Return the anomaly of a whole turn, `nan` for open arcs."""
        turn: FloatArray = 2.0 * np.pi / np.sqrt(self.alpha)
        return np.where(np.isfinite(turn), turn, np.nan)

    def radial_squared(self, radius: FloatArray) -> FloatArray:
        """Return (r·v)² at a distance; negative where the arc never has it."""
        return radius * (2.0 - self.alpha * radius) - self.momentum * self.momentum

    def first_descent(self, radius: FloatArray) -> FloatArray:
        """Return the first anomaly >= 0 of descent through a distance; `nan` without one.

        The half-angle tangent T of the way there satisfies T (sigma + sigma_end) = r_end - r_start,
        or equally T (alpha (r_start + r_end) - 2) = sigma_start - sigma_end; the form without
        cancellation is used.
        """
        end = -np.sqrt(self.radial_squared(radius))
        rising = self.sigma > 0.0
        over = np.where(rising, self.sigma - end, 1.0 - radius)
        under = np.where(rising, self.alpha * (radius + 1.0) - 2.0, -self.sigma - end)
        return self.anomalies(over, under)

    def anomalies(self, over: FloatArray, under: FloatArray) -> FloatArray:
        """Return the anomaly in [0, a turn) whose half-angle tangent G1(s/2) / G0(s/2) is over /
        under.

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
    position = np.ascontiguousarray(position_m.T)
    velocity = np.ascontiguousarray(velocity_m_s.T)
    distance = length(position)
    speed = np.sqrt(mu_m3_s2 / distance)
    position = position / distance
    velocity = velocity / speed
    momentum = length(cross(position, velocity))
    alpha = 2.0 - dot(velocity, velocity)
    return ConicArcs(
        position, velocity, dot(position, velocity), alpha, momentum, distance, distance / speed
    )


#: Angles with tangent T at which the quartic is sampled. It is expressed in the tangent of the
#: angle from that of the largest sample, and so has no root at infinity.
_ANGLES = np.pi / 5.0 * np.arange(5)
_FROM_INFINITY = _ANGLES - 0.5 * np.pi
_COEFFICIENTS = np.linalg.inv(
    np.stack(
        [np.sin(_FROM_INFINITY) ** k * np.cos(_FROM_INFINITY) ** (4 - k) for k in range(5)], axis=1
    )
)

#: A start on the surface is itself a root: roots within this anomaly of the start are ignored.
_START = 1e-6


def grazing_brackets(arcs: ConicArcs, height_m: FloatArray, on_surface_m: float) -> FloatPair:
    """Return anomalies that bracket the first descent of each arc through the surface; `nan`
    without one.

    Both are 0 where the start is on the surface, to `on_surface_m`, and the arc descends.
    """
    start = arcs.heights_m(np.zeros_like(height_m)) - height_m
    on_surface = np.abs(start) <= on_surface_m
    probes = _probes(arcs, _cuts(arcs, height_m), on_surface)
    outside = (
        arcs.at(np.arange(probes.size) % start.size).heights_m(probes.ravel()).reshape(probes.shape)
        > height_m
    )
    outside[0] = start > on_surface_m
    falls = outside[:-1] & ~outside[1:]
    fall = np.argmax(falls, axis=0)
    column = np.arange(start.size)
    low, high = (np.where(falls.any(axis=0), probes[fall + k, column], np.nan) for k in (0, 1))
    at_once = on_surface & ~outside[1]
    return np.where(at_once, 0.0, low), np.where(at_once, 0.0, high)


def _probes(arcs: ConicArcs, cuts: FloatArray, on_surface: BoolArray) -> FloatArray:
    """Return rows of increasing anomalies: the start, the cuts, the end of the turn (or beyond),
    and the midpoints.
    """
    turn = arcs.turns()
    near_start = on_surface & ((cuts < _START) | (cuts > turn - _START))
    cuts = np.sort(np.where(near_start, np.nan, cuts), axis=0)
    end = np.where(np.isfinite(turn), turn, 2.0 * np.nanmax(cuts, axis=0, initial=0.5))
    cuts = np.where(np.isfinite(cuts), cuts, end)
    marks = np.concatenate([np.zeros_like(end)[None], cuts, end[None]])
    probes = np.empty((2 * len(marks) - 1, end.size))
    probes[::2] = marks
    probes[1::2] = 0.5 * (marks[1:] + marks[:-1])
    return probes


def _cuts(arcs: ConicArcs, height_m: FloatArray) -> FloatArray:
    """Return the anomalies (4, n) of the cuts, or nearest approaches, of each arc with the
    ellipsoid of that height.
    """
    largest, coefficients = _quartic(arcs, height_m)
    companions = np.zeros((height_m.size, 4, 4))
    companions[:, (1, 2, 3), (0, 1, 2)] = 1.0
    for k in range(4):
        companions[:, 0, 3 - k] = -coefficients[k] / coefficients[4]
    companions[~np.isfinite(companions).all(axis=(1, 2))] = 0.0
    tangents = np.linalg.eigvals(companions).real.T
    cosine = np.cos(_ANGLES[largest])
    sine = np.sin(_ANGLES[largest])
    return np.stack([arcs.anomalies(cosine - t * sine, -sine - t * cosine) for t in tangents])


def _quartic(arcs: ConicArcs, height_m: FloatArray) -> tuple[RowArray, list[FloatArray]]:
    """Return the numbers of the angles with the largest samples, and the coefficients of the
    quartics, lowest power first, in the tangent of the angle from there.
    """
    samples = np.stack([_excess(arcs, height_m, np.cos(angle), np.sin(angle)) for angle in _ANGLES])
    largest = np.argmax(np.abs(samples), axis=0)
    column = np.arange(height_m.size)
    turned = [samples[(largest + k) % 5, column] for k in range(5)]
    return largest, [
        sum(factor * sample for factor, sample in zip(row, turned, strict=True))
        for row in _COEFFICIENTS
    ]


def _excess(arcs: ConicArcs, height_m: FloatArray, cosine: float, sine: float) -> FloatArray:
    """Return the quartic in homogeneous T = sine / cosine: positive outside the ellipsoid."""
    c2 = cosine * cosine
    s2 = sine * sine
    x, y, z = (c2 + (arcs.alpha - 2.0) * s2) * arcs.position + 2.0 * (
        cosine * sine + arcs.sigma * s2
    ) * arcs.velocity
    equatorial = (EARTH_EQUATORIAL_RADIUS_M + height_m) / arcs.length_m
    polar = (EARTH_POLAR_RADIUS_M + height_m) / arcs.length_m
    scale = c2 + arcs.alpha * s2
    return (x * x + y * y) / (equatorial * equatorial) + z * z / (polar * polar) - scale * scale


#: A start this close to the surface, m, is on it, so that rounding does not decide whether it
#: falls.
ON_SURFACE_M = 1e-6

#: Margin of the spheres to the surface, m, so that the bracket encloses a crossing on a sphere.
_MARGIN_M = 1.0


_BLOCK = 8192


def kepler_impact(
    position_m: ArrayLike,
    velocity_m_s: ArrayLike,
    height_m: ArrayLike = 0.0,
    mu_m3_s2: float = EARTH_MU_M3_S2,
) -> FloatPair:
    """Return the times to impact, s, and the impact points, m (ECI), of two-body arcs.

    Position and velocity (..., 3) are in an inertial frame about the Earth's centre with z along
    its axis, such as ECEF frozen at scene epoch; leading axes broadcast with `height_m`. The impact
    is the first descent through the surface of geodetic height `height_m` above the WGS 84
    ellipsoid, to 1e-6 m. A start below the surface that descends has come down: time 0, at the
    start. One that ascends, as from a launch site below the ellipsoid, must first rise through the
    surface. A start within 1e-6 m of the surface is on it.

    `nan` without a descent (pericentre above the surface, apocentre below it, escape), where an
    input is not finite, and for heights below -6 000 km.
    """
    position, velocity, height, shape = flat_states(position_m, velocity_m_s, height_m)
    duration = np.empty(height.shape)
    point = np.empty((height.size, 3))
    with np.errstate(all="ignore"):
        for start in range(0, height.size, _BLOCK):
            block = slice(start, start + _BLOCK)
            duration[block], point[block] = _impacts(
                position[block], velocity[block], height[block], mu_m3_s2
            )
    return duration.reshape(shape), point.reshape(*shape, 3)


def _impacts(
    position: FloatArray, velocity: FloatArray, height: FloatArray, mu: float
) -> FloatPair:
    """Return times (n,) and points (n, 3) of impact."""
    duration = np.full(height.shape, np.nan)
    point = np.full((height.size, 3), np.nan)
    finite = (
        np.isfinite(position).all(axis=1) & np.isfinite(velocity).all(axis=1) & (height > -6.0e6)
    )
    (at,) = (finite & (height < np.inf) & (position != 0.0).any(axis=1)).nonzero()
    if not at.size:
        return duration, point
    arcs = conic_arcs(position[at], velocity[at], mu)
    low, high = _brackets(arcs, height[at])
    (hit,) = (low <= high).nonzero()
    at = at[hit]
    if at.size:
        arcs = arcs.at(hit)
        duration[at], places = arcs.times_and_positions(
            _descent(arcs, height[at], low[hit], high[hit])
        )
        point[at] = places.T
    return duration, point


def _brackets(arcs: ConicArcs, height: FloatArray) -> FloatPair:
    """Return anomalies that bracket the first descent of each arc through the surface; `nan`
    without one.
    """
    outer = (EARTH_EQUATORIAL_RADIUS_M + _MARGIN_M + height) / arcs.length_m
    inner = (EARTH_POLAR_RADIUS_M - _MARGIN_M + height) / arcs.length_m
    at_outer = arcs.radial_squared(outer)
    at_inner = arcs.radial_squared(inner)
    # An arc is steep above this slope: twice the steepest slope of the surface against a sphere.
    least = ((2.0 * EARTH_FLATTENING) * arcs.momentum) ** 2
    steep = (at_outer > least) & (at_inner > least)
    low, high = _steep_brackets(arcs, height, outer, inner)
    turning = 1.0 / arcs.alpha
    turns_between = (turning > inner) & (turning < outer)
    (grazing,) = (~steep & ((at_outer > 0.0) | (at_inner > 0.0) | turns_between)).nonzero()
    low[~steep] = np.nan
    if grazing.size:
        low[grazing], high[grazing] = grazing_brackets(
            arcs.at(grazing), height[grazing], ON_SURFACE_M
        )
    (deep,) = (outer > 1.0).nonzero()
    if deep.size:
        landed = deep[_have_come_down(arcs.at(deep), height[deep])]
        low[landed] = 0.0
        high[landed] = 0.0
    return low, high


def _have_come_down(arcs: ConicArcs, height: FloatArray) -> BoolArray:
    """Return which arcs start below their heights and descend."""
    above, climb = arcs.heights_and_slopes(np.zeros(height.size))
    return (above < height - ON_SURFACE_M) & (climb < 0.0)


def _steep_brackets(
    arcs: ConicArcs, height: FloatArray, outer: FloatArray, inner: FloatArray
) -> FloatPair:
    """Return the anomalies of the first descents through the two spheres.

    A start that falls between them has yet to fall through the surface, or is on it: then the
    impact is immediate.
    """
    low = arcs.first_descent(outer)
    high = arcs.first_descent(inner)
    (falling,) = ((outer > 1.0) & (inner < 1.0) & (arcs.sigma < 0.0)).nonzero()
    if falling.size:
        above = arcs.at(falling).heights_m(np.zeros(falling.size)) - height[falling]
        low[falling] = 0.0
        high[falling] = np.where(above <= ON_SURFACE_M, 0.0, high[falling])
    return low, high


def _descent(arcs: ConicArcs, height: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Return the anomaly within each bracket at which the height is reached, by Newton's method
    held to the bracket.
    """
    s = 0.5 * (low + high)
    still = low < high
    for _ in range(80):
        (at,) = still.nonzero()
        if not at.size:
            break
        above, slope = arcs.at(at).heights_and_slopes(s[at])
        above -= height[at]
        low[at] = np.where(above > 0.0, s[at], low[at])
        high[at] = np.where(above > 0.0, high[at], s[at])
        newton = s[at] - above / slope
        inside = (newton >= low[at]) & (newton <= high[at])
        trial = np.where(inside, newton, 0.5 * (low[at] + high[at]))
        # A Newton step this small, relative to the anomaly, is the last: the next would be its
        # square. A halving of a few roundings leaves nothing to halve.
        enough = np.where(inside, 1e-10, 4.0 * np.finfo(float).eps) * high[at]
        still[at] = np.abs(trial - s[at]) > enough
        s[at] = trial
    return s
