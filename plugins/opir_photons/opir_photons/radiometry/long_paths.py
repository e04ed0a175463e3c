"""Paths that first descend: the LOWTRAN7 table of their transmittances, and interpolation between
its points.

Interpolated is growth: the ratio of optical depth to a prediction from paths that only rise, which
varies little from path to path. Akima splines run along the square root of the climb, from the
lowest height to the target, then over lowest heights. Below the lowest one of the table growth is
constant: LOWTRAN bends such rays into the ground. Lowest heights are those of straight paths;
refraction lowers rays by up to 2 km, where the air changes fast with height.
"""

import math
from functools import cache
from typing import NamedTuple

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray, IntArray
from opir_photons.columns import floats
from opir_photons.laws import DATA


def akima(x: FloatArray, y: FloatArray, at: FloatArray) -> FloatArray:
    """Return Akima splines through values (n, m) at increasing x (n,), at places (k,) within them:
    (k, m).

    Source: H. Akima, Journal of the ACM 17 (1970), 589-602: cubics whose slope at a point is the
    mean of the slopes beside it, each weighted with the change of slope on the other side; slopes
    beyond the ends are extrapolated. Where nothing bends the plain mean is taken. SciPy's
    `Akima1DInterpolator` differs in the last bits and takes 0.3 s to import.
    """
    rise = np.diff(y, axis=0) / np.diff(x)[:, None]
    start = 2.0 * rise[0] - rise[1]
    end = 2.0 * rise[-1] - rise[-2]
    slopes = np.vstack([2.0 * start - rise[0], start, rise, end, 2.0 * end - rise[-1]])
    bend = np.abs(np.diff(slopes, axis=0))
    lower = slopes[1:-2]
    upper = slopes[2:-1]
    total = bend[2:] + bend[:-2]
    is_straight = total <= 1e-9 * np.abs(bend).max()
    weighted = (bend[2:] * lower + bend[:-2] * upper) / np.where(is_straight, 1.0, total)
    slope = np.where(is_straight, 0.5 * (lower + upper), weighted)
    return _hermite(x, y, slope, at)


def _hermite(x: FloatArray, y: FloatArray, slope: FloatArray, at: FloatArray) -> FloatArray:
    """Return cubics by their values and slopes at points."""
    place = np.clip(np.searchsorted(x, at, side="right") - 1, 0, len(x) - 2)
    width = (x[place + 1] - x[place])[:, None]
    t = ((at - x[place])[:, None]) / width
    start: FloatArray = y[place] * (1.0 + 2.0 * t) * (1.0 - t) ** 2
    level = start + y[place + 1] * t * t * (3.0 - 2.0 * t)
    return level + width * t * (1.0 - t) * (slope[place] * (1.0 - t) - slope[place + 1] * t)


def sky_columns(table: str, climate: str, aerosol: str) -> dict[str, list[str]]:
    """Return the cells of a climate and aerosol in a file of data by column name; empty for an
    unknown sky.

    The rows of one sky are consecutive, below a line of names.
    """
    text = (DATA / table).read_text(encoding="utf-8")
    beginning = f"\n{climate},{aerosol},"
    start = text.find(beginning)
    if start < 0:
        return {}
    head = text.find("\natmosphere,aerosol,") + 1
    names = text[head : text.find("\n", head)].split(",")
    end = text.find("\n", text.rfind(beginning) + 1)
    cells = text[start + 1 : end].replace("\n", ",").split(",")
    return {name: cells[place :: len(names)] for place, name in enumerate(names)}


#: Added to depths before their ratio: for almost clear air the ratio of depths is rounding.
_ADDED = 1e-3


@frozen(eq=False)
class LimbTable:
    """Transmittances (n,) of one band from heights (n,), m, of paths that would be lowest at others
    if straight.
    """

    lowest_m: FloatArray
    height_m: FloatArray
    transmittance: FloatArray

    def depths(self, depth: FloatArray) -> FloatArray:
        """Return optical depths (climbs, lowest) of paths by their climb and their lowest height.

        `depth` (slants, lowest) are those of paths that only rise, from the horizon up, on the grid
        of `long_paths`.
        """
        lowest = np.unique(self.lowest_m)
        predicted = predicted_depth(depth, self.lowest_m, self.height_m)
        # The least transmittance in the table is 1e-9.
        log_air = np.log(np.maximum(self.transmittance, 1e-9))
        log_growth = np.log((_ADDED - log_air) / (predicted + _ADDED))
        rows = [*(self._along_climbs(low, log_growth) for low in lowest), np.zeros(CLIMBS)]
        places = np.linspace(0.0, TOP_M, depth.shape[1]).clip(lowest[0])
        growth = np.exp(akima(np.append(lowest, TOP_M), np.vstack(rows), places).T)
        return np.maximum((predicted_grid(depth) + _ADDED) * growth - _ADDED, depth[0])

    def _along_climbs(self, lowest_m: float, log_growth: FloatArray) -> FloatArray:
        """Return logarithms (climbs,) of growth from one lowest height by those (n,) of the
        table.
        """
        rows = self.lowest_m == lowest_m
        climb = np.sqrt(np.append(0.0, self.height_m[rows] - lowest_m))
        values = np.append(0.0, log_growth[rows])[:, None]
        places = np.minimum(np.linspace(0.0, HIGHEST_ROOT, CLIMBS), climb[-1])
        return akima(climb, values, places)[:, 0]


