"""The atmosphere against LOWTRAN7's own values: at every point of the table, and at points left out of it.

Leaving a height out makes the gap there two to three times as wide as any that is interpolated over. The error of a
smooth curve grows at least with the square of its gap, so what is found is scaled by the square of how much wider the
gap has become.
"""

import csv
from pathlib import Path

import numpy as np
import pytest
from attrs import evolve

import opir_core
from opir_core.protocols import Band
from opir_core.radiometry.lowtran import LowtranAtmosphere, lowtran_atmosphere
from opir_core.radiometry.lowtran_table import fine_grid, node_tables
from opir_core.radiometry.protocols import AtmosphereContext
from opir_core.radiometry.records import Paths
from opir_core.radiometry.sky_configs import CLIMATES, LowtranConfig

TABLE = Path(opir_core.__file__).parent / "data" / "lowtran7_band_transmittance.csv"
WEIGHTINGS = {"flat": "tau_flat", "blackbody-1500K": "tau_bb1500"}


def table_rows():
    lines = TABLE.read_text(encoding="utf-8").splitlines()
    return list(csv.DictReader(line for line in lines if not line.startswith("#")))


ROWS = table_rows()
SKIES = sorted({(row["atmosphere"], row["aerosol"]) for row in ROWS})


def paths(height_m, zenith_rad):
    height = np.asarray(height_m, dtype=np.float64)
    nowhere = np.zeros((len(height), 3))
    return Paths(height, np.cos(zenith_rad), nowhere, nowhere, np.zeros(len(height)))


def test_all_climates_are_in_the_table():
    assert {climate for climate, _ in SKIES} == set(CLIMATES)
    assert TABLE.stat().st_size + (TABLE.parent / "lowtran7_background_radiance.csv").stat().st_size < 1_000_000


@pytest.mark.parametrize(("climate", "aerosol"), SKIES)
@pytest.mark.parametrize("weighting", WEIGHTINGS)
def test_every_point_of_the_table_is_met(climate, aerosol, weighting):
    rows = [row for row in ROWS if (row["atmosphere"], row["aerosol"]) == (climate, aerosol)]
    bands = sorted({(row["band"], float(row["lo_um"]), float(row["hi_um"])) for row in rows})
    context = AtmosphereContext(bands=tuple(Band(*band) for band in bands), path="atmosphere", seed=0)
    model = lowtran_atmosphere(LowtranConfig(climate=climate, aerosol=aerosol, weighting=weighting), context)
    for number, (name, _, _) in enumerate(bands):
        own = [row for row in rows if row["band"] == name]
        heights = np.array([float(row["h_km"]) for row in own]) * 1e3
        zenith = np.radians([float(row["zen_deg"]) for row in own])
        theirs = np.array([float(row[WEIGHTINGS[weighting]]) for row in own])
        assert np.abs(model.transmittance(number, paths(heights, zenith)) - theirs).max() < 5e-4


def left_out_errors(nodes, axis):
    """Yield, for each inner height or angle, how far the curve without it is from it, and how much wider its gap is."""
    points = nodes.height_m if axis == 0 else -np.log(np.cos(nodes.zenith_rad))
    for place in range(1, len(points) - 1):
        fewer = {
            "transmittance": np.delete(nodes.transmittance, place, axis=axis),
            ("height_m", "zenith_rad")[axis]: np.delete((nodes.height_m, nodes.zenith_rad)[axis], place),
        }
        model = LowtranAtmosphere((fine_grid(evolve(nodes, **fewer)),), None)
        zenith = nodes.zenith_rad if axis == 0 else np.full(len(nodes.height_m), nodes.zenith_rad[place])
        height = np.full(len(nodes.zenith_rad), nodes.height_m[place]) if axis == 0 else nodes.height_m
        truth = np.take(nodes.transmittance, place, axis=axis)
        error = float(np.abs(model.transmittance(0, paths(height, zenith)) - truth).max())
        gaps = np.diff(points)[place - 1 : place + 1]
        yield error, float(gaps.sum() / gaps.max())


#: Four of the 84 tables, with the worst of all: LOWTRAN's humid summer near the tropopause in SWIR.
HARDEST = [
    ("midlat_summer", "rural23km", "SWIR"),
    ("tropical", "rural23km", "LWIR"),
    ("midlat_winter", "rural23km", "SWIR"),
    ("subarctic_winter", "rural23km", "MWIR_N"),
]


@pytest.mark.parametrize(("climate", "aerosol", "band"), HARDEST)
def test_between_its_points_the_table_is_met_to_3_percent(climate, aerosol, band):
    nodes = node_tables(climate, aerosol, "flat")[band]
    by_height, by_angle = (list(left_out_errors(nodes, axis)) for axis in (0, 1))
    assert max(error / wider**2 for error, wider in by_height) < 0.03
    assert max(error for error, _ in by_height) < 0.06
    assert max(error for error, _ in by_angle) < 0.005
