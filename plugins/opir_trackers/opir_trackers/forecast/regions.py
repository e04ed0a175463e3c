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
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M as _RADIUS_M
from opir_core.interfaces.impact_regions import ImpactRegion
from opir_core.interfaces.records import TRACK_CONTAINMENTS

#: Cells of the grid along each axis, and how far it reaches beyond the points, widths of the kernel.
CELLS, BEYOND = 64, 3.0

#: Least and largest ratio of a kernel's width to that of the first density.
_LOCAL = 0.1, 2.0


def regions(place: FloatArray, weight: FloatArray) -> tuple[ImpactRegion, ...]:
    """Return the regions of `TRACK_CONTAINMENTS` of points (n, 2), latitude and longitude, rad, with weights (n,)."""
    centre = centre_of(place, weight)
    plane = projected(place, centre)
    mean = weight @ plane
    away = plane - mean
    spread = (weight[:, None] * away).T @ away
    # A least width of a metre, so that one point has a region too.
    variance, axes = np.linalg.eigh(spread + np.eye(2))
    scale = np.sqrt(variance)
    unit = away @ axes / scale
    width = float(np.sum(weight * weight) ** (1.0 / 6.0))
    pilot = _density(unit, unit, np.full(len(unit), width), weight)
    mean_log = weight @ np.log(pilot)
    widths = width * np.clip(np.sqrt(np.exp(mean_log) / pilot), *_LOCAL)
    x, y = (_grid(unit[:, axis], widths) for axis in (0, 1))
    along, across = (_kernel(grid[:, None] - unit[:, axis], widths) for axis, grid in enumerate((x, y)))
    density = (along * weight) @ across.T
    at = _density(unit, unit, widths, weight)
    order = np.argsort(-at, kind="stable")
    held = np.cumsum(weight[order])
    levels = [float(at[order[min(int(np.searchsorted(held, share)), len(order) - 1)]]) for share in TRACK_CONTAINMENTS]
    generator = contour_generator(x, y, density.T, fill_type=FillType.OuterOffset)
    found = []
    latitude, longitude = unprojected(np.zeros((1, 2)), centre)[0].tolist()
    for share, level in zip(TRACK_CONTAINMENTS, levels, strict=True):
        polygons = [[mean + (ring * scale) @ axes.T for ring in rings] for rings in _filled(generator, level)]
        area_m2 = sum(_area(rings[0]) - sum(map(_area, rings[1:])) for rings in polygons)
        places = tuple(tuple(unprojected(ring, centre) for ring in rings) for rings in polygons)
        found.append(ImpactRegion(share, 1e-6 * area_m2, places, (latitude, longitude)))
    return tuple(found)


def _grid(unit: FloatArray, widths: FloatArray) -> FloatArray:
    """Return grid lines, half of them at equal steps and half at quantiles of the points, where detail is."""
    even = np.linspace((unit - BEYOND * widths).min(), (unit + BEYOND * widths).max(), CELLS // 2)
    lines = np.concatenate([even, np.quantile(unit, np.linspace(0.0, 1.0, CELLS // 2))])
    return np.unique(lines)


def _density(place: FloatArray, unit: FloatArray, widths: FloatArray, weight: FloatArray) -> FloatArray:
    """Return densities (m,) at places (m, 2) of kernels about points (n, 2) with widths (n,)."""
    apart = [_kernel(place[:, None, axis] - unit[:, axis], widths) for axis in (0, 1)]
    density: FloatArray = (apart[0] * apart[1]) @ weight
    return density


def _kernel(away: FloatArray, width: FloatArray) -> FloatArray:
    kernel: FloatArray = np.exp(-0.5 * np.square(away / width)) / width
    return kernel


def _filled(generator: Any, level: float) -> list[list[FloatArray]]:
    """Return polygons of outer ring and holes, (k, 2) each, in which the density is above the level."""
    points, offsets = generator.filled(level, np.inf)
    return [[ring[one:two] for one, two in pairwise(cuts.tolist())] for ring, cuts in zip(points, offsets, strict=True)]


def _area(ring: FloatArray) -> float:
    """Return the area, m², on the sphere of a closed ring (k, 2) of points as `projected`.

    Each triangle of the origin and an edge counts as a sector of the sphere counts beside one of the plane.
    """
    x, y = ring.T
    square = np.minimum(0.5 * (x[:-1] ** 2 + y[:-1] ** 2 + x[1:] ** 2 + y[1:] ** 2), (np.pi * _RADIUS_M) ** 2)
    angle = np.sqrt(square) / _RADIUS_M
    share = np.square(np.sinc(0.5 * angle / np.pi))
    return abs(0.5 * float(np.sum((x[:-1] * y[1:] - x[1:] * y[:-1]) * share)))


def centre_of(place: FloatArray, weight: FloatArray) -> FloatArray:
    """Return the unit vector of the mean of points, and east and north there, rows (3, 3)."""
    flat = np.cos(place[:, 0])
    unit = np.stack([flat * np.cos(place[:, 1]), flat * np.sin(place[:, 1]), np.sin(place[:, 0])], axis=1)
    up = weight @ unit
    up = up / np.linalg.norm(up)
    longitude = np.arctan2(up[1], up[0])
    east = np.array([-np.sin(longitude), np.cos(longitude), 0.0])
    return np.stack([east, np.cross(up, east), up])


def projected(place: FloatArray, centre: FloatArray) -> FloatArray:
    """Return points (n, 2), rad, as east and north, m, about a centre: azimuthal equidistant."""
    flat = np.cos(place[:, 0])
    unit = np.stack([flat * np.cos(place[:, 1]), flat * np.sin(place[:, 1]), np.sin(place[:, 0])], axis=1)
    level = unit @ centre[:2].T
    sine = np.sqrt(np.sum(level * level, axis=1))
    angle = np.arctan2(sine, unit @ centre[2])
    plane: FloatArray = level * (_RADIUS_M * np.where(sine > 1e-12, angle / np.maximum(sine, 1e-300), 1.0))[:, None]
    return plane


def unprojected(plane: FloatArray, centre: FloatArray) -> FloatArray:
    """Return latitudes and longitudes (n, 2), rad, of points of `projected`."""
    far = np.sqrt(np.sum(plane * plane, axis=1))
    angle = far / _RADIUS_M
    share = np.where(far > 1e-6, np.sin(angle) / np.maximum(far, 1e-300), 1.0 / _RADIUS_M)
    unit = (plane * share[:, None]) @ centre[:2] + np.cos(angle)[:, None] * centre[2]
    return np.stack([np.arcsin(np.clip(unit[:, 2], -1.0, 1.0)), np.arctan2(unit[:, 1], unit[:, 0])], axis=1)
