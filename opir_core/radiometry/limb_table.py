"""Paths that first descend: the shipped LOWTRAN7 table of them, and what lies between its points.

What is interpolated is growth: by which factor optical depth exceeds what paths that only rise foretell for it
(`long_paths`). Akima's curves lead along the square root of the climb, from the lowest height to the target, then over
lowest heights. Below the table's lowest one growth is taken to be as there: LOWTRAN bends such rays into the ground.
"""

from functools import cache
from pathlib import Path

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray
from opir_core.radiometry.akima import akima
from opir_core.radiometry.long_paths import CLIMBS, HIGHEST_ROOT, TOP_M, foretold_depth, foretold_grid
from opir_core.radiometry.sky_columns import sky_columns

#: The least transmittance in the table.
_LEAST = 1e-9

#: Growth is that of depths with so much added: where the air is all but clear, ratios of depths are rounding.
_ADDED = 1e-3

#: The table's columns that say where: sky, lowest height and height.
_PLACE = 4

_TABLE = Path(__file__).parents[1] / "data" / "lowtran7_limb_transmittance.csv"


@frozen(eq=False)
class LimbTable:
    """Transmittances (n,) of one band from heights (n,), m, of paths that would be lowest at others if straight."""

    lowest_m: FloatArray
    height_m: FloatArray
    transmittance: FloatArray

    def depths(self, depth: FloatArray) -> FloatArray:
        """Return optical depths (climbs, lowest) of paths by their climb and their lowest height.

        `depth` (slants, lowest) are those of paths that only rise, from the horizon up, on the grid of `long_paths`.
        """
        lowest, lowest_m = np.unique(self.lowest_m), np.linspace(0.0, TOP_M, depth.shape[1])
        foretold = foretold_depth(depth, self.lowest_m, self.height_m)
        log_growth = np.log((_ADDED - np.log(np.maximum(self.transmittance, _LEAST))) / (foretold + _ADDED))
        whole = np.vstack([*(self._along_climbs(low, log_growth) for low in lowest), np.zeros(CLIMBS)])
        growth = np.exp(akima(np.append(lowest, TOP_M), whole, np.maximum(lowest_m, lowest[0])).T)
        grown: FloatArray = np.maximum((foretold_grid(depth) + _ADDED) * growth - _ADDED, depth[0])
        return grown

    def _along_climbs(self, lowest_m: float, log_growth: FloatArray) -> FloatArray:
        """Return logarithms (climbs,) of growth from one lowest height by those (n,) of the table."""
        own = self.lowest_m == lowest_m
        climb = np.sqrt(np.append(0.0, self.height_m[own] - lowest_m))
        values = np.append(0.0, log_growth[own])[:, None]
        return akima(climb, values, np.minimum(np.linspace(0.0, HIGHEST_ROOT, CLIMBS), climb[-1]))[:, 0]


@cache
def limb_tables(climate: str, aerosol: str, suffix: str) -> dict[str, LimbTable]:
    """Return a climate's tables by the name of the band; `suffix` is that of the columns' names, "" or "_bb1500"."""
    cells = sky_columns(_TABLE, climate, aerosol)
    lowest_m, height_m = (np.array(list(map(float, cells[name]))) * 1e3 for name in ("lowest_km", "h_km"))
    return {
        name.removesuffix(suffix): LimbTable(lowest_m, height_m, np.array(list(map(float, cells[name]))))
        for name in list(cells)[_PLACE:]
        if name.endswith("_bb1500") == bool(suffix)
    }
