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

Rings and areas are computed at the first reading: most regions are replaced before.
"""

from collections.abc import Callable, Sequence
from functools import partial
from itertools import pairwise
from typing import Any, NamedTuple

import numpy as np
from attrs import fields
from contourpy import FillType, LineType, SerialContourGenerator, ZInterp
from opir_estimation import law_parameters

from opir_core.arrays import FloatArray, IntArray
from opir_core.constants import EARTH_EQUATORIAL_RADIUS_M
from opir_core.geometry import AzimuthalEquidistant, unit_vectors
from opir_core.interfaces import IMPACT_CONDITIONS, TRACK_CONTAINMENTS
from opir_core.plugin import ImpactRegion
from opir_forecast.map_edge import FARTHEST_M, LONGEST_EDGE_M, within_map

LAW = law_parameters("opir_forecast", "regions")

#: Steps of the sequence R2: a point of it is a multiple of both, modulo 1.
_R2_STEPS = np.array([0.7548776662466927, 0.5698402909980532])


class Outline(NamedTuple):
    """Outline of a region: its area, km², and the rings of its polygons, as in `ImpactRegion`."""

    area_km2: float
    polygons: tuple[tuple[FloatArray, ...], ...]


class Outlines:
    """The outlines of regions of one ensemble, computed together at the first question for one of
    them.
    """

    def __init__(self, make: Callable[[], Sequence[Outline]]) -> None:
        self._make: Callable[[], Sequence[Outline]] | None = make
        self._outlines: Sequence[Outline] = ()

    def __getitem__(self, number: int) -> Outline:
        """Return the outline of a region; the points of the ensemble are let go."""
        make = self._make  # another thread may read at the same time: both make the same outlines
        if make is not None:
            self._outlines = make()
            self._make = None
        return self._outlines[number]


class DeferredRegion(ImpactRegion):
    """A region that takes its area and polygons from outlines when they are first read; otherwise a
    plain region.
    """

    __slots__ = ("_number", "_outlines")

    @classmethod
    def of(cls, outlines: Outlines, number: int, **figures: Any) -> "DeferredRegion":
        """Return the region of an outline, with the other attributes of `ImpactRegion`."""
        region = cls.__new__(cls)
        region._set(figures | {"_outlines": outlines, "_number": number})
        return region

    def _set(self, figures: dict[str, Any]) -> None:
        for name, value in figures.items():
            object.__setattr__(self, name, value)

    def __getattr__(self, name: str) -> Any:
        """Set and return an attribute of the outline: Python asks here for slots that are empty."""
        if name not in Outline._fields:
            raise AttributeError(f"{type(self).__name__!r} object has no attribute {name!r}")
        self._set(self._outlines[self._number]._asdict())
        return getattr(self, name)

    def __reduce__(self) -> tuple[type[ImpactRegion], tuple[Any, ...]]:
        figures = tuple(getattr(self, attribute.name) for attribute in fields(ImpactRegion))
        return ImpactRegion, figures


class Plane:
    """The map of points: kernels are normal in metres."""

    #: Least and largest value (2, 2) of each coordinate.
    limits: FloatArray = np.array([[-np.inf, np.inf], [-np.inf, np.inf]])

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
    """Logarithm of the distance from the map's centre, and bearing: impacts of a remaining burn
    spread in proportion to the range."""

    #: Short of half a turn, for lines that end there would meet on the map.
    limits = np.array(
        [[-np.inf, np.log(LAW.end_m + LAW.near_m)], [1e-3 - np.pi, np.pi - 1e-3]],
    )

    def __init__(self, bearing: float) -> None:
        self._bearing = bearing

    def curved(self, point: FloatArray) -> FloatArray:
        """Return logarithm and bearing, rad, from the mean one."""
        turn = np.arctan2(point[..., 1], point[..., 0]) - self._bearing
        distance = np.sqrt(np.sum(point * point, axis=-1))
        bearing = np.arctan2(np.sin(turn), np.cos(turn))
        return np.stack([np.log(distance + LAW.near_m), bearing], axis=-1)

    def flat(self, curved: FloatArray) -> FloatArray:
        """Return the points of the map, m."""
        distance = np.maximum(np.exp(curved[..., 0]) - LAW.near_m, 0.0)
        angle = curved[..., 1] + self._bearing
        return np.stack([distance * np.cos(angle), distance * np.sin(angle)], axis=-1)

    def stretch(self, curved: FloatArray) -> FloatArray:
        """Return the areas, m²."""
        total = np.exp(curved[..., 0])
        distance = np.clip(total - LAW.near_m, LAW.near_m, FARTHEST_M)
        sine = np.sin(distance / EARTH_EQUATORIAL_RADIUS_M)
        return EARTH_EQUATORIAL_RADIUS_M * sine * total


def coordinates(plane: FloatArray, weight: FloatArray) -> Plane:
    """Return the coordinates for points of a map (n, 2), m: polar ones if they lie in one
    direction, not near.
    """
    distance = np.sqrt(np.sum(plane * plane, axis=1))
    x, y = weight @ (plane / np.maximum(distance, 1.0)[:, None])
    near_share = weight[distance < 2.0 * LAW.near_m].sum()
    is_polar = np.hypot(x, y) > LAW.gathered and near_share < LAW.outside
    return LogPolar(float(np.arctan2(y, x))) if is_polar else Plane()


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
    antipode; else their own middle is. Areas and polygons are computed when they are first read.
    """
    units = unit_vectors(place)
    middle = weight @ units
    is_along = False
    if origin is not None:
        up = unit_vectors(origin[None])[0]
        end = np.cos(LAW.end_m / EARTH_EQUATORIAL_RADIUS_M)
        is_along = bool(weight @ (units @ up < end) < LAW.outside)
        middle = up if is_along else middle
    chart = AzimuthalEquidistant.about(middle)
    outlines = Outlines(partial(_outlines_of, chart, place, weight, is_along=is_along))
    return tuple(
        DeferredRegion.of(
            outlines,
            number,
            containment=share,
            centre=chart.centre,
            condition=condition,
            probability=probability,
            effective_samples=samples,
        )
        for number, share in enumerate(TRACK_CONTAINMENTS)
    )


