"""Highest-density regions of weighted points on the ground, as polygons.

The density is a sum of normal kernels (Silverman, "Density Estimation for Statistics and Data
Analysis", 1986, 4.3.2: width n^(-1/6) for n points in a plane, in axes in which the points have
unit covariance), the level that of the weighted quantile of the density at the points (Hyndman,
"Computing and graphing highest density regions", American Statistician 50(2), 1996). Kernels are
wider where points are few, by the inverse root of a first density (Abramson, "On bandwidth
variation in kernel estimates", Annals of Statistics 10(4), 1982): impacts of a long burn have long
tails. What burns on spreads in proportion to its range: where all points lie in one direction,
kernels are normal in the logarithm of the distance and in bearing, and levels are of the density on
the ground.
"""

from functools import partial
from itertools import pairwise
from typing import Any

import numpy as np
from contourpy import FillType, LineType, SerialContourGenerator, ZInterp

from opir_core.arrays import FloatArray
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M
from opir_core.geometry import AzimuthalEquidistant, unit_vectors
from opir_core.interfaces import IMPACT_CONDITIONS, TRACK_CONTAINMENTS
from opir_core.plugin import ImpactRegion
from opir_trackers.forecast.deferred_regions import DeferredRegion, Outline, Outlines
from opir_trackers.forecast.map_edge import FARTHEST_M, LONGEST_EDGE_M, within_map

#: Cells of the grid along each axis, and how far it reaches beyond the points, widths of the
#: kernel.
CELLS = 56
BEYOND = 3.0

#: Standard deviation by which all points are spread, m: no forecast is better known.
LEAST_M = 100.0

#: Points that weigh less than this share of the heaviest are left out: far away they would stretch
#: the grid.
_LEAST_WEIGHT = 1e-4

#: Steps of the sequence R2: a point of it is a multiple of both, modulo 1.
_R2_STEPS = np.array([0.7548776662466927, 0.5698402909980532])

