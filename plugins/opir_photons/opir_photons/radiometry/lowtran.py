"""The atmosphere `lowtran`: band transmittances of LOWTRAN7 for six climates, with clouds if a
scene has them.

Between the table's heights and zenith angles τ is interpolated in the fourth root of optical depth,
-ln τ: by Akima splines in height, then in the logarithm of an air mass, from the zenith to the
horizon. Paths to a sensor below the target's horizon first descend; they have a table of their own
(`long_paths`). Above 100 km τ is 1.
"""

import math
from collections.abc import Mapping, Sequence
from functools import cache

import numpy as np
from attrs import evolve, field, frozen
from numpy.typing import ArrayLike

from opir_core.arrays import FloatArray, IntArray
from opir_core.errors import ModelError
from opir_core.plugin import AtmosphereContext, Band, Paths, Transmittance
from opir_photons.columns import as_slice_if_consecutive, floats
from opir_photons.radiometry.clouds import CloudField, Deck, FullDeck, is_hidden
from opir_photons.radiometry.configs import CloudConfig, LowtranConfig
from opir_photons.radiometry.long_paths import (
    BEND,
    CLIMBS,
    HIGHEST_ROOT,
    HIGHEST_SLANT,
    RADIUS_M,
    SCALE_HEIGHT_M,
    TOP_M,
    LimbTable,
    akima,
    limb_tables,
    sky_columns,
)
from opir_photons.radiometry.planck import band_radiance

#: The grid: numbers of sines of elevation, from the horizon to the zenith, and of heights from 0 to
#: the top.
GRID_SHAPE = (125, 401)

#: A weighting's column in the table, and the ending of its columns in that of long paths.
_WEIGHTINGS = {"flat": ("tau_flat", ""), "blackbody-1500K": ("tau_bb1500", "_bb1500")}


@frozen(eq=False)
class NodeTable:
    """Transmittances (heights, zenith angles) of one band at the points of the table, and those of
    long paths.
    """

    band: Band
    height_m: FloatArray
    zenith_rad: FloatArray
    transmittance: FloatArray
    limb: LimbTable


@cache
def node_tables(climate: str, aerosol: str, weighting: str) -> Mapping[str, NodeTable]:
    """Return the tables of a climate by the name of the band; empty for an unknown climate and
    aerosol.
    """
    column, suffix = _WEIGHTINGS[weighting]
    cells = sky_columns("lowtran7_band_transmittance.csv", climate, aerosol)
    if not cells:
        return {}
    height_km = floats(cells["h_km"])
    zenith_deg = floats(cells["zen_deg"])
    edges_um = zip(floats(cells["lo_um"]), floats(cells["hi_um"]), strict=True)
    bands = dict(zip(cells["band"], edges_um, strict=True))
    numbers = {name: number for number, name in enumerate(bands)}
    order = np.lexsort((zenith_deg, height_km, floats([numbers[name] for name in cells["band"]])))
    heights_m = np.unique(height_km) * 1e3
    zeniths_rad = np.radians(np.unique(zenith_deg))
    by_band = floats(cells[column])[order].reshape(len(bands), len(heights_m), -1)
    limbs = limb_tables(climate, aerosol, suffix)
    return {
        name: NodeTable(
            Band(name, *map(float, ends_um)), heights_m, zeniths_rad, transmittance, limbs[name]
        )
        for (name, ends_um), transmittance in zip(bands.items(), by_band, strict=True)
    }


@frozen(eq=False)
class BandGrid:
    """Transmittances of one band: (slants, heights) from the horizon up, (climbs, lowest heights)
    below it.
    """

    above: FloatArray
    below: FloatArray


@np.errstate(under="ignore")
def fine_grid(nodes: NodeTable, shape: tuple[int, int] = GRID_SHAPE) -> BandGrid:
    """Return transmittances of a band over the grid, non-decreasing with height and elevation."""
    heights_m = np.linspace(0.0, TOP_M, shape[1])
    sines = np.sinh(np.linspace(0.0, HIGHEST_SLANT, shape[0])) * BEND
    roots = akima(nodes.height_m, _roots(nodes.transmittance), heights_m)
    masses = np.log(shell_air_mass(np.cos(nodes.zenith_rad)))
    depth = akima(masses, roots.T, np.log(shell_air_mass(sines))) ** 4
    risen = np.maximum.accumulate(_transmittance(depth, heights_m), axis=0)
    return BandGrid(risen, _transmittance(nodes.limb.depths(depth), heights_m))


