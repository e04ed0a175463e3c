"""Each point of LOWTRAN's table left out in turn: errors of the interpolation without it, by place.

Above the horizon inner heights and inner zenith angles are left out; below it each lowest height
but the last and each climb but the last, the outermost lowest height included: there growth is only
continued.
"""

from collections.abc import Callable
from itertools import pairwise

import numpy as np
from attrs import evolve
from opir_photons.radiometry.long_paths import RADIUS_M, LimbTable
from opir_photons.radiometry.lowtran import NodeTable

#: Returns transmittances by height, m, and sine of elevation; and the maker of such a model from a
#: table.
Model = Callable[[np.ndarray, np.ndarray], np.ndarray]
Way = Callable[[NodeTable], Model]
#: Heights (n,) of places above the horizon, or lowest heights below it, m, and errors there.
Errors = tuple[np.ndarray, np.ndarray]

#: Edges of the regions, m: the haze and what refraction lowers into it, weather, stratosphere, and
#: above.
EDGES_M = (0.0, 5e3, 10e3, 20e3, 100e3)
RISING = ("a height", "an angle")
KINDS = (*RISING, "a lowest height", "a climb")


def left_out(way, nodes, kind):
    """Yield, for each point of a kind that a table can spare, the errors there without it."""
    errors = _rising if kind in RISING else _descending
    return errors(way, nodes, kind)


def _rising(way, nodes, kind):
    axis = RISING.index(kind)
    grid = np.meshgrid(nodes.height_m, nodes.zenith_rad, indexing="ij")
    name = ("height_m", "zenith_rad")[axis]
    for point in range(1, nodes.transmittance.shape[axis] - 1):
        sparse = evolve(
            nodes,
            transmittance=np.delete(nodes.transmittance, point, axis=axis),
            **{name: np.delete(getattr(nodes, name), point)},
        )
        height_m, zenith_rad, exact = (
            np.take(values, point, axis=axis) for values in (*grid, nodes.transmittance)
        )
        yield height_m, np.abs(way(sparse)(height_m, np.cos(zenith_rad)) - exact)


def _descending(way, nodes, kind):
    limb = nodes.limb
    # The climb to the top of the air is never left out.
    is_top = limb.height_m > 99e3
    climb_m = np.where(is_top, np.inf, np.round(limb.height_m - limb.lowest_m, -2))
    column = limb.lowest_m if kind == "a lowest height" else climb_m
    for value in np.unique(column)[:-1]:
        out = column == value
        sparse = LimbTable(limb.lowest_m[~out], limb.height_m[~out], limb.transmittance[~out])
        lowest_m = limb.lowest_m[out]
        height_m = limb.height_m[out]
        cosine = (RADIUS_M + lowest_m) / (RADIUS_M + height_m)
        sine = -np.sqrt((1.0 - cosine) * (1.0 + cosine))
        transmittance = way(evolve(nodes, limb=sparse))(height_m, sine)
        yield lowest_m, np.abs(transmittance - limb.transmittance[out])


def region_rows(way, tables):
    """Yield the largest errors of all tables by kind and by region."""
    every_table = list(tables)
    for kind in KINDS:
        errors = [error for nodes in every_table for error in left_out(way, nodes, kind)]
        height_m, error = (np.concatenate(column) for column in zip(*errors, strict=True))
        for lower_m, upper_m in pairwise(EDGES_M):
            inside = (height_m >= lower_m) & (height_m < upper_m)
            yield {
                "left_out": kind,
                "from_km": lower_m / 1e3,
                "to_km": upper_m / 1e3,
                "error": float(error[inside].max()),
                "values": int(np.count_nonzero(inside)),
            }