def _outlines_of(
    chart: AzimuthalEquidistant, place: FloatArray, weight: FloatArray, *, is_along: bool
) -> list[Outline]:
    """Return the outlines of the regions of `TRACK_CONTAINMENTS`; `is_along` says that points lie
    along a flight.
    """
    heavy = np.flatnonzero(weight > LAW.least_weight * weight.max())
    plane = chart.points(place[heavy])
    weight = weight[heavy]
    frame = coordinates(plane, weight) if is_along else Plane()
    contours = _Contours(frame, frame.curved(plane), weight)
    outlines = [within_map(*contours.around(share)) for share in TRACK_CONTAINMENTS]
    # The map is read once for all regions.
    places = chart.places(np.concatenate([points for points, _ in outlines]))
    ends = np.cumsum([len(points) for points, _ in outlines])
    return [
        _outline(*outline, ring_places)
        for outline, ring_places in zip(outlines, np.split(places, ends[:-1]), strict=True)
    ]


def _outline(points: FloatArray, edges: list[list[int]], places: FloatArray) -> Outline:
    """Return the outline of rings of points of the map (k, 2), m, with places (k, 2) on Earth."""
    polygons = [[slice(start, end) for start, end in pairwise(ends)] for ends in edges]
    # The first ring of a polygon is the outer one, others are holes.
    area_m2 = sum(
        map_area_m2(points[ring]) * (-1.0 if number else 1.0)
        for rings in polygons
        for number, ring in enumerate(rings)
    )
    rings_of_places = tuple(tuple(places[ring] for ring in rings) for rings in polygons)
    return Outline(1e-6 * area_m2, rings_of_places)


