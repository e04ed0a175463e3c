"""Highest-density regions of weighted points on the ground, as polygons.

The density is a sum of normal kernels (Silverman, "Density Estimation for Statistics and Data Analysis", 1986, 4.3.2:
width n^(-1/6) for n points in a plane, in axes in which the points have unit covariance), the level that of the
weighted quantile of the density at the points (Hyndman, "Computing and graphing highest density regions", American
Statistician 50(2), 1996). Kernels are wider where points are few, by the inverse root of a first density (Abramson, "On
bandwidth variation in kernel estimates", Annals of Statistics 10(4), 1982): impacts of a long burn have long tails.
"""

from itertools import pairwise
from typing import Any

import numpy as np
from contourpy import FillType, contour_generator

from opir_core.arrays import FloatArray
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M
from opir_core.geometry import AzimuthalEquidistant, map_area_m2, unit_vectors
from opir_core.interfaces import IMPACT_CONDITIONS, TRACK_CONTAINMENTS
from opir_core.plugin import ImpactRegion

#: Cells of the grid along each axis, and how far it reaches beyond the points, widths of the kernel.
CELLS, BEYOND = 64, 3.0

#: Least standard deviation of the points along any axis, m: no forecast is better known.
LEAST_M = 100.0

_SHARES = np.linspace(0.0, 1.0, CELLS // 2)

#: Least and largest ratio of a kernel's width to that of the first density.
_LOCAL = 0.1, 2.0


def regions(
    place: FloatArray,
    weight: FloatArray,
    condition: str = IMPACT_CONDITIONS[0],
    probability: float = 1.0,
    samples: float = np.nan,
) -> tuple[ImpactRegion, ...]:
    """Return the regions of `TRACK_CONTAINMENTS` of points (n, 2), latitude and longitude, rad, with weights (n,).

    They presume a condition with a probability, and rest on so many effective samples.
    """
    chart = AzimuthalEquidistant.about(weight @ unit_vectors(place))
    plane = chart.points(place)
    mean = weight @ plane
    away = plane - mean
    spread = (weight[:, None] * away).T @ away
    variance, axes = np.linalg.eigh(spread + LEAST_M**2 * np.eye(2))
    scale = np.sqrt(variance)
    unit = away @ axes / scale
    width = float(np.sum(weight * weight) ** (1.0 / 6.0))
    squares = _squared_distances(unit)
    pilot = _density(squares, np.full(len(unit), width), weight)
    mean_log = weight @ np.log(pilot)
    widths = width * np.clip(np.sqrt(np.exp(mean_log) / pilot), *_LOCAL)
    x, y = (_grid(unit[:, axis], widths) for axis in (0, 1))
    along, across = (_kernel(grid[:, None] - unit[:, axis], widths) for axis, grid in enumerate((x, y)))
    density = (along * weight) @ across.T
    at = _density(squares, widths, weight)
    order = np.argsort(-at, kind="stable")
    held = np.cumsum(weight[order])
    levels = [float(at[order[min(int(np.searchsorted(held, share)), len(order) - 1)]]) for share in TRACK_CONTAINMENTS]
    generator = contour_generator(x, y, density.T, fill_type=FillType.OuterOffset)
    found = []
    for share, level in zip(TRACK_CONTAINMENTS, levels, strict=True):
        shapes = _filled(generator, level)
        polygons = [[_on_earth(mean + (ring * scale) @ axes.T) for ring in rings] for rings in shapes]
        area_m2 = sum(map_area_m2(rings[0]) - sum(map(map_area_m2, rings[1:])) for rings in polygons)
        places = tuple(tuple(chart.places(ring) for ring in rings) for rings in polygons)
        found.append(ImpactRegion(share, 1e-6 * area_m2, places, chart.centre, condition, probability, samples))
    return tuple(found)


def _grid(unit: FloatArray, widths: FloatArray) -> FloatArray:
    """Return grid lines, half of them at equal steps and half at quantiles of the points, where detail is."""
    even = np.linspace((unit - BEYOND * widths).min(), (unit + BEYOND * widths).max(), CELLS // 2)
    return np.unique(np.concatenate([even, _quantiles(unit)]))


def _quantiles(unit: FloatArray) -> FloatArray:
    """Return quantiles in equal steps, those of `np.quantile` in a fifth of the time."""
    ordered, place = np.sort(unit), _SHARES * (len(unit) - 1)
    before = place.astype(np.int64)
    low, high, share = ordered[before], ordered[np.minimum(before + 1, len(unit) - 1)], place - before
    step = high - low
    return np.where(share < 0.5, low + step * share, high - step * (1.0 - share))


def _squared_distances(place: FloatArray) -> FloatArray:
    """Return the squared distances (n, n) of points (n, 2)."""
    (squares, more) = (place[:, None, axis] - place[:, axis] for axis in (0, 1))
    squares *= squares
    more *= more
    squares += more
    return squares


def _density(squares: FloatArray, widths: FloatArray, weight: FloatArray) -> FloatArray:
    """Return densities (m,) at places with squared distances (m, n) from kernels with widths (n,)."""
    exponents = squares * (-0.5 / np.square(widths))
    density: FloatArray = np.exp(exponents, out=exponents) @ (weight / np.square(widths))
    return density


def _kernel(away: FloatArray, width: FloatArray) -> FloatArray:
    kernel: FloatArray = np.exp(-0.5 * np.square(away / width)) / width
    return kernel


#: Distance from the centre of the map to which regions reach, m: a kilometre short of the antipode.
_FARTHEST_M = np.pi * EARTH_EQUATORIAL_RADIUS_M - 1e3


def _on_earth(ring: FloatArray) -> FloatArray:
    """Return a ring with the points beyond the antipode moved to the edge of the map: there is no more Earth."""
    far = np.sqrt(np.sum(ring * ring, axis=1))
    share = np.minimum(1.0, _FARTHEST_M / np.maximum(far, 1.0))
    inside: FloatArray = ring * share[:, None]
    return inside


def _filled(generator: Any, level: float) -> list[list[FloatArray]]:
    """Return polygons of outer ring and holes, (k, 2) each, in which the density is above the level."""
    points, offsets = generator.filled(level, np.inf)
    return [[ring[one:two] for one, two in pairwise(cuts.tolist())] for ring, cuts in zip(points, offsets, strict=True)]
