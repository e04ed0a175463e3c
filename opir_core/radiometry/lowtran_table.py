"""The shipped LOWTRAN7 table of band transmittances, and a fine grid of them for one climate and band.

Between the table's heights and zenith angles τ is interpolated in the fourth root of optical depth, -ln τ: Akima's
curves in height, then in ln sec z. Beyond 85° optical depth grows with a power of the air mass of an exponential
atmosphere, the power that it has between 80° and 85°. Towards a sensor below the target's horizon light first descends
to its lowest height and rises from there: twice the optical depth of a level path from the lowest height, less that of
the path away from the sensor. Both are rules of opir, not LOWTRAN's.
"""

import math
from collections.abc import Mapping
from functools import cache
from pathlib import Path

import numpy as np
from attrs import frozen

from opir_core.protocols import Band
from opir_core.radiometry.akima import akima
from opir_core.records import FloatArray

#: Above this LOWTRAN has no atmosphere, m.
TOP_M = 100e3

#: Radius of the sphere on which long paths are reckoned, m, and scale height of the air, m.
RADIUS_M, SCALE_HEIGHT_M = 6_371_000.0, 8_000.0

#: The grid: so many sines of elevation, even in asinh(sine / 0.05) from the lowest, whose slant this is, to 1, and so
#: many heights from 0 to the top.
GRID_SHAPE = (192, 401)
BEND = 0.05
LOWEST_SLANT, HIGHEST_SLANT = math.asinh(-0.18 / BEND), math.asinh(1.0 / BEND)

#: Optical depths are kept between these: τ from 1e-26 to all but 1.
_LEAST, _MOST = 1e-12, 60.0
_TABLE = Path(__file__).parents[1] / "data" / "lowtran7_band_transmittance.csv"
_WEIGHTINGS = {"flat": 7, "blackbody-1500K": 8}


@frozen(eq=False)
class NodeTable:
    """Transmittances (heights, zenith angles) of one band at the table's own points."""

    band: Band
    height_m: FloatArray
    zenith_rad: FloatArray
    transmittance: FloatArray


@cache
def node_tables(climate: str, aerosol: str, weighting: str) -> Mapping[str, NodeTable]:
    """Return a climate's tables by the name of the band; of no such climate and aerosol, none."""
    wanted, column = f"{climate},{aerosol},", _WEIGHTINGS[weighting]
    text = _TABLE.read_text(encoding="utf-8")
    rows = [line.split(",") for line in text.splitlines() if line.startswith(wanted)]
    bands = dict.fromkeys((row[2], float(row[3]), float(row[4])) for row in rows)
    return {name: _nodes(Band(name, *edges), rows, column) for name, *edges in bands}


def _nodes(band: Band, rows: list[list[str]], column: int) -> NodeTable:
    own = np.array([[float(row[5]), float(row[6]), float(row[column])] for row in rows if row[2] == band.name])
    heights, angles = (np.array(sorted(set(own[:, part].tolist()))) for part in (0, 1))
    values = own[np.lexsort((own[:, 1], own[:, 0])), 2].reshape(len(heights), len(angles))
    return NodeTable(band, heights * 1e3, np.radians(angles), values)


@np.errstate(under="ignore")
def fine_grid(nodes: NodeTable, shape: tuple[int, int] = GRID_SHAPE) -> FloatArray:
    """Return transmittances (slants, heights) of a band over the grid, nowhere falling along either."""
    heights_m = np.linspace(0.0, TOP_M, shape[1])
    sines = np.sinh(np.linspace(LOWEST_SLANT, HIGHEST_SLANT, shape[0])) * BEND
    column = _Column(nodes.zenith_rad, heights_m, akima(nodes.height_m, _roots(nodes.transmittance), heights_m))
    rising = sines >= 0.0
    depth = np.vstack([column.downward(sines[~rising]), column.upward(sines[rising])])
    transmittance = np.where(heights_m >= TOP_M, 1.0, np.exp(-depth))
    risen = np.maximum.accumulate(np.maximum.accumulate(transmittance, axis=1), axis=0)
    return np.clip(risen, 0.0, 1.0)


def air_mass(sine: FloatArray | float, height_m: FloatArray | float) -> FloatArray:
    """Return how many times the air above a place a straight path upward meets, for sines of elevation from 0 to 1.

    Of an exponential atmosphere around a sphere: a rational approach to Chapman's function, sqrt(pi X / 2) at the
    horizon for radius over scale height X, right to some percent between. Source: Smith and Smith, J. Geophys. Res. 77
    (1972), 3592.
    """
    x = (RADIUS_M + np.asarray(height_m)) / SCALE_HEIGHT_M
    y = np.sqrt(0.5 * x) * np.asarray(sine)
    # exp(y²) erfc(y) in the rational form of Smith and Smith.
    near, far = (1.0606963 + 0.55643831 * y) / (1.0619896 + y * (1.7245609 + y)), 0.56498823 / (0.06651874 + y)
    scaled = np.where(y <= 8.0, near, far)
    mass: FloatArray = np.sqrt(0.5 * np.pi * x) * scaled
    return mass


@frozen(eq=False)
class _Column:
    """One band over a column of heights: fourth roots of optical depth (heights, zenith angles)."""

    zenith_rad: FloatArray
    height_m: FloatArray
    roots: FloatArray

    def upward(self, sines: FloatArray) -> FloatArray:
        """Return optical depths (sines, heights) towards sensors above the horizon."""
        last = math.cos(float(self.zenith_rad[-1]))
        within = akima(-np.log(np.cos(self.zenith_rad)), self.roots.T, -np.log(np.maximum(sines, last))) ** 4
        depth, before = (np.maximum(self.roots[:, place] ** 4, _LEAST) for place in (-1, -2))
        steeper, edge = (air_mass(one, self.height_m) for one in (math.cos(float(self.zenith_rad[-2])), last))
        power = np.clip(np.log(depth / before) / np.log(edge / steeper), 0.0, 1.0)
        beyond = depth * (air_mass(sines[:, None], self.height_m) / edge) ** power
        return np.where(sines[:, None] >= last, within, beyond)

    def downward(self, sines: FloatArray) -> FloatArray:
        """Return optical depths (sines, heights) towards sensors below the horizon, inf through the Earth."""
        level = self.upward(np.zeros(1))[0]
        lowest_m = (RADIUS_M + self.height_m) * np.sqrt(1.0 - sines[:, None] ** 2) - RADIUS_M
        both = 2.0 * np.interp(lowest_m, self.height_m, level) - self.upward(-sines)
        return np.where(lowest_m < 0.0, np.inf, np.maximum(both, level))


def _roots(transmittance: FloatArray) -> FloatArray:
    """Return fourth roots of optical depth."""
    return np.clip(-np.log(np.maximum(transmittance, math.exp(-_MOST))), _LEAST, _MOST) ** 0.25
