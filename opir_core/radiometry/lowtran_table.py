"""The shipped LOWTRAN7 table of band transmittances, and a fine grid of them for one climate and band.

Between the table's heights and zenith angles τ is interpolated in the fourth root of optical depth, -ln τ: Akima's
curves in height, then in the logarithm of an air mass, from the zenith to the horizon. Towards a sensor below the
target's horizon light first descends to its lowest height and rises from there: a table of its own has such paths
(`limb_table`).
"""

import math
from collections.abc import Mapping
from functools import cache
from pathlib import Path

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray
from opir_core.protocols import Band
from opir_core.radiometry.akima import akima
from opir_core.radiometry.limb_table import LimbTable, limb_tables
from opir_core.radiometry.long_paths import BEND, HIGHEST_SLANT, RADIUS_M, SCALE_HEIGHT_M, TOP_M
from opir_core.radiometry.sky_columns import sky_columns

#: The grid: so many sines of elevation, from the horizon to the zenith, and so many heights from 0 to the top.
GRID_SHAPE = (125, 401)

#: Optical depths are kept between these: τ from 1e-26 to all but 1.
_LEAST, _MOST = 1e-12, 60.0

_TABLE = Path(__file__).parents[1] / "data" / "lowtran7_band_transmittance.csv"

#: A weighting's column in the table, and the ending of its columns in that of long paths.
_WEIGHTINGS = {"flat": ("tau_flat", ""), "blackbody-1500K": ("tau_bb1500", "_bb1500")}


@frozen(eq=False)
class NodeTable:
    """Transmittances (heights, zenith angles) of one band at the table's own points, and those of long paths."""

    band: Band
    height_m: FloatArray
    zenith_rad: FloatArray
    transmittance: FloatArray
    limb: LimbTable


@cache
def node_tables(climate: str, aerosol: str, weighting: str) -> Mapping[str, NodeTable]:
    """Return a climate's tables by the name of the band; of no such climate and aerosol, none."""
    column, suffix = _WEIGHTINGS[weighting]
    cells = sky_columns(_TABLE, climate, aerosol)
    if not cells:
        return {}
    height_km, zenith_deg, values = (np.array(list(map(float, cells[name]))) for name in ("h_km", "zen_deg", column))
    edges_um = zip(cells["lo_um"], cells["hi_um"], strict=True)
    bands = [Band(name, *map(float, ends)) for name, ends in dict(zip(cells["band"], edges_um, strict=True)).items()]
    places = {band.name: place for place, band in enumerate(bands)}
    number = np.array([places[name] for name in cells["band"]])
    order = np.lexsort((zenith_deg, height_km, number))
    heights, angles = (np.array(sorted(set(own.tolist()))) for own in (height_km, zenith_deg))
    limbs, by_band = limb_tables(climate, aerosol, suffix), values[order].reshape(len(bands), len(heights), -1)
    return {
        band.name: NodeTable(band, heights * 1e3, np.radians(angles), own, limbs[band.name])
        for band, own in zip(bands, by_band, strict=True)
    }


@frozen(eq=False)
class BandGrid:
    """Transmittances of one band: (slants, heights) from the horizon up, (climbs, lowest heights) below it."""

    above: FloatArray
    below: FloatArray


@np.errstate(under="ignore")
def fine_grid(nodes: NodeTable, shape: tuple[int, int] = GRID_SHAPE) -> BandGrid:
    """Return transmittances of a band over the grid, nowhere falling with height or elevation."""
    heights_m = np.linspace(0.0, TOP_M, shape[1])
    sines = np.sinh(np.linspace(0.0, HIGHEST_SLANT, shape[0])) * BEND
    roots = akima(nodes.height_m, _roots(nodes.transmittance), heights_m)
    masses, at = (np.log(shell_air_mass(one)) for one in (np.cos(nodes.zenith_rad), sines))
    depth = akima(masses, roots.T, at) ** 4
    risen = np.maximum.accumulate(_transmittance(depth, heights_m), axis=0)
    return BandGrid(risen, _transmittance(nodes.limb.depths(depth), heights_m))


def _transmittance(depth: FloatArray, height_m: FloatArray) -> FloatArray:
    """Return transmittances (k, heights) of depths, nowhere falling with height."""
    risen = np.maximum.accumulate(np.where(height_m >= TOP_M, 1.0, np.exp(-depth)), axis=1)
    return np.clip(risen, 0.0, 1.0)


def shell_air_mass(sine: FloatArray | float) -> FloatArray:
    """Return how many times its thickness a straight path crosses a shell of even air, for sines from 0 to 1.

    Of a shell as thick as the air's scale height around a sphere: the secant of small zenith angles, 40 at the horizon.
    """
    ratio = RADIUS_M / SCALE_HEIGHT_M
    across = ratio * np.asarray(sine, dtype=np.float64)
    mass: FloatArray = (2.0 * ratio + 1.0) / (np.sqrt(across * across + (2.0 * ratio + 1.0)) + across)
    return mass


def _roots(transmittance: FloatArray) -> FloatArray:
    """Return fourth roots of optical depth."""
    return np.clip(-np.log(np.maximum(transmittance, math.exp(-_MOST))), _LEAST, _MOST) ** 0.25