_SHARES = np.linspace(0.0, 1.0, CELLS // 2)

#: Length added to distances before their logarithm, m; directions of points whose mean is longer
#: than this are one; share of the points that may be near, or beyond the end of such regions.
NEAR_M = 10e3
_GATHERED = 0.85
_FEW = 0.02

#: Least and largest ratio of a kernel's width to that of the first density.
_LOCAL = 0.1, 2.0


#: Regions along a flight end here, m from where it is: a thousand kilometres short of the antipode.
_FAR_M = 19e6
_FAR_COSINE = np.cos(_FAR_M / EARTH_EQUATORIAL_RADIUS_M)


class Plane:
    """The map of points: kernels are normal in metres."""

    #: Largest value of each coordinate.
    most: FloatArray = np.array([np.inf, np.inf])

    def curved(self, point: FloatArray) -> FloatArray:
        """Return the coordinates (n, 2) of points of the map (n, 2), m."""
        return point

    def flat(self, curved: FloatArray) -> FloatArray:
        """Return the points of the map, m, of coordinates."""
        return curved

    def stretch(self, curved: FloatArray) -> FloatArray:
        """Return the areas (n,) on the ground of a unit of the coordinates."""
        return np.ones(curved.shape[:-1])


class LogPolar(Plane):
    """Logarithm of the distance from the map's centre, and bearing: what burns on spreads in
    proportion to its range."""

    most = np.array([np.log(_FAR_M + NEAR_M), np.pi])

    def __init__(self, bearing: float) -> None:
        self._bearing = bearing

    def curved(self, point: FloatArray) -> FloatArray:
        """Return logarithm and bearing, rad, from the mean one."""
        turn = np.arctan2(point[..., 1], point[..., 0]) - self._bearing
        distance = np.sqrt(np.sum(point * point, axis=-1))
        return np.stack(
            [np.log(distance + NEAR_M), np.arctan2(np.sin(turn), np.cos(turn))], axis=-1
        )

    def flat(self, curved: FloatArray) -> FloatArray:
        """Return the points of the map, m."""
        distance = np.maximum(np.exp(curved[..., 0]) - NEAR_M, 0.0)
        angle = curved[..., 1] + self._bearing
        return np.stack([distance * np.cos(angle), distance * np.sin(angle)], axis=-1)

    def stretch(self, curved: FloatArray) -> FloatArray:
        """Return the areas, m²."""
        total = np.exp(curved[..., 0])
        angle = np.clip(total - NEAR_M, NEAR_M, FARTHEST_M) / EARTH_EQUATORIAL_RADIUS_M
        area: FloatArray = EARTH_EQUATORIAL_RADIUS_M * np.sin(angle) * total
        return area


def coordinates(plane: FloatArray, weight: FloatArray) -> Plane:
    """Return the coordinates for points of a map (n, 2), m: polar ones if they lie in one
    direction, not near.
    """
    distance = np.sqrt(np.sum(plane * plane, axis=1))
    x, y = weight @ (plane / np.maximum(distance, 1.0)[:, None])
    gathered = np.hypot(x, y) > _GATHERED and weight[distance < 2.0 * NEAR_M].sum() < _FEW
    return LogPolar(float(np.arctan2(y, x))) if gathered else Plane()


def regions(
    place: FloatArray,
    weight: FloatArray,
    condition: str = IMPACT_CONDITIONS[0],
    probability: float = 1.0,
    samples: float = np.nan,
    origin: FloatArray | None = None,
) -> tuple[ImpactRegion, ...]:
    """Return the regions of `TRACK_CONTAINMENTS` of points (n, 2), latitude and longitude, rad,
    with weights (n,).

    They presume a condition with a probability, and rest on a number of effective samples. `origin`
    (2,) is where the points have come from: the centre of the map, unless many lie near its
    antipode; else their own middle is. Areas and polygons are made when they are first read.
    """
    units = unit_vectors(place)
    middle = weight @ units
    is_along = False
    if origin is not None:
        up = unit_vectors(origin[None])[0]
        is_along = bool(weight @ (units @ up < _FAR_COSINE) < _FEW)
        middle = up if is_along else middle
    chart = AzimuthalEquidistant.about(middle)
    outlines = Outlines(partial(_outlines_of, chart, place, weight, is_along=is_along))
    figures = {
        "centre": chart.centre,
        "condition": condition,
        "probability": probability,
        "effective_samples": samples,
    }
    shares = enumerate(TRACK_CONTAINMENTS)
    return tuple(
        DeferredRegion.of(outlines, number, containment=share, **figures)
        for number, share in shares
    )


def _outlines_of(
    chart: AzimuthalEquidistant, place: FloatArray, weight: FloatArray, *, is_along: bool
) -> list[Outline]:
    """Return the outlines of the regions of `TRACK_CONTAINMENTS`; `is_along` says that points lie
    along a flight.
    """
    heavy = np.flatnonzero(weight > _LEAST_WEIGHT * weight.max())
    plane = chart.points(place[heavy])
    weight = weight[heavy]
    frame = coordinates(plane, weight) if is_along else Plane()
    contours = _Contours(frame, frame.curved(plane), weight)
    outlines = [within_map(*contours.around(share)) for share in TRACK_CONTAINMENTS]
    points = np.concatenate([ring for ring, _ in outlines])
    places = chart.places(points)
    start = 0
    found = []
    for ring, cuts in outlines:
        polygons = [
            [slice(start + one, start + two) for one, two in pairwise(rings)] for rings in cuts
        ]
        # The first ring of a polygon is the outer one, others are holes.
        area_m2 = sum(
            map_area_m2(points[part]) * (-1.0 if number else 1.0)
            for parts in polygons
            for number, part in enumerate(parts)
        )
        found.append(
            Outline(
                1e-6 * area_m2, tuple(tuple(places[part] for part in parts) for parts in polygons)
            )
        )
        start += len(ring)
    return found


class _Contours:
    """Lines of equal density on the ground of points (n, 2) in the coordinates of a frame, with
    weights (n,).
    """

    def __init__(self, frame: Plane, curved: FloatArray, weight: FloatArray) -> None:
        self._frame = frame
        self._mean = weight @ curved / weight.sum()
        least = LEAST_M**2 / frame.stretch(self._mean)
        away = curved - self._mean + np.sqrt(least) * _normal_offsets(weight)
        spread = (weight[:, None] * away).T @ away
        flat = type(frame) is Plane
        axes: FloatArray
        variance, axes = np.linalg.eigh(spread) if flat else (spread.diagonal(), np.eye(2))
        self._axes = axes
        turned = away @ axes
        sigma = np.sqrt(np.maximum(variance, 0.0))
        self._scale = np.maximum(_robust_sigmas(turned, weight, sigma), np.sqrt(least))
        unit = turned / self._scale
        width = float(np.sum(weight * weight) ** (1.0 / 6.0))
        squares = _squared_distances(unit)
        pilot = _density(squares, np.full(len(unit), width), weight)
        widths = width * np.clip(np.sqrt(np.exp(weight @ np.log(pilot)) / pilot), *_LOCAL)
        most = (frame.most - self._mean) / self._scale
        x, y = (np.unique(np.minimum(_grid(unit[:, axis], widths), most[axis])) for axis in (0, 1))
        along, across = (
            _kernel(grid[:, None] - unit[:, axis], widths) for axis, grid in enumerate((x, y))
        )
        nodes = (
            self._mean
            + (np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1) * self._scale) @ self._axes.T
        )
        density = (along * weight) @ across.T / frame.stretch(nodes)
        at = _density_without_own(squares, widths, weight) / frame.stretch(self._mean + away)
        order = np.argsort(-at, kind="stable")
        self._levels = at[order]
        self._held = np.cumsum(weight[order])
        self._generator = _contour_lines(x, y, density.T)

    def around(self, share: float) -> tuple[FloatArray, list[list[int]]]:
        """Return points of the map (k, 2), m, and where the rings of each polygon begin and end: a
        share is inside.
        """
        held = int(np.searchsorted(self._held, share))
        level = float(self._levels[min(held, len(self._levels) - 1)])
        filled: Any = self._generator.filled(level, np.inf)
        points, cuts = filled
        starts = np.cumsum([0, *map(len, points)]).tolist()
        rings = np.concatenate([*points, np.empty((0, 2))])
        edges = [
            (offsets.astype(np.int64) + start).tolist()
            for offsets, start in zip(cuts, starts, strict=False)
        ]
        return _outlines(self._frame, self._mean + (rings * self._scale) @ self._axes.T, edges)


