"""Columns of impact regions as arrays of numbers, and back: the archives of a spool hold no
objects.

A tuple of regions that several rows share is stored once.
"""

from collections.abc import Mapping, Sequence
from math import isnan
from typing import Any

import numpy as np
from numpy.typing import NDArray

from opir_core.interfaces.impact_regions import IMPACT_CONDITIONS, ImpactRegion

#: The arrays of a packed column: the tuple (n,) of each row, then the number of parts of each
#: tuple, region, polygon and ring, the figures of all regions (a condition is its place among all;
#: nan: no centre), and all points, latitude_rad and longitude_rad.
REGION_PARTS = (
    *(
        "of_row",
        "regions",
        "polygons",
        "rings",
        "ring_points",
        "containment",
        "area_km2",
        "centre",
        "points",
    ),
    *("condition", "probability", "effective_samples"),
)
_NUMBERS = ("containment", "area_km2", "probability", "effective_samples")


def packed_regions(column: NDArray[np.object_]) -> Mapping[str, NDArray[Any]]:
    """Return the arrays of a column (n,) of tuples of regions."""
    place: dict[int, int] = {}
    tuples: list[tuple[ImpactRegion, ...]] = []
    for row in column.tolist():
        if id(row) not in place:
            place[id(row)] = len(tuples)
            tuples.append(row)
    regions = [region for row in tuples for region in row]
    polygons = [polygon for region in regions for polygon in region.polygons]
    rings = [ring for polygon in polygons for ring in polygon]
    return {
        "of_row": np.array([place[id(row)] for row in column.tolist()], dtype=np.int64),
        "regions": _lengths(tuples),
        "polygons": _lengths([region.polygons for region in regions]),
        "rings": _lengths(polygons),
        "ring_points": _lengths(rings),
        **{
            name: np.array([getattr(region, name) for region in regions], dtype=np.float64)
            for name in _NUMBERS
        },
        "condition": np.array(
            [IMPACT_CONDITIONS.index(region.condition) for region in regions], dtype=np.uint8
        ),
        "centre": np.array(
            [region.centre or (np.nan, np.nan) for region in regions], dtype=np.float64
        ).reshape(-1, 2),
        "points": np.concatenate([np.empty((0, 2)), *rings]),
    }


def unpacked_regions(arrays: Mapping[str, NDArray[Any]]) -> NDArray[np.object_]:
    """Return the column (n,) of packed arrays."""
    rings = np.split(arrays["points"], np.cumsum(arrays["ring_points"]))[:-1]
    polygons = _grouped(rings, arrays["rings"])
    shapes = _grouped(polygons, arrays["polygons"])
    figures = zip(*(arrays[name].tolist() for name in _NUMBERS), strict=True)
    columns = (arrays[name].tolist() for name in ("centre", "condition"))
    regions = [
        ImpactRegion(
            **dict(zip(_NUMBERS, numbers, strict=True)),
            polygons=shape,
            centre=None if isnan(lat) else (lat, lon),
            condition=IMPACT_CONDITIONS[code],
        )
        for numbers, (lat, lon), code, shape in zip(figures, *columns, shapes, strict=True)
    ]
    tuples = _grouped(regions, arrays["regions"])
    column = np.empty(len(arrays["of_row"]), dtype=np.object_)
    for row, number in enumerate(arrays["of_row"].tolist()):
        column[row] = tuples[number]
    return column


def _lengths(groups: Sequence[Sequence[Any] | NDArray[Any]]) -> NDArray[np.int64]:
    return np.array([len(group) for group in groups], dtype=np.int64)


def _grouped(items: Sequence[Any], counts: NDArray[Any]) -> list[tuple[Any, ...]]:
    """Return successive parts as tuples of the given lengths."""
    ends = np.cumsum(counts).tolist()
    return [
        tuple(items[end - count : end]) for end, count in zip(ends, counts.tolist(), strict=True)
    ]
