"""The background `earth`: radiance of the Earth by sun, sky and look angle, and its clutter.

Between the points of LOWTRAN7's table radiance is interpolated linearly in the sines of the
elevation of sensor and Sun at the ground; the solar part falls linearly to zero at sunset, and
below the lowest look of the table radiance is that of the lowest. Where the scene's atmosphere has
cloud it is the table's opaque cloud, for all climates. Beyond the limb the air radiates, by a table
of the height of the tangent in which the logarithm of radiance is linear; above 100 km is cold
space. The rules of interpolation are opir's. A sea, where one is set, adds sun glint to the clear
sky.
"""

import csv
import math
from collections.abc import Iterable, Mapping, Sequence
from functools import cache
from typing import TypeVar

import numpy as np
from attrs import evolve, frozen

from opir_core.arrays import FloatArray, IndexArray, IntArray
from opir_core.interfaces import Structure
from opir_core.plugin import Background, BackgroundContext, Band, Transmittance, Views
from opir_photons.columns import as_slice_if_consecutive
from opir_photons.laws import DATA
from opir_photons.radiometry.configs import EarthConfig, StructureConfig, StructuresConfig
from opir_photons.radiometry.long_paths import TOP_M
from opir_photons.radiometry.lowtran import composition_of, require_known_bands
from opir_photons.radiometry.sea_surface import SeaGlint

_OPAQUE = "ANALYTIC_opaque_cloud_top"

#: Sine of the sensor's elevation at the ground for the table's look angles (incidence 78.8 and 61.6
#: degrees, nadir).
LOOK_SINES: Mapping[float, float] = {
    105.0: math.cos(math.radians(78.8)),
    120.0: math.cos(math.radians(61.6)),
    180.0: 1.0,
}

#: The sine of the Sun's elevation in rows of the night.
_NIGHT = -1.0

_Row = Mapping[str, str]
#: Radiances by place and sine of the Sun's elevation.
_Radiances = Mapping[tuple[float, float], float]


@frozen(eq=False)
class RadianceTable:
    """Radiances of one band, W m⁻² sr⁻¹, by place: the sine of the sensor's elevation of a sky, or
    the height of the top of opaque cloud, m.

    `night` (places,) is at `night_at`; `day` (places, suns) is the solar part, at `day_at` and
    `sun_sine`, which begins with 0.
    """

    band: Band
    night_at: FloatArray
    night: FloatArray
    day_at: FloatArray
    sun_sine: FloatArray
    day: FloatArray

    @classmethod
    def of(cls, band: Band, radiances: _Radiances) -> "RadianceTable":
        """Return the table of radiances by place and Sun."""
        nights = sorted({place for place, sun in radiances if sun == _NIGHT})
        days = sorted({place for place, sun in radiances if sun != _NIGHT})
        suns = sorted({sun for _, sun in radiances} - {_NIGHT})
        # By night LOWTRAN's surface is black and by day it emits 0.9: in long waves day would be
        # the colder (-3.6 K).
        solar = [
            [0.0, *(max(radiances[day, sun] - radiances[day, _NIGHT], 0.0) for sun in suns)]
            for day in days
        ]
        return cls(
            band=band,
            night_at=np.array(nights),
            night=np.array([radiances[place, _NIGHT] for place in nights]),
            day_at=np.array(days),
            sun_sine=np.array([0.0, *suns]),
            day=np.array(solar),
        )


@frozen(eq=False)
class LimbRadiance:
    """Logarithms of radiances of one band beyond the limb, by rising tangent heights (k,), m."""

    band: Band
    tangent_m: FloatArray
    log_radiance: FloatArray

    def at(self, height_m: FloatArray) -> FloatArray:
        """Return radiances (n,), W m⁻² sr⁻¹, at tangent heights (n,), m; 0 from 100 km on."""
        radiance = np.exp(np.interp(height_m, self.tangent_m, self.log_radiance))
        return np.where(height_m < TOP_M, radiance, 0.0)


_Table = TypeVar("_Table", RadianceTable, LimbRadiance)

#: Tables with their factors.
_Parts = Sequence[tuple[float, RadianceTable]]
_LimbParts = Sequence[tuple[float, LimbRadiance]]


@cache
def table_rows(name: str = "lowtran7_background_radiance.csv") -> tuple[_Row, ...]:
    """Return the rows of a table, by default that of the Earth's radiance."""
    lines = (DATA / name).read_text(encoding="utf-8").splitlines()
    return tuple(csv.DictReader(line for line in lines if not line.startswith("#")))


