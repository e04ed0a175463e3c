"""Each point of LOWTRAN's table left out in turn: how far what is interpolated without it is from
LOWTRAN, by place.

Above the horizon inner heights and inner zenith angles are left out; below it each lowest height
but the last and each climb but the last, the outermost lowest height included: there growth is only
continued.
"""

from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from attrs import evolve
from opir_photons.radiometry.long_paths import RADIUS_M, LimbTable
from opir_photons.radiometry.lowtran import NodeTable

#: Returns transmittances by height, m, and sine of elevation; and what makes such a model of a
#: table.
Model = Callable[[np.ndarray, np.ndarray], np.ndarray]
Way = Callable[[NodeTable], Model]

#: Edges of the regions, m: the haze and what refraction lowers into it, weather, stratosphere, what
#: is above.
EDGES_M = (0.0, 5e3, 10e3, 20e3, 100e3)

#: A last climb, to the top of the air, is never left out.
TO_THE_TOP_M = 99e3

AXES = {"a height": "height_m", "an angle": "zenith_rad"}
KINDS = ("a height", "an angle", "a lowest height", "a climb")


class Errors(NamedTuple):
    """Heights (n,) of places above the horizon, or lowest heights below it, m, and errors there."""

    height_m: np.ndarray
    error: np.ndarray


def left_out(way: Way, nodes: NodeTable, kind: str) -> Iterator[Errors]:
    """Yield, for each point of a kind that a table can spare, the errors there without it."""
    return (
        _rising(way, nodes, list(AXES).index(kind))
        if kind in AXES
        else _descending(way, nodes, kind)
    )


def _rising(way: Way, nodes: NodeTable, axis: int) -> Iterator[Errors]:
    height, zenith = np.meshgrid(nodes.height_m, nodes.zenith_rad, indexing="ij")
    for place in range(1, nodes.transmittance.shape[axis] - 1):
        changes = {
            tuple(AXES.values())[axis]: np.delete((nodes.height_m, nodes.zenith_rad)[axis], place)
        }
        model = way(
            evolve(nodes, transmittance=np.delete(nodes.transmittance, place, axis=axis), **changes)
        )
        h, z, theirs = (
            np.take(of, place, axis=axis) for of in (height, zenith, nodes.transmittance)
        )
        yield Errors(h, np.abs(model(h, np.cos(z)) - theirs))


def _descending(way: Way, nodes: NodeTable, kind: str) -> Iterator[Errors]:
    own = nodes.limb
    climbs = np.where(
        own.height_m > TO_THE_TOP_M, np.inf, np.round(own.height_m - own.lowest_m, -2)
    )
    column = own.lowest_m if kind == "a lowest height" else climbs
    for value in np.unique(column)[:-1]:
        out = column == value
        model = way(
            evolve(
                nodes,
                limb=LimbTable(own.lowest_m[~out], own.height_m[~out], own.transmittance[~out]),
            )
        )
        lowest = own.lowest_m[out]
        height = own.height_m[out]
        cosine = (RADIUS_M + lowest) / (RADIUS_M + height)
        found = model(height, -np.sqrt((1.0 - cosine) * (1.0 + cosine)))
        yield Errors(lowest, np.abs(found - own.transmittance[out]))


class Region(NamedTuple):
    """The largest error in a range of heights with points of a kind left out, and the number of
    values.
    """

    left_out: str
    from_km: float
    to_km: float
    error: float
    values: int


def regions(way: Way, tables: list[NodeTable]) -> Iterator[Region]:
    """Yield the largest errors of all tables by what is left out and by region."""
    for kind in KINDS:
        found = _joined(error for nodes in tables for error in left_out(way, nodes, kind))
        for lower_m, upper_m in pairwise(EDGES_M):
            inside = (found.height_m >= lower_m) & (found.height_m < upper_m)
            error = float(found.error[inside].max())
            yield Region(kind, lower_m / 1e3, upper_m / 1e3, error, int(np.count_nonzero(inside)))


def _joined(errors: Iterator[Errors]) -> Errors:
    return Errors(*map(np.concatenate, zip(*errors, strict=True)))