def _transmittance(depth: FloatArray, height_m: FloatArray) -> FloatArray:
    """Return transmittances (k, heights) of depths, non-decreasing with height."""
    risen = np.maximum.accumulate(np.where(height_m >= TOP_M, 1.0, np.exp(-depth)), axis=1)
    return np.clip(risen, 0.0, 1.0)


def shell_air_mass(sine: FloatArray | float) -> FloatArray:
    """Return the air mass of straight paths through a uniform shell, as thick as the scale height,
    for sines 0 to 1.

    The secant of small zenith angles, 40 at the horizon.
    """
    ratio = RADIUS_M / SCALE_HEIGHT_M
    across = ratio * floats(sine)
    return (2.0 * ratio + 1.0) / (np.sqrt(across * across + (2.0 * ratio + 1.0)) + across)


def _roots(transmittance: FloatArray) -> FloatArray:
    """Return fourth roots of optical depth, within bounds: τ from 1e-26 to almost 1."""
    return np.clip(-np.log(np.maximum(transmittance, math.exp(-60.0))), 1e-12, 60.0) ** 0.25


@frozen(eq=False)
class LowtranAtmosphere(Transmittance):
    """Transmittances of each band on the grids of `lowtran_table`, and clouds."""

    grids: tuple[BandGrid, ...]
    deck: Deck | None
    _extended: tuple[BandGrid, ...] = field(init=False)

    @_extended.default
    def _extended_grids(self) -> tuple[BandGrid, ...]:
        return tuple(BandGrid(_extended(grid.above), _extended(grid.below)) for grid in self.grids)

    def transmittance(self, band: int, path: Paths) -> FloatArray:
        """Return in-band transmittances (n,): cubic in height, linear in asinh(sine / 0.05).

        Below the horizon they are cubic in the lowest height, linear in the root of the climb from
        there.
        """
        return self.transmittances((band,), path)[0]

    def transmittances(self, bands: Sequence[int], path: Paths) -> FloatArray:
        """Return those of several bands (bands, n), with one search in the grid."""
        result = np.ones((len(bands), len(path)))
        low = np.flatnonzero(lowest_m(path.height_m, path.elevation_sine) < TOP_M)
        if not len(low):
            return result
        result[:, as_slice_if_consecutive(low)] = self._looked_up(
            bands, path.height_m[low], path.elevation_sine[low]
        )
        if self.deck is not None:
            result[:, low[is_hidden(self.deck, path.take(low))]] = 0.0
        return result

    @property
    def uses_seed(self) -> bool:
        """Whether there are clouds, whose places are random."""
        return self.deck is not None

    @property
    def clear(self) -> Transmittance:
        """The same air without clouds."""
        return evolve(self, deck=None)

    @property
    def altitude_breakpoints_m(self) -> FloatArray:
        """The top of the air, and that of the deck of cloud."""
        return np.array([TOP_M] if self.deck is None else [TOP_M, self.deck.top_m])

    def cloud_top_m(self, point_ecef_m: FloatArray) -> FloatArray:
        """Return the heights (n,) of cloud tops over points (n, 3), m; -inf where there is no
        cloud.
        """
        if self.deck is None:
            return np.full(len(point_ecef_m), -np.inf)
        return np.where(self.deck.is_cloudy(point_ecef_m), self.deck.top_m, -np.inf)

    def _looked_up(
        self, bands: Sequence[int], height_m: FloatArray, elevation_sine: FloatArray
    ) -> FloatArray:
        grids = [self._extended[band] for band in bands]
        scale = (len(grids[0].above) - 1) / HIGHEST_SLANT
        across = np.arcsinh(np.maximum(elevation_sine, 0.0) / BEND) * scale
        result = _within([grid.above for grid in grids], height_m, across)
        falling = np.flatnonzero(elevation_sine < 0.0)
        if len(falling):
            below = [grid.below for grid in grids]
            result[:, falling] = _below(below, height_m[falling], elevation_sine[falling])
        return result


def lowest_m(height_m: FloatArray, elevation_sine: FloatArray) -> FloatArray:
    """Return the lowest heights (n,) of straight paths from heights (n,), m: their own at and above
    the horizon.
    """
    falling = np.minimum(elevation_sine, 0.0)
    cosine = np.sqrt((1.0 - falling) * (1.0 + falling))
    # 1 - cosine without cancellation.
    return height_m - (RADIUS_M + height_m) * (falling * falling / (1.0 + cosine))