def limb_tables(climate: str) -> list[LimbRadiance]:
    """Return the tables of radiance beyond the limb in a climate, one per band."""
    rows = [row for row in table_rows("lowtran7_limb_radiance.csv") if row["atmosphere"] == climate]
    return [
        LimbRadiance(
            band,
            np.array([1e3 * float(row["tangent_km"]) for row in own]),
            np.log([_radiance(row) for row in own]),
        )
        for band, own in _by_band(rows).items()
    ]


def sky_tables(climate: str, sky: str) -> list[RadianceTable]:
    """Return the tables of a climate and sky, one per band."""
    rows = [row for row in table_rows() if row["atmosphere"] == climate and row["sky"] == sky]
    return [
        RadianceTable.of(
            band,
            {(LOOK_SINES[float(row["look_deg"])], _sun_sine(row)): _radiance(row) for row in own},
        )
        for band, own in _by_band(rows).items()
    ]


def cloud_tables(albedo: float) -> list[RadianceTable]:
    """Return the tables of opaque cloud of an albedo, one per band: linear in the albedos 0.1 and
    0.3 of the table.
    """
    share = (albedo - 0.1) / (0.3 - 0.1)
    tables = []
    for band, rows in _by_band(row for row in table_rows() if _OPAQUE in row["sky"]).items():
        dark, bright = (
            {
                (_top_m(row), _sun_sine(row)): _radiance(row)
                for row in rows
                if float(row["albedo"]) == level
            }
            for level in (0.1, 0.3)
        )
        radiances = {place: low + share * (bright[place] - low) for place, low in dark.items()}
        tables.append(RadianceTable.of(band, radiances))
    return tables


def _by_band(rows: Iterable[_Row]) -> dict[Band, list[_Row]]:
    by_band: dict[Band, list[_Row]] = {}
    for row in rows:
        band = Band(row["band"], float(row["lo_um"]), float(row["hi_um"]))
        by_band.setdefault(band, []).append(row)
    return by_band


def _top_m(row: _Row) -> float:
    return float(row["sky"].removeprefix(_OPAQUE).removesuffix("km")) * 1e3


def _sun_sine(row: _Row) -> float:
    return math.cos(math.radians(float(row["sza_deg"]))) if row["day_night"] == "day" else _NIGHT


def _radiance(row: _Row) -> float:
    return float(row["L_W_m2_sr"])


