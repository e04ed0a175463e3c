"""The background `earth`: radiance of the Earth by sun, sky and look angle, and its clutter.

Between the points of LOWTRAN7's table radiance is interpolated linearly in the sines of the
elevation of sensor and Sun at the ground; the solar part falls linearly to zero at sunset, and
below the lowest look of the table radiance is that of the lowest. Where the scene's atmosphere has
cloud it is the table's opaque cloud, for all climates. Beyond the limb is cold space. The rules of
interpolation are opir's. A sea, where one is set, adds sun glint to the clear sky.
"""

import csv
import math
from collections.abc import Iterator, Mapping, Sequence
from functools import cache
from pathlib import Path

import numpy as np
from attrs import evolve, frozen

from opir_core.arrays import FloatArray, IndexArray, IntArray
from opir_core.errors import ModelError
from opir_core.interfaces import Structure
from opir_core.plugin import Background, BackgroundContext, Band, Transmittance, Views
from opir_photons.radiometry.configs import EarthConfig, StructureConfig, StructuresConfig
from opir_photons.radiometry.lowtran import nearest_of, parts_of, require_known_bands
from opir_photons.radiometry.sea_surface import SeaGlint
from opir_photons.row_slices import as_slice_if_consecutive

_TABLE = Path(__file__).parents[1] / "data" / "lowtran7_background_radiance.csv"
_OPAQUE = "ANALYTIC_opaque_cloud_top"

#: Sine of the sensor's elevation at the ground for the table's look angles (incidence 78.8 and 61.6
#: degrees, nadir).
LOOK_SINES: Mapping[float, float] = {
    105.0: math.cos(math.radians(78.8)),
    120.0: math.cos(math.radians(61.6)),
    180.0: 1.0,
}

_Row = Mapping[str, str]


@frozen(eq=False)
class SkyTable:
    """Radiances of one band under one sky, W m⁻² sr⁻¹.

    `night` (looks,) is at `night_sine`; `day` (looks, suns) is the solar part, at `day_sine` and
    `sun_sine`, which begins with 0.
    """

    band: Band
    night_sine: FloatArray
    night: FloatArray
    day_sine: FloatArray
    sun_sine: FloatArray
    day: FloatArray


@frozen(eq=False)
class CloudTable:
    """Radiances of opaque cloud in one band by height of its top: (tops,) by night, (tops, suns)
    the solar part.
    """

    band: Band
    top_m: FloatArray
    sun_sine: FloatArray
    night: FloatArray
    day: FloatArray


@cache
def table_rows() -> tuple[_Row, ...]:
    """Return the rows of the table."""
    lines = _TABLE.read_text(encoding="utf-8").splitlines()
    return tuple(csv.DictReader(line for line in lines if not line.startswith("#")))


def sky_tables(climate: str, sky: str) -> list[SkyTable]:
    """Return the tables of a climate and sky, one per band."""
    rows = [row for row in table_rows() if row["atmosphere"] == climate and row["sky"] == sky]
    return [
        _sky_table(band, [row for row in rows if row["band"] == band.name]) for band in _bands(rows)
    ]


def cloud_tables(albedo: float) -> list[CloudTable]:
    """Return the tables of opaque cloud of an albedo, one per band: linear in the albedos 0.1 and
    0.3 of the table.
    """
    rows = [row for row in table_rows() if row["sky"].startswith(_OPAQUE)]
    return [
        _cloud_table(band, [row for row in rows if row["band"] == band.name], albedo)
        for band in _bands(rows)
    ]


def _bands(rows: list[_Row]) -> Iterator[Band]:
    yield from dict.fromkeys(
        Band(row["band"], float(row["lo_um"]), float(row["hi_um"])) for row in rows
    )


def _sky_table(band: Band, rows: list[_Row]) -> SkyTable:
    night = {float(row["look_deg"]): _radiance(row) for row in rows if row["day_night"] == "night"}
    by_sun = {
        (float(row["look_deg"]), _sun_sine(row)): _radiance(row)
        for row in rows
        if row["day_night"] == "day"
    }
    looks = sorted({look for look, _ in by_sun})
    suns = sorted({sun for _, sun in by_sun})
    # By night LOWTRAN's surface is black and by day it emits 0.9: in long waves day would be the
    # colder (-3.6 K).
    added = [[0.0, *(max(by_sun[look, sun] - night[look], 0.0) for sun in suns)] for look in looks]
    return SkyTable(
        band=band,
        night_sine=np.array([LOOK_SINES[look] for look in sorted(night)]),
        night=np.array([night[look] for look in sorted(night)]),
        day_sine=np.array([LOOK_SINES[look] for look in looks]),
        sun_sine=np.array([0.0, *suns]),
        day=np.array(added),
    )


