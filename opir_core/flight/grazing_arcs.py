"""Arcs that run along the surface: all their cuts with the ellipsoid, and between which of them they come down.

With T the half-angle tangent of the way along a conic, its point is a quadratic in T over 1 + alpha T², so its cuts
with an ellipsoid of revolution are the roots of a quartic, for any conic. The roots, real or nearly, are where the
height can change sign; its sign is looked up there and in between, on the true geodetic height.
"""

import numpy as np

from opir_core.arrays import BoolArray, FloatArray
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M, EARTH_POLAR_RADIUS_M
from opir_core.flight.conic_arcs import ConicArcs

#: Directions (cos, sin) with T = sin / cos in which the quartic is sampled. It is written in the tangent of the angle
#: from the one in which it is largest, and so has no root at infinity.
_ANGLES = np.pi / 5.0 * np.arange(5)
_FROM_INFINITY = _ANGLES - 0.5 * np.pi
_COEFFICIENTS = np.linalg.inv(
    np.stack([np.sin(_FROM_INFINITY) ** k * np.cos(_FROM_INFINITY) ** (4 - k) for k in range(5)], axis=1)
)

#: A start on the surface is a root itself: it and its double within this anomaly of the start are not looked at.
_START = 1e-6


def grazing_brackets(arcs: ConicArcs, height_m: FloatArray, on_surface_m: float) -> tuple[FloatArray, FloatArray]:
    """Return anomalies between which each arc first descends through the surface; `nan` where it never does.

    Both are 0 where the start is on the surface, to `on_surface_m`, and the arc falls from there.
    """
    start = arcs.heights_m(np.zeros_like(height_m)) - height_m
    on_surface = np.abs(start) <= on_surface_m
    probes = _probes(arcs, _cuts(arcs, height_m), on_surface)
    outside = np.stack([arcs.heights_m(probe) > height_m for probe in probes])
    outside[0] = start > on_surface_m
    falls = outside[:-1] & ~outside[1:]
    first, column = np.argmax(falls, axis=0), np.arange(start.size)
    low, high = (np.where(falls.any(axis=0), probes[first + k, column], np.nan) for k in (0, 1))
    at_once = on_surface & ~outside[1]
    return np.where(at_once, 0.0, low), np.where(at_once, 0.0, high)


def _probes(arcs: ConicArcs, cuts: FloatArray, on_surface: BoolArray) -> FloatArray:
    """Return rising anomalies, rows: the start, the cuts, the turn's end (or beyond all), the middles between."""
    turn = arcs.turns()
    near_start = on_surface & ((cuts < _START) | (cuts > turn - _START))
    cuts = np.sort(np.where(near_start, np.nan, cuts), axis=0)
    last = np.where(np.isfinite(turn), turn, 2.0 * np.nanmax(cuts, axis=0, initial=0.5))
    cuts = np.where(np.isfinite(cuts), cuts, last)
    marks = np.concatenate([np.zeros_like(last)[None], cuts, last[None]])
    probes = np.empty((2 * len(marks) - 1, last.size))
    probes[::2], probes[1::2] = marks, 0.5 * (marks[1:] + marks[:-1])
    return probes


def _cuts(arcs: ConicArcs, height_m: FloatArray) -> FloatArray:
    """Return the anomalies (4, n) at which each arc meets the ellipsoid of that height, or comes nearest to it."""
    samples = np.stack([_excess(arcs, height_m, np.cos(angle), np.sin(angle)) for angle in _ANGLES])
    largest, column = np.argmax(np.abs(samples), axis=0), np.arange(height_m.size)
    turned = np.stack([samples[(largest + k) % 5, column] for k in range(5)])
    coefficients = [sum(factor * sample for factor, sample in zip(row, turned, strict=True)) for row in _COEFFICIENTS]
    companions = np.zeros((height_m.size, 4, 4))
    companions[:, (1, 2, 3), (0, 1, 2)] = 1.0
    for k in range(4):
        companions[:, 0, 3 - k] = -coefficients[k] / coefficients[4]
    companions[~np.isfinite(companions).all(axis=(1, 2))] = 0.0
    tangents = np.linalg.eigvals(companions).real.T
    cosine, sine = np.cos(_ANGLES[largest]), np.sin(_ANGLES[largest])
    return np.stack([arcs.anomalies(cosine - t * sine, -sine - t * cosine) for t in tangents])


def _excess(arcs: ConicArcs, height_m: FloatArray, cosine: float, sine: float) -> FloatArray:
    """Return the quartic: positive outside the ellipsoid, in the homogeneous T = sine / cosine."""
    c2, s2 = cosine * cosine, sine * sine
    x, y, z = (c2 + (arcs.alpha - 2.0) * s2) * arcs.position + 2.0 * (cosine * sine + arcs.sigma * s2) * arcs.velocity
    equatorial = (EARTH_EQUATORIAL_RADIUS_M + height_m) / arcs.length_m
    polar = (EARTH_POLAR_RADIUS_M + height_m) / arcs.length_m
    scale = c2 + arcs.alpha * s2
    excess: FloatArray = (x * x + y * y) / (equatorial * equatorial) + z * z / (polar * polar) - scale * scale
    return excess