@frozen(eq=False)
class EarthBackground(Background):
    """Radiance tables by band: those that compose it, with their factors.

    `residual` is the share of radiance that is clutter to sensors without a focal plane,
    `structure` that of others; `is_cloudy` says that skies without opaque cloud are cloudy, too;
    `sea` mirrors the Sun below a clear sky.
    """

    skies: Sequence[_Parts]
    clouds: Sequence[_Parts]
    limbs: Sequence[_LimbParts]
    residual: float
    atmosphere: Transmittance
    structure: StructuresConfig
    is_cloudy: bool
    sea: SeaGlint | None = None

    def radiance_w_m2_sr(self, band: int, view: Views) -> FloatArray:
        """Return in-band radiances (n,), W m⁻² sr⁻¹; beyond the limb those of the air."""
        return self._radiances_w_m2_sr((band,), view)[0]

    def clutter_w_m2_sr(self, band: int, view: Views) -> FloatArray:
        """Return the standard deviations (n,) of the residual of subtraction: a fixed share of the
        radiance.
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
        return tuple(Structure(1e3 * kind.scale_km, kind.exponent) for kind in self._kinds)

    def structured_radiances_w_m2_sr(
        self, bands: Sequence[int], view: Views
    ) -> tuple[FloatArray, FloatArray, IndexArray]:
        """Return radiances and the standard deviations of their structure (bands, n), and its
        number (n,).

        Emission is the radiance by night; shares of it and of sunlight add as independent.
        Beyond the limb they are of the radiance at the horizon, and fall exponentially with the
        tangent height.
        """
        beyond = view.height_m > 0.0
        fall = np.where(beyond, np.exp(-1e-3 * view.height_m / self.structure.limb.height_km), 1.0)
        edge = evolve(view, height_m=np.where(beyond, 0.0, view.height_m))
        radiance = self._radiances_w_m2_sr(bands, edge)
        emission = radiance
        if np.any(view.sun_elevation_sine > 0.0):
            night = evolve(edge, sun_elevation_sine=-np.ones(len(view)))
            emission = self._radiances_w_m2_sr(bands, night)
        cloudy = self.is_cloudy | np.isfinite(self.atmosphere.cloud_top_m(view.point_ecef_m))
        number = np.where(beyond, 2, np.where(cloudy, 0, 1)).astype(np.int32)
        thermal = np.array([kind.thermal_rms for kind in self._kinds])[number]
        solar = np.array([kind.solar_rms for kind in self._kinds])[number]
        rms = fall * np.hypot(thermal * emission, solar * (radiance - emission))
        rows = np.flatnonzero(beyond)
        radiance[:, rows] = self._limb_w_m2_sr(bands, view.take(rows))
        return radiance, rms, number

    def _limb_w_m2_sr(self, bands: Sequence[int], view: Views) -> FloatArray:
        """Return the radiances (bands, n) of the air beyond the limb."""
        radiance = np.zeros((len(bands), len(view)))
        for column, band in zip(radiance, bands, strict=True):
            for factor, table in self.limbs[band]:
                column += factor * table.at(view.height_m)
        return radiance

    @property
    def _kinds(self) -> tuple[StructureConfig, ...]:
        structure = self.structure
        surface = structure.sea if structure.surface == "sea" else structure.terrain
        return structure.cloud, surface, structure.limb

    def _radiances_w_m2_sr(self, bands: Sequence[int], view: Views) -> FloatArray:
        radiance = np.zeros((len(bands), len(view)))
        on_ground = view.height_m <= 0.0
        top_m = self.atmosphere.cloud_top_m(view.point_ecef_m)
        is_cloudy = np.isfinite(top_m)
        for is_sky, points, tables in (
            (on_ground & ~is_cloudy, view.elevation_sine, self.skies),
            (on_ground & is_cloudy, top_m, self.clouds),
        ):
            if np.any(is_sky):
                rows = as_slice_if_consecutive(np.flatnonzero(is_sky))
                place = _SkyPlaces(points[rows])
                sun = _SkyPlaces(view.sun_elevation_sine[rows])
                radiance[:, rows] = [_interpolated(tables[band], place, sun) for band in bands]
        beyond = as_slice_if_consecutive(np.flatnonzero(~on_ground))
        radiance[:, beyond] = self._limb_w_m2_sr(bands, view.take(beyond))
        if self.sea is not None:
            clear = as_slice_if_consecutive(np.flatnonzero(on_ground & ~is_cloudy))
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
    known = [table.band for table in skies]
    parts = [_factors(band, config.bands, known, context.path) for band in context.bands]
    atmosphere = context.make_atmosphere()
    wind_m_s = config.sea_wind_m_s
    return EarthBackground(
        skies=_composed(parts, skies),
        clouds=_composed(parts, clouds),
        limbs=_composed(parts, limb_tables(config.climate)),
        residual=config.clutter_residual,
        atmosphere=atmosphere,
        structure=config.structure,
        is_cloudy=config.sky != "clear",
        sea=None
        if wind_m_s is None
        else SeaGlint.of(context.bands, wind_m_s, atmosphere, context.epoch_us),
    )


def _composed(
    parts: Sequence[Mapping[Band, float]], tables: Sequence[_Table]
) -> Sequence[Sequence[tuple[float, _Table]]]:
    """Return the tables that compose each band, with their factors."""
    by_band = {table.band: table for table in tables}
    return [[(factor, by_band[band]) for band, factor in factors.items()] for factors in parts]


def _factors(
    band: Band, stand_ins: Mapping[str, str], known: Sequence[Band], path: str
) -> Mapping[Band, float]:
    """Return the bands of the table that compose a band, with their factors; a stand-in is scaled
    by width.
    """
    parts = composition_of(band, stand_ins, known, path, "the table's")
    width = sum(part.upper_um - part.lower_um for part in parts)
    factor = (band.upper_um - band.lower_um) / width if band.name in stand_ins else 1.0
    return dict.fromkeys(parts, factor)


def _interpolated(parts: _Parts, place: _SkyPlaces, sun: _SkyPlaces) -> FloatArray:
    total = np.zeros(len(place.at))
    for factor, table in parts:
        night = _along(table.night, *place.among(table.night_at))
        solar = _between(table.day, place.among(table.day_at), sun.among(table.sun_sine))
        total += factor * (night + solar)
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