@cache
def limb_tables(climate: str, aerosol: str, suffix: str) -> dict[str, LimbTable]:
    """Return a climate's tables by the name of the band; `suffix` is that of the columns' names, ""
    or "_bb1500".
    """
    cells = sky_columns("lowtran7_limb_transmittance.csv", climate, aerosol)
    lowest_m = floats(cells["lowest_km"]) * 1e3
    height_m = floats(cells["h_km"]) * 1e3
    # The columns before the bands are sky, lowest height and height.
    return {
        name.removesuffix(suffix): LimbTable(lowest_m, height_m, floats(cells[name]))
        for name in list(cells)[4:]
        if name.endswith("_bb1500") == bool(suffix)
    }


#: Radius of the sphere for long paths, m.
RADIUS_M = 6_371_000.0

#: Above this LOWTRAN has no atmosphere, m.
TOP_M = 100e3

#: Scale height of the air, m.
SCALE_HEIGHT_M = 8_000.0

#: Sines of elevation from the horizon to the zenith are uniform in asinh(sine / 0.05).
BEND = 0.05
HIGHEST_SLANT = math.asinh(1.0 / BEND)

#: Climbs from the lowest height to the start of a path: square roots, uniform from 0 to that of the
#: highest, √m.
CLIMBS = 81
HIGHEST_ROOT = math.sqrt(TOP_M)


class _LimbPlaces(NamedTuple):
    """Places of paths on the grid of rising ones: bent lowest heights, m, the corner below,
    fractions across and up.
    """

    turn_m: FloatArray
    corner: IntArray
    across: FloatArray
    up: FloatArray


def bent_lowest_m(lowest_m: FloatArray, height_m: FloatArray) -> FloatArray:
    """Return the lowest heights, m, of bent paths from heights, given those of straight paths; at
    least 0.

    Along a ray index, distance from the Earth's centre and sine of the zenith angle have a constant
    product (Bouguer); the refractivity falls with the scale height.
    """
    radius = RADIUS_M + lowest_m
    index = _refractivity(height_m)
    turn = lowest_m + 0.0 * height_m
    # Each iteration leaves 0.22 of the error, 1.8 km at first.
    for _ in range(8):
        turn = lowest_m - radius * (_refractivity(turn) - index)
    return np.maximum(turn, 0.0)


def _refractivity(height_m: FloatArray) -> FloatArray:
    """Return the refractive index of air in the infrared less 1: at the ground that at 7 °C (Edlén,
    Metrologia 2 (1966), 71).
    """
    return 2.8e-4 * np.exp(-height_m / SCALE_HEIGHT_M)


def climbs_of(heights: int) -> tuple[FloatArray, FloatArray]:
    """Return the lowest heights (1, heights) and the start heights (climbs, heights), m, of the
    grid of paths.
    """
    lowest_m = np.linspace(0.0, TOP_M, heights)[None, :]
    return lowest_m, lowest_m + np.square(np.linspace(0.0, HIGHEST_ROOT, CLIMBS))[:, None]


def predicted_depth(depth: FloatArray, lowest_m: FloatArray, height_m: FloatArray) -> FloatArray:
    """Return predicted optical depths of paths, from those of paths that only rise, (slants,
    heights) up to the top.

    From its lowest height a ray rises to space like a horizontal path. The way down to there is
    that path less the part above the start of the ray, weighted as for strong lines.
    """
    return _predicted(depth, _places(lowest_m, height_m, *depth.shape))


def predicted_grid(depth: FloatArray) -> FloatArray:
    """Return the prediction (climbs, heights) for the paths of `climbs_of`."""
    return _predicted(depth, _grid_places(*depth.shape))


@cache
def _grid_places(slants: int, heights: int) -> _LimbPlaces:
    return _places(*climbs_of(heights), slants, heights)


def _places(lowest_m: FloatArray, height_m: FloatArray, slants: int, heights: int) -> _LimbPlaces:
    cosine = (RADIUS_M + lowest_m) / (RADIUS_M + height_m)
    sine = np.sqrt((1.0 - cosine) * (1.0 + cosine))
    slant = np.arcsinh(sine / BEND) * ((slants - 1) / HIGHEST_SLANT)
    level = np.minimum(height_m, TOP_M) * ((heights - 1) / TOP_M)
    row = np.minimum(slant.astype(np.int64), slants - 2)
    column = np.minimum(level.astype(np.int64), heights - 2)
    turn_m = bent_lowest_m(lowest_m, height_m)
    return _LimbPlaces(turn_m, row * heights + column, slant - row, level - column)


def _predicted(depth: FloatArray, places: _LimbPlaces) -> FloatArray:
    turn_m, corner, across, up = places
    flat = depth.ravel()
    heights = depth.shape[1]
    # Bilinear between four corners.
    low, high, steep_low, steep_high = (
        flat.take(corner + step) for step in (0, 1, heights, heights + 1)
    )
    lower = low + across * (steep_low - low)
    beyond = lower + up * (high + across * (steep_high - high) - lower)
    level = np.exp(np.interp(turn_m, np.linspace(0.0, TOP_M, heights), np.log(depth[0])))
    # For strong lines optical depth grows as the root of the amount of air (Goody and Yung,
    # Atmospheric Radiation, 2nd edition 1989, section 4.4): on the way back by this share.
    return level + (math.sqrt(2.0) - 1.0) * np.maximum(level - beyond, 0.0)
