"""The background `earth`: the radiance under a line of sight, by sun, sky and look angle, and the clutter it leaves.

Between the table's points radiance is interpolated straight in the sines of the sensor's and the Sun's elevation at the
ground; what the Sun adds falls straight to nothing as it sets, and below the table's lowest look it is that of the
lowest. Where the scene's atmosphere has cloud it is the table's opaque cloud, whatever the climate. Beyond the limb
there is cold space. Sources: LOWTRAN7's table; the rules between its points are opir's.
"""

from collections.abc import Mapping, Sequence

import numpy as np
from attrs import frozen

from opir_core.errors import ModelError
from opir_core.protocols import Band
from opir_core.radiometry.earth_table import CloudTable, SkyTable, cloud_tables, sky_tables
from opir_core.radiometry.lowtran import parts_of
from opir_core.radiometry.protocols import Background, BackgroundContext, Transmittance
from opir_core.radiometry.records import Views, in_a_row
from opir_core.radiometry.sky_configs import EarthConfig
from opir_core.records import FloatArray, IntArray


@frozen(eq=False)
class EarthBackground:
    """Radiance tables by band: each a list of parts with the factor that they count with."""

    skies: tuple[tuple[tuple[float, SkyTable], ...], ...]
    clouds: tuple[tuple[tuple[float, CloudTable], ...], ...]
    residual: float
    atmosphere: Transmittance

    def radiance_w_m2_sr(self, band: int, view: Views) -> FloatArray:
        """Return in-band radiances (n,), W m⁻² sr⁻¹; 0 beyond the limb."""
        radiance = np.zeros(len(view))
        on_ground = view.height_m <= 0.0
        top_m = self.atmosphere.cloud_top_m(view.point_ecef_m)
        is_cloudy = np.isfinite(top_m)
        clear, cloudy = (in_a_row(np.flatnonzero(on_ground & sky)) for sky in (~is_cloudy, is_cloudy))
        if np.any(is_cloudy):
            radiance[cloudy] = _cloud_radiance(self.clouds[band], view.take(cloudy), top_m[cloudy])
        radiance[clear] = _sky_radiance(self.skies[band], view.take(clear))
        return radiance

    def radiance_and_clutter_w_m2_sr(self, band: int, view: Views) -> tuple[FloatArray, FloatArray]:
        """Return radiances (n,) and the standard deviations (n,) of what subtraction leaves of them."""
        radiance = self.radiance_w_m2_sr(band, view)
        return radiance, self.residual * radiance

    def clutter_w_m2_sr(self, band: int, view: Views) -> FloatArray:
        """Return the standard deviations (n,) of the radiance left after subtraction: a fixed share of the radiance."""
        return self.residual * self.radiance_w_m2_sr(band, view)


def earth_background(config: EarthConfig, context: BackgroundContext) -> Background:
    """Return the background of a climate and sky; `ModelError` names a band that the table cannot answer for."""
    skies, clouds = sky_tables(config.climate, config.sky), cloud_tables(config.cloud_albedo)
    parts = [_parts(band, config.bands, [table.band for table in skies], context.path) for band in context.bands]
    return EarthBackground(
        skies=tuple(tuple((factor, skies[number]) for factor, number in own) for own in parts),
        clouds=tuple(tuple((factor, _of_band(clouds, skies[number].band)) for factor, number in own) for own in parts),
        residual=config.clutter_residual,
        atmosphere=context.make_atmosphere(),
    )


def _of_band(tables: Sequence[CloudTable], band: Band) -> CloudTable:
    return next(table for table in tables if table.band == band)


def _parts(band: Band, stand_ins: Mapping[str, str], known: Sequence[Band], path: str) -> list[tuple[float, int]]:
    """Return the table's bands that a band is made of, each with its factor: a stand-in counts by width."""
    chosen = parts_of(band, stand_ins, known)
    if not chosen:
        names = ", ".join(f"{one.name} {one.lower_um:g}-{one.upper_um:g}" for one in known)
        raise ModelError(
            f"{path}: the band {band.name}, {band.lower_um:g} to {band.upper_um:g} um, is not one of the table's"
            f" ({names}), nor made of them side by side; say in bands which of them stands for it,"
            f" {{{band.name}: {known[0].name}}}"
        )
    width = sum(one.upper_um - one.lower_um for one in chosen)
    factor = (band.upper_um - band.lower_um) / width if band.name in stand_ins else 1.0
    return [(factor, known.index(one)) for one in chosen]


def _sky_radiance(parts: Sequence[tuple[float, SkyTable]], view: Views) -> FloatArray:
    total = np.zeros(len(view))
    for factor, table in parts:
        night = np.interp(view.elevation_sine, table.night_sine, table.night)
        added = _between(table.day_sine, table.sun_sine, table.day, view.elevation_sine, view.sun_elevation_sine)
        total += factor * (night + added)
    return np.maximum(total, 0.0)


def _cloud_radiance(parts: Sequence[tuple[float, CloudTable]], view: Views, top_m: FloatArray) -> FloatArray:
    total = np.zeros(len(view))
    for factor, table in parts:
        night = np.interp(top_m, table.top_m, table.night)
        added = _between(table.top_m, table.sun_sine, table.day, top_m, view.sun_elevation_sine)
        total += factor * (night + added)
    return np.maximum(total, 0.0)


def _between(x: FloatArray, y: FloatArray, table: FloatArray, at_x: FloatArray, at_y: FloatArray) -> FloatArray:
    """Return a table (x, y) straight between its points, constant beyond its ends."""
    (row, across), (column, up) = _place(x, at_x), _place(y, at_y)
    lower = table[row, column] * (1.0 - up) + table[row, column + 1] * up
    upper = table[row + 1, column] * (1.0 - up) + table[row + 1, column + 1] * up
    mixed: FloatArray = lower * (1.0 - across) + upper * across
    return mixed


def _place(points: FloatArray, at: FloatArray) -> tuple[IntArray, FloatArray]:
    row = np.clip(np.searchsorted(points, at, side="right") - 1, 0, len(points) - 2)
    return row, np.clip((at - points[row]) / (points[row + 1] - points[row]), 0.0, 1.0)