class _Contours:
    """Lines of equal density on the ground of points (n, 2) in the coordinates of a frame, with
    weights (n,).
    """

    def __init__(self, frame: Plane, curved: FloatArray, weight: FloatArray) -> None:
        self._frame = frame
        self._mean = weight @ curved / weight.sum()
        least = np.sqrt(LAW.least_m**2 / frame.stretch(self._mean))
        offset = curved - self._mean + least * _normal_offsets(weight)
        unit = self._whitened(offset, weight, least)
        squares = _squared_distances(unit)
        widths = _widths(squares, weight)
        density = _density_without_own(squares, widths, weight)
        density = density / frame.stretch(self._mean + offset)
        self._set_levels(density, weight)
        limits = (frame.limits - self._mean[:, None]) / self._scale[:, None]
        self._generator = self._contour_lines(unit, widths, weight, limits)

    def _set_levels(self, density: FloatArray, weight: FloatArray) -> None:
        """Set the densities (n,) at the points from the highest down, and the shares above them."""
        order = np.argsort(-density, kind="stable")
        self._levels = density[order]
        self._shares = np.cumsum(weight[order])

    def _whitened(self, offset: FloatArray, weight: FloatArray, least: Any) -> FloatArray:
        """Set the axes and scales of offsets (n, 2), at least as long as `least`; return these as
        multiples of them.
        """
        spread = (weight[:, None] * offset).T @ offset
        is_flat = type(self._frame) is Plane
        variance, axes = np.linalg.eigh(spread) if is_flat else (spread.diagonal(), np.eye(2))
        self._axes: FloatArray = axes
        turned = offset @ axes
        sigma = _robust_sigmas(turned, weight, np.sqrt(np.maximum(variance, 0.0)))
        self._scale = np.maximum(sigma, least)
        return turned / self._scale

    def _contour_lines(
        self, unit: FloatArray, widths: FloatArray, weight: FloatArray, limits: FloatArray
    ) -> SerialContourGenerator:
        """Return a generator of contours of the density on a grid about points (n, 2)."""
        x, y = (
            np.unique(np.clip(_grid(column, widths), *ends))
            for column, ends in zip(unit.T, limits, strict=True)
        )
        along, across = (
            _kernel(grid[:, None] - column, widths)
            for grid, column in zip((x, y), unit.T, strict=True)
        )
        nodes = self._coordinates(np.stack(np.meshgrid(x, y, indexing="ij"), axis=-1))
        density = _product(along * weight, across.T) / self._frame.stretch(nodes)
        return _generator(x, y, density)

    def _coordinates(self, unit: FloatArray) -> FloatArray:
        """Return the coordinates (..., 2) of multiples (..., 2) of the scales along the axes."""
        return self._mean + (unit * self._scale) @ self._axes.T

    def around(self, share: float) -> tuple[FloatArray, list[list[int]]]:
        """Return points of the map (k, 2), m, and the ends of the rings of each polygon: a share is
        inside.
        """
        row = int(np.searchsorted(self._shares, share))
        level = float(self._levels[min(row, len(self._levels) - 1)])
        filled: Any = self._generator.filled(level, np.inf)
        points, cuts = filled
        starts = np.cumsum([0, *map(len, points)]).tolist()
        rings = np.concatenate([*points, np.empty((0, 2))])
        edges = [
            (offsets.astype(np.int64) + start).tolist()
            for offsets, start in zip(cuts, starts, strict=False)
        ]
        return _dense_rings(self._frame, self._coordinates(rings), edges)


def _generator(x: FloatArray, y: FloatArray, density: FloatArray) -> SerialContourGenerator:
    """Return a generator of contours of densities (x, y).

    `contour_generator` takes as long to look for masks.
    """
    no_mask: Any = np.False_
    grid: Any = *np.meshgrid(x, y), density.T, no_mask
    return SerialContourGenerator(
        *grid,
        corner_mask=False,
        line_type=LineType.Separate,
        fill_type=FillType.OuterOffset,
        quad_as_tri=False,
        z_interp=ZInterp.Linear,
    )


def _widths(squares: FloatArray, weight: FloatArray) -> FloatArray:
    """Return the widths (n,) of the kernels of points with squared distances (n, n): wider where
    points are few.
    """
    width = float(np.sum(weight * weight) ** (1.0 / 6.0))
    pilot = _density(squares, np.full(len(weight), width), weight)
    return width * np.clip(np.sqrt(np.exp(weight @ np.log(pilot)) / pilot), *LAW.local)