def _below(
    grids: Sequence[FloatArray], height_m: FloatArray, elevation_sine: FloatArray
) -> FloatArray:
    """Return transmittances (bands, n) of paths that first descend; 0 through the Earth.

    Paths from above the air enter it at its top.
    """
    lowest = lowest_m(height_m, elevation_sine)
    drop_m = np.minimum(height_m, TOP_M) - lowest
    climb = np.sqrt(drop_m) * ((CLIMBS - 1) / HIGHEST_ROOT)
    return np.where(lowest < 0.0, 0.0, _within(grids, lowest, climb))


def _within(grids: Sequence[FloatArray], height_m: FloatArray, across: FloatArray) -> FloatArray:
    """Return values (bands, n) of extended grids: cubic along heights from 0 to the top, linear
    across.
    """
    rows = grids[0].shape[0]
    heights = grids[0].shape[1] - 2
    across = np.clip(across, 0.0, rows - 1.0)
    up = np.clip(height_m * ((heights - 1) / TOP_M), 0.0, heights - 1.0)
    row = np.minimum(across.astype(np.int64), rows - 2)
    column = np.minimum(up.astype(np.int64), heights - 2)
    across -= row
    up -= column
    # Extended grids have two more columns.
    at = row * (heights + 2) + column
    result = np.empty((len(grids), len(at)))
    for value, grid in zip(result, grids, strict=True):
        _mixed(grid, at, across, up, value)
    return np.clip(result, 0.0, 1.0, out=result)


def _extended(grid: FloatArray) -> FloatArray:
    """Return a grid with one more column at both ends, extrapolated linearly."""
    lower = 2.0 * grid[:, :1] - grid[:, 1:2]
    upper = 2.0 * grid[:, -1:] - grid[:, -2:-1]
    return np.concatenate([lower, grid, upper], axis=1)


def _mixed(
    grid: FloatArray, at: IntArray, across: FloatArray, up: FloatArray, into: FloatArray
) -> None:
    """Write values of an extended grid: linear between rows, cubic between columns.

    The cubics have the slopes of neighbouring chords (Catmull and Rom, 1974), so that the
    interpolation has no kinks.
    """
    flat = grid.ravel()
    width = grid.shape[1]
    taps = []
    for place in range(4):
        lower = flat.take(at + place)
        upper = flat.take(at + (width + place))
        upper -= lower
        upper *= across
        upper += lower
        taps.append(upper)
    # The taps at -1, 0, 1 and 2 of the fraction.
    outer_low, low, high, outer_high = taps
    rise = 0.5 * (high - outer_low)
    bend = 0.5 * (outer_high - low)
    cubic = 2.0 * (low - high) + rise + bend
    into[:] = low + up * (rise + up * (high - low - rise - cubic + up * cubic))


def lowtran_atmosphere(config: LowtranConfig, context: AtmosphereContext) -> Transmittance:
    """Return the atmosphere of a climate; `ModelError` for a band of the scene that the table does
    not have.
    """
    require_known_bands(config.bands, context.bands, context.path)
    grids = tuple(_grid(band, config, context.path) for band in context.bands)
    deck = None if config.cloud is None else _deck(config.cloud, context.seed)
    return LowtranAtmosphere(grids, deck)


def band_transmittance(
    lower_um: float,
    upper_um: float,
    height_m: ArrayLike,
    elevation_rad: ArrayLike,
    *,
    climate: str = "us1976",
    aerosol: str = "rural23km",
    weighting: str = "flat",
) -> FloatArray:
    """Return in-band transmittances, in [0, 1], of cloudless paths from targets to space, by
    LOWTRAN7.

    `lower_um` to `upper_um` are the edges of the band, µm: one of LOWTRAN's table or adjacent ones
    of it. `height_m` is the target's height above the WGS 84 ellipsoid, m (at 100 km and above the
    result is 1), `elevation_rad` the elevation of the sensor above the target's horizon, rad, in
    [-pi/2, pi/2]: below 0 the path first descends, and the result is 0 through the Earth. The two
    broadcast; the result has their common shape. `climate`, `aerosol` and `weighting` are those of
    the component `lowtran`. `ValueError` for a band or a climate that the table does not have.

    Source: LOWTRAN7 (Kneizys et al., AFGL-TR-88-0177, 1988), tabulated and interpolated as by the
    component `lowtran`.
    """
    height, sine = np.broadcast_arrays(floats(height_m), np.sin(elevation_rad))
    grid = _cached_grid(lower_um, upper_um, climate, aerosol, weighting)
    nowhere = np.empty((height.size, 3))
    path = Paths(height.ravel(), sine.ravel(), nowhere, nowhere, np.empty(height.size))
    return LowtranAtmosphere((grid,), None).transmittance(0, path).reshape(height.shape)