def _cloud_table(band: Band, rows: list[_Row], albedo: float) -> CloudTable:
    share = (albedo - 0.1) / (0.3 - 0.1)
    by_albedo: dict[tuple[float, float], dict[float, float]] = {}
    for row in rows:
        sun = _sun_sine(row) if row["day_night"] == "day" else -1.0
        by_albedo.setdefault((_top_m(row), sun), {})[float(row["albedo"])] = _radiance(row)
    radiance = {
        place: pair[0.1] + share * (pair[0.3] - pair[0.1]) for place, pair in by_albedo.items()
    }
    tops = sorted({top for top, _ in radiance})
    suns = sorted({sun for _, sun in radiance if sun > 0.0})
    added = [[0.0, *(radiance[top, sun] - radiance[top, -1.0] for sun in suns)] for top in tops]
    night = np.array([radiance[top, -1.0] for top in tops])
    return CloudTable(band, np.array(tops), np.array([0.0, *suns]), night, np.array(added))


def _top_m(row: _Row) -> float:
    return float(row["sky"].removeprefix(_OPAQUE).removesuffix("km")) * 1e3


def _sun_sine(row: _Row) -> float:
    return math.cos(math.radians(float(row["sza_deg"])))


def _radiance(row: _Row) -> float:
    return float(row["L_W_m2_sr"])


@frozen(eq=False)
class EarthBackground(Background):
    """Radiance tables by band, each a list of tables with their factors.

    `residual` is the share of radiance that is clutter to sensors without a focal plane,
    `structure` that of others; `is_cloudy` says that skies without opaque cloud are cloudy, too;
    `sea` mirrors the Sun below a clear sky.
    """

    skies: tuple[tuple[tuple[float, SkyTable], ...], ...]
    clouds: tuple[tuple[tuple[float, CloudTable], ...], ...]
    residual: float
    atmosphere: Transmittance
    structure: StructuresConfig
    is_cloudy: bool
    sea: SeaGlint | None = None

    def radiance_w_m2_sr(self, band: int, view: Views) -> FloatArray:
        """Return in-band radiances (n,), W m⁻² sr⁻¹; 0 beyond the limb."""
        return self._radiances_w_m2_sr((band,), view)[0]

    def clutter_w_m2_sr(self, band: int, view: Views) -> FloatArray:
        """Return the standard deviations (n,) of the radiance left after subtraction: a fixed share
        of the radiance.
        """
        return self.residual * self.radiance_w_m2_sr(band, view)

    def radiances_and_clutter_w_m2_sr(
        self, bands: Sequence[int], view: Views
    ) -> tuple[FloatArray, FloatArray]:
        """Return both of several bands (bands, n), with one search in the tables."""
        radiance = self._radiances_w_m2_sr(bands, view)
        return radiance, self.residual * radiance

    @property
    def structures(self) -> tuple[Structure, ...]:
        """The structures of cloud, surface and limb."""
        parts = (self.structure.cloud, self._surface, self.structure.limb)
        return tuple(Structure(1e3 * part.scale_km, part.exponent) for part in parts)

    def structured_radiances_w_m2_sr(
        self, bands: Sequence[int], view: Views
    ) -> tuple[FloatArray, FloatArray, IndexArray]:
        """Return radiances and the standard deviations of their structure (bands, n), and its
        number (n,).

        Emission is what is left without the Sun; shares of it and of sunlight add as independent.
        Beyond the limb they are of the radiance at the horizon, and fall exponentially with the
        tangent height.
        """
        beyond = view.height_m > 0.0
        lower = np.where(beyond, np.exp(-1e-3 * view.height_m / self.structure.limb.height_km), 1.0)
        edge = evolve(view, height_m=np.where(beyond, 0.0, view.height_m))
        whole = self._radiances_w_m2_sr(bands, edge)
        is_lit = bool(np.any(view.sun_elevation_sine > 0.0))
        night = evolve(edge, sun_elevation_sine=-np.ones(len(view)))
        dark = self._radiances_w_m2_sr(bands, night) if is_lit else whole
        cloudy = self.is_cloudy | np.isfinite(self.atmosphere.cloud_top_m(view.point_ecef_m))
        number = np.where(beyond, 2, np.where(cloudy, 0, 1)).astype(np.int32)
        parts = (self.structure.cloud, self._surface, self.structure.limb)
        thermal, solar = (
            np.array(each)
            for each in zip(*((p.thermal_rms, p.solar_rms) for p in parts), strict=True)
        )
        rms = lower * np.hypot(thermal[number] * dark, solar[number] * (whole - dark))
        return np.where(beyond, 0.0, whole), rms, number

    @property
    def _surface(self) -> StructureConfig:
        return self.structure.sea if self.structure.surface == "sea" else self.structure.terrain

    def _radiances_w_m2_sr(self, bands: Sequence[int], view: Views) -> FloatArray:
        radiance = np.zeros((len(bands), len(view)))
        on_ground = view.height_m <= 0.0
        top_m = self.atmosphere.cloud_top_m(view.point_ecef_m)
        is_cloudy = np.isfinite(top_m)
        clear, cloudy = (
            as_slice_if_consecutive(np.flatnonzero(on_ground & sky))
            for sky in (~is_cloudy, is_cloudy)
        )
        if np.any(is_cloudy):
            high = _SkyPlaces(top_m[cloudy])
            sun = _SkyPlaces(view.sun_elevation_sine[cloudy])
            radiance[:, cloudy] = [_cloud_radiance(self.clouds[band], high, sun) for band in bands]
        low = _SkyPlaces(view.elevation_sine[clear])
        sun = _SkyPlaces(view.sun_elevation_sine[clear])
        radiance[:, clear] = [_sky_radiance(self.skies[band], low, sun) for band in bands]
        if self.sea is not None:
            radiance[:, clear] += self.sea.radiances_w_m2_sr(bands, view.take(clear))
        return radiance


