"""Each point of LOWTRAN's table left out in turn: how far what is interpolated without it is from LOWTRAN, by place.

Above the horizon inner heights and inner zenith angles are left out; below it each lowest height but the last and each
climb but the last, the outermost lowest height included: there growth is only continued.
"""

from collections.abc import Callable, Iterator
from itertools import pairwise
from typing import NamedTuple

import numpy as np
from attrs import evolve
from opir_photons.radiometry.long_paths import RADIUS_M, LimbTable
from opir_photons.radiometry.lowtran import NodeTable

#: Returns transmittances by height, m, and sine of elevation; and what makes such a model of a table.
Model = Callable[[np.ndarray, np.ndarray], np.ndarray]
Way = Callable[[NodeTable], Model]

#: Edges of the regions, m: the haze and what refraction lowers into it, weather, stratosphere, what is above.
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
    return _rising(way, nodes, list(AXES).index(kind)) if kind in AXES else _descending(way, nodes, kind)


def _rising(way: Way, nodes: NodeTable, axis: int) -> Iterator[Errors]:
    height, zenith = np.meshgrid(nodes.height_m, nodes.zenith_rad, indexing="ij")
    for place in range(1, nodes.transmittance.shape[axis] - 1):
        changes = {tuple(AXES.values())[axis]: np.delete((nodes.height_m, nodes.zenith_rad)[axis], place)}
        model = way(evolve(nodes, transmittance=np.delete(nodes.transmittance, place, axis=axis), **changes))
        h, z, theirs = (np.take(of, place, axis=axis) for of in (height, zenith, nodes.transmittance))
        yield Errors(h, np.abs(model(h, np.cos(z)) - theirs))


def _descending(way: Way, nodes: NodeTable, kind: str) -> Iterator[Errors]:
    own = nodes.limb
    climbs = np.where(own.height_m > TO_THE_TOP_M, np.inf, np.round(own.height_m - own.lowest_m, -2))
    column = own.lowest_m if kind == "a lowest height" else climbs
    for value in np.unique(column)[:-1]:
        out = column == value
        model = way(evolve(nodes, limb=LimbTable(own.lowest_m[~out], own.height_m[~out], own.transmittance[~out])))
        lowest, height = own.lowest_m[out], own.height_m[out]
        cosine = (RADIUS_M + lowest) / (RADIUS_M + height)
        found = model(height, -np.sqrt((1.0 - cosine) * (1.0 + cosine)))
        yield Errors(lowest, np.abs(found - own.transmittance[out]))


def by_region(way: Way, tables: list[NodeTable]) -> str:
    """Return as a Markdown table the largest errors of all tables by region and by what is left out."""
    found = {kind: _joined(error for nodes in tables for error in left_out(way, nodes, kind)) for kind in KINDS}
    head = "| heights, km | " + " | ".join(f"{kind} omitted" for kind in KINDS) + " |\n|---" + "|---" * len(KINDS) + "|"
    lines = []
    for lower, upper in pairwise(EDGES_M):
        largest = [_largest(found[kind], lower, upper) for kind in KINDS]
        lines.append(f"| {lower / 1e3:g} to {upper / 1e3:g} | " + " | ".join(largest) + " |")
    return "\n".join([head, *lines])


def _joined(errors: Iterator[Errors]) -> Errors:
    return Errors(*map(np.concatenate, zip(*errors, strict=True)))


def _largest(errors: Errors, lower_m: float, upper_m: float) -> str:
    inside = (errors.height_m >= lower_m) & (errors.height_m < upper_m)
    return f"{errors.error[inside].max():.4f} of {np.count_nonzero(inside)}"
