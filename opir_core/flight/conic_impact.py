"""Where and when a two-body arc comes down through the WGS 84 ellipsoid, or a surface of constant height above it.

The Earth turns about the axis of its ellipsoid, so the ellipsoid stands still in an inertial frame. The arc is cut with
the two spheres that hold the surface between them, in closed form; between those cuts a steep arc meets the surface
once. Arcs that graze it are told apart by all their cuts (`grazing_arcs`). Newton's method, held to the bracket found
either way, ends on the geodetic height.
"""

import numpy as np
from numpy.typing import ArrayLike

from opir_core.arrays import FloatArray
from opir_core.constants import (
    EARTH_EQUATORIAL_RADIUS_M,
    EARTH_FLATTENING,
    EARTH_MU_M3_S2,
    EARTH_POLAR_RADIUS_M,
)
from opir_core.flight.conic_arcs import ConicArcs, conic_arcs
from opir_core.flight.grazing_arcs import grazing_brackets
from opir_core.flight.kepler import flat_states

#: A start this near the surface, m, is on it: rounding of its position must not decide whether it has yet to fall.
ON_SURFACE_M = 1e-6

#: The cuts with the spheres lie this far outside the surface, m, so that the bracket holds a crossing on a sphere.
_MARGIN_M = 1.0

#: An arc is steep where it descends at this many times the steepest slope of the surface against a sphere.
_STEEP = 2.0 * EARTH_FLATTENING

_BLOCK = 8192
_MOST_STEPS = 80

#: A step this small, relative to the anomaly, is the last: Newton's method squares it.
_LAST_STEP = 1e-10

#: A halving this small, relative to the anomaly, leaves nothing to halve.
_LAST_HALVING = 4.0 * float(np.finfo(float).eps)


def kepler_impact(
    position_m: ArrayLike, velocity_m_s: ArrayLike, height_m: ArrayLike = 0.0, mu_m3_s2: float = EARTH_MU_M3_S2
) -> tuple[FloatArray, FloatArray]:
    """Return the time to impact, s, and the point of impact, m (ECI), of two-body arcs from the given states.

    Position and velocity have shape (..., 3) in an inertial frame about the Earth's centre with z along its axis, such
    as ECEF frozen at scene epoch; leading axes broadcast with `height_m`. The impact is the first descent through the
    surface of geodetic height `height_m` above the WGS 84 ellipsoid. A start below the surface first has to rise
    through it; one within 1e-6 m of it counts as on it and falls at once if it descends. The arc is followed through
    the Earth where it starts inside. The point has the height to 1e-6 m, and is the arc's at that time as nearly as
    rounding the inputs allows.

    `nan` where the arc never descends through the surface (pericentre above it, apocentre below it, escape), where an
    input is not finite, and for heights below -6 000 km.
    """
    position, velocity, height, shape = flat_states(position_m, velocity_m_s, height_m)
    duration, point = np.empty(height.shape), np.empty((height.size, 3))
    with np.errstate(all="ignore"):
        for first in range(0, height.size, _BLOCK):
            block = slice(first, first + _BLOCK)
            duration[block], point[block] = _impacts(position[block], velocity[block], height[block], mu_m3_s2)
    return duration.reshape(shape), point.reshape(*shape, 3)


def _impacts(
    position: FloatArray, velocity: FloatArray, height: FloatArray, mu: float
) -> tuple[FloatArray, FloatArray]:
    """Return times (n,) and points (n, 3) of impact."""
    duration, point = np.full(height.shape, np.nan), np.full((height.size, 3), np.nan)
    finite = np.isfinite(position).all(axis=1) & np.isfinite(velocity).all(axis=1) & (height > -6.0e6)
    (at,) = (finite & (height < np.inf) & (position != 0.0).any(axis=1)).nonzero()
    if not at.size:
        return duration, point
    arcs = conic_arcs(position[at], velocity[at], mu)
    low, high = _brackets(arcs, height[at])
    (hit,) = (low <= high).nonzero()
    at = at[hit]
    if at.size:
        arcs = arcs.at(hit)
        duration[at], places = arcs.times_and_positions(_descent(arcs, height[at], low[hit], high[hit]))
        point[at] = places.T
    return duration, point


def _brackets(arcs: ConicArcs, height: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return anomalies between which each arc first descends through the surface; `nan` where it never does."""
    outer = (EARTH_EQUATORIAL_RADIUS_M + _MARGIN_M + height) / arcs.length_m
    inner = (EARTH_POLAR_RADIUS_M - _MARGIN_M + height) / arcs.length_m
    at_outer, at_inner = arcs.radial_squared(outer), arcs.radial_squared(inner)
    least = (_STEEP * arcs.momentum) ** 2
    steep = (at_outer > least) & (at_inner > least)
    low, high = _steep_brackets(arcs, height, outer, inner)
    turning = 1.0 / arcs.alpha
    turns_between = (turning > inner) & (turning < outer) & (arcs.radial_squared(turning) > 0.0)
    (grazing,) = (~steep & ((at_outer > 0.0) | (at_inner > 0.0) | turns_between)).nonzero()
    low[~steep] = np.nan
    if grazing.size:
        low[grazing], high[grazing] = grazing_brackets(arcs.at(grazing), height[grazing], ON_SURFACE_M)
    return low, high


def _steep_brackets(
    arcs: ConicArcs, height: FloatArray, outer: FloatArray, inner: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Return the anomalies of the first descents through the two spheres; a start that falls between them comes before.

    Such a start is met by its own height: above the surface it has yet to fall, on it it falls at once, below it waits
    for the next turn.
    """
    low, high = arcs.first_descent(outer), arcs.first_descent(inner)
    (falling,) = ((outer > 1.0) & (inner < 1.0) & (arcs.sigma < 0.0)).nonzero()
    if falling.size:
        above = arcs.at(falling).heights_m(np.zeros(falling.size)) - height[falling]
        here, below = np.abs(above) <= ON_SURFACE_M, above < -ON_SURFACE_M
        low[falling] = np.where(below, low[falling], 0.0)
        high[falling] = np.where(here, 0.0, high[falling] + np.where(below, arcs.turns()[falling], 0.0))
    return low, high


def _descent(arcs: ConicArcs, height: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
    """Return the anomaly within each bracket at which the height is reached, by Newton's method held to the bracket."""
    s = 0.5 * (low + high)
    still = low < high
    for _ in range(_MOST_STEPS):
        (at,) = still.nonzero()
        if not at.size:
            break
        above, slope = arcs.at(at).heights_and_slopes(s[at])
        above -= height[at]
        low[at], high[at] = np.where(above > 0.0, s[at], low[at]), np.where(above > 0.0, high[at], s[at])
        newton = s[at] - above / slope
        inside = (newton >= low[at]) & (newton <= high[at])
        trial = np.where(inside, newton, 0.5 * (low[at] + high[at]))
        enough = np.where(inside, _LAST_STEP, _LAST_HALVING) * high[at]
        still[at] = np.abs(trial - s[at]) > enough
        s[at] = trial
    return s
