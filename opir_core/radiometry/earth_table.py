"""The shipped LOWTRAN7 table of the Earth's radiance, by band: night, what the Sun adds, and opaque cloud."""

import csv
import math
from collections.abc import Iterator, Mapping
from functools import cache
from pathlib import Path

import numpy as np
from attrs import frozen

from opir_core.arrays import FloatArray
from opir_core.protocols import Band

_TABLE = Path(__file__).parents[1] / "data" / "lowtran7_background_radiance.csv"
_OPAQUE = "ANALYTIC_opaque_cloud_top"

#: Sine of the sensor's elevation at the ground for the table's look angles (incidence 78.8 and 61.6 degrees, nadir).
LOOK_SINES: Mapping[float, float] = {
    105.0: math.cos(math.radians(78.8)),
    120.0: math.cos(math.radians(61.6)),
    180.0: 1.0,
}

_Row = Mapping[str, str]


@frozen(eq=False)
class SkyTable:
    """Radiances of one band under one sky, W m⁻² sr⁻¹.

    `night` (looks,) at `night_sine`; `day` (looks, suns) what the Sun adds to it, at `day_sine` and `sun_sine`, of
    which the first is 0 with nothing added.
    """

    band: Band
    night_sine: FloatArray
    night: FloatArray
    day_sine: FloatArray
    sun_sine: FloatArray
    day: FloatArray


@frozen(eq=False)
class CloudTable:
    """Radiances of opaque cloud in one band by height of its top: (tops,) by night, (tops, suns) what the Sun adds."""

    band: Band
    top_m: FloatArray
    sun_sine: FloatArray
    night: FloatArray
    day: FloatArray


@cache
def table_rows() -> tuple[_Row, ...]:
    """Return the table's rows as its file has them."""
    lines = _TABLE.read_text(encoding="utf-8").splitlines()
    return tuple(csv.DictReader(line for line in lines if not line.startswith("#")))


def sky_tables(climate: str, sky: str) -> list[SkyTable]:
    """Return the tables of a climate and sky, one a band."""
    rows = [row for row in table_rows() if row["atmosphere"] == climate and row["sky"] == sky]
    return [_sky_table(band, [row for row in rows if row["band"] == band.name]) for band in _bands(rows)]


def cloud_tables(albedo: float) -> list[CloudTable]:
    """Return the tables of opaque cloud of an albedo, one a band.

    The table has albedos 0.1 and 0.3 of a formula that is straight in it, so any other is on the line through the two.
    """
    rows = [row for row in table_rows() if row["sky"].startswith(_OPAQUE)]
    return [_cloud_table(band, [row for row in rows if row["band"] == band.name], albedo) for band in _bands(rows)]


def _bands(rows: list[_Row]) -> Iterator[Band]:
    yield from dict.fromkeys(Band(row["band"], float(row["lo_um"]), float(row["hi_um"])) for row in rows)


def _sky_table(band: Band, rows: list[_Row]) -> SkyTable:
    night = {float(row["look_deg"]): _radiance(row) for row in rows if row["day_night"] == "night"}
    by_sun = {(float(row["look_deg"]), _sun_sine(row)): _radiance(row) for row in rows if row["day_night"] == "day"}
    looks, suns = sorted({look for look, _ in by_sun}), sorted({sun for _, sun in by_sun})
    added = [[0.0, *(by_sun[look, sun] - night[look] for sun in suns)] for look in looks]
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
    found = {place: pair[0.1] + share * (pair[0.3] - pair[0.1]) for place, pair in by_albedo.items()}
    tops = sorted({top for top, _ in found})
    suns = sorted({sun for _, sun in found if sun > 0.0})
    added = [[0.0, *(found[top, sun] - found[top, -1.0] for sun in suns)] for top in tops]
    night = np.array([found[top, -1.0] for top in tops])
    return CloudTable(band, np.array(tops), np.array([0.0, *suns]), night, np.array(added))


def _top_m(row: _Row) -> float:
    return float(row["sky"].removeprefix(_OPAQUE).removesuffix("km")) * 1e3


def _sun_sine(row: _Row) -> float:
    return math.cos(math.radians(float(row["sza_deg"])))


def _radiance(row: _Row) -> float:
    return float(row["L_W_m2_sr"])