def _robust_sigmas(offset: FloatArray, weight: FloatArray, sigma: FloatArray) -> FloatArray:
    """Return the lesser one of standard deviations (2,) and quartiles' distances over 1.349
    (Silverman, 3.4.2).

    A few points far away do not widen the kernels of the others.
    """
    order = np.argsort(offset, axis=0, kind="stable")
    sums = np.cumsum(weight[order], axis=0)
    ordered = np.take_along_axis(offset, order, axis=0)
    low, high = (
        np.array(
            [
                ordered[min(int(np.searchsorted(sums[:, axis], share)), len(offset) - 1), axis]
                for axis in (0, 1)
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
    radius = np.sqrt(-2.0 * np.log1p(-share))
    angle = 2.0 * np.pi * turn
    offset = np.stack([radius * np.cos(angle), radius * np.sin(angle)], axis=1)
    return offset - weight @ offset


def _grid(unit: FloatArray, widths: FloatArray) -> FloatArray:
    """Return grid lines, half of them at equal steps and half at quantiles of the points, where
    detail is.
    """
    reach = LAW.beyond * widths
    even = np.linspace((unit - reach).min(), (unit + reach).max(), LAW.cells // 2)
    return np.unique(np.concatenate([even, _quantiles(unit)]))


def _quantiles(unit: FloatArray) -> FloatArray:
    """Return quantiles in equal steps, those of `np.quantile` in a fifth of the time."""
    ordered = np.sort(unit)
    place = np.linspace(0.0, 1.0, LAW.cells // 2) * (len(unit) - 1)
    row = place.astype(np.int64)
    low = ordered[row]
    high = ordered[np.minimum(row + 1, len(unit) - 1)]
    share = place - row
    step = high - low
    return np.where(share < 0.5, low + step * share, high - step * (1.0 - share))


def _squared_distances(place: FloatArray) -> FloatArray:
    """Return the squared distances (n, n) of points (n, 2), to seven digits: twice as fast, and
    kernels are wide.
    """
    x, y = place.astype(np.float32).T
    squares: FloatArray = x[:, None] - x
    squares_y = y[:, None] - y
    squares *= squares
    squares_y *= squares_y
    squares += squares_y
    return squares


def _density(squares: FloatArray, widths: FloatArray, weight: FloatArray) -> FloatArray:
    """Return densities (m,) at places with squared distances (m, n) from kernels with widths
    (n,).
    """
    exponents = squares * (-0.5 / np.square(widths)).astype(squares.dtype)
    share = (weight / np.square(widths)).astype(squares.dtype)
    density = np.exp(exponents, out=exponents) @ share
    return density.astype(np.float64)


def _density_without_own(squares: FloatArray, widths: FloatArray, weight: FloatArray) -> FloatArray:
    """Return the densities (n,) at the points from the kernels of all others: the truth is not one
    of the points.

    With its own kernel each point would lie in denser places than the truth does, and regions of
    few points would hold it too seldom. At least the density at the edge of its own kernel.
    """
    np.fill_diagonal(squares, np.inf)
    density = _density(squares, widths, weight) / np.maximum(1.0 - weight, np.finfo(float).tiny)
    edge = weight / np.square(widths) * np.exp(-0.5 * LAW.beyond**2)
    return np.maximum(density, edge)


def _product(rows: FloatArray, columns: FloatArray) -> FloatArray:
    """Return a product of matrices, a few rows at a time: each is so small that BLAS starts no
    threads, which take longer than they save.
    """
    size = max(LAW.product // columns.size, 1)
    parts = [rows[start : start + size] @ columns for start in range(0, len(rows), size)]
    return np.concatenate(parts)


def _kernel(distance: FloatArray, width: FloatArray) -> FloatArray:
    return np.exp(-0.5 * np.square(distance / width)) / width


def _dense_rings(
    frame: Plane, ring: FloatArray, edges: list[list[int]]
) -> tuple[FloatArray, list[list[int]]]:
    """Return rings of coordinates (k, 2) on the map, m, and the ends of rings, given by polygon.

    Edges are so short that they cross in no other map either.
    """
    points = frame.flat(ring)
    length_m = np.sqrt(np.sum(np.diff(points, axis=0) ** 2, axis=1))
    counts = np.ceil(np.maximum(length_m, 1.0) / LONGEST_EDGE_M).astype(np.int64)
    # From the end of a ring no edge leads to the next one.
    counts[[end - 1 for ends in edges for end in ends[1:] if end < len(points)]] = 1
    if counts.max(initial=1) == 1:
        return points, edges
    moved = np.cumsum([0, *counts, 1])
    return frame.flat(_divided(ring, counts)), [moved[ends].tolist() for ends in edges]


def _divided(ring: FloatArray, counts: IntArray) -> FloatArray:
    """Return the points of a ring (k, 2) with each edge divided into parts (k - 1,)."""
    end = np.cumsum(counts)
    start = np.repeat(np.arange(len(counts)), counts)
    share = (np.arange(len(start)) - (end - counts)[start]) / counts[start]
    between = ring[start] + share[:, None] * (ring[start + 1] - ring[start])
    return np.concatenate([between, ring[-1:]])


def map_area_m2(ring: FloatArray) -> float:
    """Return the area on the sphere, m², of a closed ring (k, 2) of points of an azimuthal
    equidistant map.

    Each triangle of the map's centre and an edge counts as a sector of the sphere does beside one
    of the plane.
    """
    x, y = ring.T
    square = 0.5 * (x[:-1] ** 2 + y[:-1] ** 2 + x[1:] ** 2 + y[1:] ** 2)
    square = np.minimum(square, (np.pi * EARTH_EQUATORIAL_RADIUS_M) ** 2)
    share = np.square(np.sinc(0.5 * np.sqrt(square) / EARTH_EQUATORIAL_RADIUS_M / np.pi))
    return abs(0.5 * float(np.sum((x[:-1] * y[1:] - x[1:] * y[:-1]) * share)))