class _SkyPlaces:
    """The places of values (n,) between the points of tables, computed once for equal points."""

    def __init__(self, at: FloatArray) -> None:
        self.at = at
        self._cached: dict[bytes, tuple[IntArray, FloatArray]] = {}

    def among(self, points: FloatArray) -> tuple[IntArray, FloatArray]:
        """Return the point before each value, and the fraction to the next: 0 or 1 beyond the
        ends.
        """
        key = points.tobytes()
        if key not in self._cached:
            row = np.clip(np.searchsorted(points, self.at, side="right") - 1, 0, len(points) - 2)
            share = (self.at - points.take(row)) / np.diff(points).take(row)
            self._cached[key] = row, np.clip(share, 0.0, 1.0)
        return self._cached[key]


def earth_background(config: EarthConfig, context: BackgroundContext) -> Background:
    """Return the background of a climate and sky; `ModelError` for a band that the table does not
    have.
    """
    require_known_bands(config.bands, context.bands, context.path)
    skies = sky_tables(config.climate, config.sky)
    clouds = cloud_tables(config.cloud_albedo)
    parts = [
        _parts(band, config.bands, [table.band for table in skies], context.path)
        for band in context.bands
    ]
    atmosphere = context.make_atmosphere()
    wind_m_s = config.sea_wind_m_s
    sea = (
        None
        if wind_m_s is None
        else SeaGlint.of(context.bands, wind_m_s, atmosphere, context.epoch_us)
    )
    return EarthBackground(
        skies=tuple(tuple((factor, skies[number]) for factor, number in own) for own in parts),
        clouds=tuple(
            tuple((factor, _of_band(clouds, skies[number].band)) for factor, number in own)
            for own in parts
        ),
        residual=config.clutter_residual,
        atmosphere=atmosphere,
        structure=config.structure,
        is_cloudy=config.sky != "clear",
        sea=sea,
    )


def _of_band(tables: Sequence[CloudTable], band: Band) -> CloudTable:
    return next(table for table in tables if table.band == band)


def _parts(
    band: Band, stand_ins: Mapping[str, str], known: Sequence[Band], path: str
) -> list[tuple[float, int]]:
    """Return the bands of the table that compose a band, with their factors; a stand-in is scaled
    by width.
    """
    chosen = parts_of(band, stand_ins, known)
    if not chosen:
        names = ", ".join(f"{one.name} {one.lower_um:g}-{one.upper_um:g}" for one in known)
        raise ModelError(
            f"{path}: the band {band.name}, {band.lower_um:g} to {band.upper_um:g} um, is not one"
            f" of the table's"
            f" ({names}), nor made of them side by side; say in {path}.bands which of them stands"
            f" for it,"
            f" as in bands: {{{band.name}: {nearest_of(band, known).name}}}"
        )
    width = sum(one.upper_um - one.lower_um for one in chosen)
    factor = (band.upper_um - band.lower_um) / width if band.name in stand_ins else 1.0
    return [(factor, known.index(one)) for one in chosen]


def _sky_radiance(
    parts: Sequence[tuple[float, SkyTable]], look: _SkyPlaces, sun: _SkyPlaces
) -> FloatArray:
    total = np.zeros(len(look.at))
    for factor, table in parts:
        night = _along(table.night, *look.among(table.night_sine))
        added = _between(table.day, look.among(table.day_sine), sun.among(table.sun_sine))
        total += factor * (night + added)
    return np.maximum(total, 0.0)


def _cloud_radiance(
    parts: Sequence[tuple[float, CloudTable]], top: _SkyPlaces, sun: _SkyPlaces
) -> FloatArray:
    total = np.zeros(len(top.at))
    for factor, table in parts:
        night = _along(table.night, *top.among(table.top_m))
        added = _between(table.day, top.among(table.top_m), sun.among(table.sun_sine))
        total += factor * (night + added)
    return np.maximum(total, 0.0)


def _between(
    table: FloatArray, of_row: tuple[IntArray, FloatArray], of_column: tuple[IntArray, FloatArray]
) -> FloatArray:
    """Return a table (x, y), linear between its points and constant beyond."""
    (row, across), (column, up) = of_row, of_column
    flat = table.ravel()
    at = row * table.shape[1] + column
    lower = _along(flat, at, up)
    upper = _along(flat, at + table.shape[1], up)
    return lower * (1.0 - across) + upper * across


def _along(values: FloatArray, at: IntArray, share: FloatArray) -> FloatArray:
    return values.take(at) * (1.0 - share) + values.take(at + 1) * share