def _contour_lines(x: FloatArray, y: FloatArray, density: FloatArray) -> SerialContourGenerator:
    """Return what makes contours of finite densities (y, x); `contour_generator` takes as long to
    look for masks.
    """
    ahead, aside = np.meshgrid(x, y)
    no_mask: Any = np.False_
    return SerialContourGenerator(
        ahead,
        aside,
        density,
        no_mask,
        corner_mask=False,
        line_type=LineType.Separate,
        fill_type=FillType.OuterOffset,
        quad_as_tri=False,
        z_interp=ZInterp.Linear,
    )


def _robust_sigmas(away: FloatArray, weight: FloatArray, sigma: FloatArray) -> FloatArray:
    """Return the lesser one of standard deviations (2,) and quartiles' distances over 1.349
    (Silverman, 3.4.2).

    A few points far away do not widen the kernels of the others.
    """
    order = np.argsort(away, axis=0, kind="stable")
    sums = np.cumsum(weight[order], axis=0)
    low, high = (
        np.array(
            [
                away[order[min(int(np.searchsorted(sums[:, k], share)), len(away) - 1), k], k]
                for k in (0, 1)
            ]
        )
        for share in (0.25, 0.75)
    )
    return np.minimum(sigma, np.where(high > low, (high - low) / 1.349, sigma))


def _normal_offsets(weight: FloatArray) -> FloatArray:
    """Return offsets (n, 2) of unit variance and weighted mean 0: a sequence of low discrepancy,
    made normal.

    The sequence is R2 (M. Roberts, "The unreasonable effectiveness of quasirandom sequences",
    2018), whose steps are the powers of 1 / 1.3247, the root of x³ = x + 1; the transform is that
    of Box and Muller.
    """
    share, turn = np.mod(np.arange(1, len(weight) + 1)[:, None] * _R2_STEPS, 1.0).T
    away = np.sqrt(-2.0 * np.log1p(-share))
    angle = 2.0 * np.pi * turn
    offset = np.stack([away * np.cos(angle), away * np.sin(angle)], axis=1)
    centred: FloatArray = offset - weight @ offset
    return centred


