"""Paths that first descend: the shipped LOWTRAN7 table of them, and what lies between its points.

What is interpolated is growth: by which factor optical depth exceeds that of the level path from the lowest height.
Akima's curves lead along the square root of the climb, from the lowest height to the target, then over lowest heights.
Below the table's lowest one growth is taken to be as there: LOWTRAN bends such rays into the ground.
"""

import math
from functools import cache
from pathlib import Path

import numpy as np
from attrs import frozen

from opir_core.radiometry.akima import akima
from opir_core.records import FloatArray

#: The least transmittance in the table.
_LEAST = 1e-9

#: Radius of the sphere on which long paths are reckoned, m.
RADIUS_M = 6_371_000.0

#: Growth is that of depths with so much added: where the air is all but clear, ratios of depths are rounding.
_ADDED = 1e-3

#: Climbs at which growth is had, as square roots, even from 0 to that of the highest, √m.
CLIMBS, HIGHEST_ROOT = 81, math.sqrt(100e3)

_TABLE = Path(__file__).parents[1] / "data" / "lowtran7_limb_transmittance.csv"


@frozen(eq=False)
class LimbTable:
    """Transmittances (n,) of one band from heights (n,), m, of paths that would be lowest at others if straight."""

    lowest_m: FloatArray
    height_m: FloatArray
    transmittance: FloatArray

    def depths(self, lowest_m: FloatArray, level: FloatArray) -> FloatArray:
        """Return optical depths (climbs, lowest) of paths by their climb and their lowest height.

        `level` are those of level paths from the lowest heights, which rise from 0 to the top of the air.
        """
        lowest = np.unique(self.lowest_m)
        rows = [self._log_growth(low, float(np.interp(low, lowest_m, level))) for low in lowest]
        whole = np.vstack([*rows, np.zeros(CLIMBS)])
        growth = np.exp(akima(np.append(lowest, lowest_m[-1]), whole, np.maximum(lowest_m, lowest[0])).T)
        return np.maximum((level + _ADDED) * growth - _ADDED, level)

    def _log_growth(self, lowest_m: float, level: float) -> FloatArray:
        """Return logarithms (climbs,) of growth from one lowest height."""
        own = self.lowest_m == lowest_m
        depth = -np.log(np.maximum(self.transmittance[own], _LEAST))
        climb = np.sqrt(np.append(0.0, self.height_m[own] - lowest_m))
        growth = np.append(0.0, np.log((depth + _ADDED) / (level + _ADDED)))
        return akima(climb, growth[:, None], np.minimum(np.linspace(0.0, HIGHEST_ROOT, CLIMBS), climb[-1]))[:, 0]


@cache
def limb_tables(climate: str, aerosol: str, suffix: str) -> dict[str, LimbTable]:
    """Return a climate's tables by the name of the band; `suffix` is that of the columns' names, "" or "_bb1500"."""
    head, *lines = (line for line in _TABLE.read_text(encoding="utf-8").splitlines() if not line.startswith("#"))
    names = head.split(",")
    own = [line.split(",")[2:] for line in lines if line.startswith(f"{climate},{aerosol},")]
    lowest_km, height_km, *bands = np.array(own, dtype=np.float64).T
    columns = dict(zip(names[4:], bands, strict=True))
    return {
        name.removesuffix(suffix): LimbTable(lowest_km * 1e3, height_km * 1e3, columns[name])
        for name in columns
        if name.endswith("_bb1500") == bool(suffix)
    }
