"""The shipped LOWTRAN7 table of band transmittances, and a fine grid of them for one climate and band.

Between the table's heights and zenith angles τ is interpolated in the fourth root of optical depth, -ln τ: Akima's
curves in height, then in the logarithm of an air mass, from the zenith to the horizon. Towards a sensor below the
target's horizon light first descends to its lowest height and rises from there: there and back less the way on from the
target, each by the level path from the lowest height, of which optical depth grows with a power of the air passed, as
it does from 88° to the horizon. That is a rule of opir, not LOWTRAN's, which bends rays too: it is 0.016 off as a rule
and up to 0.15 where light grazes the lowest kilometres.
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

#: The grid: so many sines of elevation, even in asinh(sine / 0.05) from -0.18 to 1, and so many heights from 0 to the
#: top. The horizon is one of the sines: τ breaks there.
GRID_SHAPE = (192, 401)
BEND = 0.05
HIGHEST_SLANT = math.asinh(1.0 / BEND)
LOWEST_SLANT = -HIGHEST_SLANT * 67 / 124

#: Optical depths are kept between these: τ from 1e-26 to all but 1.
_LEAST, _MOST = 1e-12, 60.0

#: Sines nearer to the horizon are those of the horizon, but for rounding.
_HORIZON = 1e-9

#: Sine of the elevation from which to the horizon the growth of optical depth with the air passed is taken, and the
#: least of its powers: weak absorption has 1, strong lines 0.5.
_NEAR_HORIZON, _LEAST_POWER = math.sin(math.radians(2.0)), 0.1
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
    column = _WEIGHTINGS[weighting]
    by_band: dict[tuple[str, ...], list[list[str]]] = {}
    for line in _lines_of(f"\n{climate},{aerosol},"):
        cells = line.split(",")
        by_band.setdefault(tuple(cells[2:5]), []).append([cells[5], cells[6], cells[column]])
    bands = [Band(name, float(lower), float(upper)) for name, lower, upper in by_band]
    return {band.name: _nodes(band, rows) for band, rows in zip(bands, by_band.values(), strict=True)}


def _lines_of(beginning: str) -> list[str]:
    """Return the table's lines that begin so, which stand together."""
    text = _TABLE.read_text(encoding="utf-8")
    first, last = text.find(beginning), text.rfind(beginning)
    return text[first + 1 : text.find("\n", last + 1)].splitlines() if first >= 0 else []


def _nodes(band: Band, rows: list[list[str]]) -> NodeTable:
    own = np.array(rows, dtype=np.float64)
    heights, angles = (np.array(sorted(set(own[:, part].tolist()))) for part in (0, 1))
    values = own[np.lexsort((own[:, 1], own[:, 0])), 2].reshape(len(heights), len(angles))
    return NodeTable(band, heights * 1e3, np.radians(angles), values)


@np.errstate(under="ignore")
def fine_grid(nodes: NodeTable, shape: tuple[int, int] = GRID_SHAPE) -> FloatArray:
    """Return transmittances (slants, heights) of a band over the grid, nowhere falling along either."""
    heights_m = np.linspace(0.0, TOP_M, shape[1])
    sines = np.sinh(np.linspace(LOWEST_SLANT, HIGHEST_SLANT, shape[0])) * BEND
    sines[np.abs(sines) < _HORIZON] = 0.0
    column = _Column(nodes.zenith_rad, heights_m, akima(nodes.height_m, _roots(nodes.transmittance), heights_m))
    rising = sines >= 0.0
    depth = np.vstack([column.downward(sines[~rising]), column.upward(sines[rising])])
    transmittance = np.where(heights_m >= TOP_M, 1.0, np.exp(-depth))
    risen = np.maximum.accumulate(np.maximum.accumulate(transmittance, axis=1), axis=0)
    return np.clip(risen, 0.0, 1.0)


def shell_air_mass(sine: FloatArray | float) -> FloatArray:
    """Return how many times its thickness a straight path crosses a shell of even air, for sines from 0 to 1.

    Of a shell as thick as the air's scale height around a sphere: the secant of small zenith angles, 40 at the horizon.
    """
    ratio = RADIUS_M / SCALE_HEIGHT_M
    across = ratio * np.asarray(sine, dtype=np.float64)
    mass: FloatArray = (2.0 * ratio + 1.0) / (np.sqrt(across * across + (2.0 * ratio + 1.0)) + across)
    return mass


@frozen(eq=False)
class _Column:
    """One band over a column of heights: fourth roots of optical depth (heights, zenith angles)."""

    zenith_rad: FloatArray
    height_m: FloatArray
    roots: FloatArray

    def upward(self, sines: FloatArray) -> FloatArray:
        """Return optical depths (sines, heights) towards sensors above the horizon."""
        nodes, at = (np.log(shell_air_mass(one)) for one in (np.cos(self.zenith_rad), sines))
        depth: FloatArray = akima(nodes, self.roots.T, at) ** 4
        return depth

    def downward(self, sines: FloatArray) -> FloatArray:
        """Return optical depths (sines, heights) towards sensors below the horizon, inf through the Earth."""
        level, near = self.upward(np.array([0.0, _NEAR_HORIZON]))
        growth = math.log(float(shell_air_mass(0.0)) / float(shell_air_mass(_NEAR_HORIZON)))
        power = np.clip(np.log(np.maximum(level, _LEAST) / np.maximum(near, _LEAST)) / growth, _LEAST_POWER, 1.0)
        lowest_m = (RADIUS_M + self.height_m) * np.sqrt(1.0 - sines[:, None] ** 2) - RADIUS_M
        half, law = (np.interp(lowest_m, self.height_m, column) for column in (np.maximum(level, _LEAST), power))
        passed = np.minimum(self.upward(-sines) / half, 1.0) ** (1.0 / law)
        both = half * (2.0 - passed) ** law
        return np.where(lowest_m < 0.0, np.inf, np.maximum(both, level))


def _roots(transmittance: FloatArray) -> FloatArray:
    """Return fourth roots of optical depth."""
    return np.clip(-np.log(np.maximum(transmittance, math.exp(-_MOST))), _LEAST, _MOST) ** 0.25