def _grid(unit: FloatArray, widths: FloatArray) -> FloatArray:
    """Return grid lines, half of them at equal steps and half at quantiles of the points, where
    detail is.
    """
    even = np.linspace((unit - BEYOND * widths).min(), (unit + BEYOND * widths).max(), CELLS // 2)
    return np.unique(np.concatenate([even, _quantiles(unit)]))


def _quantiles(unit: FloatArray) -> FloatArray:
    """Return quantiles in equal steps, those of `np.quantile` in a fifth of the time."""
    ordered = np.sort(unit)
    place = _SHARES * (len(unit) - 1)
    before = place.astype(np.int64)
    low = ordered[before]
    high = ordered[np.minimum(before + 1, len(unit) - 1)]
    share = place - before
    step = high - low
    return np.where(share < 0.5, low + step * share, high - step * (1.0 - share))


def _squared_distances(place: FloatArray) -> FloatArray:
    """Return the squared distances (n, n) of points (n, 2), to seven digits: twice as fast, and
    kernels are wide.
    """
    place = place.astype(np.float32)
    (squares, more) = (place[:, None, axis] - place[:, axis] for axis in (0, 1))
    squares *= squares
    more *= more
    squares += more
    return squares


def _density(squares: FloatArray, widths: FloatArray, weight: FloatArray) -> FloatArray:
    """Return densities (m,) at places with squared distances (m, n) from kernels with widths
    (n,).
    """
    exponents = squares * (-0.5 / np.square(widths)).astype(squares.dtype)
    density = np.exp(exponents, out=exponents) @ (weight / np.square(widths)).astype(squares.dtype)
    return density.astype(np.float64)


def _density_without_own(squares: FloatArray, widths: FloatArray, weight: FloatArray) -> FloatArray:
    """Return the densities (n,) at the points from the kernels of all others: the truth is none of
    the points.

    With its own kernel each point would lie in denser places than the truth does, and regions of
    few points would hold it too seldom. At least the density at the edge of its own kernel.
    """
    np.fill_diagonal(squares, np.inf)
    others = _density(squares, widths, weight) / np.maximum(1.0 - weight, np.finfo(float).tiny)
    return np.maximum(others, weight / np.square(widths) * np.exp(-0.5 * BEYOND**2))


def _kernel(away: FloatArray, width: FloatArray) -> FloatArray:
    kernel: FloatArray = np.exp(-0.5 * np.square(away / width)) / width
    return kernel


def _outlines(
    frame: Plane, ring: FloatArray, edges: list[list[int]]
) -> tuple[FloatArray, list[list[int]]]:
    """Return rings of coordinates (k, 2) on the map, m, and where they begin and end, given that by
    polygon.

    Edges are so short that they cross in no other map either.
    """
    point = frame.flat(ring)
    parts = np.ceil(
        np.maximum(np.sqrt(np.sum(np.diff(point, axis=0) ** 2, axis=1)), 1.0) / LONGEST_EDGE_M
    )
    parts = parts.astype(np.int64)
    # From the end of a ring no edge leads to the next one.
    parts[[end - 1 for rings in edges for end in rings[1:] if end < len(point)]] = 1
    if parts.max(initial=1) == 1:
        return point, edges
    place = np.concatenate([[0], np.cumsum(parts)])
    start = np.repeat(np.arange(len(parts)), parts)
    share = (np.arange(len(start)) - place[start]) / parts[start]
    between = ring[start] + share[:, None] * (ring[start + 1] - ring[start])
    moved = np.append(place, place[-1] + 1)
    return frame.flat(np.concatenate([between, ring[-1:]])), [
        moved[rings].tolist() for rings in edges
    ]


def map_area_m2(ring: FloatArray) -> float:
    """Return the area on the sphere, m², of a closed ring (k, 2) of points of an azimuthal
    equidistant map.

    Each triangle of the map's centre and an edge counts as a sector of the sphere does beside one
    of the plane.
    """
    x, y = ring.T
    most = (np.pi * EARTH_EQUATORIAL_RADIUS_M) ** 2
    square = np.minimum(0.5 * (x[:-1] ** 2 + y[:-1] ** 2 + x[1:] ** 2 + y[1:] ** 2), most)
    share = np.square(np.sinc(0.5 * np.sqrt(square) / EARTH_EQUATORIAL_RADIUS_M / np.pi))
    return abs(0.5 * float(np.sum((x[:-1] * y[1:] - x[1:] * y[:-1]) * share)))