@cache
def _cached_grid(
    lower_um: float, upper_um: float, climate: str, aerosol: str, weighting: str
) -> BandGrid:
    config = LowtranConfig(climate=climate, aerosol=aerosol, weighting=weighting)
    try:
        return _grid(Band("band", lower_um, upper_um), config, "band_transmittance")
    except ModelError:
        edges = ", ".join(
            f"{table.band.lower_um:g}-{table.band.upper_um:g}"
            for table in node_tables(climate, aerosol, weighting).values()
        )
        raise ValueError(
            f"{lower_um:g} to {upper_um:g} um is no band of LOWTRAN's table, nor composed of"
            f" adjacent ones: {edges}"
        ) from None


def _deck(config: CloudConfig, seed: int) -> Deck:
    if config.cover >= 1.0:
        return FullDeck(config.top_km * 1e3)
    return CloudField.drawn(config.top_km * 1e3, config.cover, config.cell_km * 1e3, seed)


def _grid(band: Band, config: LowtranConfig, path: str) -> BandGrid:
    nodes = node_tables(config.climate, config.aerosol, config.weighting)
    bands = [table.band for table in nodes.values()]
    parts = composition_of(band, config.bands, bands, path, "LOWTRAN's table")
    shares = _shares(parts, config.weighting)
    grids = [fine_grid(nodes[part.name]) for part in parts]
    above = np.array([grid.above for grid in grids])
    below = np.array([grid.below for grid in grids])
    return BandGrid((shares * above).sum(axis=0), (shares * below).sum(axis=0))


def require_known_bands(stand_ins: Mapping[str, str], bands: Sequence[Band], path: str) -> None:
    """Raise `ModelError` for a stand-in for a band that no sensor has."""
    names = sorted({band.name for band in bands})
    for name, standing in stand_ins.items():
        if name not in names:
            raise ModelError(
                f"{path}.bands: no sensor of the scene has a band {name}, for which {standing} is"
                f" to stand; they have {', '.join(names)}"
            )


def composition_of(
    band: Band, stand_ins: Mapping[str, str], bands: Sequence[Band], path: str, table: str
) -> list[Band]:
    """Return the bands of a table that compose a band: the stand-in of the scene, or adjacent ones;
    `ModelError` if there are none, with the name of the `table`.
    """
    if band.name in stand_ins:
        parts = [candidate for candidate in bands if candidate.name == stand_ins[band.name]]
    else:
        parts = _adjacent(band, bands)
    if parts:
        return parts
    names = ", ".join(f"{other.name} {other.lower_um:g}-{other.upper_um:g}" for other in bands)
    middle_um = band.lower_um + band.upper_um
    nearest = min(bands, key=lambda other: abs(other.lower_um + other.upper_um - middle_um))
    raise ModelError(
        f"{path}: the band {band.name}, {band.lower_um:g} to {band.upper_um:g} um, is not one of"
        f" {table} ({names}), nor made of them side by side; say in {path}.bands which of them"
        f" stands for it, as in bands: {{{band.name}: {nearest.name}}}"
    )


def _adjacent(band: Band, bands: Sequence[Band]) -> list[Band]:
    """Return the adjacent bands, widest first, between the edges of a band; none if they do not
    cover it.
    """
    # Edges agree to this, µm.
    same_um = 1e-6
    parts: list[Band] = []
    edge = band.lower_um
    while edge < band.upper_um - same_um:
        fitting = [
            part
            for part in bands
            if abs(part.lower_um - edge) <= same_um and part.upper_um <= band.upper_um + same_um
        ]
        if not fitting:
            return []
        parts.append(max(fitting, key=lambda part: part.upper_um))
        edge = parts[-1].upper_um
    return parts


def _shares(bands: Sequence[Band], weighting: str) -> FloatArray:
    """Return the shares (n, 1, 1) of bands in the band that they compose: by width, or by the
    radiance of a black body of 1500 K.
    """
    if weighting == "flat":
        weights = np.array([band.upper_um - band.lower_um for band in bands])
    else:
        weights = np.array(
            [float(band_radiance(1500.0, band.lower_um, band.upper_um)) for band in bands]
        )
    return (weights / weights.sum())[:, None, None]
